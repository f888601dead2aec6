//! The one queue before the pipeline. It is bounded, and each kind of event has a lane of its own with its own rule for
//! what happens when more comes than is taken: nothing here waits, and nothing grows.

use super::Change;
use super::event::{ArrivedFrame, Awaited, Command, DeviceRole, Event};
use crate::device::{Clock, DeviceError, Signal, Truth};
use crate::model::{frame::RawFrame, imu::ImuSample, time::Timestamp};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Inertial samples that wait at most: a second at 1000 Hz. The oldest goes.
pub const IMU_LANE: usize = 1024;
/// Commands that wait at most. One more is refused.
pub const COMMAND_LANE: usize = 16;

/// What went another way than to the pipeline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InboxCounts {
    /// Frames that newer ones took the place of.
    pub frames_passed_over: u64,
    /// Inertial samples dropped because the lane was full.
    pub imu_dropped: u64,
    /// Commands refused because the lane was full.
    pub commands_refused: u64,
}

/// What the inbox does not take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{COMMAND_LANE} commands are waiting already: try again")]
pub struct LaneFull;

/// The newest word on a device that has not been taken yet.
#[derive(Debug)]
enum DeviceWord {
    Lost(DeviceError),
    Back,
}

#[derive(Default)]
struct Lanes {
    /// The newest frame, and how many it took the place of.
    frame: Option<(RawFrame, Option<Box<Truth>>)>,
    passed_over: u64,
    imu: VecDeque<ImuSample>,
    commands: VecDeque<Command>,
    /// Settings that are ready; later ones take over what earlier ones bring.
    change: Option<Box<Change>>,
    devices: [Option<DeviceWord>; DeviceRole::ALL.len()],
    stop: bool,
    /// The last event of all. It stays.
    end: Option<Result<(), DeviceError>>,
    counts: InboxCounts,
}

/// One bounded queue with lanes: a frame (the newest wins), [`IMU_LANE`] samples (the oldest goes), [`COMMAND_LANE`]
/// commands (refused when full), the newest word on each device, and finished work. Any thread puts, one takes.
#[derive(Default)]
pub struct Inbox {
    lanes: Mutex<Lanes>,
    arrived: Condvar,
    /// Times that the pipeline came for an event: somebody who watches it sees whether it lives.
    turns: AtomicU64,
    /// [`Command::Stop`] was put, at any time.
    is_stopped: Signal,
}

