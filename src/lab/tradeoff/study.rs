//! The study: single settings, then the search for the front, then the front's times.

use super::{
    axes::{AXES, AccuracyAxis, TriedPoint},
    measure::{Measured, measure},
    search::{FrontSearch, corners},
    subject::StudySubject,
    writing::rounded,
};
use crate::config::Settings;
use crate::daemon::host::Host;
use crate::engine::Engine;
use crate::error::LabError;
use crate::plan::front::{PRESETS, presets, undominated};

/// Is told how far a study is.
pub trait StudyWatch {
    /// Another part begins.
    fn begin(&self, part: &str);
    /// So many more draws are to come.
    fn expect(&self, draws: usize);
    /// One draw is done.
    fn done(&self);
}

/// What a study is made with.
pub struct Bench<'a> {
    /// Draws.
    pub engine: &'a mut dyn Engine,
    /// Settings that everything starts from.
    pub base: &'a Settings,
    /// Readers of files, and where long work shows how far it is.
    pub host: Host<'a>,
    /// Is told how far the study is.
    pub watch: &'a dyn StudyWatch,
}

impl Bench<'_> {
    /// The settings of a point.
    ///
    /// # Errors
    /// A value that the settings do not allow.
    pub fn settings_of(&self, point: &TriedPoint) -> Result<Settings, LabError> {
        let mut settings = self.base.clone();
        point.put_over(&mut settings)?;
        Ok(settings)
    }
}

/// How thorough a study is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StudyPlan {
    /// Fewer values of each setting.
    pub quick: bool,
    /// How often each point is timed.
    pub rounds: usize,
    /// Settings tried in search of the front.
    pub tries: usize,
    /// Rays a pixel of truths that are traced.
    pub samples: usize,
}

/// Settings with their mean milliseconds and mean error.
pub type Placed = (TriedPoint, [f64; 2]);

/// All that was measured.
pub struct StudyResults {
    /// For each subject its points: the single settings, then the front's.
    pub points: Vec<Vec<Measured>>,
    /// The front by rising time.
    pub front: Vec<Placed>,
    /// Names of the front's points, and their places on it.
    pub named: Vec<(String, usize)>,
    /// Points of the front that have no name because they cannot be told from a cheaper one.
    pub untold: usize,
}

/// A point of the front with what is not known of it.
#[derive(Clone, Copy, Debug)]
struct FrontSpread {
    /// Lower and upper quartile of its time, milliseconds; means over the subjects.
    quartiles_ms: [f64; 2],
    error: f64,
}

fn spreads(front: &[Placed], measured: &[Vec<Measured>]) -> Vec<FrontSpread> {
    let of = |(point, [_, error]): &Placed| {
        let own: Vec<&Measured> =
            measured.iter().filter_map(|all| all.iter().find(|m| m.point == *point)).collect();
        let mean = |k: usize| own.iter().map(|m| m.quartiles_ms[k]).sum::<f64>() / own.len().max(1) as f64;
        FrontSpread { quartiles_ms: [mean(0), mean(1)], error: *error }
    };
    front.iter().map(of).collect()
}

/// Standard error of the truths, in the mean over the subjects; 0 where none is known.
fn noise_of(subjects: &[StudySubject]) -> f64 {
    let sum: f64 = subjects.iter().filter_map(|s| s.truth.noise).filter(|n| n.is_finite()).sum();
    sum / subjects.len().max(1) as f64
}

/// Which points of a front (by rising time) are told from those before: their times do not overlap by the quartiles, and
/// their error is smaller by more than the truth's noise lets appear. Errors below the noise are all alike.
fn told_apart(front: &[FrontSpread], noise: f64) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::new();
    for (i, point) in front.iter().enumerate() {
        let is_apart = kept.last().is_none_or(|&last| {
            let last = front[last];
            point.quartiles_ms[0] > last.quartiles_ms[1] && point.error.max(noise) < last.error.max(noise)
        });
        if is_apart {
            kept.push(i);
        }
    }
    kept
}

/// The presets, among the points that are told apart.
fn names(front: &[Placed], apart: &[usize]) -> Vec<(String, usize)> {
    let places: Vec<[f64; 2]> = apart.iter().map(|&i| front[i].1).collect();
    presets(&places).map_or_else(Vec::new, |chosen| {
        PRESETS.iter().zip(chosen).map(|(name, k)| ((*name).to_owned(), apart[k])).collect()
    })
}

