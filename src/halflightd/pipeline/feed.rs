//! How frames reach the pipeline: every one in lockstep, or the newest as time passes.

use super::event::Event;
use crate::device::{Clock, DeviceError, ErrorKind, FrameSource, Truth};
use crate::model::{frame::RawFrame, time::Timestamp};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Gives events, one after the other.
pub trait Feed {
    /// The next event.
    fn next_event(&mut self) -> Event;
}

/// Every frame in turn; a manual clock follows the frames, so that a run is the same each time.
pub struct Lockstep<'a> {
    source: &'a mut dyn FrameSource,
    clock: &'a mut dyn Clock,
}

impl<'a> Lockstep<'a> {
    /// Feeds from `source`; `clock` (a manual one) is moved to each frame's time.
    pub fn new(source: &'a mut dyn FrameSource, clock: &'a mut dyn Clock) -> Self {
        Self { source, clock }
    }
}

impl Feed for Lockstep<'_> {
    fn next_event(&mut self) -> Event {
        match self.source.next(Timestamp(i64::MAX)) {
            Ok(frame) => {
                self.clock.wait_until(frame.t_mid);
                let truth = self.source.truth().map(Box::new);
                Event::Frame { frame, passed_over: 0, truth }
            }
            Err(error) => of_error(error),
        }
    }
}

fn of_error(error: DeviceError) -> Event {
    match error.kind {
        ErrorKind::Again => Event::Nothing,
        ErrorKind::Ended => Event::Ended,
        ErrorKind::Reopen | ErrorKind::Refused => Event::Failed(error),
    }
}

/// A place for one frame: the newest wins.
#[derive(Default)]
struct Mailbox {
    slot: Mutex<Slot>,
    changed: Condvar,
}

#[derive(Default)]
struct Slot {
    frame: Option<(RawFrame, Option<Box<Truth>>)>,
    passed_over: u64,
    end: Option<Result<(), DeviceError>>,
    stop: bool,
}

/// As time passes: a thread captures, the pipeline takes the newest frame when it is ready for one.
pub struct Realtime {
    mailbox: Arc<Mailbox>,
    capture: Option<JoinHandle<()>>,
}

impl Realtime {
    /// Starts capturing. With a `pace` (for recordings, which deliver at once) each frame is held back until its own
    /// time has come on that clock, counted from the first frame.
    pub fn start(mut source: Box<dyn FrameSource>, mut pace: Option<Box<dyn Clock>>) -> Self {
        let mailbox = Arc::new(Mailbox::default());
        let theirs = Arc::clone(&mailbox);
        let capture = std::thread::spawn(move || {
            let mut first: Option<(Timestamp, Timestamp)> = None;
            loop {
                let result = source.next(Timestamp(i64::MAX));
                if let (Ok(frame), Some(clock)) = (&result, pace.as_mut()) {
                    let (frame_zero, clock_zero) = *first.get_or_insert((frame.t_mid, clock.now()));
                    clock.wait_until(clock_zero.plus_seconds(frame.t_mid.seconds_since(frame_zero)));
                }
                let truth = source.truth().map(Box::new);
                let mut slot = theirs.slot.lock().unwrap_or_else(PoisonError::into_inner);
                if slot.stop {
                    return;
                }
                match result {
                    Ok(frame) => {
                        if slot.frame.replace((frame, truth)).is_some() {
                            slot.passed_over += 1;
                        }
                    }
                    Err(error) => match error.kind {
                        ErrorKind::Again => continue,
                        ErrorKind::Ended => slot.end = Some(Ok(())),
                        ErrorKind::Reopen | ErrorKind::Refused => slot.end = Some(Err(error)),
                    },
                }
                theirs.changed.notify_one();
                if slot.end.is_some() {
                    return;
                }
            }
        });
        Self { mailbox, capture: Some(capture) }
    }
}

