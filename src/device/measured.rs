//! What is measured of an open camera: its response, from its own exposures, and how its exposure control behaves.
//!
//! The camera finds both out by itself while it runs ([`bracketed`](crate::bracketed)); this waits for it, and checks what was
//! found on pictures that it was not found from.

use crate::bracket::Report;
use crate::hdr::attribute::{Tolerance, check_exposures};
use crate::model::{
    frame::{Exposure, RawFrame},
    image::Rgb8Image,
    response::Response,
};
use crate::{Clock, DeviceError, ErrorKind, FrameSource, Signal, Timestamp};
use std::sync::Arc;

/// A frame that does not come within this time is given up, seconds.
const PATIENCE_S: f64 = 60.0;
/// Signals are looked for so often while no frame comes, seconds.
const LOOK_EVERY_S: f64 = 0.25;
/// Rounds of a cycle within which each of its exposures must come once.
const MOST_ROUNDS: usize = 30;

/// How a measurement waits: for whom, by which clock, and until which signal.
pub struct Patience<'a> {
    /// The camera's name, for messages.
    pub device: &'a str,
    /// For waits.
    pub clock: &'a dyn Clock,
    /// Raised by whoever wants it to end.
    pub stop: &'a Signal,
}

/// An exposure, told from the pictures through the response that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckedExposure {
    /// What the camera says.
    pub exposure: Exposure,
    /// Against the exposure that shares most with it, as the camera says and as the pictures say; 0 where none shares enough.
    pub stated_ratio: f64,
    /// As the pictures say.
    pub measured_ratio: f64,
}

impl CheckedExposure {
    /// |ln (measured / stated)|; `None` where nothing could be measured.
    pub fn error(&self) -> Option<f64> {
        (self.stated_ratio > 0.0 && self.measured_ratio > 0.0)
            .then(|| (self.measured_ratio / self.stated_ratio).ln().abs())
    }
}

/// A response, and how well it tells exposures.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredResponse {
    /// ln exposure of each 8-bit value.
    pub response: Response,
    /// The exposures of the cycle, on pictures that the response was not found from.
    pub checked: Vec<CheckedExposure>,
    /// Frames until it was found and checked, by the driver's count.
    pub frames: u64,
}

impl MeasuredResponse {
    /// The worst exposure's error, ln; `None` where no two could be compared.
    pub fn worst(&self) -> Option<f64> {
        self.checked.iter().filter_map(CheckedExposure::error).max_by(f64::total_cmp)
    }
}

/// Waits for a camera's response and checks it. The camera has been opened without a response of its own and goes through
/// `cycle`, two exposures or more. `None` where it was stopped.
///
/// # Errors
/// The camera fails, gives no frame, or finds no response.
pub fn response_of(
    frames: &mut dyn FrameSource,
    cycle: &[Exposure],
    waiting: &Patience<'_>,
) -> Result<Option<MeasuredResponse>, DeviceError> {
    let refused = |why: &str| DeviceError::new(waiting.device, why, ErrorKind::Refused);
    let cycle = frames.set_exposures(cycle)?;
    if cycle.len() < 2 {
        return Err(refused("its exposure cannot be set, so nothing tells its response"));
    }
    let mut newest: Vec<Option<Arc<Rgb8Image>>> = vec![None; cycle.len()];
    let mut found = None;
    for _ in 0..MOST_ROUNDS * cycle.len() {
        let Some(frame) = next(frames, waiting)? else { return Ok(None) };
        let Some(response) = &frame.response else {
            return Err(refused(
                "no response was found from its own exposures: let it look at a place at rest, in even light, with \
                 bright and dark parts (-v says more)",
            ));
        };
        found = Some((Arc::clone(response), frame.sequence));
        if let Some(k) = cycle.iter().position(|exposure| *exposure == frame.exposure) {
            newest[k] = Some(frame.pixels);
        }
        if newest.iter().all(Option::is_some) {
            break;
        }
    }
    let (response, frames) = found.ok_or_else(|| refused("no frame came"))?;
    let seen = || newest.iter().zip(&cycle).filter_map(|(picture, e)| Some((picture.as_deref()?, *e)));
    let (pictures, exposures): (Vec<&Rgb8Image>, Vec<Exposure>) = seen().unzip();
    let check = check_exposures(&pictures, &exposures, &response, Tolerance::KNOWN_RESPONSE);
    let checked = exposures.iter().zip(check.reports()).map(|(exposure, report)| CheckedExposure {
        exposure: *exposure,
        stated_ratio: if report.against.is_some() { report.stated_ratio } else { 0.0 },
        measured_ratio: report.measured_ratio,
    });
    let checked = checked.collect();
    Ok(Some(MeasuredResponse { response: Response::clone(&response), checked, frames }))
}

/// Lets a camera go through `cycle` for so many frames of known exposure, and tells what was found of its control. `None` where
/// it was stopped before the first.
///
/// # Errors
/// The camera fails, gives no frame of known exposure, or its exposure cannot be set.
pub fn latency_of(
    frames: &mut dyn FrameSource,
    cycle: &[Exposure],
    count: u64,
    waiting: &Patience<'_>,
    mut each: impl FnMut(),
) -> Result<Option<Report>, DeviceError> {
    frames.set_exposures(cycle)?;
    for k in 0..count {
        if next(frames, waiting)?.is_none() {
            if k == 0 {
                return Ok(None);
            }
            break;
        }
        each();
    }
    let none = "its exposure cannot be set: there is no delay to measure";
    frames
        .bracket_report()
        .map(Some)
        .ok_or_else(|| DeviceError::new(waiting.device, none, ErrorKind::Refused))
}

/// The next frame; `None` where it was stopped.
fn next(frames: &mut dyn FrameSource, waiting: &Patience<'_>) -> Result<Option<RawFrame>, DeviceError> {
    let patience = waiting.clock.now().plus_seconds(PATIENCE_S);
    while !waiting.stop.is_raised() {
        let deadline = match frames.delivers_at_once() {
            true => Timestamp::NEVER,
            false => waiting.clock.now().plus_seconds(LOOK_EVERY_S),
        };
        match frames.next(deadline) {
            Ok(frame) => return Ok(Some(frame)),
            // A camera that works is not silent, however slow it is.
            Err(error) if error.kind == ErrorKind::Working => {}
            Err(error) if error.kind == ErrorKind::Again && waiting.clock.now() < patience => {}
            Err(error) if error.kind == ErrorKind::Again => {
                let why = format!("no frame came within {PATIENCE_S} s");
                return Err(DeviceError::new(waiting.device, why, ErrorKind::Reopen));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}
