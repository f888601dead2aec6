//! Frame-accurate bracketing: exposures change with every frame, and nobody waits for the sensor.
//!
//! A written exposure is in force some frames later, not always as many, and hardly a driver says which frame had which. The
//! [`Scheduler`] says what to write next, takes each frame as a [`Thumbnail`], and tells its exposure a few frames later, or
//! that nobody can know. It is pure: no clock, no device; `simulator` has a camera with every fault to try it on.
//!
//! **Method.** A frame's level is the median over blocks of ln (light seen / light of the scene so far): the sum of ln exposure,
//! ln light and a constant. The scheduler compares all sequences of writes that may have been in force (`chain`): delays cost
//! by how rare they have been, changes of light by how large they are. A frame is [`Attribution::Sure`] where every sequence
//! with another exposure is worse by [`SURE`] in -ln probability, and a frame of another exposure saw the same light.
//!
//! **What cannot be told.** Light that changes everywhere by just the ratio of two exposures, for one frame, where delays vary
//! so much that both exposures are to be expected: that picture is the other exposure's, to the bit. Spacings that are not
//! equal ([`plan`]) make this rarer.

mod chain;
mod offsets;
pub mod plan;
pub mod response;
mod shape;
pub mod simulator;
mod stated;
pub mod thumbnail;
mod writes;

#[cfg(test)]
mod tests;

use crate::model::{frame::Exposure, time::Timestamp};
use chain::{Chain, Entry, Finding};
use halflight_math::dice;
use shape::Shapes;
pub use stated::Belief;
use stated::Stated;
use std::collections::VecDeque;
pub use thumbnail::{Thumbnail, ThumbnailReader};
use writes::{Delays, Writes};

/// Most exposures of a cycle.
pub const MOST_EXPOSURES: usize = 9;
/// By how much the second best explanation must be worse, in -ln probability: 1 in 480 million.
pub const SURE: f64 = 20.0;
/// Frames after which a frame that is still not sure is given up.
const LONGEST_WAIT: usize = 8;
/// Writes at the start that follow no cycle, so that a delay of one round is not taken for none.
const START: u64 = 24;
/// Frames in a row from the past that mean a camera which counts from the beginning again.
const MOST_LATE: u32 = 16;

/// A cycle that no camera can have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BadCycle {
    /// None, or too many.
    #[error("{0} exposures in a cycle: must be 1 to {MOST_EXPOSURES}")]
    Count(usize),
    /// No time, or no gain.
    #[error("exposure {index} of the cycle is {time_s} s at gain {gain}: must be finite and above 0")]
    Exposure {
        /// From 0.
        index: usize,
        /// Seconds.
        time_s: f64,
        /// 1 = none.
        gain: f64,
    },
}

/// One frame as it came.
#[derive(Clone, Copy, Debug)]
pub struct FrameSeen<'a> {
    /// The driver's count of frames.
    pub sequence: u64,
    /// The driver's time of the frame.
    pub t: Timestamp,
    /// What the driver says that it was exposed with.
    pub stated: Option<Exposure>,
    /// The frame in small.
    pub thumbnail: &'a Thumbnail,
}

/// Why a frame's exposure is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsure {
    /// Too few blocks are well exposed, here and in what is known of the scene.
    NothingToSee,
    /// Blocks disagree: the scene moved, or its light changed from place to place.
    SceneMoved,
    /// Two exposures explain what is seen.
    Ambiguous,
    /// No written exposure explains what is seen: the control did something else, or the light changed for one frame.
    NotExplained,
    /// The camera was started again, or the cycle's history was forgotten, before the frame was decided.
    Abandoned,
}

/// What is known of a frame's exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Attribution {
    /// It was exposed with this.
    Sure(Exposure),
    /// Leave it out.
    Unsure(Unsure),
    /// The same frame has come before.
    Duplicate,
    /// A newer frame has come before.
    Late,
}

