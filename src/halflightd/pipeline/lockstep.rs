//! Lockstep: the same inbox, filled from a recording in order of time, one item after the other. Nothing waits, nothing
//! is passed over, and a manual clock follows the frames, so that a run is the same each time.

use super::event::{Awaited, DeviceRole, Event, EventSource};
use super::inbox::Inbox;
use crate::device::{
    Clock, DeviceError, ErrorKind, FrameSource, ImuSource, Truth, clock::ManualClock, supervise::Backoff,
};
use crate::model::{frame::RawFrame, time::Timestamp};
use std::sync::Arc;

/// Opens a lost camera anew.
pub type Reopen = Box<dyn FnMut() -> Result<Box<dyn FrameSource>, DeviceError>>;

/// Merges a camera and an inertial sensor by time.
pub struct Lockstep {
    inbox: Arc<Inbox>,
    clock: ManualClock,
    /// `None` while it is lost.
    frames: Option<Box<dyn FrameSource>>,
    imu: Option<Box<dyn ImuSource>>,
    /// The next frame, until all samples before it are taken.
    ahead: Option<(RawFrame, Option<Box<Truth>>)>,
    reopen: Option<Reopen>,
    backoff: Backoff,
    /// When a lost camera is opened again.
    reopen_at: Option<Timestamp>,
    /// The frame after the one that is drawn is read already.
    looks_ahead: bool,
    /// What reading ahead came to, until its turn.
    failed_ahead: Option<DeviceError>,
    is_over: bool,
}

/// What filling the inbox came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Filling {
    /// There is something to take.
    Something,
    /// The deadline came first.
    Nothing,
}

impl Lockstep {
    /// Follows sources that are open; `clock` is moved to each frame's time.
    pub fn new(
        inbox: Arc<Inbox>,
        frames: Box<dyn FrameSource>,
        imu: Option<Box<dyn ImuSource>>,
        clock: ManualClock,
    ) -> Self {
        Self {
            inbox,
            clock,
            frames: Some(frames),
            imu,
            ahead: None,
            reopen: None,
            backoff: Backoff::default(),
            reopen_at: None,
            looks_ahead: false,
            failed_ahead: None,
            is_over: false,
        }
    }

    /// Opens a camera that is lost again, after 0.1 s to 2 s of the clock, in place of ending.
    pub fn reopening(mut self, reopen: Reopen) -> Self {
        self.reopen = Some(reopen);
        self
    }

    /// Reads each frame before the one before it is drawn, so that tags are looked for in it meanwhile. The same events come
    /// in the same order.
    pub fn looking_ahead(mut self, looks_ahead: bool) -> Self {
        self.looks_ahead = looks_ahead;
        self
    }

    /// Puts the next item of all sources into the inbox.
    fn fill(&mut self, deadline: Timestamp) -> Filling {
        if self.is_over {
            return Filling::Something;
        }
        if self.ahead.is_none() {
            let read = match self.failed_ahead.take() {
                Some(error) => Err(error),
                None => self.read_frame(deadline),
            };
            match read {
                Ok(Some(frame)) => self.ahead = Some(frame),
                Ok(None) => return Filling::Something,
                Err(error) => return self.handle(error, deadline),
            }
        }
        let until = self.ahead.as_ref().map_or(Timestamp::NEVER, |(frame, _)| frame.t_mid);
        if let Some(imu) = &mut self.imu {
            match imu.next(until) {
                Ok(sample) => {
                    self.inbox.put_imu(sample);
                    return Filling::Something;
                }
                Err(error) if error.kind == ErrorKind::Again => {}
                Err(error) => {
                    self.imu = None;
                    if error.kind != ErrorKind::Ended {
                        self.inbox.put_lost(DeviceRole::Imu, error);
                        return Filling::Something;
                    }
                }
            }
        }
        if let Some((frame, truth)) = self.ahead.take() {
            self.clock.wait_until(frame.t_mid);
            self.inbox.put_frame(frame, truth);
        }
        Filling::Something
    }

    /// The next frame of the camera, opened anew where it was lost; `None`: it is there again, which is told first.
    #[allow(clippy::type_complexity, reason = "a frame with what is known of it")]
    fn read_frame(
        &mut self,
        deadline: Timestamp,
    ) -> Result<Option<(RawFrame, Option<Box<Truth>>)>, DeviceError> {
        let source = match &mut self.frames {
            Some(source) => source,
            lost => {
                let at = self.reopen_at.unwrap_or(self.clock.now());
                if at > deadline {
                    return Err(DeviceError::again());
                }
                self.clock.wait_until(at);
                let Some(reopen) = &mut self.reopen else {
                    return Err(DeviceError::new("the camera", "open it again", ErrorKind::Ended));
                };
                lost.insert(reopen()?)
            }
        };
        let by = if source.delivers_at_once() { Timestamp::NEVER } else { deadline };
        let frame = source.next(by)?;
        let truth = source.truth().map(Box::new);
        if self.reopen_at.take().is_none() {
            return Ok(Some((frame, truth)));
        }
        self.backoff.reset();
        self.ahead = Some((frame, truth));
        self.inbox.put_back(DeviceRole::Camera);
        Ok(None)
    }

