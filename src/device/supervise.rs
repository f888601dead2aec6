//! One thread for each device: opened, asked for items, opened anew when it was lost, and never waited for in vain.
//! The thread opens the device and asks it for one item after the other, each time with a deadline from the [`Budget`].
//! `Again` and `Working` ask once more. `Reopen`, a panic, or silence for too long closes the device and opens it again after
//! 0.1 s, then 0.2 s, doubling to 2 s, until an item comes. `Refused` and `Ended` end the thread. What happens is said to `deliver`.

use crate::clock::{Clock, Signal};
use crate::model::time::Timestamp;
use crate::{DEADLINE_SLACK_S, DeviceError, ErrorKind};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU8, AtomicU64, Ordering};
use std::thread::JoinHandle;

/// Something that may block, and so has a deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// Opening a device.
    Open,
    /// Asking a device for an item.
    Item,
    /// Waiting for the threads of all devices to end, together.
    Stop,
    /// The main loop waiting for an event.
    Inbox,
    /// Handing a picture to the display.
    Show,
    /// Waiting for the engine.
    Engine,
}

impl Wait {
    /// Each kind of wait once.
    pub const ALL: [Self; 6] = [Self::Open, Self::Item, Self::Stop, Self::Inbox, Self::Show, Self::Engine];
}

/// Shares of the watchdog's period, in the order of [`Wait::ALL`]; together a half.
const SHARES: [f64; 6] = [0.10, 0.05, 0.12, 0.05, 0.04, 0.14];

/// Deadlines of everything that may block. Together they are at most half of the watchdog's period, so that one of each can
/// run out in a row and the watchdog is still told in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    waits_s: [f64; Wait::ALL.len()],
}

/// Why a budget is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("budget of waits for a watchdog of {period_s} s: {why}")]
pub struct BudgetError {
    period_s: f64,
    why: String,
}

impl Budget {
    /// Takes the watchdog's period and the longest wait of each kind, in seconds and in the order of [`Wait::ALL`]. An error
    /// unless all are positive, their sum is at most half of the period, and stopping takes as long as opening or an item
    /// may (with the slack of a deadline).
    pub fn new(period_s: f64, waits_s: [f64; Wait::ALL.len()]) -> Result<Self, BudgetError> {
        let refuse = |why: String| Err(BudgetError { period_s, why });
        if let Some((wait, s)) = Wait::ALL.iter().zip(waits_s).find(|(_, s)| !(*s > 0.0 && s.is_finite())) {
            return refuse(format!("{wait:?} = {s} s must be positive"));
        }
        let sum: f64 = waits_s.iter().sum();
        // The shares add up to a half only up to rounding.
        if !(sum <= 0.5 * period_s * (1.0 + 1e-12)) {
            return refuse(format!("the waits are {sum} s together, must be at most half of it"));
        }
        let budget = Self { waits_s };
        let longest = budget.seconds(Wait::Open).max(budget.seconds(Wait::Item)) + DEADLINE_SLACK_S;
        if budget.seconds(Wait::Stop) < longest * (1.0 - 1e-12) {
            return refuse(format!(
                "Stop = {} s must be at least {longest} s, the longest call of a device",
                budget.seconds(Wait::Stop)
            ));
        }
        Ok(budget)
    }

    /// Shares out the watchdog's period, seconds. An error below 1 s, where a device could not keep its deadline.
    pub fn of_watchdog(period_s: f64) -> Result<Self, BudgetError> {
        Self::new(period_s, SHARES.map(|share| share * period_s))
    }

    /// The longest wait of this kind, seconds.
    pub fn seconds(&self, wait: Wait) -> f64 {
        self.waits_s[wait as usize]
    }

    /// The deadline of a wait that begins now.
    pub fn deadline(&self, wait: Wait, now: Timestamp) -> Timestamp {
        now.plus_seconds(self.seconds(wait))
    }
}

/// How long to wait before a lost device is opened again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backoff {
    next_s: f64,
}

impl Backoff {
    /// The first wait, seconds.
    pub const FIRST_S: f64 = 0.1;
    /// The longest, seconds.
    pub const LONGEST_S: f64 = 2.0;

    /// Gives the next wait in seconds: 0.1, 0.2, 0.4, 0.8, 1.6, 2, 2, ..
    pub fn advance(&mut self) -> f64 {
        let wait = self.next_s;
        self.next_s = (2.0 * wait).min(Self::LONGEST_S);
        wait
    }

