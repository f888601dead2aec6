//! Exposures that are not what the driver says of them: a control that is rounded or cut in silence.
//!
//! Each exposure's mean residual, of ln light that two joined frames of different exposure should have seen alike. A residual
//! counts for both exposures, for nobody knows whose it is.

use super::chain::SAME;

/// Exposures that are watched at once.
const WATCHED: usize = 16;
/// Residuals before an exposure is known well enough.
const FEWEST: f64 = 8.0;
/// Residuals that a mean remembers.
const MEMORY: f64 = 40.0;
/// The mean residual that a true exposure may have, ln.
const TOLERATED: f64 = 0.025;

#[derive(Clone, Copy, Debug)]
struct Offset {
    log: f64,
    mean: f64,
    count: f64,
    used: u64,
}

/// Mean residuals by exposure; the one unseen for longest makes room for a new one.
#[derive(Clone, Debug)]
pub(super) struct Offsets {
    kept: [Offset; WATCHED],
    clock: u64,
}

impl Offsets {
    pub fn new() -> Self {
        Self { kept: [Offset { log: f64::NAN, mean: 0.0, count: 0.0, used: 0 }; WATCHED], clock: 0 }
    }

    /// Adds a residual of an exposure (ln); `other` is the exposure that it was compared with.
    pub fn add(&mut self, log: f64, other: f64, residual: f64) {
        for (log, residual) in [(log, residual), (other, -residual)] {
            self.clock += 1;
            let close = |offset: &Offset| (offset.log - log).abs() <= 0.1 * SAME;
            let at = self.kept.iter().position(close);
            let oldest = (0..WATCHED).min_by_key(|k| self.kept[*k].used).unwrap_or(0);
            let offset = &mut self.kept[at.unwrap_or(oldest)];
            if at.is_none() {
                *offset = Offset { log, mean: 0.0, count: 0.0, used: 0 };
            }
            offset.used = self.clock;
            offset.count = (offset.count + 1.0).min(MEMORY);
            offset.mean += (residual - offset.mean) / offset.count;
        }
    }

    /// Whether this exposure (ln) has been seen often enough, and sees the light that the others see. `unrest` is the mean
    /// |change of ln light| from frame to frame, which the mean must be allowed.
    pub fn is_true(&self, log: f64, unrest: f64) -> bool {
        let kept = self.kept.iter().find(|offset| (offset.log - log).abs() <= 0.1 * SAME);
        kept.is_some_and(|offset| {
            // Below the least unrest there is none to speak of; a mean's error is that of one over sqrt(n), times 3.
            let allowed = 3.0 * (unrest - 0.02).max(0.0) / offset.count.sqrt();
            offset.count >= FEWEST && offset.mean.abs() <= TOLERATED + allowed
        })
    }

    /// The largest mean residual among exposures in use, ln.
    pub fn worst(&self) -> f64 {
        let known = self.kept.iter().filter(|offset| offset.count >= FEWEST);
        known.map(|offset| offset.mean.abs()).fold(0.0, f64::max)
    }
}
