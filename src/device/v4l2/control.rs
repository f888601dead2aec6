//! Exposure and gain by hand, everything automatic off, and all as it was before when the camera is let go.

use super::node::{ControlFacts, ControlKind, VideoNode};
use crate::model::frame::Exposure;
use std::io;

const USER: u32 = 0x0098_0900;
const CAMERA: u32 = 0x009a_0900;

/// Kernel's numbers of controls.
pub mod id {
    use super::{CAMERA, USER};
    /// White balance that follows the picture.
    pub const AUTO_WHITE_BALANCE: u32 = USER + 12;
    /// Gain that follows the picture.
    pub const AUTO_GAIN: u32 = USER + 18;
    /// Gain, in the driver's own numbers.
    pub const GAIN: u32 = USER + 19;
    /// Who chooses the exposure: 0 the camera, 1 nobody, 3 the camera at a fixed opening.
    pub const AUTO_EXPOSURE: u32 = CAMERA + 1;
    /// Exposure in units of 100 microseconds.
    pub const EXPOSURE: u32 = CAMERA + 2;
    /// Whether the camera may lower its rate for longer exposures.
    pub const MAY_SLOW_DOWN: u32 = CAMERA + 3;
    /// Focus that follows the picture.
    pub const AUTO_FOCUS: u32 = CAMERA + 12;
    /// Gain of a sensor, in its driver's numbers.
    pub const ANALOGUE_GAIN: u32 = 0x009e_0903;
    /// All that is listed for people.
    pub const LISTED: [u32; 8] = [
        AUTO_EXPOSURE,
        EXPOSURE,
        MAY_SLOW_DOWN,
        AUTO_GAIN,
        GAIN,
        ANALOGUE_GAIN,
        AUTO_WHITE_BALANCE,
        AUTO_FOCUS,
    ];
}

/// Exposure by hand: the menu's number of it.
const BY_HAND: i32 = 1;
/// Unit of `id::EXPOSURE`, seconds.
const EXPOSURE_UNIT_S: f64 = 1e-4;

/// What can be asked of a camera's exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureLimits {
    /// Shortest time, seconds.
    pub shortest_s: f64,
    /// Longest time, seconds.
    pub longest_s: f64,
    /// Step of the time, seconds.
    pub step_s: f64,
    /// Least gain, 1 being the driver's own choice.
    pub least_gain: f64,
    /// Largest gain.
    pub most_gain: f64,
}

/// Exposure of a camera in the hand of the program.
#[derive(Debug)]
pub struct ManualExposure {
    exposure: ControlFacts,
    gain: Option<ControlFacts>,
    /// The driver's number for a gain of 1.
    gain_of_one: f64,
    /// Control and value as found, in the order in which they were changed.
    found: Vec<(u32, i32)>,
}

impl ManualExposure {
    /// Switches off all that is automatic. `None`: the camera has no control of its exposure time; what was switched off is
    /// as it was.
    pub fn take<N: VideoNode>(node: &N) -> Option<Self> {
        let exposure = node.control_facts(id::EXPOSURE).filter(|c| c.can_be_set && c.most > c.least)?;
        let gain = [id::GAIN, id::ANALOGUE_GAIN]
            .into_iter()
            .filter_map(|id| node.control_facts(id))
            .find(|c| c.can_be_set && c.most > c.least);
        let gain_of_one = gain.as_ref().map_or(1.0, |c| f64::from(c.default.clamp(c.least, c.most)));
        let mut taken = Self { exposure, gain_of_one: gain_of_one.max(1.0), gain, found: Vec::new() };
        for (id, off) in [
            (id::AUTO_EXPOSURE, BY_HAND),
            (id::AUTO_GAIN, 0),
            (id::AUTO_WHITE_BALANCE, 0),
            (id::AUTO_FOCUS, 0),
            (id::MAY_SLOW_DOWN, 0),
        ] {
            taken.change(node, id, off);
        }
        for id in [Some(id::EXPOSURE), taken.gain.as_ref().map(|c| c.id)].into_iter().flatten() {
            if let Ok(value) = node.control(id) {
                taken.found.push((id, value));
            }
        }
        Some(taken)
    }

