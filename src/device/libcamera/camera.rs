//! A camera of libcamera as a source of frames that are not developed yet.

use super::device::{CompletedRequest, RequestDevice};
use super::exposure::{ExposureCycle, RequestControls, taken};
use super::format::{self, GrantedStream};
use crate::bracket::plan::Limits;
use crate::frame_count::FrameCount;
use crate::model::{
    frame::{CapturedFrame, Exposure},
    pixels::{PixelFormat, PixelLayout, PixelPool},
    rig::Rig,
    time::Timestamp,
};
use crate::v4l2::format::FormatWish;
use crate::v4l2::node::{EBUSY, ENODEV, Ready};
use crate::v4l2::stream::StreamCounts;
use crate::{Clock, DeviceError, ErrorKind, bracketed::ExposureControl, developed::CaptureSource};
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// Damaged frames in a row that mean that the camera has lost its state.
const MOST_DAMAGED_IN_A_ROW: u64 = 30;
/// The longest wait at a time: the camera says only when it is asked that it is gone.
const LONGEST_WAIT: Duration = Duration::from_millis(250);
/// The shortest exposure that is planned, seconds.
const SHORTEST_PLANNED_S: f64 = 1e-4;
/// What requests ask for before anybody has said.
const FIRST: Exposure = Exposure { time_s: 0.01, gain: 1.0 };

/// Whether metadata states exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Statement {
    /// No frame has come.
    Unknown,
    /// It does: each frame's exposure is known.
    Stated,
    /// It does not (USB cameras): a frame's is what its request asked for, which another frame may have had.
    Missing,
}

/// A camera of libcamera. Each frame's exposure is what its metadata states.
pub struct RequestCamera<D: RequestDevice> {
    device: String,
    identity: String,
    is_usb: bool,
    door: D,
    pool: PixelPool<D::Memory>,
    /// What the request of each buffer asked for.
    asked: Vec<Exposure>,
    cycle: ExposureCycle,
    clock: Arc<dyn Clock>,
    layout: PixelLayout,
    granted: GrantedStream,
    frames_per_s: f64,
    statement: Statement,
    sequence: FrameCount,
    counts: StreamCounts,
    damaged_in_a_row: u64,
}

impl<D: RequestDevice> RequestCamera<D> {
    /// Takes the best stream for a wish and starts it. `id` is libcamera's name of the camera. `Refused` where the camera has no
    /// format that is read.
    pub fn start(
        device: &str,
        id: &str,
        mut door: D,
        wish: &FormatWish,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let refused = |action: String| DeviceError::new(device, action, ErrorKind::Refused);
        let offers = door.offers().map_err(|e| failed(device, "list its formats", e))?;
        let Some(choice) = format::choose(&offers, wish) else {
            let wanted = wish.fourcc.map(|f| format!(" as {}", crate::v4l2::format::shown(f)));
            let wanted = wanted.unwrap_or_default();
            let listed = format::listed(&offers);
            return Err(refused(format!("has no format that is read here{wanted}; it offers {listed}")));
        };
        let granted = door.configure(&choice).map_err(|e| failed(device, "set its format", e))?;
        let is_usb = format::is_usb(id);
        let layout = format::layout(&granted, is_usb).filter(|layout| layout.check().is_ok());
        let Some(layout) = layout else {
            let what = granted.format.shown();
            let (width, height) = (granted.width, granted.height);
            let listed = format::listed(&offers);
            let action = format!("gives {what} of {width} x {height}, which is not read; it offers {listed}");
            return Err(refused(action));
        };
        let first = RequestControls::new(FIRST, wish.frames_per_s);
        let buffers = door.start(&layout, &first).map_err(|e| failed(device, "start its stream", e))?;
        if buffers.len() < 2 {
            return Err(refused(format!("has {} buffers; at least 2 are needed", buffers.len())));
        }
        if !door.takes_exposures() {
            tracing::warn!(
                "{device}: its requests take no exposure; every frame has what its metadata states"
            );
        }
        let mut camera = Self {
            device: device.to_owned(),
            identity: String::new(),
            is_usb,
            asked: vec![taken(FIRST); buffers.len()],
            pool: PixelPool::new(buffers),
            door,
            cycle: ExposureCycle::new(FIRST),
            clock,
            layout,
            granted,
            frames_per_s: wish.frames_per_s,
            statement: Statement::Unknown,
            sequence: FrameCount::default(),
            counts: StreamCounts::default(),
            damaged_in_a_row: 0,
        };
        (0..camera.asked.len()).try_for_each(|index| camera.queue(index))?;
        Ok(camera)
    }

