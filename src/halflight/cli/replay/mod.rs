//! `halflight replay`: a recording through the daemon's own pipeline.

mod film;
mod report;
mod sheet;
pub mod statistics;

use super::global_options::put;
use super::output::{camera_of, make_folder, write_file};
use super::progress::{Bar, host};
use super::{CliError, GlobalOptions, quality_flags::QualityFlags, run_folder};
use crate::assets::pictures;
use crate::config::settings::{RunMode, Settings};
use crate::daemon::{prepare::prepare, run::run as run_prepared};
use crate::lab::digest::PixelDigest;
use crate::model::{path_text, picture::Picture};
use crate::pipeline::{
    PipelineError,
    turns::{FinishedFrame, FrameSink},
};
use crate::plan::PassTiming;
use film::Film;
use report::ReplayReport;
use sheet::ContactSheet;
use statistics::FrameNumbers;
use std::ffi::OsString;
use std::path::PathBuf;

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Run a recording through the daemon's own pipeline. Leaves pictures, a film and a report. The result is the \
same every time.\n\n\
The folder then holds frames/*.png, contact_sheet.png, replay.mp4 (where ffmpeg is installed), report.json \
and index.html.\n\n\
Example: halflight replay desk.mcap --scene desk.toml --out out";

/// What a run leaves in its folder.
const LEFT: [&str; 5] =
    ["frames/frame_*.png", "contact_sheet.png", "replay.mp4", "report.json", "index.html"];

/// Arguments of `halflight replay`.
#[derive(clap::Args, Debug)]
pub struct ReplayArguments {
    /// Recording (MCAP), or any device name such as synthetic:frames=30.
    #[arg(value_name = "REC")]
    recording: OsString,
    /// Scene file with the virtual objects.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Settings file; what is given on the command line wins.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Folder for the results. It is made where it is missing.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Stop after this many frames.
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Run in real time: where frames come faster than they can be drawn, the newest one is taken.
    #[arg(long)]
    realtime: bool,
    /// What is shown: light, direct, global, cast, self, lambert, phong, mirror, blockers, maps or final.
    #[arg(long, value_name = "VIEW")]
    view: Option<String>,
    /// Write over every picture which effects are on, kept or off, and why.
    #[arg(long)]
    hud: bool,
    /// Leave out the PNG of every frame.
    #[arg(long)]
    no_frames: bool,
    /// Time that a frame may take, in milliseconds. The governor walks along the measured front to the most accurate settings
    /// that keep it.
    #[arg(long, value_name = "MS")]
    budget_ms: Option<f64>,
    /// The same as a rate: pictures a second.
    #[arg(long, value_name = "FPS")]
    target_fps: Option<f64>,
    /// Error that shadows may have. The governor takes the cheapest settings of the front that keep it.
    #[arg(long, value_name = "ERROR")]
    max_error: Option<f64>,
    #[command(flatten)]
    quality: QualityFlags,
}

/// Runs `halflight replay`.
pub fn run(arguments: ReplayArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let settings = settings_of(&arguments, global)?;
    if let Some(out) = &arguments.out {
        run_folder::check(out, &LEFT)?;
    }
    let prepared = prepare(&settings, &host())?;
    if let Some(out) = &arguments.out {
        run_folder::begin(out, "replay", &LEFT)?;
        make_folder(&out.join("frames"))?;
    }
    let total = prepared.source.frames_left().map(|n| arguments.frames.map_or(n, |limit| limit.min(n)));
    let mut sink = ReplayCollector::new(&arguments, total);
    let engine = prepared.engine.clone();
    let ran = run_prepared(prepared, &settings, &mut sink)?;
    drop(sink.progress.take());
    if ran.counts.frames == 0 {
        return Err(CliError::on(arguments.recording.display(), "holds no frames"));
    }
    let has_film = sink.finish_film();
    let report = ReplayReport {
        recording: arguments.recording.to_string_lossy().into_owned(),
        engine,
        counts: ran.counts,
        frames: sink.numbers,
        light: sink.light,
        passes: sink.passes,
        last_plan: ran.last_plan,
        digest: sink.digest.hex(),
    };
    if let Some(out) = &arguments.out {
        if let Some(picture) = sink.sheet.picture() {
            pictures::save_png(&out.join("contact_sheet.png"), &picture)?;
        }
        write_file(&out.join("report.json"), format!("{:#}\n", report.json()))?;
        write_file(&out.join("index.html"), report.page(has_film))?;
    }
    if global.json {
        println!("{}", report.json());
    } else {
        print!("{}", report.table());
        if let Some(out) = &arguments.out {
            println!("\nresults in {}", out.display());
        }
    }
    if global.digest && !global.json {
        println!("digest {}", report.digest);
    }
    Ok(())
}

