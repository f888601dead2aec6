//! A camera whose exposure is written while it runs, as one whose frames each know their exposure: the loop around
//! [`bracket`](crate::bracket).
//!
//! Each frame asks for the next write, which is done at once; frames wait (at most nine) until it is settled what they were
//! exposed with. A frame of which nobody can know is left out and counted.

use crate::bracket::{Attribution, FrameSeen, Report, Scheduler, Thumbnail, ThumbnailReader};
use crate::developed::{CaptureSource, DevelopedCamera};
use crate::model::{
    frame::{Exposure, RawFrame},
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use crate::{DeviceError, ErrorKind, FrameSource};
use std::collections::VecDeque;

/// Frames in a row of unknown exposure after which brackets are given up: one exposure, which is always known, is worth more
/// than none.
const MOST_UNSURE: u32 = 90;
/// Room for frames that wait, with some to spare.
const ROOM: usize = 32;

/// A driver that can be told an exposure while it runs.
pub trait ExposureControl {
    /// Writes an exposure, which will be in force some frames later; returns what the camera took. May take the time of a
    /// control transfer (some 10 ms).
    fn write_exposure(&mut self, wish: Exposure) -> Result<Exposure, DeviceError>;

    /// Returns whether exposures can be written at all.
    fn can_be_written(&self) -> bool;

    /// Returns whether the driver's times are the start of an exposure; else they are its end.
    fn times_are_starts(&self) -> bool;
}

/// What became of the frames so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BracketCounts {
    /// Handed on with their exposure.
    pub known: u64,
    /// Left out: of unknown exposure, repeated or late.
    pub left_out: u64,
}

/// A camera with exposures in turn.
pub struct BracketedCamera<S> {
    device: String,
    camera: DevelopedCamera<S>,
    scheduler: Option<Scheduler>,
    reader: ThumbnailReader,
    thumbnail: Thumbnail,
    /// Frames by the order of their arrival that are not settled yet.
    waiting: VecDeque<RawFrame>,
    ready: VecDeque<RawFrame>,
    newest: Option<Timestamp>,
    unsure_in_a_row: u32,
    counts: BracketCounts,
}

impl<S: CaptureSource + ExposureControl> BracketedCamera<S> {
    /// `response` is that of the developed pictures.
    pub fn new(device: impl Into<String>, camera: DevelopedCamera<S>, response: &Response) -> Self {
        Self {
            device: device.into(),
            camera,
            scheduler: None,
            reader: ThumbnailReader::new(response),
            thumbnail: Thumbnail::default(),
            waiting: VecDeque::with_capacity(ROOM),
            ready: VecDeque::with_capacity(ROOM),
            newest: None,
            unsure_in_a_row: 0,
            counts: BracketCounts::default(),
        }
    }

    /// What became of the frames so far.
    pub fn counts(&self) -> BracketCounts {
        self.counts
    }

    /// What the scheduler has found; `None` where exposures cannot be written.
    pub fn report(&self) -> Option<Report> {
        self.scheduler.as_ref().map(Scheduler::report)
    }

    fn take(&mut self, frame: RawFrame) -> Result<(), DeviceError> {
        let Some(scheduler) = &mut self.scheduler else {
            self.ready.push_back(frame);
            return Ok(());
        };
        self.reader.read(&frame.pixels, &mut self.thumbnail);
        let sequence = frame.sequence;
        // What the driver said is what it was told last, which is no statement about this frame.
        scheduler.frame(FrameSeen { sequence, t: frame.t_mid, stated: None, thumbnail: &self.thumbnail });
        self.waiting.push_back(frame);
        if let Some(wish) = scheduler.next_write(sequence) {
            let source = self.camera.source_mut();
            let taken = source.write_exposure(wish)?;
            scheduler.written(wish, taken, sequence);
        }
        let at_start = self.camera.source_mut().times_are_starts();
        while let Some(settled) = scheduler.settled() {
            let Some(mut frame) = self.waiting.pop_front() else { break };
            match settled.attribution {
                Attribution::Sure(exposure) => {
                    // The driver placed the middle by the exposure that it was told last.
                    let longer_s = 0.5 * (exposure.time_s - frame.exposure.time_s);
                    let moved_s = if at_start { longer_s } else { -longer_s };
                    frame.t_mid = Timestamp(frame.t_mid.0.saturating_add((moved_s * 1e9) as i64));
                    frame.exposure = exposure;
                    self.counts.known += 1;
                    self.unsure_in_a_row = 0;
                    self.ready.push_back(frame);
                }
                Attribution::Unsure(_) => {
                    self.counts.left_out += 1;
                    self.unsure_in_a_row += 1;
                }
                Attribution::Duplicate | Attribution::Late => self.counts.left_out += 1,
            }
        }
        self.give_up_where_nothing_is_known();
        Ok(())
    }

    fn give_up_where_nothing_is_known(&mut self) {
        let Some(scheduler) = self.scheduler.as_mut().filter(|s| s.cycle().len() > 1) else { return };
        if self.unsure_in_a_row < MOST_UNSURE {
            return;
        }
        self.unsure_in_a_row = 0;
        let middle = scheduler.cycle()[scheduler.cycle().len() / 2];
        tracing::debug!("{}: {:?}", self.device, scheduler.report());
        tracing::warn!(
            "{}: no frame's exposure could be told for {MOST_UNSURE} frames: the camera does not do what it is told, or its pictures \
             are not sRGB; it goes on with one exposure, {:.2} ms",
            self.device,
            1e3 * middle.time_s
        );
        if scheduler.set_cycle(&[middle]).is_ok() {
            scheduler.restart();
            // The frames that wait come out as abandoned, in their order.
        }
    }
}

impl<S: CaptureSource + ExposureControl> FrameSource for BracketedCamera<S> {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        let mut has_come = false;
        loop {
            while let Some(frame) = self.ready.pop_front() {
                // Middles move by half an exposure, so two frames may change places.
                if self.newest.is_none_or(|newest| frame.t_mid > newest) {
                    self.newest = Some(frame.t_mid);
                    return Ok(frame);
                }
                self.counts.left_out += 1;
            }
            let frame = match self.camera.next(deadline) {
                Ok(frame) => frame,
                Err(error) if error.kind == ErrorKind::Again && has_come => {
                    return Err(DeviceError::working());
                }
                Err(error) => return Err(error),
            };
            has_come = true;
            self.take(frame)?;
        }
    }

    /// Takes a cycle of at most nine exposures; returns what the camera makes of them. Where exposures cannot be written
    /// every frame has the one that the camera states.
    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        let taken = self.camera.set_exposures(exposures)?;
        if !self.camera.source_mut().can_be_written() {
            return Ok(taken);
        }
        let refused =
            |e| DeviceError::new(&self.device, "use these exposures", ErrorKind::Refused).because(e);
        match &mut self.scheduler {
            Some(scheduler) => scheduler.set_cycle(&taken).map_err(refused)?,
            none => *none = Some(Scheduler::new(&taken).map_err(refused)?),
        }
        Ok(taken)
    }

    fn rig(&self) -> Option<Rig> {
        self.camera.rig()
    }

    fn response(&self) -> Option<Response> {
        self.camera.response()
    }
}

#[cfg(test)]
mod tests;
