//! Which exposures to cycle: from what the longest leaves dark and the shortest leaves saturated.
//!
//! The longest must lift the scene's darkest hundredth to value 32, above noise; the shortest must keep its brightest
//! thousandth, the light's reflection, below value 225. Between them exposures are spread by unequal ratios, so that no two
//! pairs have one ratio: light that changes by one of them is then told from a change of exposure within two frames.

use super::MOST_EXPOSURES;
use super::thumbnail::Thumbnail;
use crate::model::{frame::Exposure, response::Response};

/// The value to which the longest exposure lifts the dark end of the scene.
const DARK_VALUE: usize = 32;
/// The value below which the shortest exposure keeps the bright end.
const BRIGHT_VALUE: usize = 225;
/// Values from here on are saturated, up to here black.
const SATURATED: usize = 250;
const BLACK: usize = 12;
/// Share of samples that may lie beyond each end of the scene.
const DARK_SHARE: f64 = 0.01;
const BRIGHT_SHARE: f64 = 0.001;
/// An end that is out of sight is looked for by steps of this factor.
const SEARCH: f64 = 4.0;
/// Change of an end of the plan that is worth a new one, ln.
const WORTH: f64 = 0.35;
/// Frames of that end's exposure in a row that must want the change, to the same side.
const PATIENCE: u32 = 8;
/// How fast the wanted ends follow what single frames say.
const FOLLOWS: f64 = 0.25;
/// Neighbours farther apart than this share too few well-exposed blocks to be compared.
const WIDEST_STEP: f64 = 32.0;
/// Neighbours nearer than this add nothing.
const NARROWEST_STEP: f64 = 2.0;
/// By how much the last of the ratios, in ln, exceeds the first.
const UNEVEN: f64 = 0.5;

/// The frequency of the mains, which lamps flicker at twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mains {
    /// 50 Hz: light repeats every 1/100 s.
    Hz50,
    /// 60 Hz: light repeats every 1/120 s.
    Hz60,
}

impl Mains {
    /// Seconds after which the light of lamps repeats.
    pub fn period_s(self) -> f64 {
        match self {
            Self::Hz50 => 1.0 / 100.0,
            Self::Hz60 => 1.0 / 120.0,
        }
    }
}

/// What the control can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Shortest time, seconds.
    pub least_s: f64,
    /// Longest time, seconds.
    pub most_s: f64,
    /// Times are multiples of this, seconds (UVC: 0.0001); 0: any.
    pub step_s: f64,
    /// Seconds from frame to frame; no exposure is longer.
    pub frame_interval_s: f64,
    /// Gain of all exposures.
    pub gain: f64,
    /// Times are made multiples of the light's period where they are long enough.
    pub mains: Option<Mains>,
}

/// Limits or a count that no plan can keep.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BadLimits {
    /// See [`MOST_EXPOSURES`].
    #[error("{0} exposures: must be 1 to {MOST_EXPOSURES}")]
    Count(usize),
    /// Not finite, not above 0, or ends that are the wrong way round.
    #[error(
        "times from {least_s} s to {most_s} s at gain {gain}: must be finite and above 0, the first not above the second"
    )]
    Range {
        /// Seconds.
        least_s: f64,
        /// Seconds, cut to the frame's interval.
        most_s: f64,
        /// 1 = none.
        gain: f64,
    },
}

/// How well a plan covers the scene. Factors of 1 and below are none missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// How much shorter the shortest exposure would have to be.
    pub too_long: f64,
    /// How much longer the longest exposure would have to be.
    pub too_short: f64,
    /// How much farther apart neighbours are than 1:32, at which pictures still share well-exposed blocks.
    pub too_far_apart: f64,
    /// An exposure of the plan is shorter than the period of the mains' light, so that it flickers.
    pub flickers: bool,
}

impl Coverage {
    /// Whether the light's reflection and the shadows are both within the plan, up to 5 %.
    pub fn is_whole(&self) -> bool {
        self.too_long <= 1.05 && self.too_short <= 1.05 && self.too_far_apart <= 1.05
    }
}

