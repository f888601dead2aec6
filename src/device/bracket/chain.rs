//! Which write was in force at which frame: a hidden Markov chain over the frames that could be measured.
//!
//! The state of a frame is the number of the write in force. Costs are -ln probability: of the write's delay ([`Delays`]), and
//! of the light's change between two frames, which follows from both states and both levels. Metadata has no part in it, so that
//! the pictures can contradict it. A frame's margin is by how much the best path through any other exposure costs more than the best of all.

use super::offsets::Offsets;
use super::shape::Level;
use super::writes::{Delays, Writes};
use crate::model::frame::Exposure;

/// Most writes that a frame chooses from; at one write a frame there are eleven.
pub(super) const STATES: usize = 12;
/// Cost of light that changes in the whole scene from one frame to the next.
const JUMP: f64 = 14.0;
/// Two frames up to this cost of light are joined: one light, three sigma.
const JOINED: f64 = 4.5;
/// Exposures nearer than this, ln, are one.
pub(super) const SAME: f64 = 0.02;
/// The margin from which a frame tells of its exposure's truth.
const CLEAR: f64 = 8.0;
/// Frames apart after which light may have become anything.
const FAR_APART: u64 = 16;

/// A frame in the chain.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub sequence: u64,
    pub level: Level,
    /// ln of the stated exposure.
    pub stated: Option<f64>,
    /// Number of the write of the first state.
    first: u64,
    count: usize,
    log: [f64; STATES],
    exposure: [Exposure; STATES],
    after_sequence: [u64; STATES],
    /// -ln P(this write came in force since the frame before).
    arrives: [f64; STATES],
    /// -ln P(the next write did not).
    next_waits: [f64; STATES],
    /// Cost of the best path up to here.
    alpha: [f64; STATES],
    /// Cost of the best path from here on, and its next state.
    beta: [f64; STATES],
    onward: [usize; STATES],
}

/// What the chain says of one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finding {
    pub state: usize,
    /// ln of its exposure; not a number where that is unknown.
    pub log: f64,
    pub exposure: Exposure,
    pub margin: f64,
    /// A frame of another exposure saw the same light: the exposure is what it is said to be.
    pub joined: bool,
    /// Over several frames this exposure has seen the light that others see.
    pub proven: bool,
}

/// A frame that was decided, as the next one needs it.
#[derive(Clone, Copy, Debug)]
struct Decided {
    state: usize,
    joined: bool,
}

/// The frames that wait, after the last one that was decided.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    entries: Vec<Entry>,
    decided: Option<Decided>,
    /// Mean |change of ln light| from frame to frame.
    unrest: f64,
    offsets: Offsets,
}

impl Entry {
    pub fn new(sequence: u64, level: Level, stated: Option<f64>, writes: &Writes) -> Self {
        let (begin, end) = writes.candidates(sequence);
        let first = begin.max(end.saturating_sub(STATES as u64));
        let none = Exposure { time_s: f64::NAN, gain: f64::NAN };
        let mut entry = Self {
            sequence,
            level,
            stated,
            first,
            count: 0,
            log: [f64::NAN; STATES],
            exposure: [none; STATES],
            after_sequence: [0; STATES],
            arrives: [0.0; STATES],
            next_waits: [0.0; STATES],
            alpha: [0.0; STATES],
            beta: [0.0; STATES],
            onward: [0; STATES],
        };
        for write in (first..end).map_while(|number| writes.get(number)) {
            let k = entry.count;
            entry.log[k] = write.log;
            entry.exposure[k] = write.exposure;
            entry.after_sequence[k] = write.after_sequence;
            entry.count += 1;
        }
        entry
    }

    fn set_delays(&mut self, before: u64, delays: &Delays) {
        for k in 0..self.count {
            let ln = |k: usize| delays.ln_still_waiting(self.after_sequence[k], before, self.sequence);
            self.arrives[k] = -(-ln(k).exp_m1()).max(1e-6).ln();
            self.next_waits[k] = if k + 1 < self.count { -ln(k + 1) } else { 0.0 };
        }
    }
}

