//! Figure 3 of [Gib03]: 50 sources light a point, some are hidden, and their light is taken from the displayed value in two
//! sets. How far is that from the displayed value of the light that is left?

use crate::nearfield::two_sets::{Division, Experiment, Off, Strengths, run};
use crate::page::svg::{Anchor, Scale, Svg};
use std::fmt::Write;

/// Sources that light the point.
pub const SOURCES: usize = 50;

/// One way of displaying and dividing.
struct Way {
    name: &'static str,
    colour: &'static str,
    /// What is displayed of an amount of light.
    tone: fn(f64) -> f64,
    strengths: Strengths,
    division: Division,
}

const fn way(
    name: &'static str,
    colour: &'static str,
    tone: fn(f64) -> f64,
    strengths: Strengths,
    division: Division,
) -> Way {
    Way { name, colour, tone, strengths, division }
}

const WAYS: [Way; 5] = [
    way("gamma 2.2, two sets", "#1f77b4", gamma, Strengths::Uniform, Division::Chance(50)),
    way("gamma 2.2, a quarter and the rest", "#2ca02c", gamma, Strengths::Uniform, Division::Chance(25)),
    way("gamma 2.2, two sets, few strong sources", "#9467bd", gamma, Strengths::Pareto, Division::Chance(50)),
    way("gamma 2.2, one set", "#d62728", gamma, Strengths::Uniform, Division::Chance(0)),
    way("linear display, two sets", "#7f7f7f", linear, Strengths::Uniform, Division::Chance(50)),
];

fn gamma(light: f64) -> f64 {
    255.0 * light.clamp(0.0, 1.0).powf(1.0 / 2.2)
}

fn linear(light: f64) -> f64 {
    255.0 * light
}

/// The errors of one way, by the number of hidden sources, 0 to [`SOURCES`].
pub struct ErrorCurve {
    /// The way, for people.
    pub name: &'static str,
    /// Values of 255.
    pub offs: Vec<Off>,
    colour: &'static str,
}

/// Runs the experiment for every way.
pub fn error_curves() -> Vec<ErrorCurve> {
    let hidden: Vec<usize> = (0..=SOURCES).collect();
    let of = |way: &Way| {
        let (strengths, division) = (way.strengths, way.division);
        let about = Experiment { sources: SOURCES, strengths, division, datasets: 8, trials: 1000, seed: 1 };
        ErrorCurve { name: way.name, offs: run(&about, &hidden, &way.tone), colour: way.colour }
    };
    WAYS.iter().map(of).collect()
}

/// All errors as a table.
pub fn table(curves: &[ErrorCurve]) -> String {
    let mut csv = String::from("curve,hidden,mean,std,rms\n");
    for curve in curves {
        for off in &curve.offs {
            let Off { hidden, mean, std, rms } = off;
            let _ = writeln!(csv, "\"{}\",{hidden},{mean:.4},{std:.4},{rms:.4}", curve.name);
        }
    }
    csv
}

/// Lines of the means, bands of one standard deviation.
pub fn plot(curves: &[ErrorCurve]) -> String {
    const SIZE: [f64; 2] = [720.0, 440.0];
    let x = Scale::linear([0.0, SOURCES as f64], [60.0, SIZE[0] - 20.0]);
    let y = Scale::linear([-80.0, 120.0], [SIZE[1] - 50.0, 20.0]);
    let mut svg = Svg::new(SIZE, 12);
    for k in 0..=10 {
        let off = y.values[0] + 20.0 * f64::from(k);
        let style = if off == 0.0 { "stroke=\"#888\"" } else { "stroke=\"#ddd\"" };
        svg.line([x.pixels[0], y.at(off)], [x.pixels[1], y.at(off)], style);
        svg.text([52.0, y.at(off) + 4.0], Anchor::End, &off.to_string());
    }
    for k in 0..=5 {
        let hidden = 10.0 * f64::from(k);
        svg.text([x.at(hidden), SIZE[1] - 32.0], Anchor::Middle, &hidden.to_string());
    }
    svg.text([x.at(25.0), SIZE[1] - 12.0], Anchor::Middle, "hidden sources of 50");
    svg.upright_text([16.0, y.at(20.0)], "error, values of 255");
    for (k, curve) in curves.iter().enumerate() {
        let line = |by: f64| -> Vec<[f64; 2]> {
            curve.offs.iter().map(|off| [x.at(off.hidden as f64), y.at(off.mean + by * off.std)]).collect()
        };
        svg.band(&line(1.0), &line(-1.0), curve.colour);
        svg.curve(line(0.0).into_iter().map(Some), curve.colour, 2.0);
        svg.key([74.0, 36.0 + 18.0 * k as f64], curve.colour, "", curve.name);
    }
    svg.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plot_holds_every_curve_and_no_broken_number() {
        let off = |hidden| Off { hidden, mean: -1e9, std: 2.0, rms: 3.0 };
        let curve =
            |way: &Way| ErrorCurve { name: way.name, offs: vec![off(0), off(50)], colour: way.colour };
        let curves: Vec<_> = WAYS.iter().map(curve).collect();
        let svg = plot(&curves);
        assert!(WAYS.iter().all(|way| svg.contains(way.name)));
        assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.ends_with("</svg>\n"));
        assert_eq!(
            table(&curves).lines().nth(2),
            Some("\"gamma 2.2, two sets\",50,-1000000000.0000,2.0000,3.0000")
        );
    }
}
