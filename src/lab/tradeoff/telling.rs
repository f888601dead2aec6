//! What the truth can tell: truths are traced on until their noise is small beside the best error, and points whose errors
//! or times do not differ get no names of their own.

use super::{
    measure::{Measured, judge_again},
    study::{Bench, Placed, StudyPlan},
    subject::StudySubject,
};
use crate::error::LabError;
use crate::plan::front::{PRESETS, presets};

/// A truth is traced until its noise is at most this share of the best error.
const NOISE_SHARE: f64 = 0.5;
/// Rays are added by at most this factor at a time: the best error moves with the truth.
const MOST_GROWTH: f64 = 4.0;

/// Whether a truth's noise is too large beside the best error.
pub fn is_noisy(noise: Option<f64>, best: f64) -> bool {
    noise.is_some_and(|noise| noise > NOISE_SHARE * best)
}

/// Rays a pixel that a truth needs next; none where its noise is small enough, or the limit is reached.
fn samples_needed(noise: Option<f64>, samples: usize, best: f64, most: usize) -> Option<usize> {
    if samples >= most || !is_noisy(noise, best) {
        return None;
    }
    // Noise falls with the square root. A little more than that, or it ends beside the bound.
    let wanted = 1.1 * (noise.unwrap_or(0.0) / (NOISE_SHARE * best)).powi(2);
    Some(((samples as f64 * wanted.clamp(1.1, MOST_GROWTH)).ceil() as usize).min(most))
}

/// The least error of any point, in the mean over the subjects, which have the same points.
fn best_error(measured: &[Vec<Measured>]) -> f64 {
    let count = measured.iter().map(Vec::len).min().unwrap_or(0);
    let mean = |i: usize| measured.iter().map(|m| m[i].errors.shadow).sum::<f64>() / measured.len() as f64;
    (0..count).map(mean).fold(f64::INFINITY, f64::min)
}

/// Traces truths on until the noise of each is below half of the best error, or there are as many rays as the plan allows, and
/// takes the errors anew. True where anything was traced.
///
/// # Errors
/// A point cannot be composed or drawn.
pub fn trace_until_told(
    subjects: &mut [StudySubject],
    measured: &mut [Vec<Measured>],
    plan: &StudyPlan,
    bench: &mut Bench<'_>,
) -> Result<bool, LabError> {
    let mut was_traced = false;
    loop {
        let best = best_error(measured);
        let mut goes_on = false;
        for (subject, own) in subjects.iter_mut().zip(measured.iter_mut()) {
            let Some(samples) = subject.truth_samples() else { continue };
            let needed = samples_needed(subject.truth.noise, samples, best, plan.most_samples);
            let Some(samples) = needed else { continue };
            bench.watch.begin(&format!("truth: {}, {samples} rays a pixel", subject.name));
            subject.trace_on(samples, &bench.host)?;
            judge_again(subject, own, bench)?;
            goes_on = true;
        }
        if !goes_on {
            return Ok(was_traced);
        }
        was_traced = true;
    }
}

/// A point of the front with what is not known of it.
#[derive(Clone, Copy, Debug)]
pub struct FrontSpread {
    /// Lower and upper quartile of its time, milliseconds; means over the subjects.
    quartiles_ms: [f64; 2],
    error: f64,
}

/// What is known of each point of the front.
pub fn spreads(front: &[Placed], measured: &[Vec<Measured>]) -> Vec<FrontSpread> {
    let of = |(point, [_, error]): &Placed| {
        let own: Vec<&Measured> =
            measured.iter().filter_map(|all| all.iter().find(|m| m.point == *point)).collect();
        let mean = |k: usize| own.iter().map(|m| m.quartiles_ms[k]).sum::<f64>() / own.len().max(1) as f64;
        FrontSpread { quartiles_ms: [mean(0), mean(1)], error: *error }
    };
    front.iter().map(of).collect()
}

/// What the truths' noise hides, in the mean over the subjects; 0 where none is known.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hidden {
    /// Standard error of the truths: errors below it are all alike, for it is itself an estimate that was taken out of them.
    noise: f64,
    /// Differences of errors below this may be the noise's.
    difference: f64,
}

