//! What was written to the control, and how many frames a write takes to be in force.

use crate::model::frame::Exposure;
use std::collections::VecDeque;

/// Writes that are remembered: more than can be under way.
const REMEMBERED: usize = 64;
/// The longest delay that is told apart, frames; longer ones count as this.
pub(super) const LONGEST_DELAY: usize = 9;
/// Frames after which old evidence on delays has halved, about.
const FORGETTING: f64 = 0.9985;
/// No delay is ruled out for good, and none is certain: a loaded machine changes them.
const RAREST: f64 = 1e-3;
/// Share that is taken before anything was seen.
const FIRST_GUESS: f64 = 0.25;

/// One write.
#[derive(Clone, Copy, Debug)]
pub(super) struct Write {
    /// ln of time times gain as the driver read it back; not a number where that was none.
    pub log: f64,
    pub exposure: Exposure,
    /// The newest frame at the time of the write.
    pub after_sequence: u64,
}

/// The newest writes, numbered from 0. Number 0 stands for what the camera did before anybody wrote.
#[derive(Clone, Debug)]
pub(super) struct Writes {
    kept: VecDeque<Write>,
    /// Number of the first one kept.
    first: u64,
}

impl Writes {
    pub fn new() -> Self {
        let mut kept = VecDeque::with_capacity(REMEMBERED + 1);
        let exposure = Exposure { time_s: f64::NAN, gain: f64::NAN };
        kept.push_back(Write { log: f64::NAN, exposure, after_sequence: 0 });
        Self { kept, first: 0 }
    }

    pub fn push(&mut self, exposure: Exposure, after_sequence: u64) {
        let effective_s = exposure.effective_s();
        let sound = effective_s.is_finite() && effective_s > 0.0;
        let log = if sound { effective_s.ln() } else { f64::NAN };
        // Writes are in order whatever the caller counts.
        let after_sequence = after_sequence.max(self.kept.back().map_or(0, |write| write.after_sequence));
        self.kept.push_back(Write { log, exposure, after_sequence });
        if self.kept.len() > REMEMBERED {
            self.kept.pop_front();
            self.first += 1;
        }
    }

    pub fn last(&self) -> Option<&Write> {
        self.kept.back().filter(|_| self.first > 0 || self.kept.len() > 1)
    }

    pub fn get(&self, number: u64) -> Option<&Write> {
        self.kept.get(usize::try_from(number.checked_sub(self.first)?).ok()?)
    }

    /// Numbers of the writes that a frame may have been exposed by: from the newest that must be in force to the newest that
    /// came before the frame.
    pub fn candidates(&self, sequence: u64) -> (u64, u64) {
        let end = self.kept.partition_point(|write| write.after_sequence < sequence).max(1);
        let old = |write: &Write| write.after_sequence.saturating_add(1 + LONGEST_DELAY as u64) <= sequence;
        let begin = self.kept.partition_point(old).saturating_sub(1).min(end - 1);
        (self.first + begin as u64, self.first + end as u64)
    }

    /// The exposure that a frame had whatever the delay: all writes that may have been in force are equal.
    pub fn certain(&self, sequence: u64) -> Option<Exposure> {
        let (begin, end) = self.candidates(sequence);
        let mut writes = (begin..end).map_while(|number| self.get(number));
        let first = writes.next().filter(|write| write.log.is_finite())?;
        writes.all(|write| (write.log - first.log).abs() < 1e-3).then_some(first.exposure)
    }

    /// Whether all that is remembered is one exposure.
    pub fn all_equal(&self) -> bool {
        let Some(last) = self.last() else { return false };
        self.kept.iter().skip(usize::from(self.first == 0)).all(|w| (w.log - last.log).abs() < 1e-3)
    }
}

/// For each delay k: the share of writes in force at k frames after the first possible one, among those that were not before.
#[derive(Clone, Debug)]
pub(super) struct Delays {
    arrived: [f64; LONGEST_DELAY + 1],
    at_risk: [f64; LONGEST_DELAY + 1],
    /// `ln_waiting[k]` = the sum over delays below k of ln (1 - share).
    ln_waiting: [f64; LONGEST_DELAY + 2],
}

impl Delays {
    pub fn new() -> Self {
        let mut delays = Self {
            arrived: [0.0; LONGEST_DELAY + 1],
            at_risk: [0.0; LONGEST_DELAY + 1],
            ln_waiting: [0.0; LONGEST_DELAY + 2],
        };
        delays.sum_up();
        delays
    }

    fn share(&self, delay: usize) -> f64 {
        ((self.arrived[delay] + FIRST_GUESS) / (self.at_risk[delay] + 1.0)).clamp(RAREST, 1.0 - RAREST)
    }

    fn sum_up(&mut self) {
        for delay in 0..=LONGEST_DELAY {
            self.ln_waiting[delay + 1] = self.ln_waiting[delay] + (1.0 - self.share(delay)).ln();
        }
    }

    /// ln of the probability that a write after frame `after_sequence`, not in force at frame `from`, is not in force at frame
    /// `to` either. At most 0.
    pub fn ln_still_waiting(&self, after_sequence: u64, from: u64, to: u64) -> f64 {
        let passed = |frame: u64| (frame.saturating_sub(after_sequence) as usize).min(LONGEST_DELAY + 1);
        let ln = self.ln_waiting[passed(to)] - self.ln_waiting[passed(from)];
        // Beyond the longest delay nothing was counted: a write that is still waiting there is as rare as it gets.
        if to.saturating_sub(after_sequence) as usize > LONGEST_DELAY + 1 { ln + RAREST.ln() } else { ln }
    }

    /// Learns that a write was in force for the first time at frame `sequence`, or was not yet.
    pub fn saw(&mut self, after_sequence: u64, sequence: u64, arrived: bool) {
        let Some(delay) = sequence.checked_sub(after_sequence.saturating_add(1)) else { return };
        let delay = (delay as usize).min(LONGEST_DELAY);
        for value in self.arrived.iter_mut().chain(&mut self.at_risk) {
            *value *= FORGETTING;
        }
        self.at_risk[delay] += 1.0;
        if arrived {
            self.arrived[delay] += 1.0;
        }
        self.sum_up();
    }

    /// Shares of writes by their delay in frames, and the weight of what was seen.
    pub fn shares(&self) -> ([f64; LONGEST_DELAY + 1], f64) {
        let all: f64 = self.arrived.iter().sum();
        (self.arrived.map(|n| if all > 0.0 { n / all } else { 0.0 }), all)
    }
}
