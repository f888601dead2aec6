//! Runs the pipeline as the settings say.

use super::{
    commands::Commands,
    governing::governor_of,
    host::Host,
    picture_folder::{DaemonSink, PictureFolder},
    prepare::{OpenedCamera, Prepared, open_camera, open_named_imu, prepare_with},
    settings_thread::{Asks, LiveSettings, SettingsThread, Wishes},
    stop_signals::{Asked, StopSignals},
    watchdog::{DEFAULT_PERIOD_S, Watchdog},
};
use crate::config::settings::{RunMode, Settings};
use crate::device::bracketed::FoundResponse;
use crate::device::{
    Clock, DeviceError, ErrorKind, FrameSource, ImuSource,
    clock::{ManualClock, MonotonicClock},
    open,
    pace::{Pace, PacedFrames, PacedImu},
    supervise::{Backoff, Budget, Stopped, Supervision, Supervisor, stop_all},
};
use crate::pipeline::{
    Pipeline, PipelineError,
    inbox::Inbox,
    live::Live,
    lockstep::Lockstep,
    screen::Screen,
    turns::{self, FrameSink, RunCounts},
};
use crate::plan::FramePlan;
use std::path::PathBuf;
use std::sync::Arc;

pub use super::settings_thread::FollowedFile;

/// While a camera is waited for, somebody looks around so often, seconds.
const LOOK_EVERY_S: f64 = 0.25;

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
    let Prepared { source, imu, mut pipeline, found, .. } = prepared;
    let counts = match settings.mode {
        RunMode::Lockstep => {
            if !settings.imu.is_empty() {
                tracing::warn!(
                    "device.imu = \"{}\" is left out: lockstep takes the source's own sensor",
                    settings.imu
                );
            }
            let mut lockstep = Lockstep::new(inbox, source, imu, ManualClock::default())
                .looking_ahead(settings.search_ahead);
            turns::run(&mut lockstep, &mut pipeline, sink, settings.frames)?
        }
        RunMode::Realtime => {
            run_live(inbox, LiveDevices { source, imu, found }, &mut pipeline, settings, sink)?
        }
    };
    Ok(Ran { counts, last_plan: pipeline.plan().clone() })
}

/// What is open when a live run begins.
struct LiveDevices {
    source: Box<dyn FrameSource>,
    imu: Option<Box<dyn ImuSource>>,
    found: FoundResponse,
}