    /// Says which camera it is; its format belongs to that, since a camera may code each in its own way.
    pub fn known_as(mut self, who: &str) -> Self {
        self.identity = format!("{who} {}", self.granted.format.shown());
        self
    }

    /// Waits for the first frame, which says whether metadata states exposures; it is left out. Nothing is known of a camera
    /// that gives none by then.
    pub fn look_at_metadata(&mut self, deadline: Timestamp) -> Result<(), DeviceError> {
        match CaptureSource::next(self, deadline) {
            Err(error) if error.kind != ErrorKind::Again => Err(error),
            _ => Ok(()),
        }
    }

    /// What libcamera granted.
    pub fn granted(&self) -> &GrantedStream {
        &self.granted
    }

    /// What was lost so far.
    pub fn counts(&self) -> StreamCounts {
        StreamCounts { gaps: self.sequence.gaps, ..self.counts }
    }

    /// Hands a request over with the exposure whose turn it is.
    fn queue(&mut self, index: usize) -> Result<(), DeviceError> {
        let exposure = self.cycle.take_next();
        if let Some(asked) = self.asked.get_mut(index) {
            *asked = exposure;
        }
        let controls = RequestControls::new(exposure, self.frames_per_s);
        self.door.queue(index, &controls).map_err(|e| failed(&self.device, "hand over a request", e))
    }

    /// The newest frame that has come back; older ones that wait are asked for again.
    fn newest(&mut self) -> Result<Option<CapturedFrame>, DeviceError> {
        let mut newest: Option<(u64, CompletedRequest)> = None;
        while let Some(completed) = self.door.completed() {
            let sequence = self.sequence.next(completed.sequence);
            if completed.has_error || completed.used < self.layout.least_bytes() {
                self.count_damaged(completed.index)?;
                continue;
            }
            if let Some((_, older)) = newest.replace((sequence, completed)) {
                self.counts.passed_over += 1;
                self.queue(older.index)?;
            }
        }
        let Some((sequence, completed)) = newest else { return Ok(None) };
        let Some(Ok(pixels)) = self.pool.lend(completed.index, self.layout, completed.used) else {
            self.count_damaged(completed.index)?;
            return Ok(None);
        };
        self.damaged_in_a_row = 0;
        let exposure = self.exposure_of(&completed);
        // Another clock says nothing: the frame is taken to have just ended.
        let exposed_ns = (1e9 * exposure.time_s) as i64;
        let begun = self.clock.now().0.saturating_sub(completed.age_ns.unwrap_or(exposed_ns));
        let t_mid = Timestamp(begun.saturating_add(exposed_ns / 2));
        Ok(Some(CapturedFrame { sequence, t_mid, exposure, pixels }))
    }

    fn count_damaged(&mut self, index: usize) -> Result<(), DeviceError> {
        self.counts.damaged += 1;
        self.damaged_in_a_row += 1;
        if self.damaged_in_a_row > MOST_DAMAGED_IN_A_ROW {
            let action = format!("{MOST_DAMAGED_IN_A_ROW} damaged frames in a row");
            return Err(DeviceError::new(&self.device, action, ErrorKind::Reopen));
        }
        self.queue(index)
    }

