//! `halflight reproduce`: experiments of the papers, done again.

mod profiles;

use super::{CliError, Common};
use crate::nearfield::two_sets::{Division, Experiment, Off, Strengths, run as experiment};
use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

const AFTER_HELP: &str = "\
gib03-fig3: 50 sources light a point; some are hidden, and their light is taken away from the displayed value in two sets
(Section 7.1 of [Gib03]). How far is that from the displayed value of the light that is left? Writes gib03-fig3.csv
(curve, hidden sources, mean, standard deviation and rms of the error in values of 255) and gib03-fig3.svg.

gib03-f3: what an object in a known room takes away along three rows of the picture, by 10 and by 50 lights, beside ray
tracing: all cases f3_* of the reference folder. Writes gib03-f3.csv and gib03-f3.svg.

Examples: halflight reproduce gib03-fig3 --out out
          halflight reproduce gib03-f3 --reference reference --out out";

/// Arguments of `halflight reproduce`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
pub struct Arguments {
    /// Which experiment.
    #[arg(value_enum)]
    pub what: What,
    /// Folder for the table and the plot.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
    /// Folder of the reference cases, for gib03-f3.
    #[arg(long, value_name = "DIR")]
    pub reference: Option<PathBuf>,
}

/// The experiments.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Figure 3 of [Gib03]: the error of subtracting displayed values.
    #[value(name = "gib03-fig3")]
    Gib03Fig3,
    /// Umbra and penumbra of the method in a known room, beside ray tracing.
    #[value(name = "gib03-f3")]
    Gib03F3,
}

/// A curve: its name, its colour, what is displayed of an amount of light, strengths and sets.
type Curve = (&'static str, &'static str, fn(f64) -> f64, Strengths, Division);

const CURVES: [Curve; 5] = [
    ("gamma 2.2, two sets", "#1f77b4", gamma, Strengths::Uniform, Division::Chance(50)),
    ("gamma 2.2, a quarter and the rest", "#2ca02c", gamma, Strengths::Uniform, Division::Chance(25)),
    ("gamma 2.2, two sets, few strong sources", "#9467bd", gamma, Strengths::Pareto, Division::Chance(50)),
    ("gamma 2.2, one set", "#d62728", gamma, Strengths::Uniform, Division::Chance(0)),
    ("linear display, two sets", "#7f7f7f", linear, Strengths::Uniform, Division::Chance(50)),
];

fn gamma(light: f64) -> f64 {
    255.0 * light.clamp(0.0, 1.0).powf(1.0 / 2.2)
}

fn linear(light: f64) -> f64 {
    255.0 * light
}

/// Runs `halflight reproduce`.
pub fn run(arguments: Arguments, common: &Common) -> Result<(), CliError> {
    match arguments.what {
        What::Gib03Fig3 => displayed_values(&arguments, common),
        What::Gib03F3 => room_profiles(&arguments, common),
    }
}

fn write(out: &Path, files: &[(&str, String)]) -> Result<(), CliError> {
    std::fs::create_dir_all(out).map_err(|e| CliError::on(out.display(), e))?;
    for (name, text) in files {
        let file = out.join(name);
        std::fs::write(&file, text).map_err(|e| CliError::on(file.display(), e))?;
    }
    Ok(())
}

fn room_profiles(arguments: &Arguments, common: &Common) -> Result<(), CliError> {
    let Some(reference) = &arguments.reference else {
        return Err(CliError::on("gib03-f3", "--reference DIR is missing: the folder with the cases f3_*"));
    };
    let on = |e| CliError::on(reference.display(), e);
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(reference).map_err(on)? {
        let entry = entry.map_err(on)?;
        if entry.file_name().to_string_lossy().starts_with("f3_") {
            folders.push(entry.path());
        }
    }
    folders.sort();
    if folders.is_empty() {
        return Err(CliError::on(reference.display(), "no case in it: a folder f3_* with a case.json"));
    }
    let mut profiles = Vec::new();
    for folder in &folders {
        profiles.extend(profiles::of_case(folder)?);
    }
    let files = [("gib03-f3.csv", profiles::table(&profiles)), ("gib03-f3.svg", profiles::plot(&profiles))];
    write(&arguments.out, &files)?;
    if common.json {
        let of = |p: &profiles::Profile| {
            let off = p.off();
            serde_json::json!({"case": p.case, "object": p.object, "row": p.row, "rms_over_largest": {"10": off[0], "50": off[1]}})
        };
        let report: Vec<_> = profiles.iter().map(of).collect();
        println!("{}", serde_json::json!({ "profiles": report, "out": arguments.out }));
        return Ok(());
    }
    println!("RMS off the reference along a row, over the largest there, by 10 and by 50 lights:");
    for p in &profiles {
        let [few, many] = p.off();
        println!("  {:<24} {:<7} row {:3}: {few:.3} {many:.3}", p.case, p.object, p.row);
    }
    for (name, _) in &files {
        println!("wrote {}", arguments.out.join(name).display());
    }
    Ok(())
}

