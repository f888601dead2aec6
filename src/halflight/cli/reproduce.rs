//! `halflight reproduce`: experiments of the papers, done again.

use super::output::{shown, write_file};
use super::progress::Bar;
use super::{CliError, GlobalOptions, run_folder};
use crate::lab::papers::{displayed_values, profiles};
use crate::nearfield::two_sets::Off;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

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
pub struct ReproduceArguments {
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

/// Runs `halflight reproduce`.
///
/// # Errors
/// A mistake in the arguments; a reference case that cannot be read; a file that cannot be written.
pub fn run(arguments: ReproduceArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if arguments.what == What::Gib03F3 && arguments.reference.is_none() {
        return Err(CliError::on("gib03-f3", "--reference DIR is missing: the folder with the cases f3_*"));
    }
    run_folder::check(&arguments.out, &["gib03-*.csv", "gib03-*.svg"])?;
    let done = match arguments.what {
        What::Gib03Fig3 => displayed_values(),
        What::Gib03F3 => room_profiles(&arguments)?,
    };
    run_folder::begin(&arguments.out, "reproduce", &["gib03-*.csv", "gib03-*.svg"])?;
    for (name, text) in &done.files {
        write_file(&arguments.out.join(name), text)?;
    }
    if global.json {
        let mut report = done.json;
        report["format"] = json!(super::JSON_FORMAT);
        report["out"] = json!(shown(&arguments.out));
        println!("{report}");
        return Ok(());
    }
    print!("{}", done.table);
    for (name, _) in &done.files {
        println!("wrote {}", arguments.out.join(name).display());
    }
    Ok(())
}

/// What an experiment gave.
struct Done {
    files: [(&'static str, String); 2],
    json: Value,
    table: String,
}

fn room_profiles(arguments: &ReproduceArguments) -> Result<Done, CliError> {
    let Some(reference) = &arguments.reference else {
        return Err(CliError::on("gib03-f3", "--reference DIR is missing: the folder with the cases f3_*"));
    };
    let mut found = Vec::new();
    let folders = f3_folders(reference)?;
    let bar = Bar::of_count(Some(folders.len() as u64), "cases");
    for folder in folders {
        found.extend(profiles::of_case(&folder)?);
        bar.add_one();
    }
    drop(bar);
    let of = |p: &profiles::ShadowProfile| {
        let off = p.off();
        json!({"case": p.case, "object": p.object, "row": p.row, "rms_over_largest": {"10": off[0], "50": off[1]}})
    };
    let mut table =
        String::from("RMS off the reference along a row, over the largest there, by 10 and by 50 lights:\n");
    for p in &found {
        let [few, many] = p.off();
        table += &format!("  {:<24} {:<7} row {:3}: {few:.3} {many:.3}\n", p.case, p.object, p.row);
    }
    Ok(Done {
        files: [("gib03-f3.csv", profiles::table(&found)), ("gib03-f3.svg", profiles::plot(&found))],
        json: json!({ "profiles": found.iter().map(of).collect::<Vec<_>>() }),
        table,
    })
}

/// The folders of F3 below the reference's, sorted.
fn f3_folders(reference: &Path) -> Result<Vec<PathBuf>, CliError> {
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
    Ok(folders)
}

fn displayed_values() -> Done {
    let curves = displayed_values::error_curves();
    let of =
        |off: &Off| json!({"hidden": off.hidden, "mean_dn": off.mean, "std_dn": off.std, "rms_dn": off.rms});
    let report: Vec<_> = curves
        .iter()
        .map(|curve| json!({"curve": curve.name, "points": curve.offs.iter().map(of).collect::<Vec<_>>()}))
        .collect();
    let mut table = String::from(
        "mean error (and standard deviation), in values of 255, where so many of 50 sources are hidden:\n",
    );
    for curve in &curves {
        table += &format!("  {:<40}", curve.name);
        for k in [10, 20, 25, 30, 40, 50] {
            table += &format!(" {k}: {:.1} ({:.1})", curve.offs[k].mean, curve.offs[k].std);
        }
        table += "\n";
    }
    Done {
        files: [
            ("gib03-fig3.csv", displayed_values::table(&curves)),
            ("gib03-fig3.svg", displayed_values::plot(&curves)),
        ],
        json: json!({ "curves": report }),
        table,
    }
}