    /// Begins anew at the first wait.
    pub fn reset(&mut self) {
        self.next_s = Self::FIRST_S;
    }
}

impl Default for Backoff {
    fn default() -> Self {
        Self { next_s: Self::FIRST_S }
    }
}

/// What a device's thread says.
#[derive(Debug)]
pub enum Delivery<T> {
    /// What the device gave, in its order.
    Item(T),
    /// The device is lost, or could not be opened; it is opened again and again from now on. Said once for each loss.
    Lost(DeviceError),
    /// An item came from a device that was lost; the item follows.
    Back,
    /// The device refuses for good. The thread ends.
    Refused(DeviceError),
    /// There is no more. The thread ends.
    Ended,
}

/// How a device is supervised.
#[derive(Clone)]
pub struct Supervision {
    /// The device as the user named it, for messages and for the thread's name.
    pub name: String,
    /// The clock of deadlines and waits.
    pub clock: Arc<dyn Clock>,
    /// Deadlines.
    pub budget: Budget,
    /// A device that has given nothing but `Again` for this long, in seconds, counts as lost (a camera that goes silent gives
    /// no error, ever). `None` for devices that may be silent (a command link).
    pub silence_s: Option<f64>,
}

/// What a device's thread has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SupervisionCounts {
    /// Items handed on.
    pub items: u64,
    /// Times that the device was opened.
    pub opened: u64,
    /// Times that it was lost.
    pub lost: u64,
    /// Panics caught in the device's code.
    pub panics: u64,
}

/// The thread runs and somebody may wait for it.
const RUNS: u8 = 0;
/// The thread has ended.
const HAS_ENDED: u8 = 1;
/// Nobody waits for the thread any more.
const IS_ABANDONED: u8 = 2;

#[derive(Debug, Default)]
struct Board {
    items: AtomicU64,
    opened: AtomicU64,
    lost: AtomicU64,
    panics: AtomicU64,
    /// Deadline of the call that runs; `NEVER` between calls.
    call_until: AtomicI64,
    /// One of the three above.
    fate: AtomicU8,
}

/// How a device's thread ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    /// The thread has ended and the device is closed.
    Ended,
    /// A call to the device did not come back. The thread is left to itself; it hands nothing on, and ends if the call ever
    /// returns.
    Abandoned,
}

/// Threads that were abandoned and have not ended since.
static ABANDONED: AtomicU64 = AtomicU64::new(0);

/// Returns how many threads of this process were abandoned and have not ended since.
pub fn abandoned_threads() -> u64 {
    ABANDONED.load(Ordering::SeqCst)
}

/// A device's thread. Dropping it asks the thread to stop and waits for nothing.
pub struct Supervisor {
    how: Supervision,
    board: Arc<Board>,
    stop: Signal,
    done: Signal,
    thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// Asks the thread to stop; it does so when the running call to the device returns.
    pub fn request_stop(&self) {
        self.stop.raise();
    }

    /// Returns whether the thread has ended.
    pub fn is_over(&self) -> bool {
        self.done.is_raised()
    }

    /// Waits until the device ends or refuses by itself. For recordings and tests: a camera never does.
    pub fn wait_over(&self) {
        self.done.wait();
    }

    /// What the thread has done so far.
    pub fn counts(&self) -> SupervisionCounts {
        let of = |counter: &AtomicU64| counter.load(Ordering::SeqCst);
        let Board { items, opened, lost, panics, .. } = &*self.board;
        SupervisionCounts { items: of(items), opened: of(opened), lost: of(lost), panics: of(panics) }
    }

    /// Seconds by which the running call to the device is past its deadline; 0 where it is not.
    pub fn overdue_s(&self) -> f64 {
        let until = Timestamp(self.board.call_until.load(Ordering::SeqCst));
        self.how.clock.now().seconds_since(until).max(0.0)
    }

    /// Stops the thread; waits for it at most for the budget's [`Wait::Stop`].
    pub fn stop(self) -> Stopped {
        let deadline = self.how.budget.deadline(Wait::Stop, self.how.clock.now());
        self.stop_by(deadline)
    }

    fn stop_by(mut self, deadline: Timestamp) -> Stopped {
        self.stop.raise();
        if self.how.clock.wait_or(deadline, &self.done) || !self.abandon() {
            if let Some(thread) = self.thread.take()
                && thread.join().is_err()
            {
                tracing::error!("{}: what takes its items has panicked", self.how.name);
            }
            return Stopped::Ended;
        }
        tracing::warn!(
            "{}: the device does not come back from a call, {:.2} s past its deadline: its thread is abandoned",
            self.how.name,
            self.overdue_s()
        );
        Stopped::Abandoned
    }

