//! `halflight tradeoff`: what accuracy costs in time.

mod axes;
mod errors;
mod measure;
mod page;
mod plot;
mod search;
mod subject;
mod truth;
mod writing;

use super::{CliError, Common};
use crate::config::Settings;
use axes::{AXES, Axis, Point};
use indicatif::{ProgressBar, ProgressStyle};
use measure::{Measured, measure};
use search::{Search, corners};
use std::path::PathBuf;
use subject::{Asked, Subject};

/// Measure what accuracy costs in time: every setting of accuracy by itself, and the front of all together.
///
/// Each input is drawn with many settings, each several times in turns, and held against the truth: the ray-traced picture of
/// a reference case, or one that is traced here for a scene file or for a frame of a recording. Errors: of shadows (relative
/// RMSE of the share of light that objects leave, over the mean share that they take), FLIP (mean and 95th percentile), light
/// taken in all. Times: of every pass, by timestamp queries where the engine is a GPU that has them.
///
/// Writes into the folder: index.html (plots and pictures, needs nothing else), SUBJECT.svg, points.csv, tradeoff.json, and
/// front.json: the settings that no others beat, of which four have names (presets). `quality.front` of the settings takes
/// that file: the governor of `halflightd` then walks along the front of this device and these scenes.
///
/// Examples: halflight tradeoff shared/reference/f1_studio_lamps_five --quick --out out/tradeoff
///           halflight tradeoff tests/recordings/desk.mcap --scene tests/scenes/walker.toml --out out/tradeoff
#[derive(clap::Args, Debug)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Scene file (TOML), reference case (JSON or its folder), or recording (MCAP) with what is drawn into it: --scene, or
    /// RECORDING@SCENE. Repeatable: the front is that of their means.
    #[arg(value_name = "SCENE|CASE|REC", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Scene file that is drawn into recordings (repeatable).
    #[arg(long, value_name = "FILE")]
    pub scene: Vec<PathBuf>,
    /// Settings file that everything starts from; accuracy that is named there is taken as the default.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// The frame of a recording, counted from 1.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..))]
    pub frame: u64,
    /// Folder for the results; it is made where it is missing.
    #[arg(long, value_name = "DIR", default_value = "out/tradeoff")]
    pub out: PathBuf,
    /// Fewer values, rounds and tries: ends within 2 minutes on two cores.
    #[arg(long)]
    pub quick: bool,
    /// How often each point is timed [default: 7, with --quick 3].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: Option<u32>,
    /// Settings tried in search of the front [default: 200, with --quick 24].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=100_000))]
    pub tries: Option<u32>,
    /// Rays a pixel of truths that are traced here [default: 1024, with --quick 64].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub samples: Option<u32>,
}

/// All that was measured.
pub struct Results {
    /// For each subject its points: the single settings, then the front's.
    pub points: Vec<Vec<Measured>>,
    /// The front: settings with mean milliseconds and mean error, by rising time.
    pub front: Vec<(Point, [f64; 2])>,
    /// Names of the front's points, and their places on it.
    pub named: Vec<(String, usize)>,
}

