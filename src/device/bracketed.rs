//! A camera whose exposure is written while it runs, as one whose frames each know their exposure: the loop around
//! [`bracket`](crate::bracket).
//!
//! Each frame asks for the next write, which is done at once; frames wait (at most nine) until it is settled what they were
//! exposed with. A frame of which nobody can know is left out and counted.
//!
//! Where nobody has said what the camera's values mean, that is found first (`bracket::response`), from some 50 frames that are
//! not handed on. It is kept for when the camera comes back.

use crate::bracket::{
    Attribution, FrameSeen, Report, Scheduler, Thumbnail, ThumbnailReader,
    plan::{Limits, Mains, Planner},
    response::ResponseSearch,
    thumbnail::BLOCKS,
};
use crate::developed::{CaptureSource, DevelopedCamera};
use crate::model::{
    frame::{Exposure, RawFrame},
    pixels::PixelFormat,
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use crate::{DeviceError, ErrorKind, FrameSource};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Frames in a row of unknown exposure after which brackets are given up: one exposure, which is always known, is worth more
/// than none.
const MOST_UNSURE: u32 = 90;
/// Frames with one exposure before brackets are tried again (and the response is looked for, where it is not known); doubled
/// each time that they do not settle.
const TRY_AGAIN_AFTER: u32 = 300;
/// Blocks of a picture that must be well exposed for that: in the dark there is nothing to try.
const WORTH_TRYING: usize = 24;
/// Room for frames that wait, with some to spare.
const ROOM: usize = 32;

/// A driver that can be told an exposure while it runs.
pub trait ExposureControl {
    /// Writes an exposure, which will be in force some frames later; returns what the camera took. May take the time of a
    /// control transfer (some 10 ms).
    fn write_exposure(&mut self, wish: Exposure) -> Result<Exposure, DeviceError>;

    /// Returns whether exposures can be written at all.
    fn can_be_written(&self) -> bool;

    /// Returns whether each frame states its own exposure, and `set_exposures` says which ones come in turn: nothing is to be told
    /// from pictures.
    fn states_exposures(&self) -> bool {
        false
    }

    /// What can be asked of its exposure, at gain 1; `None` where that is not known. `gain` and `mains` are filled in by who plans.
    fn exposure_limits(&self) -> Option<Limits> {
        None
    }

    /// Returns whether the driver's times are the start of an exposure; else they are its end.
    fn times_are_starts(&self) -> bool;
}

/// A camera's identity and its response.
type ResponseOf = (String, Arc<Response>);

/// The response that was found last, and of which camera: it holds when that camera comes back.
#[derive(Clone, Debug, Default)]
pub struct FoundResponse(Arc<Mutex<Option<ResponseOf>>>);

impl FoundResponse {
    fn of(&self, identity: &str) -> Option<Arc<Response>> {
        let found = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        found.as_ref().filter(|(of, _)| of == identity).map(|(_, response)| Arc::clone(response))
    }

    fn keep(&self, identity: String, response: &Arc<Response>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((identity, Arc::clone(response)));
    }
}

/// What is known of a camera's response.
#[derive(Clone, Debug)]
pub enum CameraResponse {
    /// Somebody has said it.
    Stated(Box<Response>),
    /// It is to be found where exposures can be chosen; sRGB until then.
    ToFind(FoundResponse),
}

impl Default for CameraResponse {
    fn default() -> Self {
        Self::ToFind(FoundResponse::default())
    }
}

impl CameraResponse {
    /// What is stated, else sRGB.
    pub fn at_first(&self) -> Response {
        match self {
            Self::Stated(response) => Response::clone(response),
            Self::ToFind(_) => Response::srgb(),
        }
    }
}

/// How exposures are fitted to the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replan {
    /// Lamps that must not flicker.
    pub mains: Option<Mains>,
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
    /// Frames at the front of `ready` that the planner has seen.
    planned: usize,
    to_find: Option<FoundResponse>,
    search: Option<ResponseSearch>,
    found: Option<Arc<Response>>,
    /// The exposures that were asked for.
    cycle: Vec<Exposure>,
    replan: Option<Replan>,
    planner: Option<Planner>,
    /// Frames until brackets are tried again, and how many it will be the next time.
    try_again: Option<u32>,
    next_pause: u32,
}

