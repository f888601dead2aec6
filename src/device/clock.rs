//! Clocks on the monotonic time line of the frames. The only place that asks the machine for the time.

use super::Clock;
use crate::model::time::Timestamp;
use std::time::{Duration, Instant};

/// The machine's monotonic clock; zero is when it was made.
#[derive(Clone, Copy, Debug)]
pub struct MonotonicClock {
    zero: Instant,
}

impl MonotonicClock {
    /// Starts at zero.
    pub fn new() -> Self {
        Self { zero: Instant::now() }
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

    fn wait_until(&mut self, t: Timestamp) {
        let left = t.0.saturating_sub(self.now().0);
        if let Ok(nanoseconds) = u64::try_from(left) {
            std::thread::sleep(Duration::from_nanos(nanoseconds));
        }
    }
}

/// A clock that moves only when told: waiting jumps. It never goes back.
#[derive(Clone, Copy, Debug, Default)]
pub struct ManualClock {
    now: Timestamp,
}

impl ManualClock {
    /// Starts at this time.
    pub fn new(now: Timestamp) -> Self {
        Self { now }
    }
}

impl Clock for ManualClock {
    fn now(&self) -> Timestamp {
        self.now
    }

    fn wait_until(&mut self, t: Timestamp) {
        self.now = self.now.max(t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manual_clock_jumps_and_never_goes_back() {
        let mut clock = ManualClock::default();
        clock.wait_until(Timestamp(50));
        clock.wait_until(Timestamp(20));
        assert_eq!(clock.now(), Timestamp(50));
    }

    #[test]
    fn the_monotonic_clock_waits_and_does_not_go_back() {
        let mut clock = MonotonicClock::new();
        let before = clock.now();
        let goal = before.plus_seconds(0.002);
        clock.wait_until(goal);
        assert!(clock.now() >= goal);
        let after = clock.now();
        clock.wait_until(before);
        assert!(clock.now() >= after);
    }
}