/// A frame with its attribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settled {
    /// Counts the calls of [`Scheduler::frame`], from 0.
    pub arrival: u64,
    /// The driver's count.
    pub sequence: u64,
    /// What is known.
    pub attribution: Attribution,
}

/// What the scheduler has found so far. Counts are since its making.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Frames that were settled.
    pub settled: u64,
    /// Those of known exposure.
    pub sure: u64,
    /// Frames that came twice.
    pub duplicates: u64,
    /// Frames that came after newer ones.
    pub late: u64,
    /// Frames that never came: gaps of the driver's count.
    pub lost: u64,
    /// Frames whose picture no write explains; many mean that the driver does not do what it reads back.
    pub not_explained: u64,
    /// Writes that were read back as something else by more than 0.1 %.
    pub altered_writes: u64,
    /// How often the scene changed so much that it was learned anew.
    pub scenes: u64,
    /// What metadata is worth.
    pub metadata: Belief,
    /// Shares of writes by how many frames later than at once (the next frame) they were in force, 0 to 9.
    pub delays: [f64; 10],
    /// Writes that this rests on; the older the less they weigh.
    pub delays_from: f64,
    /// Mean |change of ln light| from frame to frame: 0.02 is the least that is told.
    pub unrest: f64,
    /// By how much the worst exposure differs from what was read back, in ln, as far as the others are right. Frames are sure
    /// up to 0.025, and 13 % and more is [`Unsure::NotExplained`] at once.
    pub worst_offset: f64,
}

#[derive(Clone, Copy, Debug)]
struct Waiting {
    arrival: u64,
    sequence: u64,
    /// `None` where the chain decides.
    attribution: Option<Attribution>,
}

/// Cycles exposures and tells which frame had which. Allocates nothing after its making.
#[derive(Clone, Debug)]
pub struct Scheduler {
    cycle: [Exposure; MOST_EXPOSURES],
    count: usize,
    asked: u64,
    last_asked: Option<(Exposure, u64)>,
    writes: Writes,
    delays: Delays,
    shapes: Shapes,
    chain: Chain,
    stated: Stated,
    waiting: VecDeque<Waiting>,
    newest: Option<(u64, Timestamp)>,
    newest_seen: Thumbnail,
    late_in_a_row: u32,
    report: Report,
    arrivals: u64,
}

impl Scheduler {
    /// A scheduler of these exposures, in this order.
    ///
    /// # Errors
    /// None or too many exposures, or one that is not finite and above 0.
    pub fn new(cycle: &[Exposure]) -> Result<Self, BadCycle> {
        let nothing = Exposure { time_s: 1.0, gain: 1.0 };
        let mut scheduler = Self {
            cycle: [nothing; MOST_EXPOSURES],
            count: 0,
            asked: 0,
            last_asked: None,
            writes: Writes::new(),
            delays: Delays::new(),
            shapes: Shapes::default(),
            chain: Chain::new(LONGEST_WAIT + 1),
            stated: Stated::default(),
            waiting: VecDeque::with_capacity(4 * MOST_LATE as usize),
            newest: None,
            newest_seen: Thumbnail::default(),
            late_in_a_row: 0,
            report: Report {
                settled: 0,
                sure: 0,
                duplicates: 0,
                late: 0,
                lost: 0,
                not_explained: 0,
                altered_writes: 0,
                scenes: 0,
                metadata: Belief::Unproven,
                delays: [0.0; 10],
                delays_from: 0.0,
                unrest: 0.0,
                worst_offset: 0.0,
            },
            arrivals: 0,
        };
        scheduler.set_cycle(cycle)?;
        Ok(scheduler)
    }