fn displayed_values(arguments: &Arguments, common: &Common) -> Result<(), CliError> {
    let hidden: Vec<usize> = (0..=50).collect();
    let curves: Vec<(&Curve, Vec<Off>)> = CURVES
        .iter()
        .map(|curve| {
            let &(_, _, tone, strengths, division) = curve;
            let about = Experiment { sources: 50, strengths, division, datasets: 8, trials: 1000, seed: 1 };
            (curve, experiment(&about, &hidden, &tone))
        })
        .collect();
    let mut csv = String::from("curve,hidden,mean,std,rms\n");
    for ((name, ..), offs) in &curves {
        for off in offs {
            let _ = writeln!(csv, "\"{name}\",{},{:.4},{:.4},{:.4}", off.hidden, off.mean, off.std, off.rms);
        }
    }
    let files = [("gib03-fig3.csv", csv), ("gib03-fig3.svg", plot(&curves))];
    write(&arguments.out, &files)?;
    if common.json {
        let of = |off: &Off| serde_json::json!({"hidden": off.hidden, "mean_dn": off.mean, "std_dn": off.std, "rms_dn": off.rms});
        let report: Vec<_> = curves
            .iter()
            .map(|((name, ..), offs)| serde_json::json!({"curve": name, "points": offs.iter().map(of).collect::<Vec<_>>()}))
            .collect();
        println!("{}", serde_json::json!({ "curves": report, "out": arguments.out }));
        return Ok(());
    }
    println!(
        "mean error (and standard deviation), in values of 255, where so many of 50 sources are hidden:"
    );
    for ((name, ..), offs) in &curves {
        print!("  {name:<40}");
        for k in [10, 20, 25, 30, 40, 50] {
            print!(" {k}: {:.1} ({:.1})", offs[k].mean, offs[k].std);
        }
        println!();
    }
    for (name, _) in &files {
        println!("wrote {}", arguments.out.join(name).display());
    }
    Ok(())
}

/// Lines of the means, bands of one standard deviation.
fn plot(curves: &[(&Curve, Vec<Off>)]) -> String {
    const SIZE: [f64; 2] = [720.0, 440.0];
    const LOW: f64 = -80.0;
    const HIGH: f64 = 120.0;
    let x = |hidden: f64| 60.0 + hidden / 50.0 * (SIZE[0] - 80.0);
    let y = |off: f64| 20.0 + (HIGH - off.clamp(LOW, HIGH)) / (HIGH - LOW) * (SIZE[1] - 70.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        SIZE[0], SIZE[1]
    );
    for k in 0..=10 {
        let off = LOW + 20.0 * f64::from(k);
        let _ = writeln!(
            svg,
            "<path d=\"M{:.1} {1:.1}H{2:.1}\" stroke=\"{3}\"/><text x=\"52\" y=\"{4:.1}\" text-anchor=\"end\">{off}</text>",
            x(0.0),
            y(off),
            x(50.0),
            if off == 0.0 { "#888" } else { "#ddd" },
            y(off) + 4.0
        );
    }
    for k in 0..=5 {
        let hidden = 10.0 * f64::from(k);
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{hidden}</text>",
            x(hidden),
            SIZE[1] - 32.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">hidden sources of 50</text>",
        x(25.0),
        SIZE[1] - 12.0
    );
    let _ = writeln!(
        svg,
        "<text transform=\"translate(16 {:.1}) rotate(-90)\" text-anchor=\"middle\">error, values of 255</text>",
        y(20.0)
    );
    for (index, ((name, colour, ..), offs)) in curves.iter().enumerate() {
        let point =
            |off: &Off, by: f64| format!("{:.1} {:.1}", x(off.hidden as f64), y(off.mean + by * off.std));
        let upper: Vec<String> = offs.iter().map(|off| point(off, 1.0)).collect();
        let lower: Vec<String> = offs.iter().rev().map(|off| point(off, -1.0)).collect();
        let middle: Vec<String> = offs.iter().map(|off| point(off, 0.0)).collect();
        let _ = writeln!(
            svg,
            "<path d=\"M{}L{}Z\" fill=\"{colour}\" opacity=\"0.15\"/>",
            upper.join("L"),
            lower.join("L")
        );
        let _ = writeln!(
            svg,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            middle.join("L")
        );
        let row = 36.0 + 18.0 * index as f64;
        let _ = writeln!(
            svg,
            "<path d=\"M74 {row}h24\" stroke=\"{colour}\" stroke-width=\"2\"/><text x=\"104\" y=\"{:.1}\">{name}</text>",
            row + 4.0
        );
    }
    svg.push_str("</svg>\n");
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_holds_every_curve_and_no_broken_number() {
        let off = |hidden| Off { hidden, mean: -1e9, std: 2.0, rms: 3.0 };
        let curves: Vec<_> = CURVES.iter().map(|curve| (curve, vec![off(0), off(50)])).collect();
        let svg = plot(&curves);
        assert!(CURVES.iter().all(|(name, ..)| svg.contains(name)));
        assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.ends_with("</svg>\n"));
    }
}