impl Inbox {
    fn lanes(&self) -> MutexGuard<'_, Lanes> {
        // A thread that panicked in here has left every lane whole: each change is one assignment.
        self.lanes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, change: impl FnOnce(&mut Lanes)) {
        change(&mut self.lanes());
        self.arrived.notify_one();
    }

    /// A frame; it takes the place of one that waits.
    pub fn put_frame(&self, frame: RawFrame, truth: Option<Box<Truth>>) {
        self.put(|lanes| {
            if lanes.frame.replace((frame, truth)).is_some() {
                lanes.passed_over += 1;
                lanes.counts.frames_passed_over += 1;
            }
        });
    }

    /// An inertial sample. Where [`IMU_LANE`] wait, the oldest is dropped.
    pub fn put_imu(&self, sample: ImuSample) {
        self.put(|lanes| {
            if lanes.imu.len() >= IMU_LANE {
                lanes.imu.pop_front();
                lanes.counts.imu_dropped += 1;
            }
            lanes.imu.push_back(sample);
        });
    }

    /// A command.
    ///
    /// # Errors
    /// Refused where [`COMMAND_LANE`] wait. [`Command::Stop`] never is.
    pub fn put_command(&self, command: Command) -> Result<(), LaneFull> {
        let mut refused = false;
        self.put(|lanes| match command {
            Command::Stop => {
                lanes.stop = true;
                self.is_stopped.raise();
            }
            command if lanes.commands.len() < COMMAND_LANE => lanes.commands.push_back(command),
            _ => {
                lanes.counts.commands_refused += 1;
                refused = true;
            }
        });
        if refused { Err(LaneFull) } else { Ok(()) }
    }

    /// Settings that are ready. They are never refused: together with ones that wait they are one change.
    pub fn put_change(&self, change: Change) {
        self.put(|lanes| {
            let change = match lanes.change.take() {
                Some(earlier) => change.after(*earlier),
                None => change,
            };
            lanes.change = Some(Box::new(change));
        });
    }

    /// A device is lost. The pipeline hears the newest word on each device.
    pub fn put_lost(&self, role: DeviceRole, error: DeviceError) {
        self.put(|lanes| lanes.devices[role as usize] = Some(DeviceWord::Lost(error)));
    }

    /// A device is there again.
    pub fn put_back(&self, role: DeviceRole) {
        self.put(|lanes| lanes.devices[role as usize] = Some(DeviceWord::Back));
    }

    /// There are no more frames. What waits is taken first.
    pub fn put_end(&self, how: Result<(), DeviceError>) {
        self.put(|lanes| {
            lanes.end.get_or_insert(how);
        });
    }

    /// The next event, if there is one: what ends and changes things first, frames after the samples before them.
    pub fn try_take(&self, wants_frame: bool) -> Option<Event> {
        Self::take_from(&mut self.lanes(), wants_frame)
    }

    /// The next event, or [`Event::Due`] once the deadline has come on `clock`.
    pub fn take(&self, awaited: Awaited, clock: &dyn Clock) -> Event {
        self.turns.fetch_add(1, Ordering::Relaxed);
        let mut lanes = self.lanes();
        loop {
            if let Some(event) = Self::take_from(&mut lanes, awaited.frame) {
                return event;
            }
            let Some(left) = time_left(clock.now(), awaited.deadline) else { return Event::Due };
            lanes = self
                .arrived
                .wait_timeout(lanes, left)
                .map_or_else(|poisoned| poisoned.into_inner().0, |w| w.0);
        }
    }

    /// Waits for [`Command::Stop`], and takes nothing; returns whether it has come by the deadline.
    pub fn stop_by(&self, deadline: Timestamp, clock: &dyn Clock) -> bool {
        self.turns.fetch_add(1, Ordering::Relaxed);
        clock.wait_or(deadline, &self.is_stopped)
    }

    fn take_from(lanes: &mut Lanes, wants_frame: bool) -> Option<Event> {
        if std::mem::take(&mut lanes.stop) {
            return Some(Event::Command(Command::Stop));
        }
        for role in DeviceRole::ALL {
            match lanes.devices[role as usize].take() {
                Some(DeviceWord::Lost(error)) => return Some(Event::Lost(role, error)),
                Some(DeviceWord::Back) => return Some(Event::Back(role)),
                None => {}
            }
        }
        if let Some(command) = lanes.commands.pop_front() {
            return Some(Event::Command(command));
        }
        if let Some(change) = lanes.change.take() {
            return Some(Event::Command(Command::Change(change)));
        }
        if let Some(sample) = lanes.imu.pop_front() {
            return Some(Event::Imu(sample));
        }
        // The last frame is taken whether or not one is wanted yet: none will take its place.
        if wants_frame || lanes.end.is_some() {
            if let Some((frame, truth)) = lanes.frame.take() {
                let passed_over = std::mem::take(&mut lanes.passed_over);
                return Some(Event::Frame(ArrivedFrame { frame, passed_over, truth }));
            }
            return match lanes.end.take() {
                Some(how) => {
                    lanes.end = Some(Ok(()));
                    Some(Event::Ended(how))
                }
                None => None,
            };
        }
        None
    }

    /// Whether a frame waits.
    pub(super) fn has_frame(&self) -> bool {
        self.lanes().frame.is_some()
    }

    /// What went another way than to the pipeline, so far.
    pub fn counts(&self) -> InboxCounts {
        self.lanes().counts
    }

    /// Times that the pipeline came for an event.
    pub fn turns(&self) -> u64 {
        self.turns.load(Ordering::Relaxed)
    }

    /// Counts a turn of a loop that takes with [`Inbox::try_take`].
    pub(super) fn count_turn(&self) {
        self.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Bytes that the lanes hold on to: they do not grow once each has been full.
    pub fn capacity(&self) -> usize {
        let lanes = self.lanes();
        lanes.imu.capacity() * size_of::<ImuSample>() + lanes.commands.capacity() * size_of::<Command>()
    }
}