/// Cost of the change of light between two frames of these states; `None` where nothing is known of it.
fn light(a: &Entry, i: usize, b: &Entry, k: usize, unrest: f64) -> Option<f64> {
    let one_write = a.first + i as u64 == b.first + k as u64;
    if a.level.epoch != b.level.epoch || b.sequence - a.sequence > FAR_APART {
        return None;
    }
    let exposures = if one_write { 0.0 } else { b.log[k] - a.log[i] };
    let change = b.level.log - a.level.log - exposures;
    if change.is_nan() {
        return None;
    }
    let sigma = 1.5 * unrest;
    let variance = sigma * sigma + a.level.error.powi(2) + b.level.error.powi(2);
    Some((0.5 * change * change / variance).min(JUMP))
}

fn transition(a: &Entry, i: usize, b: &Entry, k: usize, unrest: f64) -> f64 {
    let (from, to) = (a.first + i as u64, b.first + k as u64);
    if to < from {
        return f64::INFINITY;
    }
    let arrives = if to > from { b.arrives[k] } else { 0.0 };
    arrives + b.next_waits[k] + light(a, i, b, k, unrest).unwrap_or(0.0)
}

/// The least unrest of light, ln a frame.
const LEAST_UNREST: f64 = 0.02;
/// The most that is believed: beyond, half an exposure step could be light.
const MOST_UNREST: f64 = 0.12;

impl Chain {
    pub fn new(capacity: usize) -> Self {
        Self {
            entries: Vec::with_capacity(capacity + 2),
            decided: None,
            unrest: LEAST_UNREST,
            offsets: Offsets::new(),
        }
    }

    pub fn clear(&mut self) {
        self.entries.clear();
        self.decided = None;
        self.unrest = LEAST_UNREST;
    }

    /// Entries that wait for their decision.
    pub fn waiting(&self) -> usize {
        self.entries.len() - usize::from(self.decided.is_some())
    }

    /// What is stated of the oldest waiting frame, and whether the scene had changed with it.
    pub fn oldest(&self) -> Option<(Option<f64>, bool)> {
        let entry = self.entries.get(usize::from(self.decided.is_some()))?;
        Some((entry.stated, entry.level.begins))
    }

    /// The largest mean residual of an exposure, ln.
    pub fn worst_offset(&self) -> f64 {
        self.offsets.worst()
    }

    /// The mean change of ln light from frame to frame.
    pub fn unrest(&self) -> f64 {
        self.unrest
    }

    /// Adds a frame, newer than all others.
    pub fn push(&mut self, mut entry: Entry, delays: &Delays) {
        if let Some(before) = self.entries.last() {
            entry.set_delays(before.sequence, delays);
            for k in 0..entry.count {
                let paths = (0..before.count)
                    .map(|i| before.alpha[i] + transition(before, i, &entry, k, self.unrest));
                entry.alpha[k] = paths.fold(f64::INFINITY, f64::min);
            }
            let least = entry.alpha[..entry.count].iter().copied().fold(f64::INFINITY, f64::min);
            let least = if least.is_finite() { least } else { 0.0 };
            entry.alpha[..entry.count].iter_mut().for_each(|alpha| *alpha -= least);
        }
        self.entries.push(entry);
        self.look_back();
    }

    /// Fills in beta of all waiting frames.
    fn look_back(&mut self) {
        let from = usize::from(self.decided.is_some());
        if let Some(last) = self.entries.last_mut() {
            last.beta = [0.0; STATES];
        }
        for at in (from..self.entries.len().saturating_sub(1)).rev() {
            let (head, tail) = self.entries.split_at_mut(at + 1);
            let (Some(a), Some(b)) = (head.last_mut(), tail.first()) else { return };
            for i in 0..a.count {
                let mut best = (f64::INFINITY, 0);
                for k in 0..b.count {
                    let cost = transition(a, i, b, k, self.unrest) + b.beta[k];
                    if cost < best.0 {
                        best = (cost, k);
                    }
                }
                (a.beta[i], a.onward[i]) = best;
            }
        }
    }

