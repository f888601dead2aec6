//! Runs the pipeline as the settings say.

use super::{
    host::Host,
    picture_folder::PictureFolder,
    prepare::{OpenedCamera, Prepared, open_camera, prepare},
    settings_thread::{LiveSettings, SettingsThread, Watched},
    stop_signals::{Asked, StopSignals},
    watchdog::{DEFAULT_PERIOD_S, Watchdog},
};
use crate::config::settings::{RunMode, Settings};
use crate::device::{
    Clock, DeviceError, ErrorKind, FrameSource, ImuSource,
    clock::{ManualClock, MonotonicClock},
    pace::{Pace, PacedFrames, PacedImu},
    supervise::Budget,
};
use crate::pipeline::{
    Pipeline, PipelineError,
    inbox::Inbox,
    live::Live,
    lockstep::Lockstep,
    turns::{self, FrameSink, RunCounts},
};
use crate::plan::FramePlan;
use std::{path::PathBuf, sync::Arc};

/// What a run left.
#[derive(Clone, Debug)]
pub struct Ran {
    /// What went through.
    pub counts: RunCounts,
    /// The passes of the last picture, and those left out, each with its reason.
    pub last_plan: FramePlan,
}

/// Runs until the source ends, `device.frames` have gone through, or the sink asks to stop.
pub fn run(prepared: Prepared, settings: &Settings, sink: &mut dyn FrameSink) -> Result<Ran, PipelineError> {
    run_from(Arc::default(), prepared, settings, sink)
}

/// As [`run`], with an inbox that others put commands and settings into.
pub fn run_from(
    inbox: Arc<Inbox>,
    prepared: Prepared,
    settings: &Settings,
    sink: &mut dyn FrameSink,
) -> Result<Ran, PipelineError> {
    let Prepared { source, imu, mut pipeline, .. } = prepared;
    let counts = match settings.mode {
        RunMode::Lockstep => {
            let mut lockstep = Lockstep::new(inbox, source, imu, ManualClock::default())
                .looking_ahead(settings.search_ahead);
            turns::run(&mut lockstep, &mut pipeline, sink, settings.frames)?
        }
        RunMode::Realtime => run_live(inbox, source, imu, &mut pipeline, settings, sink)?,
    };
    Ok(Ran { counts, last_plan: pipeline.plan().clone() })
}

fn run_live(
    inbox: Arc<Inbox>,
    source: Box<dyn FrameSource>,
    imu: Option<Box<dyn ImuSource>>,
    pipeline: &mut Pipeline,
    settings: &Settings,
    sink: &mut dyn FrameSink,
) -> Result<RunCounts, PipelineError> {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::default());
    let period_s = Watchdog::period_s().unwrap_or(DEFAULT_PERIOD_S);
    let budget = Budget::of_watchdog(period_s).map_err(|e| PipelineError::Setup(e.to_string()))?;
    let pace = Pace::new(Arc::clone(&clock));
    let mut live = Live::new(inbox, clock, budget);
    let early = settings.search_ahead.then(|| pipeline.early_search());
    live.add_camera(&settings.camera, camera_opener(source, settings, pace.clone()), early)?;
    if let Some(imu) = imu {
        live.add_imu(&settings.camera, imu_opener(imu, settings, pace))?;
    }
    let counts = turns::run(&mut live, pipeline, sink, settings.frames);
    let abandoned = live.stop();
    if abandoned > 0 {
        tracing::warn!("{abandoned} devices do not answer and are left as they are");
    }
    counts
}

/// Gives the camera that is open, and opens it anew each time after that. Recordings and the synthetic room deliver at
/// once: they are held to a pace.
fn camera_opener(
    source: Box<dyn FrameSource>,
    settings: &Settings,
    pace: Pace,
) -> impl FnMut(crate::model::time::Timestamp) -> Result<Box<dyn FrameSource>, DeviceError> + Send + 'static {
    let (mut first, settings) = (Some(source), settings.clone());
    move |_deadline| {
        let source = match first.take() {
            Some(source) => source,
            None => open_camera(&settings).map(|OpenedCamera { frames, .. }| frames)?,
        };
        Ok(match source.delivers_at_once() {
            true => Box::new(PacedFrames::new(source, pace.clone())),
            false => source,
        })
    }
}

/// The same for its inertial sensor.
fn imu_opener(
    imu: Box<dyn ImuSource>,
    settings: &Settings,
    pace: Pace,
) -> impl FnMut(crate::model::time::Timestamp) -> Result<Box<dyn ImuSource>, DeviceError> + Send + 'static {
    let (mut first, name) = (Some(imu), settings.camera.clone());
    move |_deadline| {
        let imu = match first.take() {
            Some(imu) => imu,
            None => crate::device::open::open(&name)?
                .imu
                .ok_or_else(|| DeviceError::new(&name, "find its IMU again", ErrorKind::Reopen))?,
        };
        Ok(match imu.delivers_at_once() {
            true => Box::new(PacedImu::new(imu, pace.clone())),
            false => imu,
        })
    }
}

/// A settings file that is followed while the daemon runs.
pub struct FollowedFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its content when the settings were read.
    pub content: String,
    /// All settings as a content of the file, and whatever wins over it, say; or every mistake.
    pub read: Box<dyn Fn(&str) -> Result<Settings, String> + Send>,
}

/// What is told of a run that has ended.
pub fn tell_ended(counts: &RunCounts) {
    tracing::info!(
        frames = counts.frames,
        lost_by_source = counts.lost_by_source,
        passed_over = counts.passed_over,
        passed_through = counts.passed_through,
        held = counts.held,
        devices_lost = counts.devices_lost,
        "ended"
    );
}

/// The whole daemon: settings in, run to the end, or until the process is asked to stop. Where the settings name no folder
/// for pictures, `newest` is a file for the newest one.
pub fn run_daemon(
    settings: &Settings,
    file: Option<FollowedFile>,
    newest: Option<PathBuf>,
) -> Result<RunCounts, PipelineError> {
    let system = |what: &str, e: std::io::Error| PipelineError::Output(format!("{what}: {e}"));
    let (inbox, asked) = (Arc::<Inbox>::default(), Asked::default());
    let _signals = StopSignals::follow(Arc::clone(&inbox), &asked, || tell_ended(&RunCounts::default()))
        .map_err(|e| system("signals", e))?;
    let mut sink = match newest {
        Some(file) if settings.pictures_folder.is_empty() => PictureFolder::newest(file),
        _ => PictureFolder::new(&settings.pictures_folder)?,
    };
    let mut prepared = prepare(settings, &Host::default())?;
    prepared.pipeline = prepared.pipeline.for_pictures_alone();
    let live = LiveSettings::new(settings, Arc::clone(prepared.pipeline.scene()), &prepared.cycle);
    let _follows = file
        .map(|FollowedFile { path, content, read }| {
            let clock = Arc::new(MonotonicClock::default());
            let read_again = Arc::clone(&asked.read_again);
            let watched = Watched { path: &path, known: &content, read_again };
            SettingsThread::start_asked(watched, read, live, Arc::clone(&inbox), clock)
        })
        .transpose()
        .map_err(|e| system("the thread that follows the settings", e))?;
    tracing::info!(camera = settings.camera, engine = prepared.engine, "running");
    let _watchdog = Watchdog::start(Arc::clone(&inbox)).map_err(|e| system("the watchdog", e))?;
    asked.loop_begins();
    run_from(inbox, prepared, settings, &mut sink).map(|ran| ran.counts)
}