    fn handle(&mut self, error: DeviceError, deadline: Timestamp) -> Filling {
        match error.kind {
            ErrorKind::Again | ErrorKind::Working => {
                self.clock.wait_until(deadline);
                return Filling::Nothing;
            }
            ErrorKind::Reopen if self.reopen.is_some() => {
                let was_lost = self.reopen_at.is_some();
                self.frames = None;
                self.reopen_at = Some(self.clock.now().plus_seconds(self.backoff.advance()));
                if !was_lost {
                    self.inbox.put_lost(DeviceRole::Camera, error);
                }
            }
            ErrorKind::Ended => self.end(Ok(())),
            ErrorKind::Reopen | ErrorKind::Refused => self.end(Err(error)),
        }
        Filling::Something
    }

    fn end(&mut self, how: Result<(), DeviceError>) {
        self.is_over = true;
        self.inbox.put_end(how);
    }
}

impl EventSource for Lockstep {
    fn next_event(&mut self, awaited: Awaited) -> Event {
        self.inbox.count_turn();
        loop {
            if let Some(event) = self.inbox.try_take(awaited.frame) {
                return event;
            }
            // A frame that is not wanted yet stays in the inbox until the deadline.
            let waits = !awaited.frame && self.inbox.has_frame();
            if waits {
                self.clock.wait_until(awaited.deadline);
            }
            if waits || self.fill(awaited.deadline) == Filling::Nothing {
                return Event::Due;
            }
        }
    }

    fn now(&self) -> Timestamp {
        self.clock.now()
    }

    fn frame_ahead(&mut self) -> Option<&RawFrame> {
        // Only a source that never waits is asked before its time.
        let is_ready = self.frames.as_ref().is_some_and(|frames| frames.delivers_at_once());
        if self.looks_ahead && is_ready && self.ahead.is_none() && !self.is_over {
            match self.read_frame(Timestamp::NEVER) {
                Ok(frame) => self.ahead = frame.or(self.ahead.take()),
                Err(error) => self.failed_ahead = Some(error),
            }
        }
        self.ahead.as_ref().filter(|_| self.looks_ahead).map(|(frame, _)| frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::open::open;

    #[test]
    fn frames_and_samples_come_merged_by_time() {
        frames_and_samples(false);
        frames_and_samples(true);
    }

    fn frames_and_samples(looks_ahead: bool) {
        let opened = open("synthetic:frames=4,size=16x16,fps=10,texel_mm=20").unwrap();
        let clock = ManualClock::default();
        let mut lockstep = Lockstep::new(Arc::default(), opened.frames, opened.imu, clock.clone())
            .looking_ahead(looks_ahead);
        let awaited = Awaited { frame: true, deadline: Timestamp::NEVER };
        let (mut newest, mut samples, mut frames) = (Timestamp(i64::MIN), 0, 0);
        loop {
            match lockstep.next_event(awaited) {
                Event::Imu(sample) => {
                    assert!(sample.t >= newest, "in order of time");
                    newest = sample.t;
                    samples += 1;
                }
                Event::Frame(arrived) => {
                    assert!(arrived.frame.t_mid >= newest && arrived.passed_over == 0);
                    assert_eq!(clock.now(), arrived.frame.t_mid, "the clock follows");
                    assert!(arrived.truth.is_some());
                    newest = arrived.frame.t_mid;
                    frames += 1;
                    let ahead = lockstep.frame_ahead().map(|frame| frame.sequence);
                    assert_eq!(ahead, (looks_ahead && frames < 4).then_some(arrived.frame.sequence + 1));
                }
                Event::Ended(how) => {
                    how.unwrap();
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
        assert!(frames == 4 && samples > 40, "{frames} {samples}");
        assert!(matches!(lockstep.next_event(awaited), Event::Ended(Ok(()))), "the end stays");
    }

    #[test]
    fn a_frame_that_is_not_wanted_yet_waits_for_the_deadline() {
        let opened = open("synthetic:frames=2,size=16x16,texel_mm=20").unwrap();
        let clock = ManualClock::default();
        let mut lockstep = Lockstep::new(Arc::default(), opened.frames, None, clock.clone());
        let later = Timestamp::from_seconds(9.0);
        assert!(matches!(lockstep.next_event(Awaited { frame: false, deadline: later }), Event::Due));
        assert_eq!(clock.now(), later);
        let wanted = Awaited { frame: true, deadline: later };
        assert!(matches!(lockstep.next_event(wanted), Event::Frame(f) if f.frame.sequence == 0));
    }
}
