//! Index and physics behind the checksum: an 8-bit sum lets one of 256 corruptions pass, and text has no sum at all.
//!
//! A sample is given where its index follows the sample given before and its values are what a body can have done since.
//! One that does not is held back; it counts as the new beginning where the next one follows *it* in the same way. So a true
//! jump, or frames that were lost, cost one sample, and a corruption never gets through alone.

use super::sample::{SampleStamp, WireSample};
use glam::{DQuat, DVec3};

/// Most that any sensor here can state: 2292 degrees a second.
const FASTEST_RAD_S: f64 = 40.0;
/// The same for forces: 17 g.
const STRONGEST_M_S2: f64 = 170.0;
/// A silence after which nothing is known of the motion, seconds.
const FORGOTTEN_S: f64 = 0.5;
/// Weight of the newest deviation in their mean.
const NEWEST: f64 = 0.1;
/// What counts as following: so many mean deviations, and at least the floor of each kind.
const DEVIATIONS: f64 = 8.0;

/// A deviation that is usual, and what is allowed.
#[derive(Clone, Copy, Debug)]
struct Usual {
    mean: f64,
    floor: f64,
    most: f64,
}

impl Usual {
    fn new(floor: f64, most: f64) -> Self {
        Self { mean: 0.0, floor, most }
    }

    fn allows(&self, deviation: f64, steps: f64) -> bool {
        let allowed = (DEVIATIONS * self.mean).clamp(self.floor, self.most);
        deviation <= allowed * steps
    }

    fn learn(&mut self, deviation: f64) {
        self.mean += NEWEST * (deviation.min(self.most) - self.mean);
    }
}

/// A sample that others are compared with, and how fast it turned.
#[derive(Clone, Copy, Debug)]
struct HeldSample {
    sample: WireSample,
    turn: Option<DVec3>,
}

/// What the gates say of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GateVerdict {
    /// It follows; give it.
    Follows,
    /// It does not follow what came before; the next one decides.
    HeldBack,
    /// No sensor can state it.
    Impossible,
}

/// The gates of one wire.
#[derive(Clone, Debug)]
pub struct Gates {
    given: Option<HeldSample>,
    held_back: Option<HeldSample>,
    turn_rad: Usual,
    rate_rad_s: Usual,
    force_m_s2: Usual,
    period_s: f64,
}

impl Gates {
    /// Takes the time between two samples, seconds.
    pub fn new(period_s: f64) -> Self {
        // Floors for a period of 10 ms: a head that starts to turn at 5000 degrees/s^2 leaves its prediction by 0.5 degrees.
        let share = (period_s / 0.01).clamp(0.1, 10.0);
        Self {
            given: None,
            held_back: None,
            turn_rad: Usual::new(0.75f64.to_radians() * share, 0.35),
            rate_rad_s: Usual::new(0.25 * share, 12.0),
            force_m_s2: Usual::new(1.5 * share, 60.0),
            period_s,
        }
    }

    /// Judges the next sample. Only one that follows may be given.
    pub fn judge(&mut self, sample: &WireSample) -> GateVerdict {
        if !is_possible(sample) {
            return GateVerdict::Impossible;
        }
        // A count that cannot have gone round tells how long the silence was for the sensor: a slow machine hands samples on late.
        let forgotten_s = match sample.stamp {
            SampleStamp::Count { modulus, .. } => FORGOTTEN_S.max(0.4 * f64::from(modulus) * self.period_s),
            _ => FORGOTTEN_S,
        };
        let is_old = |held: &HeldSample| sample.arrival.seconds_since(held.sample.arrival) > forgotten_s;
        if self.given.as_ref().is_some_and(is_old) {
            self.given = None;
        }
        for before in [self.given, self.held_back].into_iter().flatten() {
            if let Some(held) = self.follow(&before, sample) {
                self.given = Some(held);
                self.held_back = None;
                return GateVerdict::Follows;
            }
        }
        self.held_back = Some(HeldSample { sample: *sample, turn: None });
        GateVerdict::HeldBack
    }