impl<S: CaptureSource + ExposureControl> BracketedCamera<S> {
    /// `response` is that of the developed pictures; `camera` has been given [`CameraResponse::at_first`].
    pub fn new(device: impl Into<String>, camera: DevelopedCamera<S>, response: CameraResponse) -> Self {
        Self {
            device: device.into(),
            camera,
            scheduler: None,
            reader: ThumbnailReader::new(&response.at_first()),
            thumbnail: Thumbnail::default(),
            waiting: VecDeque::with_capacity(ROOM),
            ready: VecDeque::with_capacity(ROOM),
            newest: None,
            unsure_in_a_row: 0,
            counts: BracketCounts::default(),
            planned: 0,
            to_find: match response {
                CameraResponse::ToFind(found) => Some(found),
                CameraResponse::Stated(_) => None,
            },
            search: None,
            found: None,
            cycle: Vec::new(),
            replan: None,
            planner: None,
            try_again: None,
            next_pause: TRY_AGAIN_AFTER,
        }
    }

    /// Fits the exposures to the scene while the camera runs; `None`: they stay.
    pub fn replanning(mut self, how: Option<Replan>) -> Self {
        self.replan = how;
        self
    }

    /// What became of the frames so far.
    pub fn counts(&self) -> BracketCounts {
        self.counts
    }

    /// What the scheduler has found; `None` where exposures cannot be written.
    pub fn report(&self) -> Option<Report> {
        self.scheduler.as_ref().map(Scheduler::report)
    }

    fn take(&mut self, mut frame: RawFrame) -> Result<(), DeviceError> {
        let is_stated = self.camera.source_mut().states_exposures();
        if self.scheduler.is_none() && !is_stated {
            self.ready.push_back(frame);
            return Ok(());
        }
        self.reader.read(&frame.pixels, &mut self.thumbnail);
        if self.search.is_some() {
            return self.look_for_response(&frame);
        }
        if is_stated {
            frame.response.clone_from(&self.found);
            self.counts.known += 1;
            self.ready.push_back(frame);
        } else {
            self.attribute(frame)?;
        }
        self.fit_exposures()?;
        self.give_up_where_nothing_is_known();
        self.try_again_later()
    }

    /// Lets the planner look at the frames that are known by now, and goes over to its plan.
    fn fit_exposures(&mut self) -> Result<(), DeviceError> {
        let Some(planner) = &mut self.planner else { return Ok(()) };
        if self.scheduler.as_ref().is_some_and(|scheduler| scheduler.cycle().len() < 2) {
            return Ok(());
        }
        let mut has_changed = false;
        for frame in self.ready.iter().skip(self.planned) {
            if planner.minds(frame.exposure) {
                self.reader.read(&frame.pixels, &mut self.thumbnail);
                has_changed |= planner.observe(frame.exposure, &self.thumbnail);
            }
        }
        self.planned = self.ready.len();
        if has_changed {
            let wanted = planner.plan().to_vec();
            let refused =
                |e| DeviceError::new(&self.device, "use these exposures", ErrorKind::Refused).because(e);
            match &mut self.scheduler {
                Some(scheduler) => scheduler.set_cycle(&wanted).map_err(refused)?,
                None => drop(self.camera.set_exposures(&wanted)?),
            }
            let times: Vec<String> = wanted.iter().map(|e| format!("{:.2}", 1e3 * e.time_s)).collect();
            tracing::info!("{}: exposures fitted to the scene: {} ms", self.device, times.join(", "));
            self.cycle = wanted;
        }
        Ok(())
    }

    /// A planner that begins with the exposures in use.
    fn begin_planning(&mut self) {
        self.planner = None;
        let (Some(replan), [first, _, ..]) = (self.replan, self.cycle.as_slice()) else { return };
        let Some(limits) = self.camera.source_mut().exposure_limits() else { return };
        let limits = Limits { gain: first.gain, mains: replan.mains, ..limits };
        let response = self.camera.response().unwrap_or_else(Response::srgb);
        match Planner::new(self.cycle.len(), limits, &response) {
            Ok(planner) => self.planner = Some(planner.beginning_with(&self.cycle)),
            Err(error) => tracing::warn!("{}: its exposures stay as they are: {error}", self.device),
        }
    }