fn time_left(now: Timestamp, deadline: Timestamp) -> Option<Duration> {
    let left = u64::try_from(deadline.0.saturating_sub(now.0)).ok()?;
    // A wait without an end in sight is looked at once a second.
    (left > 0).then(|| Duration::from_nanos(left.min(1_000_000_000)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{
        ErrorKind,
        clock::{ManualClock, MonotonicClock},
    };
    use crate::model::{frame::Exposure, image::Image};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn frame(sequence: u64) -> RawFrame {
        RawFrame {
            sequence,
            t_mid: Timestamp(sequence as i64),
            exposure: Exposure { time_s: 0.01, gain: 1.0 },
            pixels: Arc::new(Image::filled(1, 1, [0; 3])),
            sensor: None,
            row_time_s: 0.0,
            response: None,
        }
    }

    fn sample(k: i64) -> ImuSample {
        ImuSample { t: Timestamp(k), gyro_rad_s: [0.0; 3], accel_m_s2: [0.0; 3] }
    }

    fn gone(action: &str) -> DeviceError {
        DeviceError::new("test", action, ErrorKind::Reopen)
    }

    /// What can be done to an inbox.
    #[derive(Clone, Copy, Debug)]
    enum Deed {
        Frame,
        Imu(u16),
        Command,
        Lost(usize),
        Back(usize),
        Take { frame: bool, times: u16 },
    }

    fn deed() -> impl Strategy<Value = Deed> {
        let roles = 0..DeviceRole::ALL.len();
        prop_oneof![
            3 => Just(Deed::Frame),
            3 => (1u16..900).prop_map(Deed::Imu),
            3 => Just(Deed::Command),
            1 => roles.clone().prop_map(Deed::Lost),
            1 => roles.prop_map(Deed::Back),
            4 => (any::<bool>(), 0u16..900).prop_map(|(frame, times)| Deed::Take { frame, times }),
        ]
    }

    /// What was put, for the books to balance.
    #[derive(Default)]
    struct Books {
        frames: u64,
        frames_taken: u64,
        passed_over: u64,
        newest_frame: u64,
        samples: i64,
        samples_taken: u64,
        last_sample: i64,
        commands_taken: u64,
        commands_accepted: u64,
        words: [Option<bool>; DeviceRole::ALL.len()],
    }

    impl Books {
        fn note(&mut self, event: Event, wanted_frame: bool) {
            match event {
                Event::Frame(arrived) => {
                    assert!(wanted_frame, "a frame that nobody wanted");
                    assert!(self.samples_waiting_is(0), "samples come before the frame");
                    assert_eq!(arrived.frame.sequence, self.frames, "the newest frame wins");
                    assert!(arrived.frame.sequence > self.newest_frame);
                    self.newest_frame = arrived.frame.sequence;
                    self.passed_over += arrived.passed_over;
                    self.frames_taken += 1;
                }
                Event::Imu(sample) => {
                    assert!(sample.t.0 > self.last_sample, "in order");
                    self.last_sample = sample.t.0;
                    self.samples_taken += 1;
                }
                Event::Command(_) => self.commands_taken += 1,
                Event::Lost(role, _) => assert_eq!(self.words[role as usize].take(), Some(false)),
                Event::Back(role) => assert_eq!(self.words[role as usize].take(), Some(true)),
                other => panic!("{other:?}"),
            }
        }

        fn samples_waiting_is(&self, n: i64) -> bool {
            self.samples - self.last_sample == n
        }

        fn balance(&self, inbox: &Inbox) {
            let lanes = inbox.lanes();
            assert!(lanes.imu.len() <= IMU_LANE && lanes.commands.len() <= COMMAND_LANE);
            let waiting = u64::from(lanes.frame.is_some());
            assert_eq!(self.frames, self.frames_taken + lanes.counts.frames_passed_over + waiting);
            assert_eq!(lanes.counts.frames_passed_over, self.passed_over + lanes.passed_over);
            let samples = self.samples_taken + lanes.counts.imu_dropped + lanes.imu.len() as u64;
            assert_eq!(self.samples as u64, samples);
            assert_eq!(self.commands_accepted, self.commands_taken + lanes.commands.len() as u64);
            for (word, expected) in lanes.devices.iter().zip(&self.words) {
                assert_eq!(word.as_ref().map(|w| matches!(w, DeviceWord::Back)), *expected);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn books_balance_after_any_operations(deeds in proptest::collection::vec(deed(), 1..60)) {
            let (inbox, mut books) = (Inbox::default(), Books::default());
            for deed in deeds {
                match deed {
                    Deed::Frame => {
                        books.frames += 1;
                        inbox.put_frame(frame(books.frames), None);
                    }
                    Deed::Imu(count) => for _ in 0..count {
                        books.samples += 1;
                        inbox.put_imu(sample(books.samples));
                    },
                    Deed::Command => {
                        let was_full = inbox.lanes().commands.len() == COMMAND_LANE;
                        // Any command will do: what it holds is not looked at.
                        let given = inbox.put_command(Command::Change(Box::new(Change::of(Options::default()))));
                        prop_assert_eq!(given.is_err(), was_full);
                        books.commands_accepted += u64::from(given.is_ok());
                    }
                    Deed::Lost(k) => {
                        inbox.put_lost(DeviceRole::ALL[k], gone("unplugged"));
                        books.words[k] = Some(false);
                    }
                    Deed::Back(k) => {
                        inbox.put_back(DeviceRole::ALL[k]);
                        books.words[k] = Some(true);
                    }
                    Deed::Take { frame, times } => for _ in 0..times {
                        match inbox.try_take(frame) {
                            Some(event) => books.note(event, frame),
                            None => break,
                        }
                    },
                }
                books.balance(&inbox);
            }
        }
    }

    use super::super::Options;

    #[test]
    fn the_end_comes_last_and_stays() {
        let inbox = Inbox::default();
        inbox.put_frame(frame(1), None);
        inbox.put_imu(sample(1));
        inbox.put_end(Err(gone("for good")));
        inbox.put_end(Ok(()));
        assert!(matches!(inbox.try_take(false), Some(Event::Imu(_))));
        // Nobody waits for a better one any more.
        assert!(matches!(inbox.try_take(false), Some(Event::Frame(_))));
        assert!(matches!(inbox.try_take(false), Some(Event::Ended(Err(e))) if e.action == "for good"));
        assert!(matches!(inbox.try_take(false), Some(Event::Ended(Ok(())))));
    }

    #[test]
    fn a_stop_goes_before_everything_even_when_lanes_are_full() {
        let inbox = Inbox::default();
        let change = || Command::Change(Box::new(Change::of(Options::default())));
        for _ in 0..COMMAND_LANE {
            inbox.put_command(change()).unwrap();
        }
        assert_eq!(inbox.put_command(change()), Err(LaneFull));
        inbox.put_command(Command::Stop).unwrap();
        assert!(matches!(inbox.try_take(true), Some(Event::Command(Command::Stop))));
        assert_eq!(inbox.counts().commands_refused, 1);
    }

    #[test]
    fn a_deadline_that_has_passed_says_so_at_once_and_other_threads_wake_the_waiting() {
        let inbox = Arc::new(Inbox::default());
        let clock = ManualClock::new(Timestamp(5));
        let awaited = Awaited { frame: true, deadline: Timestamp(5) };
        assert!(matches!(inbox.take(awaited, &clock), Event::Due));
        let theirs = Arc::clone(&inbox);
        let putting = std::thread::spawn(move || theirs.put_frame(frame(1), None));
        let forever = Awaited { frame: true, deadline: Timestamp(i64::MAX) };
        assert!(matches!(inbox.take(forever, &MonotonicClock::default()), Event::Frame(_)));
        putting.join().unwrap();
        assert_eq!(inbox.turns(), 2);
    }
}
