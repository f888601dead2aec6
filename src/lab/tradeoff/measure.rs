//! Error and time of points, interleaved: every round draws each point once, so that what else the machine does falls on
//! all alike.

use super::study::Bench;
use super::{
    axes::TriedPoint,
    errors::{PictureErrors, errors, shown},
    subject::{StudySubject, SubjectShot},
};
use crate::error::LabError;
use crate::model::{image::Rgb8Image, quality::Quality};
use std::collections::BTreeMap;

/// Points that are kept in memory together.
const TOGETHER: usize = 24;

/// One point on one subject.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The settings.
    pub point: TriedPoint,
    /// How far the picture is from the truth.
    pub errors: PictureErrors,
    /// Median over the rounds of the time that drawing the picture takes, milliseconds.
    pub ms: f64,
    /// Lower and upper quartile of the same.
    pub quartiles_ms: [f64; 2],
    /// Median of each pass, and of each stage before it, milliseconds, in the order of the frame.
    pub stages_ms: Vec<(String, f64)>,
    /// The picture, and FLIP for each of its pixels.
    pub pictures: [Rgb8Image; 2],
}

/// Measures points on a subject, each `rounds` times; after none there are errors, but no times.
///
/// # Errors
/// A point cannot be composed or drawn.
pub fn measure(
    subject: &StudySubject,
    points: &[TriedPoint],
    rounds: usize,
    bench: &mut Bench<'_>,
) -> Result<Vec<Measured>, LabError> {
    let mut out = Vec::with_capacity(points.len());
    for some in points.chunks(TOGETHER) {
        out.extend(measure_together(subject, some, rounds, bench)?);
    }
    Ok(out)
}

/// Takes errors and pictures anew, after the subject's truth was traced on. Times stay.
///
/// # Errors
/// A point cannot be composed or drawn.
pub fn judge_again(
    subject: &StudySubject,
    measured: &mut [Measured],
    bench: &mut Bench<'_>,
) -> Result<(), LabError> {
    bench.watch.expect(measured.len());
    for some in measured.chunks_mut(TOGETHER) {
        let points: Vec<TriedPoint> = some.iter().map(|m| m.point.clone()).collect();
        for (point, shot) in subject.shots(&points, bench)? {
            let quality = bench.settings_of(&point)?.quality;
            let (errors, pictures) = judged(subject, &shot, &quality, bench)?;
            for own in some.iter_mut().filter(|m| m.point == point) {
                (own.errors, own.pictures) = (errors, pictures.clone());
            }
            bench.watch.done();
        }
    }
    Ok(())
}

/// Draws once: how far off it is; the picture, and its FLIP.
fn judged(
    subject: &StudySubject,
    shot: &SubjectShot,
    quality: &Quality,
    bench: &mut Bench<'_>,
) -> Result<(PictureErrors, [Rgb8Image; 2]), LabError> {
    let drawn = shot.still.draw(bench.engine, quality, None, 0)?;
    let exposure_s = shot.still.shown_exposure_s();
    let true_shown = shown(&subject.truth.radiance, &shot.still.response, exposure_s);
    let shown = (&drawn.display, &true_shown);
    let (errors, map) = errors(&drawn.radiance, &shot.still.background, &subject.truth, shown);
    Ok((errors, [drawn.display, map]))
}

/// Times of one point, round by round: of each stage and pass by its place in the frame, and of the whole.
#[derive(Clone, Default)]
struct Times {
    parts: BTreeMap<usize, (String, Vec<f32>)>,
    totals: Vec<f32>,
}

impl Times {
    fn add<'a>(&mut self, parts: impl Iterator<Item = (&'a str, f32)>) {
        let mut total = 0.0;
        for (slot, (name, ms)) in parts.enumerate() {
            self.parts.entry(slot).or_insert_with(|| (name.to_owned(), Vec::new())).1.push(ms);
            total += ms;
        }
        self.totals.push(total);
    }
}

fn measure_together(
    subject: &StudySubject,
    points: &[TriedPoint],
    rounds: usize,
    bench: &mut Bench<'_>,
) -> Result<Vec<Measured>, LabError> {
    let shots = subject.shots(points, bench)?;
    let (points, shots): (Vec<TriedPoint>, Vec<SubjectShot>) = shots.into_iter().unzip();
    let qualities: Vec<Quality> =
        points.iter().map(|point| Ok(bench.settings_of(point)?.quality)).collect::<Result<_, LabError>>()?;
    let mut pictures = Vec::new();
    for (quality, shot) in qualities.iter().zip(&shots) {
        // Warms up, and gives the picture.
        pictures.push(judged(subject, shot, quality, bench)?);
        bench.watch.done();
    }
    let mut times = vec![Times::default(); points.len()];
    for round in 0..rounds {
        for k in 0..points.len() {
            // Another first one each round.
            let i = (k + round) % points.len();
            let drawn = shots[i].still.draw(bench.engine, &qualities[i], None, 1)?;
            let passes = drawn.timings.iter().map(|t| (t.pass.name(), t.ms));
            times[i].add(shots[i].before.iter().copied().chain(passes));
            bench.watch.done();
        }
    }
    let all = points.into_iter().zip(pictures).zip(times);
    Ok(all
        .map(|((point, (errors, pictures)), Times { mut parts, mut totals })| Measured {
            point,
            errors,
            ms: quantile(&mut totals, 0.5),
            quartiles_ms: [quantile(&mut totals, 0.25), quantile(&mut totals, 0.75)],
            stages_ms: parts
                .values_mut()
                .map(|(name, ms)| (std::mem::take(name), quantile(ms, 0.5)))
                .collect(),
            pictures,
        })
        .collect())
}

/// The number below which a share of all lie; between two of them, in proportion. NaN of none.
fn quantile(all: &mut [f32], share: f64) -> f64 {
    all.sort_by(f32::total_cmp);
    let place = share * all.len().saturating_sub(1) as f64;
    let at = |i: usize| all.get(i).map_or(f64::NAN, |&x| f64::from(x));
    let (below, part) = (place.floor() as usize, place.fract());
    if part == 0.0 { at(below) } else { at(below) * (1.0 - part) + at(below + 1) * part }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_the_rounds() {
        let mut three = [9.0, 1.0, 5.0];
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(|s| quantile(&mut three, s)), [1.0, 3.0, 5.0, 7.0, 9.0]);
        assert_eq!(quantile(&mut [4.0], 0.25), 4.0);
        assert!(quantile(&mut [], 0.5).is_nan());
    }
}
