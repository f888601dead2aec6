//! `halflight record`

use super::output::shown;
use super::progress::Bar;
use super::run_folder::{need_folder_of, refuse_existing};
use super::wire_file::{WireFile, record_alone};
use super::{CliError, GlobalOptions};
use crate::assets::whole::WholeFile;
use crate::config::Settings;
use crate::daemon::prepare::{camera_options, open_named_imu};
use crate::daemon::{exit, stop_signals, version};
use crate::device::bracketed::FoundResponse;
use crate::device::clock::MonotonicClock;
use crate::device::primed::PrimedSource;
use crate::device::record::{ImuRecorder, Recorder, Tape};
use crate::device::recording::{PictureCoding, RecordingOrigin, RecordingWriter, Setup};
use crate::device::{Clock, ErrorKind, FrameSource, ImuSource, Signal, Truth, open};
use crate::lab::digest::PixelDigest;
use crate::model::{
    frame::{Exposure, RawFrame},
    path_text,
    time::Timestamp,
};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How pictures are stored.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct Coding {
    /// Store pictures as JPEG of this quality, 1 to 100 (about 100 kB a frame of 640x480 at 93).
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
    /// Store pictures as PNG: exact.
    #[arg(long, conflicts_with = "jpeg")]
    png: bool,
    /// Store pictures as they are: exact.
    #[arg(long, conflicts_with_all = ["jpeg", "png"])]
    raw: bool,
}

impl Coding {
    /// What was chosen.
    pub fn chosen(&self) -> Result<PictureCoding, CliError> {
        Ok(match (self.raw, self.png, self.jpeg) {
            (true, ..) => PictureCoding::Raw,
            (_, true, _) => PictureCoding::Png,
            (.., quality) => PictureCoding::Jpeg(quality.unwrap_or(93)),
        })
    }
}

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Record a device to an MCAP file: its pictures, its inertial samples, and what it knows of lens, tags and \
ball.\n\n\
Examples:\n\n\
  halflight record synthetic:frames=30,seed=4 --out room.mcap --png\n\
  halflight record v4l2:/dev/video0 --seconds 10 --out desk.mcap\n\
  halflight record --imu serial:/dev/ttyUSB0,protocol=rvc --seconds 10 --wire-log sensor.wire";

/// Arguments of `halflight record`.
#[derive(clap::Args, Debug)]
pub struct RecordArguments {
    /// The device, e.g. v4l2:/dev/video0, auto, synthetic:frames=90 or replay:desk.mcap (a replay can so be stored anew).
    /// Without it, with --wire-log, a sensor by itself.
    #[arg(required_unless_present = "wire_log")]
    device: Option<OsString>,
    /// The recording to write (MCAP); needed with a device.
    #[arg(long, value_name = "FILE.mcap", required_unless_present = "wire_log", requires = "device")]
    out: Option<PathBuf>,
    /// Stop after this many seconds of the camera's time.
    #[arg(long)]
    pub(super) seconds: Option<f64>,
    /// Stop after this many frames.
    #[arg(long)]
    frames: Option<u64>,
    /// Exposure times that a camera goes through in turn, seconds, e.g. 0.001,0.004,0.016 (default: camera.exposures_s).
    #[arg(long, value_name = "S,S,..", value_delimiter = ',')]
    exposures_s: Vec<f64>,
    /// The inertial sensor to record beside a camera, e.g. serial:/dev/ttyUSB0,protocol=rvc (default: device.imu, or the
    /// camera's own).
    #[arg(long, value_name = "NAME")]
    pub(super) imu: Option<String>,
    /// Write every byte that comes from the sensor (serial, HID) to this file, to look at faults and to play it again.
    #[arg(long, value_name = "FILE")]
    wire_log: Option<PathBuf>,
    /// Replace a recording or a log that is there.
    #[arg(long)]
    pub(super) force: bool,
    /// How pictures are stored (default: --jpeg 93).
    #[command(flatten)]
    coding: Coding,
}

/// A signal to end the recording, which SIGINT and SIGTERM raise from now on.
///
/// # Errors
/// The system gives no handler.
pub fn stop_of_signals() -> Result<Signal, CliError> {
    let stop = Signal::default();
    stop_signals::raise(stop.clone()).map_err(|e| CliError::on("signals", e))?;
    Ok(stop)
}

/// The tape of a recording that is there whole or not at all.
pub type WholeTape = Tape<WholeFile>;

/// Begins a recording.
///
/// # Errors
/// The file cannot be made.
pub fn tape(out: &Path, coding: PictureCoding, setup: Setup) -> Result<WholeTape, CliError> {
    let target =
        WholeFile::create(out).map_err(|e| CliError::on(out.display(), format!("cannot be written: {e}")))?;
    Ok(Tape::new(RecordingWriter::new(format!("record:{}", out.display()), target, coding, setup)?))
}

