//! Error and time of points, interleaved: every round draws each point once, so that what else the machine does falls on
//! all alike.

use super::{
    axes::Point,
    errors::{Errors, errors, shown},
    subject::{Shot, Subject},
};
use crate::cli::CliError;
use crate::config::Settings;
use crate::engine::Engine;
use crate::model::image::Rgb8Image;
use std::collections::BTreeMap;

/// Points that are kept in memory together.
const TOGETHER: usize = 24;

/// One point on one subject.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The settings.
    pub point: Point,
    /// How far the picture is from the truth.
    pub errors: Errors,
    /// Median over the rounds of the time that drawing the picture takes, milliseconds.
    pub ms: f64,
    /// Lower and upper quartile of the same.
    pub quartiles_ms: [f64; 2],
    /// Median of each pass, and of each stage before it, milliseconds, in the order of the frame.
    pub stages_ms: Vec<(String, f64)>,
    /// The picture, and FLIP for each of its pixels.
    pub pictures: [Rgb8Image; 2],
}

/// Measures points on a subject; `done` is told of each draw.
pub fn measure(
    subject: &Subject,
    points: &[Point],
    base: &Settings,
    rounds: usize,
    engine: &mut dyn Engine,
    done: &dyn Fn(),
) -> Result<Vec<Measured>, CliError> {
    let mut out = Vec::with_capacity(points.len());
    for some in points.chunks(TOGETHER) {
        let shots = subject.shots(some, base, engine)?;
        let (some, shots): (Vec<Point>, Vec<Shot>) = shots.into_iter().unzip();
        let mut times: Vec<BTreeMap<usize, (String, Vec<f32>)>> = vec![BTreeMap::new(); some.len()];
        let mut totals: Vec<Vec<f32>> = vec![Vec::new(); some.len()];
        let mut pictures = Vec::new();
        for (point, shot) in some.iter().zip(&shots) {
            let mut settings = base.clone();
            point.put_over(&mut settings)?;
            // Warms up, and gives the picture.
            let drawn = shot.still.draw(engine, &settings.quality, None, 0)?;
            let exposure_s = shot.still.shown_exposure_s();
            let true_shown = shown(&subject.truth.radiance, &shot.still.response, exposure_s);
            let shown = (&drawn.display, &true_shown);
            let (errors, map) = errors(&drawn.radiance, &shot.still.background, &subject.truth, shown);
            pictures.push((errors, [drawn.display, map]));
            done();
        }
        for round in 0..rounds.max(1) {
            for k in 0..some.len() {
                // Another first one each round.
                let i = (k + round) % some.len();
                let mut settings = base.clone();
                some[i].put_over(&mut settings)?;
                let drawn = shots[i].still.draw(engine, &settings.quality, None, 1)?;
                let mut total = 0.0;
                let before = shots[i].before.iter().map(|(name, ms)| ((*name).to_owned(), *ms));
                let passes = drawn.timings.iter().map(|t| (t.pass.name().to_owned(), t.ms));
                for (slot, (name, ms)) in before.chain(passes).enumerate() {
                    times[i].entry(slot).or_insert_with(|| (name, Vec::new())).1.push(ms);
                    total += ms;
                }
                totals[i].push(total);
                done();
            }
        }
        let all = some.iter().zip(pictures).zip(times.into_iter().zip(totals));
        for ((point, (errors, pictures)), (mut times, mut totals)) in all {
            let stages_ms =
                times.values_mut().map(|(name, ms)| (std::mem::take(name), share(ms, 0.5))).collect();
            out.push(Measured {
                point: point.clone(),
                errors,
                ms: share(&mut totals, 0.5),
                quartiles_ms: [share(&mut totals, 0.25), share(&mut totals, 0.75)],
                stages_ms,
                pictures,
            });
        }
    }
    Ok(out)
}

/// The number below which so great a share of all lie.
fn share(all: &mut [f32], share: f64) -> f64 {
    all.sort_by(f32::total_cmp);
    let at = (share * (all.len().saturating_sub(1)) as f64).round() as usize;
    all.get(at).map_or(f64::NAN, |&x| f64::from(x))
}