    /// What is known of the oldest waiting frame.
    pub fn find(&self) -> Option<Finding> {
        let at = usize::from(self.decided.is_some());
        let entry = self.entries.get(at)?;
        let total = |k: usize| entry.alpha[k] + entry.beta[k];
        let state = (0..entry.count).min_by(|a, b| total(*a).total_cmp(&total(*b)))?;
        let log = entry.log[state];
        let others = (0..entry.count).filter(|k| !((entry.log[*k] - log).abs() <= SAME));
        let other = others.map(total).fold(f64::INFINITY, f64::min);
        let margin = other - total(state);
        let joined = self.joined_before(at, state) || self.joined_after(at, state);
        let proven = self.offsets.is_true(log, self.unrest);
        Some(Finding { state, log, exposure: entry.exposure[state], margin, joined, proven })
    }

    fn joined_before(&self, at: usize, state: usize) -> bool {
        let (Some(decided), Some(entry)) = (self.decided, self.entries.get(at)) else { return false };
        let before = &self.entries[0];
        let close =
            light(before, decided.state, entry, state, self.unrest).is_some_and(|cost| cost <= JOINED);
        let differs = (before.log[decided.state] - entry.log[state]).abs() > SAME;
        close && (differs || decided.joined)
    }

    fn joined_after(&self, at: usize, mut state: usize) -> bool {
        for pair in self.entries[at..].windows(2) {
            let next = pair[0].onward[state];
            let close = light(&pair[0], state, &pair[1], next, self.unrest).is_some_and(|c| c <= JOINED);
            if !close {
                return false;
            }
            if (pair[0].log[state] - pair[1].log[next]).abs() > SAME {
                return true;
            }
            state = next;
        }
        false
    }

    /// The oldest waiting frame is done with; `sure` ones teach the delays.
    pub fn decide(&mut self, finding: &Finding, sure: bool, delays: &mut Delays) {
        if let (Some(decided), [before, entry, ..]) = (self.decided, self.entries.as_slice()) {
            if let Some(change) = self.change(before, decided, entry, finding) {
                self.unrest =
                    (self.unrest + 0.02 * (change.abs() - self.unrest)).clamp(LEAST_UNREST, MOST_UNREST);
                let other = before.log[decided.state];
                if finding.margin >= CLEAR && (finding.log - other).abs() > SAME {
                    self.offsets.add(finding.log, other, change);
                }
            }
            let adjacent = entry.sequence == before.sequence + 1;
            if sure && decided.joined && adjacent {
                // A write of the exposure that was in force already arrives unseen, and teaches nothing.
                let shows = |log: f64| (log - before.log[decided.state]).abs() > SAME;
                if shows(finding.log) {
                    delays.saw(entry.after_sequence[finding.state], entry.sequence, true);
                }
                let next = finding.state + 1;
                if next < entry.count && (entry.log[next] - finding.log).abs() > SAME {
                    delays.saw(entry.after_sequence[next], entry.sequence, false);
                }
            }
            self.entries.remove(0);
        }
        self.decided = Some(Decided { state: finding.state, joined: finding.joined });
    }

    /// Change of ln light between the frame last decided and this one, where it may be unrest and not a jump.
    fn change(&self, before: &Entry, decided: Decided, entry: &Entry, finding: &Finding) -> Option<f64> {
        let cost = light(before, decided.state, entry, finding.state, self.unrest)?;
        let exposures = finding.log - before.log[decided.state];
        let change = entry.level.log - before.level.log - exposures;
        (finding.joined && cost < JUMP && change.is_finite()).then_some(change)
    }
}