    fn exposure_of(&mut self, completed: &CompletedRequest) -> Exposure {
        let asked = self.asked.get(completed.index).copied().unwrap_or(FIRST);
        let stated = completed.metadata.exposure(asked);
        if self.statement == Statement::Unknown {
            self.statement = if stated.is_some() { Statement::Stated } else { Statement::Missing };
            if stated.is_none() {
                let other = if self.is_usb { "; a camera on USB is better opened as v4l2:" } else { "" };
                tracing::warn!(
                    "{}: its metadata states no exposure; a frame counts as exposed as its request asked until its picture tells{other}",
                    self.device
                );
            }
        }
        stated.unwrap_or(asked)
    }
}

impl<D: RequestDevice> CaptureSource for RequestCamera<D> {
    /// The frame's exposure is what its metadata states; what its request asked for where it states none.
    fn next(&mut self, deadline: Timestamp) -> Result<CapturedFrame, DeviceError> {
        while let Some(index) = self.pool.take_back() {
            self.queue(index)?;
        }
        loop {
            if let Some(frame) = self.newest()? {
                return Ok(frame);
            }
            let now = self.clock.now();
            let left = Duration::from_nanos(deadline.0.saturating_sub(now.0).max(0) as u64);
            match self.door.wait(left.min(LONGEST_WAIT)) {
                Ok(Ready::Filled) => {}
                Ok(Ready::Nothing) if self.clock.now() < deadline => {}
                Ok(Ready::Nothing) => return Err(DeviceError::again()),
                Ok(Ready::Gone) => {
                    return Err(DeviceError::new(&self.device, "was pulled out", ErrorKind::Reopen));
                }
                Err(error) => return Err(failed(&self.device, "wait for a frame", error)),
            }
        }
    }

    /// Requests have these in turn from now on; those that are on their way have the older ones still.
    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        if !self.door.takes_exposures() {
            return Ok(self.cycle.as_slice()[..1].to_vec());
        }
        let all: Vec<Exposure> = exposures.iter().map(|&wish| taken(wish)).collect();
        match self.statement {
            // Somebody else writes one after the other, and tells from the pictures which frame had which.
            Statement::Missing => self.cycle.set(&all[..all.len().min(1)]),
            Statement::Stated | Statement::Unknown => self.cycle.set(&all),
        }
        Ok(all)
    }

    /// A guess of the lens: 60 degrees wide, no distortion. Tags and ball are not known.
    fn rig(&self) -> Option<Rig> {
        let (width, height) = (self.layout.width, self.layout.height);
        Some(Rig::guessed(width as u32, height as u32))
    }

    fn pixel_format(&self) -> Option<PixelFormat> {
        Some(self.layout.format)
    }

    fn identity(&self) -> String {
        self.identity.clone()
    }
}

impl<D: RequestDevice> ExposureControl for RequestCamera<D> {
    /// All requests from the next one on ask for this.
    fn write_exposure(&mut self, wish: Exposure) -> Result<Exposure, DeviceError> {
        self.cycle.set(&[wish]);
        Ok(taken(wish))
    }

    /// Only where frames do not state their exposure: those that do need nobody who tells it.
    fn can_be_written(&self) -> bool {
        self.door.takes_exposures() && self.statement == Statement::Missing
    }

    fn states_exposures(&self) -> bool {
        self.door.takes_exposures() && self.statement == Statement::Stated
    }

    /// The binding tells no limits; these are within those of nearly all sensors, and a frame states what it had.
    fn exposure_limits(&self) -> Option<Limits> {
        self.door.takes_exposures().then(|| Limits {
            least_s: SHORTEST_PLANNED_S,
            most_s: 1.0 / self.frames_per_s,
            step_s: 1e-6,
            frame_interval_s: 1.0 / self.frames_per_s,
            gain: 1.0,
            mains: None,
        })
    }

    fn times_are_starts(&self) -> bool {
        true
    }
}

fn failed(device: &str, action: &str, error: io::Error) -> DeviceError {
    match error.raw_os_error() {
        Some(ENODEV) => DeviceError::new(device, "was pulled out", ErrorKind::Reopen),
        Some(EBUSY) => {
            let action = format!("{action}: another program has the camera");
            DeviceError::new(device, action, ErrorKind::Reopen).because(error)
        }
        _ => DeviceError::new(device, action, ErrorKind::Reopen).because(error),
    }
}