    /// Writes a control and remembers what it was; a camera without it is left alone.
    fn change<N: VideoNode>(&mut self, node: &N, id: u32, value: i32) {
        let Some(facts) = node.control_facts(id).filter(|c| c.can_be_set) else { return };
        let Ok(found) = node.control(id) else { return };
        if found != value
            && facts.least <= value
            && value <= facts.most
            && node.set_control(id, value).is_ok()
        {
            self.found.push((id, found));
        }
    }

    /// What can be asked for.
    pub fn limits(&self) -> ExposureLimits {
        let time = |value: i32| f64::from(value.max(1)) * EXPOSURE_UNIT_S;
        let gain = |pick: fn(&ControlFacts) -> i32| {
            self.gain.as_ref().map_or(1.0, |c| f64::from(pick(c).max(1)) / self.gain_of_one)
        };
        ExposureLimits {
            shortest_s: time(self.exposure.least),
            longest_s: time(self.exposure.most),
            step_s: f64::from(self.exposure.step) * EXPOSURE_UNIT_S,
            least_gain: gain(|c| c.least),
            most_gain: gain(|c| c.most),
        }
    }

    /// What a wish becomes within the camera's steps and limits. Gain is taken to be in proportion to the driver's number,
    /// 1 at the driver's own choice; `halflight calibrate` may find another rule.
    pub fn nearest(&self, wish: Exposure) -> Exposure {
        let time = on_steps(&self.exposure, wish.time_s / EXPOSURE_UNIT_S);
        let gain = self
            .gain
            .as_ref()
            .map_or(1.0, |c| f64::from(on_steps(c, wish.gain * self.gain_of_one)) / self.gain_of_one);
        Exposure { time_s: f64::from(time) * EXPOSURE_UNIT_S, gain }
    }

    /// Writes an exposure; returns what the camera took, which it may have clamped. A transfer of some 10 ms.
    pub fn set<N: VideoNode>(&self, node: &N, wish: Exposure) -> io::Result<Exposure> {
        let time = on_steps(&self.exposure, wish.time_s / EXPOSURE_UNIT_S);
        let taken = node.set_control(id::EXPOSURE, time)?;
        let mut gain = 1.0;
        if let Some(facts) = &self.gain {
            let value = on_steps(facts, wish.gain * self.gain_of_one);
            gain = f64::from(node.set_control(facts.id, value)?) / self.gain_of_one;
        }
        Ok(Exposure { time_s: f64::from(taken) * EXPOSURE_UNIT_S, gain })
    }

    /// Puts all back as it was found, last change first: values before the automatism that would refuse them.
    pub fn restore<N: VideoNode>(&mut self, node: &N) {
        for (id, value) in self.found.drain(..).rev() {
            // A camera that is gone cannot be put back.
            let _ = node.set_control(id, value);
        }
    }
}

/// The nearest value that a control takes.
fn on_steps(facts: &ControlFacts, wish: f64) -> i32 {
    let [least, most] = [facts.least, facts.most].map(f64::from);
    if wish.is_nan() {
        return facts.default.clamp(facts.least, facts.most.max(facts.least));
    }
    let step = f64::from(facts.step.max(1));
    let steps = ((wish.clamp(least, most.max(least)) - least) / step).round();
    (least + steps * step).min(most) as i32
}

/// The controls of a node, for people.
pub fn listed<N: VideoNode>(node: &N) -> Vec<(ControlFacts, Option<i32>)> {
    let of = |id: u32| node.control_facts(id).map(|facts| (facts, node.control(id).ok()));
    id::LISTED.into_iter().filter_map(of).collect()
}

/// A value of a control for people.
pub fn shown_value(facts: &ControlFacts, value: i32) -> String {
    match facts.kind {
        ControlKind::Switch => if value == 0 { "off" } else { "on" }.into(),
        ControlKind::Number if facts.id == id::EXPOSURE => {
            format!("{value} ({:.1} ms)", f64::from(value) * EXPOSURE_UNIT_S * 1e3)
        }
        _ => value.to_string(),
    }
}

/// Least, most and step of the exposure control, seconds.
pub fn exposure_range_s(facts: &ControlFacts) -> [f64; 3] {
    [facts.least.max(1), facts.most, facts.step].map(|value| f64::from(value) * EXPOSURE_UNIT_S)
}