/// Measures all subjects.
///
/// # Errors
/// A point cannot be composed or drawn.
pub fn study(
    subjects: &[StudySubject],
    plan: &StudyPlan,
    bench: &mut Bench<'_>,
) -> Result<StudyResults, LabError> {
    let mut points = Vec::new();
    for subject in subjects {
        points.push(single_settings(subject, plan, bench)?);
    }
    let near = search_front(subjects, &points, plan, bench)?;
    bench.watch.begin("front: times");
    bench.watch.expect(near.len() * subjects.len() * (plan.rounds + 1));
    let (places, measured) = means(subjects, &near, plan.rounds, bench)?;
    // As the file will hold them: what is equal there is no other point.
    let places: Vec<Placed> = places.into_iter().map(|(point, place)| (point, place.map(rounded))).collect();
    let where_to: Vec<[f64; 2]> = places.iter().map(|(_, place)| *place).collect();
    let front: Vec<Placed> = undominated(&where_to).into_iter().map(|i| places[i].clone()).collect();
    let apart = told_apart(&spreads(&front, &measured), noise_of(subjects));
    let named = names(&front, &apart);
    let untold = front.len() - apart.len();
    for (own, more) in points.iter_mut().zip(measured) {
        let fresh: Vec<Measured> =
            more.into_iter().filter(|m| front.iter().any(|(p, _)| *p == m.point)).collect();
        // The defaults were measured before; the newer time is of the same rounds as the front's.
        own.retain(|m| fresh.iter().all(|f| f.point != m.point));
        own.extend(fresh);
    }
    Ok(StudyResults { points, front, named, untold })
}

/// The defaults, and each setting that matters changed alone.
fn single_settings(
    subject: &StudySubject,
    plan: &StudyPlan,
    bench: &mut Bench<'_>,
) -> Result<Vec<Measured>, LabError> {
    let mut singles = vec![TriedPoint::default()];
    for axis in AXES.iter().filter(|a| subject.calls_for(a)) {
        singles.extend(along(axis, plan.quick));
    }
    bench.watch.begin(&format!("single settings: {}", subject.name));
    bench.watch.expect(singles.len() * (plan.rounds + 1));
    measure(subject, &singles, plan.rounds, bench)
}

/// The points that differ from the defaults by one setting.
fn along(axis: &AccuracyAxis, quick: bool) -> impl Iterator<Item = TriedPoint> {
    let each = axis.values(quick).into_iter().map(|v| TriedPoint::default().with(axis, v));
    each.filter(|point| *point != TriedPoint::default())
}

/// Points on the front or near it, by one round each. It is not looked for along settings that change no picture and no
/// time here: which of their values is on the front would be chance.
fn search_front(
    subjects: &[StudySubject],
    singles: &[Vec<Measured>],
    plan: &StudyPlan,
    bench: &mut Bench<'_>,
) -> Result<Vec<TriedPoint>, LabError> {
    let matters = |axis: &AccuracyAxis| {
        subjects.iter().zip(singles).any(|(s, own)| s.calls_for(axis) && axis.matters(own, plan.quick))
    };
    bench.watch.begin("front: search");
    let mut search = FrontSearch::default();
    let mut open = vec![TriedPoint::default()];
    open.extend(corners(&matters));
    for axis in AXES.iter().filter(|a| a.joint && matters(a)) {
        open.extend(along(axis, plan.quick));
    }
    let mut tried = 0;
    while !open.is_empty() {
        bench.watch.expect(open.len() * subjects.len() * 2);
        let (places, _) = means(subjects, &open, 1, bench)?;
        places.into_iter().for_each(|(point, place)| search.add(point, place));
        open = if tried < plan.tries { search.next(&matters) } else { Vec::new() };
        open.truncate(plan.tries.saturating_sub(tried));
        tried += open.len();
    }
    Ok(search.near_front())
}

/// Places of points in the mean over the subjects, and all that was measured of each subject.
fn means(
    subjects: &[StudySubject],
    points: &[TriedPoint],
    rounds: usize,
    bench: &mut Bench<'_>,
) -> Result<(Vec<Placed>, Vec<Vec<Measured>>), LabError> {
    let mut all = Vec::new();
    for subject in subjects {
        all.push(measure(subject, points, rounds, bench)?);
    }
    let mean = |i: usize, of: &dyn Fn(&Measured) -> f64| {
        all.iter().map(|m: &Vec<Measured>| of(&m[i])).sum::<f64>() / all.len() as f64
    };
    let place = |i: usize| [mean(i, &|m| m.ms), mean(i, &|m| m.errors.shadow)];
    Ok((points.iter().enumerate().map(|(i, p)| (p.clone(), place(i))).collect(), all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_noise_or_overlapping_times_hide_has_no_name() {
        let point = |low: f64, high: f64, error: f64| FrontSpread { quartiles_ms: [low, high], error };
        let front = [
            point(1.0, 1.2, 0.5),
            // As dear as the first, as far as one can see.
            point(1.1, 1.4, 0.4),
            point(2.0, 2.2, 0.3),
            point(4.0, 4.2, 0.04),
            // Better only by what the truth does not tell.
            point(8.0, 8.2, 0.03),
        ];
        assert_eq!(told_apart(&front, 0.0), [0, 2, 3, 4]);
        assert_eq!(told_apart(&front, 0.05), [0, 2, 3]);
        let placed: Vec<Placed> =
            front.iter().map(|p| (TriedPoint::default(), [p.quartiles_ms[0], p.error])).collect();
        let named = names(&placed, &told_apart(&front, 0.05));
        assert_eq!(named.first().map(|(name, i)| (name.as_str(), *i)), Some(("draft", 0)));
        assert_eq!(named.last().map(|(name, i)| (name.as_str(), *i)), Some(("reference", 3)));
        assert!(names(&[], &[]).is_empty());
    }
}