    /// Gives the thread up; returns false where it has ended at the last moment.
    fn abandon(&self) -> bool {
        // Counted first, so that the thread never takes off what was not put on.
        ABANDONED.fetch_add(1, Ordering::SeqCst);
        let fate = &self.board.fate;
        let is_abandoned =
            fate.compare_exchange(RUNS, IS_ABANDONED, Ordering::SeqCst, Ordering::SeqCst).is_ok();
        if !is_abandoned {
            ABANDONED.fetch_sub(1, Ordering::SeqCst);
        }
        is_abandoned
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop.raise();
    }
}

/// Stops all threads; waits for them together at most for the budget's [`Wait::Stop`] of the first.
pub fn stop_all(supervisors: Vec<Supervisor>) -> Vec<Stopped> {
    supervisors.iter().for_each(Supervisor::request_stop);
    let Some(first) = supervisors.first() else { return Vec::new() };
    let deadline = first.how.budget.deadline(Wait::Stop, first.how.clock.now());
    supervisors.into_iter().map(|supervisor| supervisor.stop_by(deadline)).collect()
}

/// Starts a device's thread.
/// `open` opens the device by a deadline, `next` asks it for an item by a deadline, `deliver` takes what happens and returns
/// whether to go on; it must not block. All three run on the thread. `Refused` where no thread can be made.
pub fn supervise<S: 'static, T: 'static>(
    how: Supervision,
    open: impl FnMut(Timestamp) -> Result<S, DeviceError> + Send + 'static,
    next: impl FnMut(&mut S, Timestamp) -> Result<T, DeviceError> + Send + 'static,
    deliver: impl FnMut(Delivery<T>) -> bool + Send + 'static,
) -> Result<Supervisor, DeviceError> {
    let board = Arc::new(Board { call_until: AtomicI64::new(i64::MAX), ..Board::default() });
    let (stop, done) = (Signal::default(), Signal::default());
    let care = Care {
        how: how.clone(),
        board: Arc::clone(&board),
        stop: stop.clone(),
        open,
        next,
        deliver,
        backoff: Backoff::default(),
        is_lost: false,
        last_item: how.clock.now(),
        item: std::marker::PhantomData,
    };
    let end = ThreadEnd { done: done.clone(), board: Arc::clone(&board) };
    let thread = std::thread::Builder::new()
        .name(how.name.chars().filter(|c| *c != '\0').take(15).collect())
        .spawn(move || {
            // Dropped after `care`, and so after the device is closed.
            let _end = end;
            care.run();
        })
        .map_err(|e| DeviceError::new(&how.name, "start its thread", ErrorKind::Refused).because(e))?;
    Ok(Supervisor { how, board, stop, done, thread: Some(thread) })
}

/// Says that the thread has ended, also where it panicked.
struct ThreadEnd {
    done: Signal,
    board: Arc<Board>,
}

impl Drop for ThreadEnd {
    fn drop(&mut self) {
        if self.board.fate.swap(HAS_ENDED, Ordering::SeqCst) == IS_ABANDONED {
            ABANDONED.fetch_sub(1, Ordering::SeqCst);
        }
        self.done.raise();
    }
}

/// What to do after an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum AfterError {
    OpenAgain,
    End,
}

/// What runs on a device's thread.
struct Care<T, O, N, D> {
    how: Supervision,
    board: Arc<Board>,
    stop: Signal,
    open: O,
    next: N,
    deliver: D,
    backoff: Backoff,
    is_lost: bool,
    last_item: Timestamp,
    item: std::marker::PhantomData<fn() -> T>,
}

