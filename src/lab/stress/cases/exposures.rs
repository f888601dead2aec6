//! Brackets that say little, or something false.

use crate::engine::{Bracket, Engine, EngineError};
use crate::hdr::response::{SolveOptions, solve};
use crate::model::{
    frame::Exposure,
    image::{HdrImage, Image, Rgb8Image},
    response::Response,
};
use crate::plan::Pass;
use crate::stress::{CaseBound, HardCase, Where, naive};

const MERGE: Where = Where::Kernel(Pass::MergeBracket);

/// Greenest pixel of a merged bracket of even pictures, through the sRGB response; where the bracket is refused, 0.
fn merged(engine: &mut dyn Engine, values: &[u8], times_s: &[f64]) -> Result<f64, EngineError> {
    let pictures: Vec<Rgb8Image> = values.iter().map(|z| Image::filled(5, 3, [*z; 3])).collect();
    let pictures: Vec<_> = pictures.iter().collect();
    let exposures: Vec<_> = times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect();
    let mut out = HdrImage::default();
    let bracket = Bracket { pictures: &pictures, exposures: &exposures };
    match engine.merge_bracket(&bracket, &Response::srgb(), &mut out) {
        Err(EngineError::Input(_)) => Ok(0.0),
        Err(error) => Err(error),
        Ok(()) => {
            let numbers = out.radiance.pixels().as_flattened();
            Ok(numbers
                .iter()
                .map(|c| f64::from(*c))
                .fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a }))
        }
    }
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "saturated in every picture",
        measures: "radiance times the shortest exposure (1 is white)",
        formula: "sum w(z) (g(z) - ln t) / sum w(z): no weight at all",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[255, 255, 255], &[0.1, 0.025, 0.004]) * 0.004),
        ours: |engine| Ok(merged(engine, &[255, 255, 255], &[0.1, 0.025, 0.004])? * 0.004),
        // A lower bound: white in the shortest. The logarithm is rounded.
        bound: CaseBound::about(1.0, 1e-6),
    },
    HardCase {
        name: "black in every picture",
        measures: "radiance times the longest exposure (1 is white)",
        formula: "sum w(z) (g(z) - ln t) / sum w(z): no weight at all",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[0, 0, 0], &[0.1, 0.025, 0.004]) * 0.1),
        ours: |engine| Ok(merged(engine, &[0, 0, 0], &[0.1, 0.025, 0.004])? * 0.1),
        // An upper bound: what rounds to value 0, a quarter of a step of 1/255/12.92.
        bound: CaseBound::new(0.0, 3.1e-4),
    },
    HardCase {
        name: "black in one, saturated in the other",
        measures: "radiance, between 10 (white in 0.1 s) and 0.0076 (black in 0.01 s)",
        formula: "sum w(z) (g(z) - ln t) / sum w(z): no weight at all",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[255, 0], &[0.1, 0.01])),
        ours: |engine| merged(engine, &[255, 0], &[0.1, 0.01]),
        bound: CaseBound::new(0.0075, 10.0),
    },
    HardCase {
        name: "one picture, a black pixel",
        measures: "radiance times the exposure (1 is white)",
        formula: "w(z) (ln z - ln t) / w(z) = 0 (-inf) / 0",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[0], &[0.1]) * 0.1),
        ours: |engine| Ok(merged(engine, &[0], &[0.1])? * 0.1),
        bound: CaseBound::new(0.0, 3.1e-4),
    },
    HardCase {
        name: "equal exposures",
        measures: "largest departure of the response from the curve that stands in, ln units",
        formula: "slope (g(z1) - g(z2)) / (ln t1 - ln t2) = 0/0",
        runs: Where::Processor,
        textbook: || f64::from(naive::response_slope([90, 90], [0.01, 0.01])),
        ours: |_| {
            let ramp = |k: usize| [(k % 256) as u8; 3];
            let picture =
                Rgb8Image::from_pixels(64, 64, (0..64 * 64).map(ramp).collect()).unwrap_or_default();
            let exposure = Exposure { time_s: 0.01, gain: 1.0 };
            let found = solve(&[&picture, &picture], &[exposure; 2], &SolveOptions::default());
            let stands_in = Response::srgb();
            let found = found.response.log_exposure().as_flattened();
            let pairs = found.iter().zip(stands_in.log_exposure().as_flattened());
            Ok(pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max))
        },
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "an exposure time of zero",
        measures: "radiance; 0 where the bracket is refused",
        formula: "ln t = -inf",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[100, 120], &[0.01, 0.0])),
        ours: |engine| merged(engine, &[100, 120], &[0.01, 0.0]),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "an exposure time that is not a number",
        measures: "radiance; 0 where the bracket is refused",
        formula: "ln t = NaN in every pixel",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[100, 120], &[0.01, f32::NAN])),
        ours: |engine| merged(engine, &[100, 120], &[0.01, f64::NAN]),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "an exposure of 1e-40 s",
        measures: "radiance; beyond what f32 holds it stops at e^88",
        formula: "exp(g - ln t) = exp(92)",
        runs: MERGE,
        textbook: || f64::from(naive::merged(&[128, 128], &[1e-40, 1e-40])),
        ours: |engine| merged(engine, &[128, 128], &[1e-40, 1e-40]),
        bound: CaseBound::new(1e38, f32::MAX as f64),
    },
];