/// Plans the exposures of a cycle. Allocates nothing.
#[derive(Clone, Debug)]
pub struct Planner {
    limits: Limits,
    /// X at the values that ends are brought to.
    dark_x: f64,
    bright_x: f64,
    /// ln X by value, mean of the channels.
    log_x: [f64; 256],
    plan: [Exposure; MOST_EXPOSURES],
    count: usize,
    /// ln of wanted effective exposure: shortest, longest.
    wanted: [Option<f64>; 2],
    /// Frames in a row that wanted another end, by sign.
    patience: [i32; 2],
}

impl Planner {
    /// A planner of so many exposures; the first plan spans all that the control can do.
    ///
    /// # Errors
    /// A count outside 1 to 9, or limits that leave no exposure.
    pub fn new(count: usize, limits: Limits, response: &Response) -> Result<Self, BadLimits> {
        if count == 0 || count > MOST_EXPOSURES {
            return Err(BadLimits::Count(count));
        }
        let Limits { least_s, gain, .. } = limits;
        let most_s = limits.most_s.min(limits.frame_interval_s);
        let sound = |x: f64| x.is_finite() && x > 0.0;
        if !(sound(least_s) && sound(most_s) && sound(gain) && sound(most_s * gain) && least_s <= most_s) {
            return Err(BadLimits::Range { least_s, most_s, gain });
        }
        let g = response.log_exposure();
        let log_x: [f64; 256] = std::array::from_fn(|z| g.iter().map(|g| f64::from(g[z])).sum::<f64>() / 3.0);
        let mut planner = Self {
            limits: Limits { most_s, ..limits },
            dark_x: log_x[DARK_VALUE],
            bright_x: log_x[BRIGHT_VALUE],
            log_x,
            plan: [Exposure { time_s: least_s, gain }; MOST_EXPOSURES],
            count,
            wanted: [None; 2],
            patience: [0; 2],
        };
        planner.spread((least_s * gain).ln(), (most_s * gain).ln());
        Ok(planner)
    }

    /// Takes these exposures for the plan until the scene asks for another; as many as the plan has.
    pub fn beginning_with(mut self, cycle: &[Exposure]) -> Self {
        if cycle.len() == self.count {
            self.plan[..self.count].copy_from_slice(cycle);
            self.plan[..self.count].sort_by(|a, b| a.effective_s().total_cmp(&b.effective_s()));
        }
        self
    }

    /// Returns whether frames of this exposure tell anything: those of the plan's ends.
    pub fn minds(&self, exposure: Exposure) -> bool {
        let log = exposure.effective_s().ln();
        [self.plan[0], self.plan[self.count - 1]]
            .iter()
            .any(|end| (end.effective_s().ln() - log).abs() < 0.05)
    }

    /// The plan: shortest exposure first.
    pub fn plan(&self) -> &[Exposure] {
        &self.plan[..self.count]
    }

    /// Takes a frame of known exposure. Returns whether the plan has changed; it does so only where an end is off by more than
    /// ln 0.35 in eight frames of that end in a row. Frames of exposures between the ends say nothing.
    pub fn observe(&mut self, exposure: Exposure, thumbnail: &Thumbnail) -> bool {
        let log = exposure.effective_s().ln();
        let same = |other: Exposure| (other.effective_s().ln() - log).abs() < 0.05;
        let mut due = false;
        let ends = [self.plan[0], self.plan[self.count - 1]];
        for (end, planned) in ends.into_iter().enumerate() {
            if !same(planned) {
                continue;
            }
            let Some(wanted) = self.wanted_end(end == 0, log, thumbnail) else { continue };
            let kept = self.wanted[end].map_or(wanted, |before| before + FOLLOWS * (wanted - before));
            self.wanted[end] = Some(kept);
            let off = self.reachable(kept) - planned.effective_s().ln();
            let sign = if off.abs() > WORTH { off.signum() as i32 } else { 0 };
            let goes_on = sign != 0 && sign == self.patience[end].signum();
            self.patience[end] = if goes_on { self.patience[end].saturating_add(sign) } else { sign };
            due |= self.patience[end].unsigned_abs() >= PATIENCE;
        }
        due && self.renew()
    }