impl Feed for Realtime {
    fn next_event(&mut self) -> Event {
        let mut slot = self.mailbox.slot.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some((frame, truth)) = slot.frame.take() {
                let passed_over = std::mem::take(&mut slot.passed_over);
                return Event::Frame { frame, passed_over, truth };
            }
            match slot.end.take() {
                Some(Ok(())) => {
                    slot.end = Some(Ok(()));
                    return Event::Ended;
                }
                Some(Err(error)) => {
                    slot.end = Some(Ok(()));
                    return Event::Failed(error);
                }
                None => slot = self.mailbox.changed.wait(slot).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }
}

impl Drop for Realtime {
    fn drop(&mut self) {
        self.mailbox.slot.lock().unwrap_or_else(PoisonError::into_inner).stop = true;
        if let Some(capture) = self.capture.take() {
            // The thread ends after the frame it is waiting for; a panic in it has been reported already.
            let _ = capture.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{
        frame::{Exposure, RawFrame},
        image::Image,
    };
    use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

    /// Gives a frame for each token, and says whenever it is asked for one.
    struct OnDemand {
        asked: SyncSender<u64>,
        tokens: Receiver<Result<(), DeviceError>>,
        given: u64,
    }

    impl FrameSource for OnDemand {
        fn next(&mut self, _deadline: Timestamp) -> Result<RawFrame, DeviceError> {
            self.asked.send(self.given).unwrap();
            self.tokens.recv().map_err(|_closed| DeviceError::new("test", "end", ErrorKind::Ended))??;
            self.given += 1;
            Ok(RawFrame {
                sequence: self.given,
                t_mid: Timestamp(self.given as i64),
                exposure: Exposure { time_s: 0.01, gain: 1.0 },
                pixels: Arc::new(Image::filled(1, 1, [0; 3])),
            })
        }

        fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
            Ok(exposures.to_vec())
        }

        fn rig(&self) -> Option<crate::model::rig::Rig> {
            None
        }
    }

    fn number(event: Event) -> (u64, u64) {
        match event {
            Event::Frame { frame, passed_over, .. } => (frame.sequence, passed_over),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn as_time_passes_the_newest_frame_wins() {
        let (asked, is_asked) = sync_channel(16);
        let (give, tokens) = sync_channel(16);
        let mut feed = Realtime::start(Box::new(OnDemand { asked, tokens, given: 0 }), None);
        for k in 0..5 {
            assert_eq!(is_asked.recv().unwrap(), k);
            give.send(Ok(())).unwrap();
        }
        // Asked for the sixth: the fifth lies in the mailbox.
        assert_eq!(is_asked.recv().unwrap(), 5);
        assert_eq!(number(feed.next_event()), (5, 4));
        give.send(Ok(())).unwrap();
        assert_eq!(number(feed.next_event()), (6, 0));
        give.send(Err(DeviceError::new("test", "nothing yet", ErrorKind::Again))).unwrap();
        give.send(Err(DeviceError::new("test", "unplugged", ErrorKind::Reopen))).unwrap();
        assert!(matches!(feed.next_event(), Event::Failed(error) if error.action == "unplugged"));
        assert!(matches!(feed.next_event(), Event::Ended));
    }

    #[test]
    fn lockstep_gives_every_frame_and_moves_the_clock() {
        let (asked, _is_asked) = sync_channel(16);
        let (give, tokens) = sync_channel(16);
        let mut source = OnDemand { asked, tokens, given: 0 };
        let mut clock = crate::device::clock::ManualClock::default();
        for _ in 0..3 {
            give.send(Ok(())).unwrap();
        }
        drop(give);
        let mut feed = Lockstep::new(&mut source, &mut clock);
        for k in 1..=3 {
            assert_eq!(number(feed.next_event()), (k, 0));
        }
        assert!(matches!(feed.next_event(), Event::Ended));
        assert_eq!(clock.now(), Timestamp(3));
    }
}
