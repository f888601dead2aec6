//! Live: a thread for each device puts what it gives into the inbox, and the pipeline takes from it as time passes.

use super::event::{Awaited, DeviceRole, Event, EventSource};
use super::inbox::Inbox;
use super::tracking::EarlySearch;
use crate::device::{
    Clock, DeviceError, FrameSource, ImuSource,
    supervise::{Budget, Delivery, Stopped, Supervision, Supervisor, stop_all, supervise},
};
use crate::model::time::Timestamp;
use std::sync::Arc;

/// A camera that gives nothing at all for so long is opened anew, seconds.
const SILENCE_S: f64 = 2.0;

/// The inbox with the threads that fill it.
pub struct Live {
    inbox: Arc<Inbox>,
    clock: Arc<dyn Clock>,
    budget: Budget,
    supervisors: Vec<Supervisor>,
}

impl Live {
    /// No device yet.
    pub fn new(inbox: Arc<Inbox>, clock: Arc<dyn Clock>, budget: Budget) -> Self {
        Self { inbox, clock, budget, supervisors: Vec::new() }
    }

    fn supervision(&self, name: &str) -> Supervision {
        Supervision {
            name: name.to_owned(),
            clock: Arc::clone(&self.clock),
            budget: self.budget,
            silence_s: Some(SILENCE_S),
        }
    }

    /// Starts a camera's thread. `open` opens it, and opens it anew when it was lost. When it ends or refuses, there are
    /// no more frames. Tags are looked for in each frame as soon as it has come, with `early`.
    ///
    /// # Errors
    /// `Refused` where no thread can be made.
    pub fn add_camera(
        &mut self,
        name: &str,
        open: impl FnMut(Timestamp) -> Result<Box<dyn FrameSource>, DeviceError> + Send + 'static,
        early: Option<EarlySearch>,
    ) -> Result<(), DeviceError> {
        let inbox = Arc::clone(&self.inbox);
        let next = |source: &mut Box<dyn FrameSource>, deadline| {
            let frame = source.next(deadline)?;
            Ok((frame, source.truth().map(Box::new)))
        };
        let deliver = move |delivery| {
            match delivery {
                Delivery::Item((frame, truth)) => {
                    if let Some(early) = &early {
                        early.offer(&frame);
                    }
                    inbox.put_frame(frame, truth);
                }
                Delivery::Lost(error) => inbox.put_lost(DeviceRole::Camera, error),
                Delivery::Back => inbox.put_back(DeviceRole::Camera),
                Delivery::Refused(error) => inbox.put_end(Err(error)),
                Delivery::Ended => inbox.put_end(Ok(())),
            }
            true
        };
        self.supervisors.push(supervise(self.supervision(name), open, next, deliver)?);
        Ok(())
    }

    /// Starts an inertial sensor's thread. The picture goes on without one that ends or refuses.
    ///
    /// # Errors
    /// `Refused` where no thread can be made.
    pub fn add_imu(
        &mut self,
        name: &str,
        open: impl FnMut(Timestamp) -> Result<Box<dyn ImuSource>, DeviceError> + Send + 'static,
    ) -> Result<(), DeviceError> {
        let inbox = Arc::clone(&self.inbox);
        let next = |source: &mut Box<dyn ImuSource>, deadline| source.next(deadline);
        let deliver = move |delivery| {
            match delivery {
                Delivery::Item(sample) => inbox.put_imu(sample),
                Delivery::Lost(error) | Delivery::Refused(error) => inbox.put_lost(DeviceRole::Imu, error),
                Delivery::Back => inbox.put_back(DeviceRole::Imu),
                Delivery::Ended => {}
            }
            true
        };
        self.supervisors.push(supervise(self.supervision(name), open, next, deliver)?);
        Ok(())
    }

    /// Ends all threads, and waits no longer for them than the budget allows. Returns how many were left to themselves,
    /// because a device did not come back from a call.
    pub fn stop(self) -> usize {
        stop_all(self.supervisors).into_iter().filter(|how| *how == Stopped::Abandoned).count()
    }
}

impl EventSource for Live {
    fn next_event(&mut self, awaited: Awaited) -> Event {
        self.inbox.take(awaited, self.clock.as_ref())
    }

    fn now(&self) -> Timestamp {
        self.clock.now()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{ErrorKind, clock::MonotonicClock};
    use crate::model::{
        frame::{Exposure, RawFrame},
        image::Image,
        rig::Rig,
    };
    use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

    /// Gives what it is handed, and says whenever it is asked.
    struct OnDemand {
        asked: SyncSender<()>,
        tokens: Receiver<Result<u64, DeviceError>>,
    }

    impl FrameSource for OnDemand {
        fn next(&mut self, _deadline: Timestamp) -> Result<RawFrame, DeviceError> {
            self.asked.send(()).unwrap();
            let sequence =
                self.tokens.recv().map_err(|_closed| DeviceError::new("test", "end", ErrorKind::Ended))??;
            Ok(RawFrame {
                sequence,
                t_mid: Timestamp(sequence as i64),
                exposure: Exposure { time_s: 0.01, gain: 1.0 },
                pixels: Arc::new(Image::filled(1, 1, [0; 3])),
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
    }

    #[test]
    fn the_newest_frame_wins_and_a_lost_camera_comes_back() {
        let (asked, is_asked) = sync_channel(64);
        let (give, tokens) = sync_channel(64);
        let (inbox, clock) = (Arc::new(Inbox::default()), Arc::new(MonotonicClock::default()));
        let mut live = Live::new(Arc::clone(&inbox), clock, Budget::of_watchdog(10.0).unwrap());
        let mut first = Some(OnDemand { asked, tokens });
        let (again, is_opened_again) = sync_channel(64);
        let open = move |_| -> Result<Box<dyn FrameSource>, DeviceError> {
            match first.take() {
                Some(source) => Ok(Box::new(source)),
                None => {
                    let _ = again.try_send(());
                    Err(DeviceError::new("test", "open", ErrorKind::Reopen))
                }
            }
        };
        live.add_camera("test", open, None).unwrap();
        let mut next = || live.next_event(Awaited { frame: true, deadline: live.now().plus_seconds(60.0) });
        for k in 1..=5 {
            is_asked.recv().unwrap();
            give.send(Ok(k)).unwrap();
        }
        // Asked for the sixth: the fifth is in the inbox.
        is_asked.recv().unwrap();
        let Event::Frame(newest) = next() else { panic!("a frame waits") };
        assert_eq!((newest.frame.sequence, newest.passed_over), (5, 4));
        give.send(Ok(6)).unwrap();
        let Event::Frame(newest) = next() else { panic!("a frame comes") };
        assert_eq!((newest.frame.sequence, newest.passed_over), (6, 0));
        give.send(Err(DeviceError::new("test", "unplugged", ErrorKind::Reopen))).unwrap();
        assert!(matches!(next(), Event::Lost(DeviceRole::Camera, error) if error.action == "unplugged"));
        is_opened_again.recv().unwrap();
        assert_eq!(live.stop(), 0);
        assert_eq!(inbox.counts().frames_passed_over, 4);
    }
}
