//! Time on one monotonic clock.

/// Nanoseconds on the monotonic clock of the recording or the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// Later than all times.
    pub const NEVER: Self = Self(i64::MAX);

    /// Rounds to whole nanoseconds; what does not fit is cut to the ends of the range.
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// Seconds since the clock's zero.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// `self - earlier` in seconds; negative where `earlier` is later.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }

    /// This time plus seconds (which may be negative).
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0.saturating_add((seconds * 1e9).round() as i64))
    }
}