impl<S, T, O, N, D> Care<T, O, N, D>
where
    O: FnMut(Timestamp) -> Result<S, DeviceError>,
    N: FnMut(&mut S, Timestamp) -> Result<T, DeviceError>,
    D: FnMut(Delivery<T>) -> bool,
{
    /// Opens, asks, closes, waits, and again, until the device ends, refuses, or nobody wants more.
    fn run(mut self) {
        while !self.stop.is_raised() {
            let deadline = self.how.budget.deadline(Wait::Open, self.how.clock.now());
            let after = match guarded(&self.how.name, &self.board, deadline, || (self.open)(deadline)) {
                Err(error) => self.handle(error),
                Ok(source) => {
                    self.board.opened.fetch_add(1, Ordering::SeqCst);
                    self.last_item = self.how.clock.now();
                    self.ask(source)
                }
            };
            if after == AfterError::End {
                return;
            }
            let now = self.how.clock.now();
            if self.how.clock.wait_or(now.plus_seconds(self.backoff.advance()), &self.stop) {
                return;
            }
        }
    }

    /// Asks an open device for items until it fails; closes it.
    fn ask(&mut self, mut source: S) -> AfterError {
        let after = loop {
            if self.stop.is_raised() {
                break AfterError::End;
            }
            let deadline = self.how.budget.deadline(Wait::Item, self.how.clock.now());
            let next = &mut self.next;
            let result = guarded(&self.how.name, &self.board, deadline, || next(&mut source, deadline));
            if self.stop.is_raised() {
                break AfterError::End;
            }
            match result {
                Ok(item) => {
                    if !self.hand_on(item) {
                        break AfterError::End;
                    }
                }
                Err(error) if error.kind == ErrorKind::Working => self.last_item = self.how.clock.now(),
                Err(error) if error.kind == ErrorKind::Again => {
                    if let Some(error) = self.silence() {
                        break self.handle(error);
                    }
                }
                Err(error) => break self.handle(error),
            }
        };
        // Closing is the device's code too.
        let deadline = self.how.budget.deadline(Wait::Item, self.how.clock.now());
        let closed: Result<(), DeviceError> = guarded(&self.how.name, &self.board, deadline, || {
            drop(source);
            Ok(())
        });
        if let Err(error) = closed {
            tracing::error!("{error}");
        }
        after
    }

    fn hand_on(&mut self, item: T) -> bool {
        self.last_item = self.how.clock.now();
        self.backoff.reset();
        if std::mem::take(&mut self.is_lost) {
            tracing::info!("{}: is back", self.how.name);
            if !(self.deliver)(Delivery::Back) {
                return false;
            }
        }
        self.board.items.fetch_add(1, Ordering::SeqCst);
        (self.deliver)(Delivery::Item(item))
    }

    /// The loss of a device that has been silent for too long.
    fn silence(&self) -> Option<DeviceError> {
        let silent_s = self.how.clock.now().seconds_since(self.last_item);
        self.how.silence_s.filter(|most| silent_s >= *most).map(|most| {
            let action = format!("nothing came for {silent_s:.2} s, {most} s are allowed");
            DeviceError::new(&self.how.name, action, ErrorKind::Reopen)
        })
    }

    /// Says what an error means, once; `Again` while opening is a loss.
    fn handle(&mut self, error: DeviceError) -> AfterError {
        match error.kind {
            ErrorKind::Ended => {
                (self.deliver)(Delivery::Ended);
                AfterError::End
            }
            ErrorKind::Refused => {
                tracing::error!("{error}");
                (self.deliver)(Delivery::Refused(error));
                AfterError::End
            }
            ErrorKind::Again | ErrorKind::Working | ErrorKind::Reopen => {
                if std::mem::replace(&mut self.is_lost, true) {
                    tracing::debug!("{error}");
                    return AfterError::OpenAgain;
                }
                self.board.lost.fetch_add(1, Ordering::SeqCst);
                tracing::warn!("{error}: the device is lost, it is opened again until it is back");
                if (self.deliver)(Delivery::Lost(error)) { AfterError::OpenAgain } else { AfterError::End }
            }
        }
    }
}

/// Runs a call to a device: its deadline is on the board meanwhile, and a panic is a `Reopen`.
fn guarded<R>(
    name: &str,
    board: &Board,
    deadline: Timestamp,
    call: impl FnOnce() -> Result<R, DeviceError>,
) -> Result<R, DeviceError> {
    board.call_until.store(deadline.0, Ordering::SeqCst);
    // The device is dropped after a panic, so nobody sees it half changed.
    let result = catch_unwind(AssertUnwindSafe(call));
    board.call_until.store(Timestamp::NEVER.0, Ordering::SeqCst);
    result.unwrap_or_else(|panic| {
        board.panics.fetch_add(1, Ordering::SeqCst);
        let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        Err(DeviceError::new(name, format!("the device's code panicked: {text}"), ErrorKind::Reopen))
    })
}

#[cfg(test)]
mod tests;