    /// The sample with its turn, where it follows another one.
    fn follow(&mut self, before: &HeldSample, sample: &WireSample) -> Option<HeldSample> {
        let steps = steps_between(before.sample.stamp, sample.stamp)?;
        let dt = steps * self.period_s;
        let (mut turn, mut turned) = (None, None);
        if let (Some(from), Some(to)) = (before.sample.orientation, sample.orientation) {
            let measured = (from.inverse() * to).to_scaled_axis_short();
            // Without a turn before, the first step is as large as the fastest head's.
            let (expected, slack) = before.turn.map_or((DVec3::ZERO, 10.0), |turn| (turn * dt, 1.0));
            let deviation = (from * DQuat::from_scaled_axis(expected)).angle_between(to);
            if !self.turn_rad.allows(deviation, slack * steps) {
                return None;
            }
            (turn, turned) = (Some(measured / dt), before.turn.map(|_| deviation));
        } else if before.sample.orientation.is_some() != sample.orientation.is_some() {
            return None;
        }
        let rate = apart(before.sample.gyro_rad_s, sample.gyro_rad_s)?;
        let force = apart(before.sample.accel_m_s2, sample.accel_m_s2)?;
        if !(self.rate_rad_s.allows(rate, steps) && self.force_m_s2.allows(force, steps)) {
            return None;
        }
        self.rate_rad_s.learn(rate);
        self.force_m_s2.learn(force);
        if let Some(deviation) = turned {
            self.turn_rad.learn(deviation);
        }
        Some(HeldSample { sample: *sample, turn })
    }
}

/// The logarithm of a rotation the short way round.
trait ShortAxis {
    fn to_scaled_axis_short(self) -> DVec3;
}

impl ShortAxis for DQuat {
    fn to_scaled_axis_short(self) -> DVec3 {
        if self.w < 0.0 { (-self).to_scaled_axis() } else { self.to_scaled_axis() }
    }
}

/// Samples from one to the next; `None` where the index does not follow.
fn steps_between(before: SampleStamp, after: SampleStamp) -> Option<f64> {
    match (before, after) {
        (SampleStamp::Count { value: a, modulus }, SampleStamp::Count { value: b, .. }) => {
            let next = a.checked_add(1).filter(|next| *next < modulus).unwrap_or(0);
            (b == next).then_some(1.0)
        }
        (SampleStamp::Ticks { value: a, bits, .. }, SampleStamp::Ticks { value: b, .. }) => {
            let passed = b.wrapping_sub(a) & mask(bits);
            // The upper half of the clock is the past.
            (passed != 0 && passed <= mask(bits) / 2).then_some(1.0)
        }
        (SampleStamp::Unstated, SampleStamp::Unstated) => Some(1.0),
        _ => None,
    }
}

/// The largest value of so many bits.
pub(crate) fn mask(bits: u32) -> u64 {
    if bits >= 64 { u64::MAX } else { (1u64 << bits) - 1 }
}

/// Distance of two values; `None` where one of them is missing.
fn apart(before: Option<[f64; 3]>, after: Option<[f64; 3]>) -> Option<f64> {
    match (before, after) {
        (Some(a), Some(b)) => Some(DVec3::from(a).distance(DVec3::from(b))),
        (None, None) => Some(0.0),
        _ => None,
    }
}

/// Whether any sensor can state these values.
pub fn is_possible(sample: &WireSample) -> bool {
    let within = |value: Option<[f64; 3]>, most: f64| {
        value.is_none_or(|v| DVec3::from(v).is_finite() && DVec3::from(v).length() <= most)
    };
    within(sample.gyro_rad_s, FASTEST_RAD_S)
        && within(sample.accel_m_s2, STRONGEST_M_S2)
        && sample.orientation.is_none_or(|q| q.is_finite() && (q.length() - 1.0).abs() < 1e-6)
}