    fn attribute(&mut self, frame: RawFrame) -> Result<(), DeviceError> {
        let Some(scheduler) = &mut self.scheduler else { return Ok(()) };
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
                    frame.response.clone_from(&self.found);
                    self.counts.known += 1;
                    self.unsure_in_a_row = 0;
                    if scheduler.cycle().len() > 1 {
                        self.next_pause = TRY_AGAIN_AFTER;
                    }
                    self.ready.push_back(frame);
                }
                Attribution::Unsure(_) => {
                    self.counts.left_out += 1;
                    self.unsure_in_a_row += 1;
                }
                Attribution::Duplicate | Attribution::Late => self.counts.left_out += 1,
            }
        }
        Ok(())
    }

    fn begin_cycle(&mut self) -> Result<(), DeviceError> {
        if self.camera.source_mut().states_exposures() {
            self.camera.set_exposures(&self.cycle)?;
            self.begin_planning();
            return Ok(());
        }
        let refused =
            |e| DeviceError::new(&self.device, "use these exposures", ErrorKind::Refused).because(e);
        self.scheduler = Some(Scheduler::new(&self.cycle).map_err(refused)?);
        self.waiting.clear();
        self.unsure_in_a_row = 0;
        self.begin_planning();
        Ok(())
    }

    /// Counts the frames with one exposure, and tries brackets again after some, where there is something to see.
    fn try_again_later(&mut self) -> Result<(), DeviceError> {
        let Some(left) = self.try_again.as_mut() else { return Ok(()) };
        *left = left.saturating_sub(1);
        let is_worth_it = || {
            let blocks = (0..BLOCKS).filter(|block| self.thumbnail.well_exposed(*block).is_some());
            blocks.count() >= WORTH_TRYING
        };
        if *left > 0 || !is_worth_it() {
            return Ok(());
        }
        self.try_again = None;
        match self.to_find.is_some() && self.found.is_none() {
            true => self.begin_search(),
            false => self.begin_cycle(),
        }
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
            "{}: no frame's exposure could be told for {MOST_UNSURE} frames: the camera does not do what it is told, or its response is \
             not the one that is used; it goes on with one exposure, {:.2} ms",
            self.device,
            1e3 * middle.time_s
        );
        if scheduler.set_cycle(&[middle]).is_ok() {
            scheduler.restart();
            // The frames that wait come out as abandoned, in their order.
        }
        self.wait_before_trying_again();
    }

    fn wait_before_trying_again(&mut self) {
        self.try_again = Some(self.next_pause);
        self.next_pause = self.next_pause.saturating_mul(2);
    }
}

impl<S: CaptureSource + ExposureControl> FrameSource for BracketedCamera<S> {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        let mut has_come = false;
        loop {
            while let Some(frame) = self.ready.pop_front() {
                self.planned = self.planned.saturating_sub(1);
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
        let source = self.camera.source_mut();
        let is_stated = source.states_exposures();
        if !source.can_be_written() && !is_stated {
            return Ok(taken);
        }
        let refused =
            |e| DeviceError::new(&self.device, "use these exposures", ErrorKind::Refused).because(e);
        let is_first = self.cycle.is_empty();
        self.cycle.clone_from(&taken);
        match &mut self.scheduler {
            _ if is_stated => {}
            Some(scheduler) => scheduler.set_cycle(&taken).map_err(refused)?,
            none => *none = Some(Scheduler::new(&taken).map_err(refused)?),
        }
        if is_first {
            self.know_response()?;
        } else if self.search.is_some() {
            // The camera was just told another exposure than the one that is held.
            self.begin_search()?;
        }
        self.begin_planning();
        Ok(taken)
    }

    fn rig(&self) -> Option<Rig> {
        self.camera.rig()
    }

    fn response(&self) -> Option<Response> {
        self.camera.response()
    }

    fn pixel_format(&self) -> Option<PixelFormat> {
        self.camera.pixel_format()
    }

    fn bracket_report(&self) -> Option<Report> {
        self.report()
    }
}

mod finding;
#[cfg(test)]
mod tests;
