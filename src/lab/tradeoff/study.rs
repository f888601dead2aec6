//! The study: single settings, then the search for the front, then the front's times.

use super::{
    axes::{AXES, AccuracyAxis, TriedPoint},
    measure::{Measured, judge_again, measure},
    search::{FrontSearch, corners},
    subject::StudySubject,
    telling::{self, Hidden, names, spreads, told_apart, trace_until_told},
    writing::rounded,
};
use crate::config::Settings;
use crate::daemon::host::Host;
use crate::engine::Engine;
use crate::error::LabError;
use crate::plan::front::undominated;

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
    /// Rays a pixel that truths which are traced here begin with.
    pub samples: usize,
    /// Rays a pixel that they have at most: they are traced on until they tell.
    pub most_samples: usize,
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

impl StudyResults {
    /// The least error of the front; infinite where it has no point.
    pub fn best_error(&self) -> f64 {
        self.front.last().map_or(f64::INFINITY, |(_, [_, error])| *error)
    }

    /// Whether a subject's truth is still too noisy: the limit on its rays ended it.
    pub fn is_noisy(&self, subject: &StudySubject) -> bool {
        telling::is_noisy(subject.truth.noise, self.best_error())
    }

    /// Presets that share their point with others: nothing between them is told apart.
    pub fn shared_names(&self) -> Vec<String> {
        let of = |i: usize| {
            self.named.iter().filter(|(_, at)| *at == i).map(|(name, _)| name.as_str()).collect::<Vec<_>>()
        };
        (0..self.front.len()).map(of).filter(|names| names.len() > 1).map(|names| names.join(", ")).collect()
    }
}

/// Measures all subjects.
///
/// # Errors
/// A point cannot be composed or drawn.
pub fn study(
    subjects: &mut [StudySubject],
    plan: &StudyPlan,
    bench: &mut Bench<'_>,
) -> Result<StudyResults, LabError> {
    trace_for_the_ends(subjects, plan, bench)?;
    let mut points = Vec::new();
    for subject in subjects.iter() {
        points.push(single_settings(subject, plan, bench)?);
    }
    let near = search_front(subjects, &points, plan, bench)?;
    bench.watch.begin("front: times");
    bench.watch.expect(near.len() * subjects.len() * (plan.rounds + 1));
    let (_, mut measured) = means(subjects, &near, plan.rounds, bench)?;
    // The front may be nearer to the truth than its ends were.
    if trace_until_told(subjects, &mut measured, plan, bench)? {
        for (subject, own) in subjects.iter().zip(&mut points) {
            judge_again(subject, own, bench)?;
        }
    }
    let places = means_of(&near, &measured);
    // As the file will hold them: what is equal there is no other point.
    let places: Vec<Placed> = places.into_iter().map(|(point, place)| (point, place.map(rounded))).collect();
    let where_to: Vec<[f64; 2]> = places.iter().map(|(_, place)| *place).collect();
    let front: Vec<Placed> = undominated(&where_to).into_iter().map(|i| places[i].clone()).collect();
    let apart = told_apart(&spreads(&front, &measured), Hidden::by(subjects));
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

/// The truths are traced before anything is timed, until they tell the defaults and the most accurate settings from the truth.
fn trace_for_the_ends(
    subjects: &mut [StudySubject],
    plan: &StudyPlan,
    bench: &mut Bench<'_>,
) -> Result<(), LabError> {
    let [_, accurate] = corners(&|axis: &AccuracyAxis| subjects.iter().any(|s| s.calls_for(axis)));
    let ends = [TriedPoint::default(), accurate];
    bench.watch.begin("the truth");
    bench.watch.expect(ends.len() * subjects.len());
    let (_, mut measured) = means(subjects, &ends, 0, bench)?;
    trace_until_told(subjects, &mut measured, plan, bench).map(|_| ())
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
    Ok((means_of(points, &all), all))
}

/// Means over the subjects.
fn means_of(points: &[TriedPoint], all: &[Vec<Measured>]) -> Vec<Placed> {
    let mean = |i: usize, of: &dyn Fn(&Measured) -> f64| {
        all.iter().map(|m: &Vec<Measured>| of(&m[i])).sum::<f64>() / all.len() as f64
    };
    let place = |i: usize| [mean(i, &|m| m.ms), mean(i, &|m| m.errors.shadow)];
    points.iter().enumerate().map(|(i, p)| (p.clone(), place(i))).collect()
}
