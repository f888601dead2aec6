//! The gyroscope's newest samples in order of time, and the turn between two times.

use crate::model::time::Timestamp;
use glam::{DQuat, DVec3};
use std::collections::VecDeque;

/// Samples that are kept: 10 s at 200 a second, 2 s at 1000.
pub const KEPT_SAMPLES: usize = 2048;
/// Samples may come swapped within this time, seconds.
const SORT_WITHIN_S: f64 = 0.020;
/// No gyroscope in a hand turns faster (2000 degrees a second), rad/s.
const FASTEST_RAD_S: f64 = 35.0;
/// Between two samples farther apart than this the rate is not known, seconds.
const LONGEST_GAP_S: f64 = 0.05;
/// The last rate is taken to go on for so long, seconds.
const GOES_ON_S: f64 = 0.06;

/// What became of the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SampleCounts {
    /// Counted as sound and used.
    pub taken: u64,
    /// Left out: not finite, or faster than any hand.
    pub absurd: u64,
    /// Left out: more than 20 ms older than the newest, or of the time of another.
    pub late: u64,
}

/// One rate, sensor axes.
#[derive(Clone, Copy, Debug)]
pub struct RateSample {
    /// True time.
    pub t: Timestamp,
    /// As shown, with its bias.
    pub rate_rad_s: DVec3,
}

/// The turn between two times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Later camera axes to earlier camera axes.
    pub rotation: DQuat,
    /// Time for which the rate was known, seconds.
    pub covered_s: f64,
    /// The rest, seconds.
    pub uncovered_s: f64,
}

/// A ring of samples.
#[derive(Clone, Debug)]
pub struct RateRing {
    samples: VecDeque<RateSample>,
    counts: SampleCounts,
}

impl Default for RateRing {
    fn default() -> Self {
        Self { samples: VecDeque::with_capacity(KEPT_SAMPLES), counts: SampleCounts::default() }
    }
}

impl RateRing {
    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Samples that fit without new memory.
    #[cfg(test)]
    pub fn capacity(&self) -> usize {
        self.samples.capacity()
    }

    /// Samples taken and left out so far.
    pub fn counts(&self) -> SampleCounts {
        self.counts
    }

    /// Mean time between the kept samples, seconds; 0 for fewer than two.
    pub fn spacing_s(&self) -> f64 {
        match (self.samples.front(), self.samples.back()) {
            (Some(first), Some(last)) if self.samples.len() > 1 => {
                last.t.seconds_since(first.t) / (self.samples.len() - 1) as f64
            }
            _ => 0.0,
        }
    }

    /// Takes a sample in its place; returns whether it was taken.
    pub fn insert(&mut self, t: Timestamp, rate_rad_s: DVec3) -> bool {
        if !rate_rad_s.is_finite() || rate_rad_s.abs().max_element() > FASTEST_RAD_S {
            self.counts.absurd += 1;
            return false;
        }
        let newest = self.samples.back().map_or(t, |last| last.t);
        let at = self.samples.partition_point(|sample| sample.t < t);
        let is_double = self.samples.get(at).is_some_and(|sample| sample.t == t);
        if is_double || newest.seconds_since(t) > SORT_WITHIN_S {
            self.counts.late += 1;
            return false;
        }
        if self.samples.len() == KEPT_SAMPLES {
            self.samples.pop_front();
        }
        let at = self.samples.partition_point(|sample| sample.t < t);
        self.samples.insert(at, RateSample { t, rate_rad_s });
        self.counts.taken += 1;
        true
    }

    /// The turn from one time to a later one: rates without `bias`, linear between samples, with the second-order term
    /// (a x b) dt^2 / 12 of a rate that changes its axis. Where the rate is not known nothing turns.
    pub fn turn(&self, from: Timestamp, to: Timestamp, bias: DVec3, camera_from_imu: DQuat) -> Turn {
        let whole_s = to.seconds_since(from).max(0.0);
        let mut turn = Turn { rotation: DQuat::IDENTITY, covered_s: 0.0, uncovered_s: whole_s };
        let mut add = |a: DVec3, b: DVec3, dt: f64| {
            let (a, b) = (camera_from_imu * (a - bias), camera_from_imu * (b - bias));
            let vector = (a + b) * (0.5 * dt) + a.cross(b) * (dt * dt / 12.0);
            turn.rotation *= DQuat::from_scaled_axis(vector);
            turn.covered_s += dt;
        };
        let first = self.samples.partition_point(|sample| sample.t <= from).saturating_sub(1);
        let mut samples = self.samples.range(first.min(self.samples.len())..).peekable();
        while let Some(sample) = samples.next() {
            if sample.t >= to {
                break;
            }
            let (end, rate_at_end) = match samples.peek() {
                Some(next) if next.t.seconds_since(sample.t) <= LONGEST_GAP_S => (next.t, next.rate_rad_s),
                Some(_) => continue,
                None => (sample.t.plus_seconds(GOES_ON_S), sample.rate_rad_s),
            };
            let (begin, stop) = (sample.t.max(from), end.min(to));
            if stop <= begin {
                continue;
            }
            let span_s = end.seconds_since(sample.t);
            let at = |t: Timestamp| sample.rate_rad_s.lerp(rate_at_end, t.seconds_since(sample.t) / span_s);
            add(at(begin), at(stop), stop.seconds_since(begin));
        }
        turn.uncovered_s = (whole_s - turn.covered_s).max(0.0);
        turn
    }
}
