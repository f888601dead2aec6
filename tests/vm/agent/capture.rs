//! Takes frames of a camera, writes a setting after each, and finds out how late settings come into force.

use crate::options::Options;
use crate::video::{self, Video};
use halflight_vm::Strip;
use std::fmt::Write;
use std::io::ErrorKind;

type Outcome = Result<String, String>;

/// How long a frame may take. Only a camera that is silent ever waits for it.
const MOST_WAIT_MS: i32 = 120_000;
/// Error of a call on a device that is gone.
const NO_DEVICE: i32 = 19;
/// Exposure written after the frame with this place, 100 us; no two are alike.
fn exposure_after(place: usize) -> i32 {
    100 + 7 * place as i32
}

/// What was seen of one frame.
struct Seen {
    sequence: u32,
    strip: Strip,
    digest: u64,
}

struct Capture {
    video: Video,
    width: usize,
    seen: Vec<Seen>,
    /// Only one buffer is with the driver at any time, so that no frame is made before the setting is written.
    one: bool,
}

impl Capture {
    fn start(options: &Options) -> Result<Self, String> {
        let told = |what: &str, error: std::io::Error| format!("{what}: {error}");
        let mut video = Video::open(&options.device).map_err(|e| told("open", e))?;
        let (width, height) = options.size;
        let made = video.set_size(width, height).map_err(|e| told("size", e))?;
        if made != (width as usize, height as usize) {
            return Err(format!("{width}x{height} became {made:?}"));
        }
        video.set(video::EXPOSURE_MODE, video::MANUAL).map_err(|e| told("manual exposure", e))?;
        video.set(video::EXPOSURE, 50).map_err(|e| told("exposure", e))?;
        let (count, queued) = if options.one { (2, 1) } else { (4, 4) };
        video.start(count, queued).map_err(|e| told("start", e))?;
        Ok(Self { video, width: made.0, seen: Vec::new(), one: options.one })
    }

    /// One frame, its setting, its buffer back.
    fn step(&mut self, wait_ms: i32) -> std::io::Result<()> {
        let full = self.video.take(wait_ms)?;
        let bytes = self.video.bytes(&full);
        let strip = Strip::of_yuyv(bytes, self.width)
            .ok_or_else(|| std::io::Error::other(format!("frame {} has no strip", full.sequence)))?;
        self.seen.push(Seen { sequence: full.sequence, strip, digest: halflight_vm::digest(bytes) });
        self.video.set(video::EXPOSURE, exposure_after(self.seen.len() - 1))?;
        let next = if self.one { 1 - full.index } else { full.index };
        self.video.queue(next)
    }

    /// Frames from each setting to the first frame that has it, the least and the most. A later setting may have come at once.
    fn lags(&self) -> Option<(usize, usize)> {
        let lags = (0..self.seen.len()).filter_map(|place| {
            let wish = exposure_after(place) as u16;
            // What a stream before this one left in the camera may look the same.
            self.seen[place + 1..].iter().position(|seen| seen.strip.exposure == wish).map(|later| later + 1)
        });
        let all: Vec<usize> = lags.collect();
        Some((*all.iter().min()?, *all.iter().max()?))
    }

    /// Frames that the driver counted and did not deliver, and frames that only the camera counted.
    fn lost(&self) -> (u32, u32) {
        let pairs = self.seen.windows(2);
        pairs.fold((0, 0), |(driver, camera), two| {
            let gap = two[1].sequence - two[0].sequence - 1;
            let numbers = two[1].strip.number.wrapping_sub(two[0].strip.number) - 1;
            (driver + gap, camera + u32::from(numbers))
        })
    }

    fn list(&self) -> String {
        let mut text = String::new();
        for Seen { sequence, strip, digest } in &self.seen {
            // Text takes everything.
            let _ = writeln!(text, "frame {sequence} {} {} {digest:016x}", strip.number, strip.exposure);
        }
        text
    }
}

/// Takes frames; fails where anything is not as the options say.
pub fn run(options: &Options) -> Outcome {
    let mut capture = Capture::start(options)?;
    let wait_ms = if options.silent { 3000 } else { MOST_WAIT_MS };
    let end = loop {
        if !options.until_gone && !options.silent && capture.seen.len() == options.frames {
            break None;
        }
        if let Err(error) = capture.step(wait_ms) {
            break Some(error);
        }
    };
    if !options.out.is_empty() {
        std::fs::write(&options.out, capture.list()).map_err(|e| format!("{}: {e}", options.out))?;
    }
    let seen = capture.seen.len();
    let is_gone = end.as_ref().is_some_and(|error| error.raw_os_error() == Some(NO_DEVICE));
    let is_silent = end.as_ref().is_some_and(|error| error.kind() == ErrorKind::TimedOut);
    if end.is_some() && !(is_gone && options.until_gone || is_silent && options.silent) {
        return Err(format!("after {seen} frames: {end:?}"));
    }
    if end.is_none() {
        capture.video.stop().map_err(|e| format!("stop: {e}"))?;
    }
    let lost = capture.lost();
    if lost != options.lost {
        return Err(format!("lost by driver and in all: {lost:?}, expected {:?}", options.lost));
    }
    let lags = capture.lags();
    if let Some((least, most)) = options.lag {
        let (from, to) = lags.ok_or("no setting came into force")?;
        if from < least || to > most {
            return Err(format!("settings came {from} to {to} frames later, expected {least} to {most}"));
        }
    }
    Ok(format!("{seen} frames, lost {lost:?}, settings came later by {lags:?}, end {end:?}"))
}

/// What the driver must say of the camera's nodes and controls.
pub fn nodes(first: &str, second: &str) -> Outcome {
    let told = |what: &str, error: std::io::Error| format!("{what}: {error}");
    let video = Video::open(first).map_err(|e| told(first, e))?;
    let metadata = Video::open(second).map_err(|e| told(second, e))?;
    let abilities = video.abilities().map_err(|e| told(first, e))?;
    let others = metadata.abilities().map_err(|e| told(second, e))?;
    if abilities & video::CAPTURES == 0 || others & video::CAPTURES != 0 {
        return Err(format!("{abilities:#x} and {others:#x} are not a camera and its metadata"));
    }
    for (control, wanted) in [
        (video::EXPOSURE, (1, 10_000, 1, 156)),
        (video::GAIN, (0, 255, 1, 16)),
        (video::BRIGHTNESS, (-64, 64, 1, 0)),
    ] {
        let range = video.range(control).map_err(|e| told("range", e))?;
        let (least, most, step, default) = wanted;
        if range != (video::Range { least, most, step, default }) {
            return Err(format!("control {control:#x}: {range:?}"));
        }
    }
    let automatic =
        video.set(video::EXPOSURE_MODE, video::APERTURE_PRIORITY).map_err(|e| told("automatic", e))?;
    if automatic != video::APERTURE_PRIORITY || video.set(video::EXPOSURE, 100).is_ok() {
        return Err("exposure can be written while it is automatic".to_owned());
    }
    if video.set(video::EXPOSURE_MODE, 2).is_ok() {
        return Err("a mode that the camera lacks was taken".to_owned());
    }
    video.set(video::EXPOSURE_MODE, video::MANUAL).map_err(|e| told("manual", e))?;
    let clamped = [(0, 1), (20_000, 10_000), (300, 300)];
    for (wish, made) in clamped {
        let value = video.set(video::EXPOSURE, wish).map_err(|e| told("exposure", e))?;
        if value != made {
            return Err(format!("exposure {wish} became {value}, not {made}"));
        }
    }
    Ok(format!("{abilities:#x} and {others:#x}"))
}
