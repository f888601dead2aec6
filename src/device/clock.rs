//! Clocks on the monotonic time line of the frames. The only place that asks the machine for the time.

use crate::model::time::Timestamp;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// A clock on the monotonic time line of the frames. It never goes back. Shared by threads.
pub trait Clock: Send + Sync {
    /// The present moment on this clock; never goes back.
    fn now(&self) -> Timestamp;

    /// Waits until `t` or until the signal is raised, whichever comes first; returns whether the signal is raised.
    fn wait_or(&self, t: Timestamp, signal: &Signal) -> bool;

    /// Waits until `t` (a manual clock jumps).
    fn wait_until(&self, t: Timestamp) {
        self.wait_or(t, &Signal::default());
    }
}

/// A flag that threads wait for. It stays raised until somebody takes it down. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct Signal(Arc<SignalState>);

#[derive(Debug, Default)]
struct SignalState {
    raised: Mutex<bool>,
    changed: Condvar,
}

impl Signal {
    /// Raises the flag and wakes all that wait for it.
    pub fn raise(&self) {
        *self.lock() = true;
        self.0.changed.notify_all();
    }

    /// Takes the flag down; returns whether it was raised. For flags that one thread waits for, again and again.
    pub fn take(&self) -> bool {
        std::mem::take(&mut *self.lock())
    }

    /// Returns whether the flag is raised.
    pub fn is_raised(&self) -> bool {
        *self.lock()
    }

    /// Waits until the flag is raised, however long that takes.
    pub fn wait(&self) {
        let mut raised = self.lock();
        while !*raised {
            raised = self.0.changed.wait(raised).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn lock(&self) -> MutexGuard<'_, bool> {
        self.0.raised.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// When the first clock of the process was made.
static ZERO: OnceLock<Instant> = OnceLock::new();

/// The kernel's monotonic clock now, nanoseconds: what drivers put onto their frames.
pub fn monotonic_ns() -> i64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec)
}

/// The machine's monotonic clock; zero is when the first of them was made, so that all agree.
#[derive(Clone, Copy, Debug)]
pub struct MonotonicClock {
    zero: Instant,
}

impl MonotonicClock {
    /// A clock on the time line of the process.
    pub fn new() -> Self {
        Self { zero: *ZERO.get_or_init(Instant::now) }
    }
}

impl Default for MonotonicClock {
    fn default() -> Self {
        Self::new()
    }
}

impl Clock for MonotonicClock {
    fn now(&self) -> Timestamp {
        Timestamp(i64::try_from(self.zero.elapsed().as_nanos()).unwrap_or(i64::MAX))
    }