    /// Uses other exposures from the next write on; what is known of delays and scene stays.
    ///
    /// # Errors
    /// As [`Scheduler::new`]; the old cycle goes on.
    pub fn set_cycle(&mut self, cycle: &[Exposure]) -> Result<(), BadCycle> {
        if cycle.is_empty() || cycle.len() > MOST_EXPOSURES {
            return Err(BadCycle::Count(cycle.len()));
        }
        let sound = |x: f64| x.is_finite() && x > 0.0;
        let is_bad = |e: &Exposure| !(sound(e.time_s) && sound(e.gain) && sound(e.effective_s()));
        if let Some((index, bad)) = cycle.iter().enumerate().find(|(_, e)| is_bad(e)) {
            return Err(BadCycle::Exposure { index, time_s: bad.time_s, gain: bad.gain });
        }
        self.cycle[..cycle.len()].copy_from_slice(cycle);
        self.count = cycle.len();
        Ok(())
    }

    /// The exposures in use.
    pub fn cycle(&self) -> &[Exposure] {
        &self.cycle[..self.count]
    }

    /// What to write to the control now, where `now_sequence` is the newest frame that came; at most once a frame. `None` where
    /// nothing is to be written. The first 24 follow no cycle, so that delays can be measured.
    pub fn next_write(&mut self, now_sequence: u64) -> Option<Exposure> {
        if self.last_asked.is_some_and(|(_, at)| now_sequence <= at) {
            return None;
        }
        let of = self.count as u64;
        let place = if self.asked < START {
            dice::mix(self.asked.wrapping_add(1).wrapping_mul(dice::STEP)) % of
        } else {
            self.asked % of
        };
        let wanted = self.cycle[place as usize];
        if of == 1 && self.last_asked.is_some_and(|(last, _)| last == wanted) {
            return None;
        }
        self.asked += 1;
        self.last_asked = Some((wanted, now_sequence));
        Some(wanted)
    }

    /// Tells that the control was written: what was asked, what the driver read back (its truth; where it cannot be read, what
    /// was asked), and the newest frame that had come when the write began. A write that failed is not told.
    pub fn written(&mut self, asked: Exposure, read_back: Exposure, after_sequence: u64) {
        let altered = !((asked.effective_s() / read_back.effective_s()).ln().abs() <= 1e-3);
        self.report.altered_writes += u64::from(altered);
        self.writes.push(read_back, after_sequence);
    }

    /// Takes a frame. What is known of it, and of earlier ones, comes out of [`Scheduler::settled`]; take all of that before the
    /// next frame.
    pub fn frame(&mut self, seen: FrameSeen<'_>) {
        let arrival = self.arrivals;
        self.arrivals += 1;
        let repeated = self.repeats(&seen);
        let mut attribution = repeated;
        match repeated {
            Some(Attribution::Late) => self.late_in_a_row += 1,
            _ => self.late_in_a_row = 0,
        }
        if self.late_in_a_row > MOST_LATE {
            self.restart();
            attribution = None;
        }
        if attribution.is_none() {
            attribution = self.take(&seen);
        }
        let sequence = seen.sequence;
        if self.waiting.len() == self.waiting.capacity() {
            self.abandon();
            self.waiting.pop_front();
        }
        self.waiting.push_back(Waiting { arrival, sequence, attribution });
    }

    fn repeats(&self, seen: &FrameSeen<'_>) -> Option<Attribution> {
        let (sequence, t) = self.newest?;
        if seen.sequence == sequence || (seen.t == t && seen.thumbnail.same_bits(&self.newest_seen)) {
            return Some(Attribution::Duplicate);
        }
        (seen.sequence < sequence).then_some(Attribution::Late)
    }

    /// Takes a frame that is newer than all; returns what is known at once.
    fn take(&mut self, seen: &FrameSeen<'_>) -> Option<Attribution> {
        if let Some((newest, _)) = self.newest {
            let missing = (seen.sequence - newest).saturating_sub(1);
            self.report.lost = self.report.lost.saturating_add(missing);
        }
        self.newest = Some((seen.sequence, seen.t));
        self.newest_seen.clone_from(seen.thumbnail);
        let Some(level) = self.shapes.measure(seen.thumbnail) else {
            // In the dark the exposure is known all the same where there is only one.
            let certain = self.writes.certain(seen.sequence).filter(|_| self.count == 1);
            return Some(certain.map_or(Attribution::Unsure(Unsure::NothingToSee), Attribution::Sure));
        };
        let stated = seen.stated.map(|e| e.effective_s().ln()).filter(|log| log.is_finite());
        let entry = Entry::new(seen.sequence, level, stated, &self.writes);
        self.chain.push(entry, &self.delays);
        None
    }

