//! A video node as a source of frames that are not developed yet.

use super::control::{ExposureLimits, ManualExposure};
use super::format::{self, FormatWish};
use super::node::{Filled, Granted, VideoNode};
use super::stream::{Stream, StreamCounts, StreamError, StreamedPicture};
use crate::bracket::plan::Limits;
use crate::model::{
    frame::{CapturedFrame, Exposure},
    pixels::{PixelFormat, PixelLayout},
    rig::Rig,
    time::Timestamp,
};
use crate::{Clock, DeviceError, ErrorKind, bracketed::ExposureControl, developed::CaptureSource};
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// Frames in a row that the driver calls damaged mean that the camera has lost its state.
const MOST_DAMAGED_IN_A_ROW: u64 = 30;

/// A camera of the kernel. Dropping it puts its controls back as they were found.
pub struct V4l2Camera<N: VideoNode> {
    device: String,
    identity: String,
    stream: Stream<N>,
    clock: Arc<dyn Clock>,
    exposure: Option<ManualExposure>,
    /// What the camera was last told.
    told: Exposure,
    layout: PixelLayout,
    granted: Granted,
    frames_per_s: f64,
    times_are_starts: bool,
    /// Damaged frames when the last good one came.
    damaged_before: u64,
}

impl<N: VideoNode> V4l2Camera<N> {
    /// Takes the best format for a wish, puts the exposure in the program's hands and starts. `Refused` where the camera has
    /// no format that is read.
    pub fn start(
        device: &str,
        mut node: N,
        wish: &FormatWish,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let refused = |action: String, kind| DeviceError::new(device, action, kind);
        let offers = node.offers().map_err(|e| failed(device, "list its formats", e))?;
        let Some((offer, _)) = format::best(&offers, wish) else {
            let mut listed: Vec<String> = offers.iter().map(|o| format::shown(o.fourcc)).collect();
            listed.dedup();
            let action = format!("has no format that is read here; it offers {}", listed.join(", "));
            return Err(refused(action, ErrorKind::Refused));
        };
        let offer = offer.clone();
        let granted = node
            .set_format(offer.fourcc, offer.width, offer.height)
            .map_err(|e| failed(device, "set its format", e))?;
        let layout = format::layout(&granted).filter(|layout| layout.check().is_ok()).ok_or_else(|| {
            let what = format::shown(granted.fourcc);
            let action = format!("gives {what} of {} x {}, which is not read", granted.width, granted.height);
            refused(action, ErrorKind::Refused)
        })?;
        // A driver that cannot be asked runs at its own rate.
        let frames_per_s = node.set_rate(wish.frames_per_s).unwrap_or(wish.frames_per_s);
        let exposure = ManualExposure::take(&node, [granted.width, granted.height], frames_per_s);
        if exposure.is_none() {
            tracing::warn!("{device}: the exposure cannot be set; every frame counts as one exposure");
        }
        let mut camera = Self {
            device: device.to_owned(),
            identity: String::new(),
            stream: Stream::start(node, layout).map_err(|e| stream_failed(device, e))?,
            clock,
            exposure,
            told: Exposure { time_s: 0.01, gain: 1.0 },
            layout,
            granted,
            frames_per_s,
            times_are_starts: true,
            damaged_before: 0,
        };
        camera.told = camera.exposure.as_ref().map_or(camera.told, |manual| manual.nearest(camera.told));
        Ok(camera)
    }

    /// Says which camera it is; its format belongs to that, since a camera may code each in its own way.
    pub fn known_as(mut self, who: String) -> Self {
        self.identity = format!("{who} {}", format::shown(self.granted.fourcc));
        self
    }

    /// What can be asked of its exposure; `None` where it cannot be set.
    pub fn exposure_limits(&self) -> Option<ExposureLimits> {
        self.exposure.as_ref().map(ManualExposure::limits)
    }

    /// Columns and rows of its pictures.
    pub fn size(&self) -> (usize, usize) {
        (self.layout.width, self.layout.height)
    }

    /// What the driver granted.
    pub fn granted(&self) -> &Granted {
        &self.granted
    }

    /// The rate that the driver stated, frames a second.
    pub fn frames_per_s(&self) -> f64 {
        self.frames_per_s
    }

    /// What was lost so far.
    pub fn counts(&self) -> StreamCounts {
        self.stream.counts()
    }