    fn wait_or(&self, t: Timestamp, signal: &Signal) -> bool {
        let mut raised = signal.lock();
        loop {
            let left = u64::try_from(t.0.saturating_sub(self.now().0)).unwrap_or(0);
            if *raised || left == 0 {
                return *raised;
            }
            let result = signal.0.changed.wait_timeout(raised, Duration::from_nanos(left));
            raised = result.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// A clock that moves only when told: waiting jumps. Clones share one time.
#[derive(Clone, Debug, Default)]
pub struct ManualClock {
    now: Arc<AtomicI64>,
}

impl ManualClock {
    /// Starts at this time.
    pub fn new(now: Timestamp) -> Self {
        Self { now: Arc::new(AtomicI64::new(now.0)) }
    }
}

impl Clock for ManualClock {
    fn now(&self) -> Timestamp {
        Timestamp(self.now.load(Ordering::SeqCst))
    }

    /// Jumps to `t`, unless the signal is raised already. `NEVER` does not jump: it waits for the signal.
    fn wait_or(&self, t: Timestamp, signal: &Signal) -> bool {
        if t == Timestamp::NEVER {
            signal.wait();
        }
        if signal.is_raised() {
            return true;
        }
        self.now.fetch_max(t.0, Ordering::SeqCst);
        false
    }
}

/// A clock that a test moves by hand while other threads wait for it. Clones share one time.
#[derive(Clone, Debug, Default)]
pub struct SteppedClock(Arc<Stepped>);

#[derive(Debug, Default)]
struct Stepped {
    now: AtomicI64,
    waiting: Mutex<Vec<(Timestamp, Signal)>>,
    somebody_waits: Condvar,
}

impl SteppedClock {
    /// The earliest time that somebody waits for; blocks until somebody waits.
    pub fn next_wake(&self) -> Timestamp {
        self.next_wake_of(1)
    }

    /// The earliest time that somebody waits for; blocks until at least so many threads wait.
    pub fn next_wake_of(&self, threads: usize) -> Timestamp {
        let mut waiting = self.lock();
        while waiting.len() < threads.max(1) {
            waiting = self.0.somebody_waits.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
        waiting.iter().map(|(t, _)| *t).min().unwrap_or(Timestamp::NEVER)
    }

    /// Moves to `t` (never back) and wakes those who waited for it.
    pub fn advance_to(&self, t: Timestamp) {
        self.0.now.fetch_max(t.0, Ordering::SeqCst);
        let due: Vec<Signal> =
            self.lock().iter().filter(|(until, _)| *until <= t).map(|(_, signal)| signal.clone()).collect();
        for signal in due {
            // Under the signal's lock, so that nobody is between looking at the time and going to sleep.
            let _raised = signal.lock();
            signal.0.changed.notify_all();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<(Timestamp, Signal)>> {
        self.0.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Clock for SteppedClock {
    fn now(&self) -> Timestamp {
        Timestamp(self.0.now.load(Ordering::SeqCst))
    }

    fn wait_or(&self, t: Timestamp, signal: &Signal) -> bool {
        self.lock().push((t, signal.clone()));
        self.0.somebody_waits.notify_all();
        let mut raised = signal.lock();
        while !*raised && self.now() < t {
            raised = signal.0.changed.wait(raised).unwrap_or_else(PoisonError::into_inner);
        }
        let raised = *raised;
        let mut waiting = self.lock();
        if let Some(at) = waiting.iter().position(|(until, s)| *until == t && Arc::ptr_eq(&s.0, &signal.0)) {
            waiting.swap_remove(at);
        }
        raised
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manual_clock_jumps_and_never_goes_back() {
        let clock = ManualClock::default();
        let same = clock.clone();
        clock.wait_until(Timestamp(50));
        same.wait_until(Timestamp(20));
        assert_eq!((clock.now(), same.now()), (Timestamp(50), Timestamp(50)));
        let stop = Signal::default();
        stop.raise();
        assert!(clock.wait_or(Timestamp(90), &stop) && clock.wait_or(Timestamp::NEVER, &stop));
        assert_eq!(clock.now(), Timestamp(50), "a raised signal leaves no time to wait");
    }

    #[test]
    fn the_monotonic_clock_waits_and_does_not_go_back() {
        let clock = MonotonicClock::new();
        let before = clock.now();
        let goal = before.plus_seconds(0.002);
        clock.wait_until(goal);
        assert!(clock.now() >= goal);
        let after = clock.now();
        clock.wait_until(before);
        assert!(clock.now() >= after);
    }

    #[test]
    fn a_signal_ends_a_wait() {
        let (clock, stop) = (MonotonicClock::new(), Signal::default());
        let theirs = stop.clone();
        let waiting = std::thread::spawn(move || clock.wait_or(Timestamp::NEVER, &theirs));
        stop.raise();
        assert!(waiting.join().unwrap());
    }

    #[test]
    fn a_stepped_clock_wakes_those_whose_time_has_come() {
        let clock = SteppedClock::default();
        let threads: Vec<_> = [30, 10]
            .map(|t| {
                let clock = clock.clone();
                std::thread::spawn(move || {
                    clock.wait_until(Timestamp(t));
                    clock.now()
                })
            })
            .into_iter()
            .collect();
        assert_eq!(clock.next_wake_of(2), Timestamp(10));
        clock.advance_to(Timestamp(10));
        clock.advance_to(Timestamp(5));
        while clock.next_wake() < Timestamp(30) {}
        clock.advance_to(Timestamp(40));
        let times: Vec<Timestamp> = threads.into_iter().map(|t| t.join().unwrap()).collect();
        assert_eq!(times[0], Timestamp(40));
        assert!(times[1] >= Timestamp(10));
    }
}
