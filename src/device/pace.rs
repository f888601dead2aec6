//! Makes a live device of one that delivers at once (a recording, a synthetic room): each item comes when its time has come.

use crate::clock::Clock;
use crate::model::{
    frame::{Exposure, RawFrame},
    imu::ImuSample,
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use crate::{DeviceError, FrameSource, ImuSource, ImuTruth, Truth};
use std::sync::{Arc, Mutex, PoisonError};

/// Where the time line of a recording lies on a clock: its first item comes at once. Clones share it, so that camera and
/// inertial sensor of one recording stay together.
#[derive(Clone)]
pub struct Pace {
    clock: Arc<dyn Clock>,
    offset_ns: Arc<Mutex<Option<i64>>>,
}

impl Pace {
    /// Not started yet.
    pub fn new(clock: Arc<dyn Clock>) -> Self {
        Self { clock, offset_ns: Arc::default() }
    }

    /// The clock's time at which the source's time `t` comes. The first call decides it: now.
    fn due(&self, t: Timestamp) -> Timestamp {
        let mut offset = self.offset_ns.lock().unwrap_or_else(PoisonError::into_inner);
        let offset = *offset.get_or_insert_with(|| self.clock.now().0.saturating_sub(t.0));
        Timestamp(t.0.saturating_add(offset))
    }

    /// Gives the held item when it is due by the deadline, with its time on the clock.
    fn hand_out<T>(
        &self,
        held: &mut Option<T>,
        deadline: Timestamp,
        mut fetch: impl FnMut() -> Result<T, DeviceError>,
        time: impl Fn(&mut T) -> &mut Timestamp,
    ) -> Result<T, DeviceError> {
        let mut item = match held.take() {
            Some(item) => item,
            None => fetch()?,
        };
        let due = self.due(*time(&mut item));
        self.clock.wait_until(due.min(deadline));
        if due > deadline {
            *held = Some(item);
            return Err(DeviceError::again());
        }
        *time(&mut item) = due;
        Ok(item)
    }
}

/// A camera that delivers at once, held to a pace. Times of frames are the clock's.
pub struct PacedFrames<S> {
    source: S,
    pace: Pace,
    held: Option<RawFrame>,
}

impl<S: FrameSource> PacedFrames<S> {
    /// Puts a pace on a source.
    pub fn new(source: S, pace: Pace) -> Self {
        Self { source, pace, held: None }
    }
}

impl<S: FrameSource> FrameSource for PacedFrames<S> {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        let source = &mut self.source;
        self.pace.hand_out(
            &mut self.held,
            deadline,
            || source.next(Timestamp::NEVER),
            |frame| &mut frame.t_mid,
        )
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        self.source.set_exposures(exposures)
    }

    fn rig(&self) -> Option<Rig> {
        self.source.rig()
    }

    fn response(&self) -> Option<Response> {
        self.source.response()
    }

    fn frames_left(&self) -> Option<u64> {
        self.source.frames_left().map(|left| left + u64::from(self.held.is_some()))
    }

    fn truth(&mut self) -> Option<Truth> {
        self.source.truth()
    }
}

/// An inertial sensor that delivers at once, held to a pace. Times of samples are the clock's.
pub struct PacedImu<I> {
    source: I,
    pace: Pace,
    held: Option<ImuSample>,
}

impl<I: ImuSource> PacedImu<I> {
    /// Puts a pace on a source.
    pub fn new(source: I, pace: Pace) -> Self {
        Self { source, pace, held: None }
    }
}

impl<I: ImuSource> ImuSource for PacedImu<I> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        let source = &mut self.source;
        self.pace.hand_out(&mut self.held, deadline, || source.next(Timestamp::NEVER), |sample| &mut sample.t)
    }

    fn imu_truth(&self) -> Option<ImuTruth> {
        self.source.imu_truth()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::ManualClock;
    use crate::{ErrorKind, synthetic};

    #[test]
    fn items_come_when_their_time_has_come() {
        let options = synthetic::Options::parse("frames=3,size=16x16,fps=10,texel_mm=40").unwrap();
        let (frames, imu) = synthetic::open(&options);
        let clock = ManualClock::new(Timestamp::from_seconds(100.0));
        let pace = Pace::new(Arc::new(clock.clone()));
        let mut frames = PacedFrames::new(frames, pace.clone());
        let mut imu = PacedImu::new(imu, pace);
        let soon = |clock: &ManualClock| clock.now().plus_seconds(0.06);
        let first = frames.next(soon(&clock)).unwrap();
        assert_eq!(first.t_mid, Timestamp::from_seconds(100.0));
        // The sensor starts 0.2 s earlier: what is due is given at once.
        let mut samples = Vec::new();
        imu.samples_until(clock.now(), &mut samples).unwrap();
        assert!(samples.len() >= 40 && samples.iter().all(|s| s.t <= clock.now()), "{}", samples.len());
        assert!(!frames.delivers_at_once() && clock.now() == first.t_mid);
        assert_eq!(frames.next(soon(&clock)).unwrap_err().kind, ErrorKind::Again);
        assert_eq!(frames.frames_left(), Some(2));
        let second = frames.next(soon(&clock)).unwrap();
        assert_eq!((second.sequence, clock.now()), (1, second.t_mid));
        assert!((second.t_mid.seconds() - 100.1).abs() < 1e-6);
        let is_last_due = frames.next(Timestamp::NEVER).unwrap();
        assert_eq!(is_last_due.sequence, 2);
        assert_eq!(frames.next(soon(&clock)).unwrap_err().kind, ErrorKind::Ended);
    }
}