fn run_live(
    inbox: Arc<Inbox>,
    devices: LiveDevices,
    pipeline: &mut Pipeline,
    settings: &Settings,
    sink: &mut dyn FrameSink,
) -> Result<RunCounts, PipelineError> {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::default());
    let LiveDevices { source, imu, found } = devices;
    let pace = Pace::new(Arc::clone(&clock));
    pipeline.go_live();
    let mut live = Live::new(inbox, clock, budget()?);
    let early = settings.search_ahead.then(|| pipeline.early_search());
    live.add_camera(&settings.camera, camera_opener(source, settings, pace.clone(), found), early)?;
    if !settings.imu.is_empty() {
        let (named, clock) = (settings.clone(), Arc::new(MonotonicClock::default()));
        live.add_imu(&settings.imu, move |_| {
            open_named_imu(&named, Arc::<MonotonicClock>::clone(&clock), None)
        })?;
    } else if let Some(imu) = imu {
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
    found: FoundResponse,
) -> impl FnMut(crate::model::time::Timestamp) -> Result<Box<dyn FrameSource>, DeviceError> + Send + 'static {
    let (mut first, settings) = (Some(source), settings.clone());
    move |_deadline| {
        let source = match first.take() {
            Some(source) => source,
            None => open_camera(&settings, &found).map(|OpenedCamera { frames, .. }| frames)?,
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

/// The whole daemon: settings in, run to the end, or until the process is asked to stop. A camera that is not there yet is
/// waited for. Where the settings name no folder for pictures, `newest` is a file for the newest one.
pub fn run_daemon(
    settings: &Settings,
    file: Option<FollowedFile>,
    newest: Option<PathBuf>,
) -> Result<RunCounts, PipelineError> {
    let system = |what: &str, e: std::io::Error| PipelineError::Output(format!("{what}: {e}"));
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::default());
    let (inbox, asked) = (Arc::<Inbox>::default(), Asked::default());
    let _signals = StopSignals::follow(Arc::clone(&inbox), &asked, || tell_ended(&RunCounts::default()))
        .map_err(|e| system("signals", e))?;
    let _watchdog = Watchdog::start(Arc::clone(&inbox)).map_err(|e| system("the watchdog", e))?;
    let mut folder = match newest {
        Some(file) if settings.pictures_folder.is_empty() => PictureFolder::newest(file),
        _ => PictureFolder::new(&settings.pictures_folder)?,
    };
    // Settings that cannot be met are told before a camera is waited for.
    governor_of(settings)?;
    let camera =
        wait_for_camera(&inbox, clock.as_ref(), &mut |missing| folder.say(&missing_lines(missing)), || {
            open_camera(settings, &FoundResponse::default())
        })?;
    let Some(camera) = camera else { return Ok(RunCounts::default()) };
    let mut prepared = prepare_with(camera, settings, &Host::default())?;
    prepared.pipeline = prepared.pipeline.for_pictures_alone();
    let live = LiveSettings::new(settings, Arc::clone(prepared.pipeline.scene()), &prepared.cycle);
    let wishes = Arc::new(Wishes::new(settings));
    let asks = Asks { wishes: Arc::clone(&wishes), read_again: Arc::clone(&asked.read_again) };
    let _follows = SettingsThread::start(file, asks, live, Arc::clone(&inbox), Arc::clone(&clock))
        .map_err(|e| system("the thread that follows the settings", e))?;
    let (screen, attached) = attach(settings, &inbox, &clock, wishes)?;
    let mut sink = DaemonSink { folder, screen, is_see_through: settings.is_see_through };
    tracing::info!(camera = settings.camera, engine = prepared.engine, "running");
    asked.loop_begins();
    let ran = run_from(inbox, prepared, settings, &mut sink);
    for stopped in stop_all(attached) {
        if stopped == Stopped::Abandoned {
            tracing::warn!("a display or a link does not answer and is left as it is");
        }
    }
    ran.map(|ran| ran.counts)
}

/// Starts the threads of the display and of the command link, where the settings name them.
fn attach(
    settings: &Settings,
    inbox: &Arc<Inbox>,
    clock: &Arc<dyn Clock>,
    wishes: Arc<Wishes>,
) -> Result<(Option<Screen>, Vec<Supervisor>), PipelineError> {
    let supervision = |name: &str| -> Result<Supervision, PipelineError> {
        Ok(Supervision {
            name: name.to_owned(),
            clock: Arc::clone(clock),
            budget: budget()?,
            silence_s: None,
        })
    };
    let mut attached = Vec::new();
    let screen = match settings.display.clone() {
        name if name.is_empty() => None,
        name => {
            // A name that is not known is said at once.
            let mut first = Some(open::open_display(&name, Arc::clone(clock))?);
            let (how, clock) = (supervision(&name)?, Arc::clone(clock));
            let opener = move |_| match first.take() {
                Some(display) => Ok(display),
                None => open::open_display(&name, Arc::clone(&clock)),
            };
            let (screen, supervisor) = Screen::start(how, Arc::clone(inbox), opener)?;
            attached.push(supervisor);
            Some(screen)
        }
    };
    if !settings.link.is_empty() {
        let name = settings.link.clone();
        let (how, clock) = (supervision(&name)?, Arc::clone(clock));
        let commands = Commands::new(Arc::clone(inbox), wishes);
        attached.push(commands.serve(how, move |_| open::open_link(&name, Arc::clone(&clock)))?);
    }
    Ok((screen, attached))
}

/// What one watchdog lets everything wait for.
fn budget() -> Result<Budget, PipelineError> {
    let period_s = Watchdog::period_s().unwrap_or(DEFAULT_PERIOD_S);
    Budget::of_watchdog(period_s).map_err(|e| PipelineError::Setup(e.to_string()))
}

/// What a picture says while there is no camera.
fn missing_lines(error: &DeviceError) -> Vec<String> {
    let mut lines = vec!["NO CAMERA".to_owned(), String::new()];
    let text = error.to_string();
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut line = String::new();
    for word in words {
        if line.len() + word.len() > 74 {
            lines.push(std::mem::take(&mut line));
        }
        line.push_str(word);
        line.push(' ');
    }
    lines.push(line);
    lines.push(String::new());
    lines.push("It is looked for again and again: connect one.".to_owned());
    lines
}

/// Opens the camera again and again until it is there, with the waits of a lost device. `None`: the daemon was asked to stop
/// meanwhile.
///
/// # Errors
/// A camera that is refused for good.
fn wait_for_camera(
    inbox: &Inbox,
    clock: &dyn Clock,
    say: &mut dyn FnMut(&DeviceError),
    mut open: impl FnMut() -> Result<OpenedCamera, DeviceError>,
) -> Result<Option<OpenedCamera>, PipelineError> {
    let (mut backoff, began) = (Backoff::default(), clock.now());
    let mut is_said = false;
    loop {
        match open() {
            Ok(camera) => {
                if is_said {
                    let waited_s = clock.now().seconds_since(began);
                    tracing::info!("the camera is there after {waited_s:.1} s");
                }
                return Ok(Some(camera));
            }
            Err(error) if matches!(error.kind, ErrorKind::Reopen | ErrorKind::Again | ErrorKind::Working) => {
                if !std::mem::replace(&mut is_said, true) {
                    tracing::warn!("no camera yet, it is waited for: {error}");
                    say(&error);
                }
            }
            Err(error) => return Err(error.into()),
        }
        let deadline = clock.now().plus_seconds(backoff.advance());
        // Commands and settings wait in their lanes until there is a pipeline that takes them.
        while clock.now() < deadline {
            if inbox.stop_by(deadline.min(clock.now().plus_seconds(LOOK_EVERY_S)), clock) {
                return Ok(None);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::clock::ManualClock;
    use crate::pipeline::event::Command;

    fn missing() -> DeviceError {
        DeviceError::new("camera", "open: there is none", ErrorKind::Reopen)
    }

    fn synthetic() -> Result<OpenedCamera, DeviceError> {
        open_camera(
            &Settings { camera: "synthetic:frames=1".into(), ..Settings::default() },
            &FoundResponse::default(),
        )
    }

    #[test]
    fn a_camera_that_is_not_there_at_the_start_is_waited_for() {
        let (inbox, clock) = (Inbox::default(), ManualClock::default());
        let mut opened_at = Vec::new();
        let camera = wait_for_camera(&inbox, &clock, &mut |_| (), || {
            opened_at.push(clock.now().0 / 1_000_000);
            if opened_at.len() < 8 { Err(missing()) } else { synthetic() }
        });
        assert!(camera.unwrap().is_some());
        assert_eq!(opened_at, [0, 100, 300, 700, 1500, 3100, 5100, 7100]);
        assert!(inbox.turns() > 7, "the watchdog sees that somebody waits");
    }

    #[test]
    fn a_stop_ends_the_wait_and_a_refusal_ends_the_daemon() {
        let (inbox, clock) = (Inbox::default(), ManualClock::default());
        inbox.put_command(Command::Stop).unwrap();
        assert!(wait_for_camera(&inbox, &clock, &mut |_| (), || Err(missing())).unwrap().is_none());
        let refused = || Err(DeviceError::new("camera", "open", ErrorKind::Refused));
        assert!(wait_for_camera(&inbox, &clock, &mut |_| (), refused).is_err());
    }
}