fn settings_of(arguments: &ReplayArguments, global: &GlobalOptions) -> Result<Settings, CliError> {
    let mut settings = global.settings(arguments.config.as_deref())?;
    settings.camera = camera_of(&arguments.recording);
    settings.mode = if arguments.realtime { RunMode::Realtime } else { RunMode::Lockstep };
    if let Some(frames) = arguments.frames {
        settings.frames = frames;
    }
    settings.hud |= arguments.hud;
    if let Some(view) = &arguments.view {
        settings.view = super::render::view_named(view)?;
    }
    if let Some(scene) = &arguments.scene {
        settings.scene_file = path_text::to_text(scene);
    }
    arguments.quality.apply(&mut settings)?;
    for (flag, key, value) in [
        ("--budget-ms", "quality.budget_ms", arguments.budget_ms),
        ("--target-fps", "quality.target_fps", arguments.target_fps),
        ("--max-error", "quality.max_error", arguments.max_error),
    ] {
        if let Some(value) = value {
            put(flag, key, &value.into(), &mut settings)?;
        }
    }
    Ok(settings)
}

/// Gathers what the report needs and writes pictures as they come.
struct ReplayCollector {
    out: Option<PathBuf>,
    frames_folder: Option<PathBuf>,
    film: Option<Film>,
    film_started: bool,
    sheet: ContactSheet,
    digest: PixelDigest,
    numbers: Vec<FrameNumbers>,
    passes: Vec<PassTiming>,
    light: Option<crate::model::estimate::LightEstimate>,
    progress: Option<Bar>,
}

impl ReplayCollector {
    fn new(arguments: &ReplayArguments, total: Option<u64>) -> Self {
        let frames_folder =
            arguments.out.as_ref().filter(|_| !arguments.no_frames).map(|out| out.join("frames"));
        Self {
            out: arguments.out.clone(),
            frames_folder,
            film: None,
            film_started: false,
            sheet: ContactSheet::default(),
            digest: PixelDigest::default(),
            numbers: Vec::new(),
            passes: Vec::new(),
            light: None,
            progress: Some(Bar::of_count(total, "frames")),
        }
    }

    fn film_frame(&mut self, picture: &Picture) {
        let Some(out) = &self.out else { return };
        if !self.film_started {
            self.film_started = true;
            let (width, height) = (picture.display.width(), picture.display.height());
            match Film::start(&out.join("replay.mp4"), width, height, 30.0) {
                Ok(film) => self.film = Some(film),
                Err(why) => tracing::warn!("{why}"),
            }
        }
        if let Some(Err(why)) = self.film.as_mut().map(|film| film.add(&picture.display)) {
            tracing::warn!("{why}");
            self.film = None;
        }
    }

    fn finish_film(&mut self) -> bool {
        match self.film.take().map(Film::finish) {
            Some(Ok(())) => true,
            Some(Err(why)) => {
                tracing::warn!("{why}");
                false
            }
            None => false,
        }
    }
}

impl FrameSink for ReplayCollector {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        let FinishedFrame { raw, truth, outcome, passes, picture } = *finished;
        self.passes.extend_from_slice(passes);
        self.digest.add_bytes(picture.display.pixels());
        self.numbers.push(FrameNumbers::of(outcome, truth));
        if outcome.light.is_some() {
            self.light = outcome.light;
        }
        if self.out.is_some() {
            self.sheet.offer(&picture.display);
            self.film_frame(picture);
        }
        if let Some(folder) = &self.frames_folder {
            let path = folder.join(format!("frame_{:06}.png", raw.sequence));
            pictures::save_png(&path, &picture.display).map_err(|e| PipelineError::Output(e.to_string()))?;
        }
        if let Some(bar) = &self.progress {
            bar.add_one();
        }
        Ok(true)
    }
}