impl Hidden {
    /// By the truths of some subjects.
    pub fn by(subjects: &[StudySubject]) -> Self {
        let mean = |of: &dyn Fn(&StudySubject) -> f64| {
            subjects.iter().map(of).filter(|n| n.is_finite()).sum::<f64>() / subjects.len().max(1) as f64
        };
        Self {
            noise: mean(&|s| s.truth.noise.unwrap_or(0.0)),
            difference: mean(&|s| s.truth.difference_noise),
        }
    }
}

/// Which points of a front (by rising time) are told from those before: their times do not overlap by the quartiles, and
/// their error is smaller by more than the truths' noise hides.
pub fn told_apart(front: &[FrontSpread], hidden: Hidden) -> Vec<usize> {
    let seen = |error: f64| error.max(hidden.noise);
    let mut kept: Vec<usize> = Vec::new();
    for (i, point) in front.iter().enumerate() {
        let is_apart = kept.last().is_none_or(|&last| {
            let last = front[last];
            point.quartiles_ms[0] > last.quartiles_ms[1]
                && seen(last.error) - seen(point.error) > hidden.difference
        });
        if is_apart {
            kept.push(i);
        }
    }
    kept
}

/// The presets, among the points that are told apart.
pub fn names(front: &[Placed], apart: &[usize]) -> Vec<(String, usize)> {
    let places: Vec<[f64; 2]> = apart.iter().map(|&i| front[i].1).collect();
    presets(&places).map_or_else(Vec::new, |chosen| {
        PRESETS.iter().zip(chosen).map(|(name, k)| ((*name).to_owned(), apart[k])).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tradeoff::axes::TriedPoint;

    #[test]
    fn what_noise_or_overlapping_times_hide_has_no_name() {
        let point = |low: f64, high: f64, error: f64| FrontSpread { quartiles_ms: [low, high], error };
        let front = [
            point(1.0, 1.2, 0.5),
            // As dear as the first, as far as one can see.
            point(1.1, 1.4, 0.4),
            point(2.0, 2.2, 0.3),
            // Better by less than noise can make.
            point(3.0, 3.2, 0.29),
            point(4.0, 4.2, 0.04),
            // Below the noise.
            point(8.0, 8.2, 0.01),
        ];
        let hidden = |noise: f64, difference: f64| Hidden { noise, difference };
        assert_eq!(told_apart(&front, hidden(0.0, 0.0)), [0, 2, 3, 4, 5]);
        assert_eq!(told_apart(&front, hidden(0.02, 0.015)), [0, 2, 4, 5]);
        assert_eq!(told_apart(&front, hidden(0.05, 0.015)), [0, 2, 4]);
        let placed: Vec<Placed> =
            front.iter().map(|p| (TriedPoint::default(), [p.quartiles_ms[0], p.error])).collect();
        let named = names(&placed, &told_apart(&front, hidden(0.05, 0.015)));
        assert_eq!(named.first().map(|(name, i)| (name.as_str(), *i)), Some(("draft", 0)));
        assert_eq!(named.last().map(|(name, i)| (name.as_str(), *i)), Some(("reference", 4)));
        assert!(names(&[], &[]).is_empty());
    }

    #[test]
    fn a_truth_is_traced_until_its_noise_is_half_of_the_best_error() {
        // Noise falls with the square root of the rays: 0.08 at 64.
        let noise = |samples: usize| 0.08 * (64.0 / samples as f64).sqrt();
        for (best, most, ended_by_limit) in
            [(0.05, 100_000, false), (0.01, 100_000, false), (0.01, 2000, true)]
        {
            let mut samples = 64;
            let mut steps = 0;
            while let Some(next) = samples_needed(Some(noise(samples)), samples, best, most) {
                assert!(next > samples && next <= most && next as f64 <= 4.0 * samples as f64 + 1.0);
                (samples, steps) = (next, steps + 1);
            }
            assert_eq!(is_noisy(Some(noise(samples)), best), ended_by_limit, "{best} {most}: {samples}");
            // And not for much longer than that.
            assert!(ended_by_limit || 1.5 * noise(samples) > NOISE_SHARE * best, "{best}: {samples}");
            assert!(steps < 10, "{steps}");
        }
        assert_eq!(samples_needed(None, 64, 0.01, 4096), None, "nothing is known of a case's own picture");
        assert_eq!(samples_needed(Some(0.001), 64, 0.01, 4096), None);
    }
}
