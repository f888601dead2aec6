//! `halflight explain`: which effects a frame has, which it keeps and which it does without, and why.

use super::capture_steps::{CaptureStep, steps_of};
use super::effect_times::PassTimes;
use super::output::{camera_of, need_frame, shown};
use super::progress::{Bar, host};
use super::{CliError, GlobalOptions, quality_flags::QualityFlags, render::is_scene_file};
use crate::assets::scene;
use crate::config::{Settings, settings::RunMode};
use crate::daemon::{prepare::prepare, run::run as run_prepared};
use crate::lab::{
    case::{self, CaseStills, default_image},
    still::of_scene,
};
use crate::model::path_text;
use crate::pipeline::{
    PipelineError,
    frame::Shown,
    turns::{FinishedFrame, FrameSink},
};
use crate::plan::{Decision, FramePlan};
use std::path::PathBuf;

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Tell which effects a frame has, which it keeps from an earlier frame, and which it does without. Of each \
effect the table says why, what that saves, and what it can change in the picture at most. Of a camera's or a \
recording's frames it says as well which steps of capture they go through.\n\n\
Example: halflight explain desk.mcap --scene desk.toml --frame 12";

/// Arguments of `halflight explain`.
#[derive(clap::Args, Debug)]
pub struct ExplainArguments {
    /// Scene file (TOML), reference case (JSON, or its folder), recording (MCAP), or any device name such as
    /// synthetic:frames=30.
    #[arg(value_name = "SCENE|RECORDING")]
    input: PathBuf,
    /// Scene file with the virtual objects of a recording.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Which frame of a recording, counted from 0 [default: the last]. The frames before it are run, too.
    #[arg(long, value_name = "N")]
    frame: Option<u64>,
    /// Settings file; what is given on the command line wins.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Accuracy against time.
    #[command(flatten)]
    quality: QualityFlags,
}

/// A still is drawn so often for its times.
const STILL_RUNS: usize = 3;

/// A frame that was planned.
struct Explained {
    plan: FramePlan,
    times: PassTimes,
    /// What is done to a recording's frames before anything is drawn.
    capture: Vec<CaptureStep>,
    /// Number of the frame, and what the viewer got, of a recording.
    frame: Option<(u64, Shown)>,
}

/// Runs `halflight explain`.
pub fn run(arguments: ExplainArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let mut settings = global.settings(arguments.config.as_deref())?;
    arguments.quality.apply(&mut settings)?;
    let name = arguments.input.to_string_lossy();
    let is_device = name.contains(':') && !arguments.input.exists();
    let is_recording =
        is_device || arguments.input.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let explained = if is_recording {
        of_recording(&arguments, settings)?
    } else {
        if arguments.frame.is_some_and(|frame| frame > 0) || arguments.scene.is_some() {
            return Err(CliError(format!(
                "{name}: --frame and --scene belong to recordings; a still has one frame"
            )));
        }
        of_still(&arguments, &settings, global)?
    };
    if global.json {
        println!("{}", json(&arguments, &explained));
    } else {
        print!("{}", table(&explained));
    }
    Ok(())
}

fn of_still(
    arguments: &ExplainArguments,
    settings: &Settings,
    global: &GlobalOptions,
) -> Result<Explained, CliError> {
    let quality = &settings.quality;
    let mut engine = global.open_engine()?;
    let input = &arguments.input;
    let still = if is_scene_file(input) {
        of_scene(&scene::load(input)?, engine.as_mut(), quality, &host(), &mut Vec::new())?
    } else {
        let case = case::load(input)?;
        CaseStills::new(&case, &default_image(&case)?)?.still(quality, &host())
    };
    let drawn = still.draw(engine.as_mut(), quality, None, STILL_RUNS)?;
    let mut times = PassTimes::default();
    times.add(&drawn.timings);
    Ok(Explained { plan: drawn.plan, times, capture: Vec::new(), frame: None })
}