/// Who records what, for the file's own notes.
pub fn origin(verb: &str, device: &str, settings: String, frames: &impl FrameSource) -> RecordingOrigin {
    RecordingOrigin {
        program: format!("halflight {verb}"),
        version: version::SHORT.to_owned(),
        device: device.to_owned(),
        settings,
        scene: frames.scene().unwrap_or_default(),
    }
}

/// When to stop; a source that ends stops too.
pub struct Limit {
    /// As soon as it is raised.
    pub stop: Signal,
    /// After so many frames.
    pub frames: Option<u64>,
    /// After so many seconds since the first frame.
    pub seconds: Option<f64>,
}

/// What passed.
#[derive(Default)]
pub struct RecordedFrames {
    frames: u64,
    imu_samples: usize,
    size: (usize, usize),
    exposures: Vec<Exposure>,
    span_s: f64,
    truth: Option<Truth>,
    digest: PixelDigest,
    /// The wire log and its bytes, where one was asked for.
    wire_log: Option<(PathBuf, u64)>,
}

/// A frame that does not come within this time is given up. A camera needs some 24 frames until it is known which exposure a
/// frame had, and a slow one gives few a second.
const PATIENCE_S: f64 = 60.0;
/// Signals are looked for so often while no frame comes, seconds.
const LOOK_EVERY_S: f64 = 0.25;

/// Draws frames and samples through the tees until the limit, with a progress bar. A sensor with the world's time is read on a
/// thread of its own: its samples' times are those of their arrival.
pub fn pump(
    frames: &mut dyn FrameSource,
    imu: Option<&mut dyn ImuSource>,
    limit: &Limit,
    expected: u64,
) -> Result<RecordedFrames, CliError> {
    let sensor = match imu {
        Some(imu) if !imu.delivers_at_once() => imu,
        at_once => return draw(frames, at_once, limit, expected),
    };
    let done = Signal::default();
    std::thread::scope(|scope| {
        let samples = scope.spawn(|| drain(sensor, &done));
        let seen = draw(frames, None, limit, expected);
        done.raise();
        let imu_samples = samples.join().unwrap_or(0);
        seen.map(|seen| RecordedFrames { imu_samples, ..seen })
    })
}

/// Reads samples until `done`; gives their number. A sensor that goes away does not end the recording.
fn drain(imu: &mut dyn ImuSource, done: &Signal) -> usize {
    let clock = MonotonicClock::new();
    let mut count = 0;
    while !done.is_raised() {
        match imu.next(clock.now().plus_seconds(LOOK_EVERY_S)) {
            Ok(_) => count += 1,
            Err(error) if matches!(error.kind, ErrorKind::Again | ErrorKind::Working) => {}
            Err(error) => {
                tracing::warn!("the recording goes on without its inertial sensor: {error}");
                break;
            }
        }
    }
    count
}

/// Draws frames, and samples up to each.
fn draw(
    frames: &mut dyn FrameSource,
    mut imu: Option<&mut dyn ImuSource>,
    limit: &Limit,
    expected: u64,
) -> Result<RecordedFrames, CliError> {
    let bar = Bar::of_count(Some(expected), "frames");
    let clock = MonotonicClock::new();
    let mut seen = RecordedFrames::default();
    let mut samples = Vec::new();
    let mut first = None;
    let mut patience = clock.now().plus_seconds(PATIENCE_S);
    while !limit.stop.is_raised() && limit.frames.is_none_or(|most| seen.frames < most) {
        let deadline = match frames.delivers_at_once() {
            true => Timestamp::NEVER,
            false => clock.now().plus_seconds(LOOK_EVERY_S),
        };
        let frame = match frames.next(deadline) {
            Ok(frame) => frame,
            Err(error)
                if matches!(error.kind, ErrorKind::Again | ErrorKind::Working) && clock.now() < patience =>
            {
                continue;
            }
            Err(error) if matches!(error.kind, ErrorKind::Again | ErrorKind::Working) => {
                let why = format!("no frame of known exposure came within {PATIENCE_S} s");
                return Err(CliError(why).with_status(exit::DEVICE));
            }
            Err(error) if error.kind == ErrorKind::Ended => break,
            // What was recorded before the device went away is worth keeping.
            Err(error) if error.kind == ErrorKind::Reopen && seen.frames > 0 => {
                tracing::warn!("the recording ends here: {error}");
                break;
            }
            Err(error) => return Err(error.into()),
        };
        patience = clock.now().plus_seconds(PATIENCE_S);
        let start = *first.get_or_insert(frame.t_mid);
        seen.span_s = frame.t_mid.seconds_since(start);
        seen.size = (frame.pixels.width(), frame.pixels.height());
        if !seen.exposures.contains(&frame.exposure) {
            seen.exposures.push(frame.exposure);
        }
        seen.digest.add_bytes(frame.pixels.pixels());
        seen.frames += 1;
        if let Some(imu) = imu.as_deref_mut() {
            samples.clear();
            imu.samples_until(frame.t_mid, &mut samples)?;
            seen.imu_samples += samples.len();
        }
        bar.add_one();
        if limit.seconds.is_some_and(|most| seen.span_s >= most) {
            break;
        }
    }
    if seen.frames == 0 && limit.stop.is_raised() {
        return Err(CliError("interrupted before the first frame: nothing is recorded".into())
            .with_status(exit::INTERRUPTED));
    }
    if seen.frames == 0 {
        let why =
            "it gave no frame (is its topic there, and does it begin after the end?): nothing is recorded";
        return Err(CliError(why.into()));
    }
    seen.truth = frames.truth();
    drop(bar);
    Ok(seen)
}