    /// The middle of the middle row's exposure, on our clock.
    fn middle_of(&self, filled: &Filled) -> Timestamp {
        let now = self.clock.now();
        let age_ns = match filled.is_monotonic {
            true => crate::clock::monotonic_ns().saturating_sub(filled.time_ns).max(0),
            // Another clock says nothing: the frame is taken to have just ended.
            false => 0,
        };
        let stated = now.0.saturating_sub(age_ns);
        let to_middle_s = 0.5 * self.told.time_s;
        let offset_ns = (if self.times_are_starts { to_middle_s } else { -to_middle_s } * 1e9) as i64;
        Timestamp(stated.saturating_add(offset_ns))
    }
}

impl<N: VideoNode> CaptureSource for V4l2Camera<N> {
    /// The frame's exposure is what the camera was last told, which may not be in force yet: `device::bracket` says which it
    /// was.
    fn next(&mut self, deadline: Timestamp) -> Result<CapturedFrame, DeviceError> {
        loop {
            let left = deadline.0.saturating_sub(self.clock.now().0).max(0);
            let longest = Duration::from_nanos(left as u64);
            match self.stream.next(longest) {
                Ok(StreamedPicture { sequence, filled, pixels }) => {
                    self.damaged_before = self.stream.counts().damaged;
                    self.times_are_starts = filled.at_start && filled.is_monotonic;
                    let t_mid = self.middle_of(&filled);
                    return Ok(CapturedFrame { sequence, t_mid, exposure: self.told, pixels });
                }
                Err(StreamError::Nothing)
                    if self.stream.counts().damaged - self.damaged_before > MOST_DAMAGED_IN_A_ROW =>
                {
                    let action = format!("{MOST_DAMAGED_IN_A_ROW} damaged frames in a row");
                    return Err(DeviceError::new(&self.device, action, ErrorKind::Reopen));
                }
                Err(StreamError::Nothing) if self.clock.now() < deadline => {}
                Err(error) => return Err(stream_failed(&self.device, error)),
            }
        }
    }

    /// Tells what the camera would make of these exposures, and writes the first.
    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        let Some(manual) = &self.exposure else { return Ok(vec![self.told]) };
        let taken: Vec<Exposure> = exposures.iter().map(|&wish| manual.nearest(wish)).collect();
        if let Some(&first) = taken.first() {
            self.write_exposure(first)?;
        }
        Ok(taken)
    }

    /// A guess of the lens: 60 degrees wide, no distortion. Tags and ball are not known.
    fn rig(&self) -> Option<Rig> {
        let (width, height) = self.size();
        Some(Rig::guessed(width as u32, height as u32))
    }

    fn pixel_format(&self) -> Option<PixelFormat> {
        Some(self.layout.format)
    }

    fn identity(&self) -> String {
        self.identity.clone()
    }
}

impl<N: VideoNode> ExposureControl for V4l2Camera<N> {
    fn write_exposure(&mut self, wish: Exposure) -> Result<Exposure, DeviceError> {
        let Some(manual) = &self.exposure else { return Ok(self.told) };
        self.told =
            manual.set(self.stream.node(), wish).map_err(|e| failed(&self.device, "set its exposure", e))?;
        Ok(self.told)
    }

    fn can_be_written(&self) -> bool {
        self.exposure.is_some()
    }

    fn exposure_limits(&self) -> Option<Limits> {
        let limits = self.exposure.as_ref().map(ManualExposure::limits)?;
        Some(Limits {
            least_s: limits.shortest_s,
            most_s: limits.longest_s,
            step_s: limits.step_s,
            frame_interval_s: 1.0 / self.frames_per_s.max(1.0),
            gain: 1.0,
            mains: None,
        })
    }

    fn times_are_starts(&self) -> bool {
        self.times_are_starts
    }
}

impl<N: VideoNode> Drop for V4l2Camera<N> {
    fn drop(&mut self) {
        if let Some(manual) = &mut self.exposure {
            manual.restore(self.stream.node());
        }
    }
}

fn failed(device: &str, action: &str, error: io::Error) -> DeviceError {
    let is_busy = error.raw_os_error() == Some(super::node::EBUSY);
    let action =
        if is_busy { format!("{action}: another program has the camera") } else { action.to_owned() };
    DeviceError::new(device, action, ErrorKind::Reopen).because(error)
}

fn stream_failed(device: &str, error: StreamError) -> DeviceError {
    match error {
        StreamError::Nothing => DeviceError::again(),
        StreamError::Gone => DeviceError::new(device, "was pulled out", ErrorKind::Reopen),
        StreamError::Driver(action, error) => failed(device, action, error),
    }
}
