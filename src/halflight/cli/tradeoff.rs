//! `halflight tradeoff`: what accuracy costs in time.

use super::output::{make_folder, shown};
use super::progress::{Bar, host};
use super::{CliError, GlobalOptions, run_folder};
use crate::lab::tradeoff::{
    Bench, StudyPlan, StudyResults, StudySubject, SubjectChoice, study,
    writing::{About, json, noise_note, write},
};
use std::path::PathBuf;

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Measure what accuracy costs in time: every setting of accuracy by itself, and the front of all together.\n\n\
Each input is drawn with many settings, several times in turns, and is held against the truth. The truth is \
the ray-traced picture of a reference case. For a scene file or a frame of a recording it is traced here, until \
its noise is below half of the front's best error (--most-samples bounds that). \
Errors: of shadows (relative RMSE of the share of light that objects leave, over the mean share that they \
take), FLIP (mean and 95th percentile), and light taken in all. Times: of every pass, by timestamp queries \
where the engine is a GPU that has them.\n\n\
The folder then holds index.html (plots and pictures; it needs no other file), SUBJECT.svg, points.csv, \
tradeoff.json, and front.json. The front is the settings that no others beat. Four of them have names \
(presets). The setting quality.front takes that file: the governor of halflightd then walks along the front \
of this device and these scenes.\n\n\
Examples:\n\
halflight tradeoff shared/reference/f1_studio_lamps_five --quick --out out/tradeoff\n\
halflight tradeoff tests/recordings/desk.mcap --scene tests/scenes/walker.toml --out out/tradeoff";

/// What a study leaves in its folder.
const LEFT: [&str; 5] = ["index.html", "*.svg", "points.csv", "tradeoff.json", "front.json"];

/// Arguments of `halflight tradeoff`.
#[derive(clap::Args, Debug)]
pub struct TradeoffArguments {
    /// Scene file (TOML), reference case (JSON or its folder), or recording (MCAP) with what is drawn into it: --scene, or
    /// RECORDING@SCENE. Repeatable: the front is that of their means.
    #[arg(value_name = "SCENE|CASE|REC", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Scene file that is drawn into recordings (repeatable).
    #[arg(long, value_name = "FILE")]
    pub scene: Vec<PathBuf>,
    /// Settings file that everything starts from. Accuracy that is named there is taken as the default.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// The frame of a recording, counted from 0.
    #[arg(long, value_name = "N", default_value_t = 11)]
    pub frame: u64,
    /// Folder for the results. It is made where it is missing.
    #[arg(long, value_name = "DIR", default_value = "out/tradeoff")]
    pub out: PathBuf,
    /// Fewer values, rounds and tries: takes less than 2 minutes on two cores.
    #[arg(long)]
    pub quick: bool,
    /// How many times each point is timed [default: 7, with --quick 3].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: Option<u32>,
    /// Settings tried in search of the front [default: 200, with --quick 24].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=100_000))]
    pub tries: Option<u32>,
    /// Rays a pixel that truths which are traced here begin with [default: 256, with --quick 64].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub samples: Option<u32>,
    /// Rays a pixel at most: a truth is traced on until its noise is below half of the front's best error [default: 16384,
    /// with --quick 1024].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    pub most_samples: Option<u32>,
}

impl TradeoffArguments {
    fn plan(&self) -> StudyPlan {
        let pick = |given: Option<u32>, full: usize, quick: usize| {
            given.map_or(if self.quick { quick } else { full }, |n| n as usize)
        };
        StudyPlan {
            quick: self.quick,
            rounds: pick(self.rounds, 7, 3),
            tries: pick(self.tries, 200, 24),
            samples: pick(self.samples, 256, 64),
            // Rays that are asked for are traced.
            most_samples: pick(self.most_samples, 16384, 1024).max(pick(self.samples, 256, 64)),
        }
    }
}

/// Runs `halflight tradeoff`.
///
/// # Errors
/// A mistake in the arguments; an input that cannot be drawn or traced; a file that cannot be written.
pub fn run(arguments: TradeoffArguments, global: &GlobalOptions) -> Result<(), CliError> {
    run_folder::check(&arguments.out, &LEFT)?;
    make_folder(&arguments.out)?;
    let plan = arguments.plan();
    let settings = global.settings(arguments.config.as_deref())?;
    let mut engine = global.open_engine()?;
    let bar = if global.json { Bar::hidden() } else { Bar::of_count(Some(0), "pictures") };
    let mut bench = Bench { engine: engine.as_mut(), base: &settings, host: host(), watch: &bar };
    let choice = SubjectChoice { scenes: &arguments.scene, frame: arguments.frame, samples: plan.samples };
    let mut subjects = Vec::new();
    for input in &arguments.inputs {
        subjects.extend(StudySubject::of(input, &choice, &mut bench)?);
    }
    let results = study(&mut subjects, &plan, &mut bench)?;
    drop(bar);
    run_folder::begin(&arguments.out, "tradeoff", &LEFT)?;
    let about = About { subjects: &subjects, engine: engine.description(), quick: arguments.quick };
    let files = write(&arguments.out, &about, &results)?;
    report(global, &about, &results, &files);
    Ok(())
}

/// For people, or for machines.
fn report(global: &GlobalOptions, about: &About<'_>, results: &StudyResults, files: &[PathBuf]) {
    if global.json {
        let mut all = json(about, results);
        all["files"] = files.iter().map(|file| shown(file)).collect();
        all["format"] = super::JSON_FORMAT.into();
        println!("{all}");
        return;
    }
    println!("engine  {}", about.engine);
    println!("front of {} subjects, means:", about.subjects.len());
    println!("  {:>9}  {:>8}  {:<20} settings (others as by default)", "ms", "error", "preset");
    for (i, (point, [ms, error])) in results.front.iter().enumerate() {
        let names: Vec<&str> =
            results.named.iter().filter(|(_, at)| *at == i).map(|(n, _)| n.as_str()).collect();
        println!("  {ms:9.2}  {error:8.4}  {:<20} {}", names.join(", "), point.label());
    }
    if results.untold > 0 {
        println!(
            "  {} of these have no name: they cannot be told from a cheaper one (times overlap, or the truth's noise hides it)",
            results.untold
        );
    }
    for names in results.shared_names() {
        println!("  {names}: one point; nothing between them is told apart");
    }
    for note in about.subjects.iter().filter_map(|subject| noise_note(subject, results)) {
        println!("  {note}");
    }
    for file in files {
        println!("wrote   {}", file.display());
    }
}