/// Closes the file and says what is in it.
pub fn report(
    verb: &str,
    out: &Path,
    tape: &WholeTape,
    seen: RecordedFrames,
    coding: PictureCoding,
    global: &GlobalOptions,
) -> Result<(), CliError> {
    let (written, target) = tape.finish().map_err(|e| CliError::on(verb, e))?;
    if let Some(target) = target {
        target.commit().map_err(|e| CliError::on(out.display(), format!("cannot be written: {e}")))?;
    }
    let bytes = std::fs::metadata(out).map(|m| m.len()).unwrap_or(0);
    let times: Vec<f64> = seen.exposures.iter().map(|e| e.time_s).collect();
    let (width, height) = seen.size;
    let to_light = seen.truth.map(|truth| truth.to_light_world);
    let digest = global.digest.then(|| seen.digest.hex());
    if global.json {
        let report = serde_json::json!({
            "format": super::JSON_FORMAT, "file": shown(out), "bytes": bytes, "frames": written.frames, "imu_samples": written.imu_samples,
            "chunks": written.chunks, "width_px": width, "height_px": height, "exposures_s": times,
            "span_s": seen.span_s, "coding": format!("{coding:?}"), "to_light_world": to_light, "digest": digest,
            "wire_log": seen.wire_log.as_ref().map(|(path, _)| shown(path)),
            "wire_log_bytes": seen.wire_log.as_ref().map(|(_, bytes)| bytes),
        });
        println!("{report}");
        return Ok(());
    }
    println!(
        "{}: {:.2} MB, {} frames of {width}x{height} over {:.2} s as {coding:?}, {} inertial samples, {} chunks",
        out.display(),
        bytes as f64 * 1e-6,
        written.frames,
        seen.span_s,
        written.imu_samples,
        written.chunks
    );
    let times: Vec<String> = times.iter().map(|t| format!("1/{:.0}", 1.0 / t)).collect();
    println!("exposures: {} s", times.join(", "));
    if let Some((path, bytes)) = &seen.wire_log {
        println!("{}: {:.1} kB came over the sensor's wire", path.display(), *bytes as f64 * 1e-3);
    }
    if let Some([x, y, z]) = to_light {
        println!(
            "true dominant light from ({x:.4}, {y:.4}, {z:.4}), {:.1} degrees high",
            z.asin().to_degrees()
        );
    }
    if let Some(digest) = digest {
        println!("digest {digest}");
    }
    Ok(())
}

/// Waits for the first frame of a camera, which finds out about itself until then; `None` where the recording was stopped.
fn first_frame(frames: &mut dyn FrameSource, stop: &Signal) -> Result<Option<RawFrame>, CliError> {
    let clock = MonotonicClock::new();
    let patience = clock.now().plus_seconds(PATIENCE_S);
    while !stop.is_raised() {
        match frames.next(clock.now().plus_seconds(LOOK_EVERY_S)) {
            Ok(frame) => return Ok(Some(frame)),
            Err(error) if !matches!(error.kind, ErrorKind::Again | ErrorKind::Working) => {
                return Err(error.into());
            }
            // A camera that works is not silent, however slow it is.
            Err(error) if error.kind == ErrorKind::Again && clock.now() >= patience => {
                let why = format!("no frame came within {PATIENCE_S} s");
                return Err(CliError(why).with_status(exit::DEVICE));
            }
            Err(_) => {}
        }
    }
    Ok(None)
}

/// The file that a device name reads, if it reads one.
fn replayed(device: &str) -> PathBuf {
    let rest = device.strip_prefix("replay:").unwrap_or(device);
    crate::device::replay::ReplayOptions::parse(rest).map(|o| o.path).unwrap_or_default()
}