fn of_recording(arguments: &ExplainArguments, mut settings: Settings) -> Result<Explained, CliError> {
    let name = arguments.input.display().to_string();
    settings.camera = camera_of(arguments.input.as_os_str());
    settings.mode = RunMode::Lockstep;
    if let Some(frame) = arguments.frame {
        need_frame(&settings.camera, frame)?;
        settings.frames = frame.saturating_add(1);
    }
    if let Some(scene) = &arguments.scene {
        settings.scene_file = path_text::to_text(scene);
    }
    let prepared = prepare(&settings, &host())?;
    let capture = steps_of(&prepared, arguments.frame == Some(0));
    let total = prepared.source.frames_left().map(|n| arguments.frame.map_or(n, |frame| n.min(frame + 1)));
    let mut last =
        LastShown { shown: None, times: PassTimes::default(), bar: Bar::of_count(total, "frames") };
    let ran = run_prepared(prepared, &settings, &mut last)?;
    let LastShown { shown, times, bar } = last;
    drop(bar);
    let Some(shown) = shown else { return Err(CliError::on(&name, "holds no frames")) };
    if let Some(wanted) = arguments.frame.filter(|&wanted| wanted >= ran.counts.frames) {
        return Err(CliError(format!(
            "--frame = {wanted}: {name} has {0} frames, numbered 0 to {1}",
            ran.counts.frames,
            ran.counts.frames - 1
        )));
    }
    Ok(Explained { plan: ran.last_plan, times, capture, frame: Some((ran.counts.frames - 1, shown)) })
}

/// What became of the newest frame.
struct LastShown {
    shown: Option<Shown>,
    times: PassTimes,
    bar: Bar,
}

impl FrameSink for LastShown {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        self.shown = Some(finished.outcome.shown);
        self.times.add(finished.passes);
        self.bar.add_one();
        Ok(true)
    }
}

/// A bound for people.
pub fn bound_text(decision: &Decision) -> String {
    let bound = decision.error_bound;
    if bound == 0.0 {
        "0".into()
    } else if bound.is_finite() {
        format!("{:.2} %", 100.0 * bound)
    } else {
        "-".into()
    }
}

fn table(explained: &Explained) -> String {
    let mut out = String::new();
    if let Some((number, shown)) = explained.frame {
        out += &format!("frame {number}: ");
        out += &match shown {
            Shown::Relit => "drawn with virtual objects\n".to_string(),
            Shown::PassedThrough(why) => format!("the camera's picture alone: {why}\n"),
        };
    }
    if !explained.capture.is_empty() {
        out += "capture\n";
    }
    for step in &explained.capture {
        out += &format!("{:<18}{:<24}{}\n", step.name, step.verdict(), step.reason);
    }
    out += &format!("{:<18}{:<6}{:>8} {:>8} {:>9}  why\n", "effect", "", "work", "ms", "without");
    for (decision, ms) in explained.plan.decisions.iter().zip(explained.times.of(&explained.plan.decisions)) {
        out += &format!(
            "{:<18}{:<6}{:>8.2} {:>8} {:>9}  {}\n",
            decision.effect.name(),
            decision.verdict.name(),
            decision.saving,
            ms.map_or("-".to_owned(), |ms| format!("{ms:.2}")),
            bound_text(decision),
            decision.reason
        );
    }
    out += "work: in millions of composed pixels, roughly; saved where kept or off\n";
    out += "ms: on this machine and engine, as timed (medians), by work where a pass draws several effects; an estimate where kept or off\n";
    out + "without: what doing without it changes at most in any pixel, of what that shows in open light; -: no bound\n"
}

fn json(arguments: &ExplainArguments, explained: &Explained) -> serde_json::Value {
    let all_ms = explained.times.of(&explained.plan.decisions);
    let decision = |(d, ms): (&Decision, Option<f64>)| {
        serde_json::json!({
            "effect": d.effect.name(), "pass": d.effect.pass().map(|p| p.name()), "verdict": d.verdict.name(),
            "reason": d.reason, "saving": d.saving, "ms": ms, "error_bound": d.error_bound,
        })
    };
    serde_json::json!({
        "format": super::JSON_FORMAT,
        "input": shown(&arguments.input),
        "frame": explained.frame.map(|(number, _)| number),
        "passed_through": explained.frame.and_then(|(_, shown)| match shown {
            Shown::Relit => None,
            Shown::PassedThrough(why) => Some(why),
        }),
        "shown_as_it_is": explained.plan.passes_through,
        "capture": explained.capture.iter().map(CaptureStep::json).collect::<Vec<_>>(),
        "decisions": explained.plan.decisions.iter().zip(all_ms).map(decision).collect::<Vec<_>>(),
    })
}