/// Runs `halflight tradeoff`.
pub fn run(arguments: Arguments, common: &Common) -> Result<(), CliError> {
    std::fs::create_dir_all(&arguments.out)
        .map_err(|e| CliError::on(arguments.out.display(), format!("cannot be made: {e}")))?;
    let pick = |given: Option<u32>, full: usize, quick: usize| {
        given.map_or(if arguments.quick { quick } else { full }, |n| n as usize)
    };
    let rounds = pick(arguments.rounds, 7, 3);
    let tries = pick(arguments.tries, 200, 24);
    let samples = pick(arguments.samples, 1024, 64);
    let mut settings = match &arguments.config {
        Some(path) => common.settings_from(path)?,
        None => Settings::default(),
    };
    common.apply(&mut settings);
    let mut engine = common.open_engine()?;
    let engine = engine.as_mut();
    let bar = bar(common);

    bar.set_message("truth");
    let done = |share: f32| bar.set_message(format!("truth: {:.0} %", 100.0 * share));
    let asked =
        Asked { scenes: &arguments.scene, frame: arguments.frame, settings: &settings, samples, done: &done };
    let mut subjects = Vec::new();
    for input in &arguments.inputs {
        subjects.extend(Subject::of(input, &asked, engine)?);
    }
    // Single settings.
    let mut points = Vec::new();
    for subject in &subjects {
        let mut singles = vec![Point::default()];
        for axis in AXES.iter().filter(|a| subject.calls_for(a)) {
            let each = axis.values(arguments.quick).into_iter().map(|v| Point::default().with(axis, v));
            singles.extend(each.filter(|p| *p != Point::default()));
        }
        bar.set_message(format!("single settings: {}", subject.name));
        bar.inc_length((singles.len() * (rounds + 1)) as u64);
        points.push(measure(subject, &singles, &settings, rounds, engine, &|| bar.inc(1))?);
    }

    // The front of all together: one round each to find it, all rounds to place it. It is not looked for along settings
    // that change no picture and no time here: which of their values is on the front would be chance.
    let matters = |axis: &Axis| {
        subjects.iter().zip(&points).any(|(s, own)| s.calls_for(axis) && axis.matters(own, arguments.quick))
    };
    bar.set_message("front: search");
    let mut search = Search::default();
    let mut todo = vec![Point::default()];
    todo.extend(corners(&matters));
    for axis in AXES.iter().filter(|a| a.joint && matters(a)) {
        let singles = axis.values(arguments.quick).into_iter().map(|v| Point::default().with(axis, v));
        todo.extend(singles.filter(|p| *p != Point::default()));
    }
    let mut tried = 0;
    while !todo.is_empty() {
        bar.inc_length((todo.len() * subjects.len() * 2) as u64);
        let places = means(&subjects, &todo, &settings, 1, engine, &bar)?;
        places.0.into_iter().for_each(|(point, place)| search.add(point, place));
        todo = if tried < tries { search.next(&matters) } else { Vec::new() };
        todo.truncate(tries.saturating_sub(tried));
        tried += todo.len();
    }
    bar.set_message("front: times");
    let near = search.near_front();
    bar.inc_length((near.len() * subjects.len() * (rounds + 1)) as u64);
    let (places, measured) = means(&subjects, &near, &settings, rounds, engine, &bar)?;
    bar.finish_and_clear();

    // As the file will hold them: what is equal there is no other point.
    let places: Vec<(Point, [f64; 2])> =
        places.into_iter().map(|(point, place)| (point, place.map(writing::rounded))).collect();
    let where_to: Vec<[f64; 2]> = places.iter().map(|(_, place)| *place).collect();
    let order = crate::plan::front::undominated(&where_to);
    let front: Vec<(Point, [f64; 2])> = order.iter().map(|&i| places[i].clone()).collect();
    let on_front: Vec<[f64; 2]> = front.iter().map(|(_, place)| *place).collect();
    let named = crate::plan::front::presets(&on_front).map_or_else(Vec::new, |places| {
        crate::plan::front::PRESETS.iter().zip(places).map(|(name, i)| ((*name).to_owned(), i)).collect()
    });
    for (own, more) in points.iter_mut().zip(measured) {
        let fresh: Vec<Measured> =
            more.into_iter().filter(|m| front.iter().any(|(p, _)| *p == m.point)).collect();
        // The defaults were measured before; the newer time is of the same rounds as the front's.
        own.retain(|m| fresh.iter().all(|f| f.point != m.point));
        own.extend(fresh);
    }
    let results = Results { points, front, named };
    let about = writing::About { subjects: &subjects, engine: engine.description(), quick: arguments.quick };
    let files = writing::write(&arguments.out, &about, &results)?;
    writing::report(common, &about, &results, &files);
    Ok(())
}

/// Places of points in the mean over the subjects, and all that was measured of each subject.
type Means = (Vec<(Point, [f64; 2])>, Vec<Vec<Measured>>);

fn means(
    subjects: &[Subject],
    points: &[Point],
    settings: &Settings,
    rounds: usize,
    engine: &mut dyn crate::engine::Engine,
    bar: &ProgressBar,
) -> Result<Means, CliError> {
    let mut all = Vec::new();
    for subject in subjects {
        all.push(measure(subject, points, settings, rounds, engine, &|| bar.inc(1))?);
    }
    let mean = |i: usize, of: &dyn Fn(&Measured) -> f64| {
        all.iter().map(|m: &Vec<Measured>| of(&m[i])).sum::<f64>() / all.len() as f64
    };
    let place = |i: usize| [mean(i, &|m| m.ms), mean(i, &|m| m.errors.shadow)];
    Ok((points.iter().enumerate().map(|(i, p)| (p.clone(), place(i))).collect(), all))
}

fn bar(common: &Common) -> ProgressBar {
    if common.json {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{msg:32} {bar:30} {pos}/{len}  {elapsed} of {duration}");
    let bar = ProgressBar::new(0);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