    /// The next frame of which it is settled what is known, in the order of arrival; each comes once. Most come with the frame
    /// after them, none later than nine measured frames.
    pub fn settled(&mut self) -> Option<Settled> {
        let head = *self.waiting.front()?;
        let attribution = match head.attribution {
            Some(attribution) => attribution,
            None => self.decide()?,
        };
        self.waiting.pop_front();
        self.report.settled += 1;
        match attribution {
            Attribution::Sure(_) => self.report.sure += 1,
            Attribution::Unsure(Unsure::NotExplained) => self.report.not_explained += 1,
            Attribution::Duplicate => self.report.duplicates += 1,
            Attribution::Late => self.report.late += 1,
            Attribution::Unsure(_) => {}
        }
        Some(Settled { arrival: head.arrival, sequence: head.sequence, attribution })
    }

    fn decide(&mut self) -> Option<Attribution> {
        let finding = self.chain.find()?;
        let (stated, begins) = self.chain.oldest()?;
        let agrees = stated.map(|stated| (stated - finding.log).abs() <= chain::SAME);
        let by_metadata = self.stated.is_believed() && agrees == Some(true);
        let known = finding.log.is_finite();
        let one_exposure = known && self.writes.all_equal() && finding.margin.is_infinite();
        let grounded = (finding.joined && finding.proven) || by_metadata || one_exposure;
        // Light that changes with a frame looks like another exposure until the next one comes.
        let waited = self.chain.waiting() > 1 || by_metadata;
        let support = if by_metadata { stated::SUPPORT } else { 0.0 };
        let sure = known && grounded && waited && finding.margin + support >= SURE;
        if !sure && self.chain.waiting() <= LONGEST_WAIT {
            return None;
        }
        if let Some(agrees) = agrees.filter(|_| known && finding.joined) {
            self.judge_metadata(agrees, &finding);
        }
        self.chain.decide(&finding, sure, &mut self.delays);
        Some(if sure {
            Attribution::Sure(finding.exposure)
        } else if begins {
            Attribution::Unsure(Unsure::SceneMoved)
        } else if known && !grounded {
            Attribution::Unsure(Unsure::NotExplained)
        } else {
            Attribution::Unsure(Unsure::Ambiguous)
        })
    }

    fn judge_metadata(&mut self, agrees: bool, finding: &Finding) {
        if agrees && finding.margin >= stated::CONTRADICTED {
            self.stated.agreed();
        } else if !agrees && finding.margin >= stated::CONTRADICTED {
            self.stated.contradicted();
        }
    }

    /// Frames that wait are given up; they come out as abandoned.
    fn abandon(&mut self) {
        for waiting in &mut self.waiting {
            waiting.attribution.get_or_insert(Attribution::Unsure(Unsure::Abandoned));
        }
        self.chain.clear();
    }

    /// Begins again after the camera was opened anew: nothing is in force that was written before. Delays stay known.
    pub fn restart(&mut self) {
        self.abandon();
        self.shapes.clear();
        self.writes = Writes::new();
        self.newest = None;
        self.asked = 0;
        self.last_asked = None;
        self.late_in_a_row = 0;
    }

    /// What was found so far.
    pub fn report(&self) -> Report {
        let (delays, delays_from) = self.delays.shares();
        Report {
            scenes: self.shapes.epochs(),
            metadata: self.stated.belief(),
            delays,
            delays_from,
            unrest: self.chain.unrest(),
            worst_offset: self.chain.worst_offset(),
            ..self.report
        }
    }
}
