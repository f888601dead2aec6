//! Makes a live device of one that delivers at once (a recording, a synthetic room): each item comes when its time has come.

use crate::asked_source::ask_source;
use crate::clock::Clock;
use crate::model::{frame::RawFrame, imu::ImuSample, time::Timestamp};
use crate::{DeviceError, FrameSource, ImuSource, ImuTruth};
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

    // It delivers at its pace, and one that is held is still to come.
    ask_source!(set_exposures rig response truth scene pixel_format bracket_report);

    fn frames_left(&self) -> Option<u64> {
        self.source.frames_left().map(|left| left + u64::from(self.held.is_some()))
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
    use crate::ErrorKind;
    use crate::clock::ManualClock;
    use crate::model::image::Rgb8Image;
    use crate::model::{frame::Exposure, rig::Rig};

    /// Gives frames or samples of these times at once.
    struct ListedTimes(Vec<f64>);

    impl ListedTimes {
        fn time(&mut self) -> Result<Timestamp, DeviceError> {
            let ended = || DeviceError::new("listed", "end", ErrorKind::Ended);
            (!self.0.is_empty()).then(|| Timestamp::from_seconds(self.0.remove(0))).ok_or_else(ended)
        }
    }

    impl FrameSource for ListedTimes {
        fn next(&mut self, _deadline: Timestamp) -> Result<RawFrame, DeviceError> {
            Ok(RawFrame {
                sequence: 3 - self.0.len() as u64,
                t_mid: self.time()?,
                exposure: Exposure { time_s: 0.01, gain: 1.0 },
                pixels: Arc::new(Rgb8Image::filled(1, 1, [0; 3])),
                sensor: None,
                row_time_s: 0.0,
                response: None,
            })
        }

        fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
            Ok(exposures.to_vec())
        }

        fn rig(&self) -> Option<Rig> {
            None
        }

        fn frames_left(&self) -> Option<u64> {
            Some(self.0.len() as u64)
        }

        fn delivers_at_once(&self) -> bool {
            true
        }
    }

    impl ImuSource for ListedTimes {
        fn next(&mut self, _deadline: Timestamp) -> Result<ImuSample, DeviceError> {
            Ok(ImuSample { t: self.time()?, gyro_rad_s: [0.0; 3], accel_m_s2: [0.0; 3] })
        }
    }

    #[test]
    fn items_come_when_their_time_has_come() {
        let clock = ManualClock::new(Timestamp::from_seconds(100.0));
        let pace = Pace::new(Arc::new(clock.clone()));
        let mut frames = PacedFrames::new(ListedTimes(vec![1.0, 1.1, 1.2]), pace.clone());
        let mut imu = PacedImu::new(ListedTimes(vec![0.8, 0.9, 1.0, 1.05]), pace);
        let soon = |clock: &ManualClock| clock.now().plus_seconds(0.06);
        let first = frames.next(soon(&clock)).unwrap();
        assert_eq!(first.t_mid, Timestamp::from_seconds(100.0));
        // The sensor starts earlier: what is due is given at once.
        let mut samples = Vec::new();
        imu.samples_until(clock.now(), &mut samples).unwrap();
        let times: Vec<Timestamp> = samples.iter().map(|s| s.t).collect();
        assert_eq!(times, [99.8, 99.9, 100.0].map(Timestamp::from_seconds));
        assert!(!frames.delivers_at_once() && clock.now() == first.t_mid);
        assert_eq!(frames.next(soon(&clock)).unwrap_err().kind, ErrorKind::Again);
        assert_eq!((frames.frames_left(), clock.now()), (Some(2), Timestamp::from_seconds(100.06)));
        let second = frames.next(soon(&clock)).unwrap();
        assert_eq!((second.sequence, second.t_mid), (1, Timestamp::from_seconds(100.1)));
        assert_eq!(clock.now(), second.t_mid);
        assert_eq!(frames.next(Timestamp::NEVER).unwrap().sequence, 2);
        assert_eq!(frames.next(soon(&clock)).unwrap_err().kind, ErrorKind::Ended);
    }
}