/// The exposures that a camera is asked for: those given, else those of the settings.
///
/// # Errors
/// A time that no camera has.
pub fn exposures_of(given: &[f64], global: &GlobalOptions) -> Result<Vec<Exposure>, CliError> {
    let settings = global.settings(None)?;
    if let Some(bad) = given.iter().find(|s| !(20e-6..=1.0).contains(*s)) {
        return Err(CliError::on(format!("--exposures-s {bad}"), "must be within 0.00002..=1 s"));
    }
    let times = if given.is_empty() { &settings.exposures_s } else { given };
    Ok(times.iter().map(|&time_s| Exposure { time_s, gain: settings.gain }).collect())
}

/// The limits that were asked for.
fn settings(arguments: &RecordArguments) -> String {
    let frames = arguments.frames.map(|n| format!("frames={n}"));
    let seconds = arguments.seconds.map(|s| format!("seconds={s}"));
    frames.into_iter().chain(seconds).collect::<Vec<_>>().join(",")
}

/// Runs `halflight record`.
pub fn run(arguments: RecordArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let a = &arguments;
    if let Some(seconds) = a.seconds.filter(|s| !(*s > 0.0 && s.is_finite())) {
        return Err(CliError::on(format!("--seconds {seconds}"), "must be positive"));
    }
    match (&a.device, &a.out, &a.wire_log) {
        (Some(device), Some(out), _) => run_camera(a, &path_text::to_text(Path::new(device)), out, global),
        (None, _, Some(log)) => record_alone(a, log, global),
        _ => Err(CliError("--out: a device is recorded to a file, name it".into())),
    }
}

/// A sensor and its wire log, as far as they were asked for.
type SensorAndLog = (Option<Box<dyn ImuSource>>, Option<WireFile>);

/// Opens the sensor that was asked for, with its wire log; `None` where none was.
fn open_sensor(a: &RecordArguments, settings: &mut Settings) -> Result<SensorAndLog, CliError> {
    if let Some(name) = &a.imu {
        settings.imu.clone_from(name);
    }
    let log = a.wire_log.as_ref().map(|path| WireFile::create(path, &settings.imu, a.force)).transpose()?;
    if settings.imu.is_empty() {
        return Ok((None, log));
    }
    let raw = log.as_ref().map(|log| log.writer(&settings.imu)).transpose()?;
    let imu = open_named_imu(settings, Arc::new(MonotonicClock::new()), raw)?;
    Ok((Some(imu), log))
}

fn run_camera(a: &RecordArguments, device: &str, out: &Path, global: &GlobalOptions) -> Result<(), CliError> {
    let (coding, stop) = (a.coding.chosen()?, stop_of_signals()?);
    need_folder_of(out)?;
    if let (Ok(from), Ok(to)) = (replayed(device).canonicalize(), out.canonicalize())
        && from == to
    {
        return Err(CliError::on(format!("--out {}", out.display()), "is the recording that is read"));
    }
    refuse_existing(out, a.force)?;
    let mut settings_of = global.settings(None)?;
    device.clone_into(&mut settings_of.camera);
    // Exposures that were asked for are kept.
    settings_of.replan &= a.exposures_s.is_empty();
    let options = camera_options(&settings_of, &FoundResponse::default())?;
    let mut opened = open::open_with(device, options)?;
    if !opened.frames.delivers_at_once() || !a.exposures_s.is_empty() {
        let cycle = opened.frames.set_exposures(&exposures_of(&a.exposures_s, global)?)?;
        let times: Vec<String> = cycle.iter().map(|e| format!("{:.4}", e.time_s)).collect();
        tracing::info!("exposures in turn: {} s", times.join(", "));
    }
    let first = match opened.frames.delivers_at_once() {
        true => None,
        false => first_frame(opened.frames.as_mut(), &stop)?,
    };
    let (sensor, log) = open_sensor(a, &mut settings_of)?;
    opened.imu = sensor.or(opened.imu);
    let setup = Setup {
        rig: opened.frames.rig(),
        response: opened.frames.response(),
        imu_truth: opened.imu.as_ref().and_then(|imu| imu.imu_truth()),
        origin: origin("record", device, settings(a), &opened.frames),
    };
    if setup.rig.is_none() {
        tracing::warn!("{device} states no lens: the recording will have no calibration");
    }
    let expected = a.frames.or(opened.frames.frames_left()).unwrap_or(0);
    let tape = tape(out, coding, setup)?;
    let mut frames = Recorder::new(PrimedSource::new(opened.frames, first), tape.clone());
    let mut imu = opened.imu.map(|imu| ImuRecorder::new(imu, tape.clone()));
    let limit = Limit { stop, frames: a.frames, seconds: a.seconds };
    let tee = imu.as_mut().map(|imu| imu as &mut dyn ImuSource);
    let mut seen = pump(&mut frames, tee, &limit, expected)?;
    drop(imu);
    if let (Some(log), Some(path)) = (log, &a.wire_log) {
        seen.wire_log = Some((path.clone(), log.finish()?));
    }
    report("record", out, &tape, seen, coding, global)
}