    /// ln of the effective exposure that one end of the plan should have, from a frame of exposure `log` at that end.
    fn wanted_end(&self, shortest: bool, log: f64, thumbnail: &Thumbnail) -> Option<f64> {
        let counts = thumbnail.counts();
        let all: u64 = counts.iter().map(|n| u64::from(*n)).sum();
        if all == 0 || !log.is_finite() {
            return None;
        }
        let share = if shortest { BRIGHT_SHARE } else { DARK_SHARE };
        let beyond = (share * all as f64) as u64;
        let mut passed = 0;
        let value = (0..256).map(|k| if shortest { 255 - k } else { k }).find(|z| {
            passed += u64::from(counts[*z]);
            passed > beyond
        })?;
        Some(match (shortest, value) {
            (true, SATURATED..) => log - SEARCH.ln(),
            (false, ..=BLACK) => log + SEARCH.ln(),
            (true, _) => log + self.bright_x - self.log_x[value],
            (false, _) => log + self.dark_x - self.log_x[value],
        })
    }

    /// ln effective exposure within what the control can do.
    fn reachable(&self, log: f64) -> f64 {
        let Limits { least_s, most_s, gain, .. } = self.limits;
        log.clamp((least_s * gain).ln(), (most_s * gain).ln())
    }

    fn renew(&mut self) -> bool {
        let planned = |e: Exposure| e.effective_s().ln();
        let short = self.reachable(self.wanted[0].unwrap_or(planned(self.plan[0])));
        let long = self.reachable(self.wanted[1].unwrap_or(planned(self.plan[self.count - 1])));
        self.patience = [0; 2];
        let before = self.plan;
        self.spread(short, long);
        // What a changed end wants is judged anew.
        self.wanted = [None; 2];
        self.plan != before
    }

    /// Fills the plan from ln `short` to ln `long`. A scene of little range still gets exposures a factor of 2 apart, as far as
    /// the control goes.
    fn spread(&mut self, short: f64, long: f64) {
        let steps = self.count - 1;
        let narrowest = steps as f64 * NARROWEST_STEP.ln();
        let mut long = if long.is_finite() { long.max(short + narrowest) } else { short + narrowest };
        let mut short = short;
        if long > self.reachable(long) {
            long = self.reachable(long);
            short = self.reachable(short.min(long - narrowest));
        }
        let weight = |k: usize| 1.0 + UNEVEN * k as f64 / steps.max(1) as f64;
        let all: f64 = (0..steps).map(weight).sum();
        let mut log = short;
        for k in 0..self.count {
            self.plan[k] = self.made(log);
            log += weight(k) / all.max(1e-9) * (long - short);
        }
    }

    /// The exposure nearest to ln `log` that the control makes, and that does not flicker where it is long enough.
    fn made(&self, log: f64) -> Exposure {
        let Limits { least_s, most_s, step_s, gain, mains, .. } = self.limits;
        let mut time_s = (log.exp() / gain).clamp(least_s, most_s);
        if let Some(period_s) = mains.map(Mains::period_s).filter(|period_s| time_s >= 0.7 * period_s) {
            let least = (least_s / period_s - 1e-9).ceil().max(1.0);
            let most = (most_s / period_s + 1e-9).floor();
            if most >= least {
                time_s = (time_s / period_s).round().clamp(least, most) * period_s;
            }
        }
        if step_s.is_finite() && step_s > 0.0 {
            let steps = (time_s / step_s).round().max(1.0);
            let rounded = steps * step_s;
            let fits = |t: f64| t >= least_s * (1.0 - 1e-9) && t <= most_s * (1.0 + 1e-9);
            time_s = [rounded, rounded - step_s, rounded + step_s]
                .into_iter()
                .find(|t| fits(*t))
                .unwrap_or(time_s);
        }
        Exposure { time_s, gain }
    }

    /// How well the plan covers what the last frames saw.
    pub fn coverage(&self) -> Coverage {
        let ends = [self.plan[0], self.plan[self.count - 1]].map(|e| e.effective_s().ln());
        let beyond = |end: usize, sign: f64| {
            self.wanted[end].map_or(1.0, |wanted| (sign * (wanted - ends[end])).exp().max(1.0))
        };
        let widest =
            self.plan().windows(2).map(|p| p[1].effective_s() / p[0].effective_s()).fold(1.0, f64::max);
        let period_s = self.limits.mains.map_or(0.0, Mains::period_s);
        Coverage {
            too_long: beyond(0, -1.0),
            too_short: beyond(1, 1.0),
            too_far_apart: (widest / WIDEST_STEP).max(1.0),
            // A control that steps by 0.1 ms is within that of the period.
            flickers: self.plan().iter().any(|e| e.time_s < 0.98 * period_s),
        }
    }
}
