//! Exposure and gain by hand, everything automatic off, and all as it was before when the camera is let go.

use super::node::{BehindNode, ControlFacts, ControlKind, ControlNode, VideoNode};
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
    /// How much the camera sharpens, in the driver's own numbers.
    pub const SHARPNESS: u32 = USER + 27;
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
    /// Exposure of a sensor, in lines.
    pub const LINES: u32 = USER + 17;
    /// Lines of a sensor between two frames.
    pub const BETWEEN_FRAMES: u32 = 0x009e_0901;
    /// Pixels of a sensor between two lines.
    pub const BETWEEN_LINES: u32 = 0x009e_0902;
    /// Gain of a sensor, in its driver's numbers.
    pub const ANALOGUE_GAIN: u32 = 0x009e_0903;
    /// Pixels of a sensor in a second; of 64 bits.
    pub const PIXEL_RATE: u32 = 0x009f_0902;
    /// All that is listed for people.
    pub const LISTED: [u32; 11] = [
        AUTO_EXPOSURE,
        EXPOSURE,
        LINES,
        BETWEEN_FRAMES,
        MAY_SLOW_DOWN,
        AUTO_GAIN,
        GAIN,
        ANALOGUE_GAIN,
        AUTO_WHITE_BALANCE,
        AUTO_FOCUS,
        SHARPNESS,
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

/// A line of a sensor takes no longer, seconds.
const LONGEST_LINE_S: f64 = 0.01;

/// Exposure of a camera in the hand of the program.
pub struct ManualExposure {
    /// Whose controls these are, where they are not the node's own.
    sensor: Option<BehindNode>,
    exposure: ControlFacts,
    /// Unit of the exposure, seconds.
    unit_s: f64,
    gain: Option<ControlFacts>,
    /// The driver's number for a gain of 1.
    gain_of_one: f64,
    /// Control and value as found, in the order in which they were changed.
    found: Vec<(u32, i32)>,
}

impl ManualExposure {
    /// Switches off all that is automatic, and sharpening. The node's own controls come first, then those of the sensor behind it. `size`: of the node's pictures; a
    /// sensor of lines is set to this rate. `None`: there is no control of the exposure time; nothing was changed.
    pub fn take<N: VideoNode>(node: &N, size: [u32; 2], frames_per_s: f64) -> Option<Self> {
        if let Some((exposure, unit_s)) = time_of(node, size) {
            return Some(Self::of(node, None, exposure, unit_s, size, frames_per_s));
        }
        let sensor = node.sensor()?;
        let size = sensor.size;
        let (exposure, unit_s) = time_of(sensor.controls.as_ref(), size)?;
        Some(Self::of(node, Some(sensor), exposure, unit_s, size, frames_per_s))
    }

    fn of<N: VideoNode>(
        node: &N,
        sensor: Option<BehindNode>,
        exposure: ControlFacts,
        unit_s: f64,
        size: [u32; 2],
        frames_per_s: f64,
    ) -> Self {
        let mut taken = Self { sensor, exposure, unit_s, gain: None, gain_of_one: 1.0, found: Vec::new() };
        for (id, off) in [
            (id::AUTO_EXPOSURE, BY_HAND),
            (id::AUTO_GAIN, 0),
            (id::AUTO_WHITE_BALANCE, 0),
            (id::AUTO_FOCUS, 0),
            (id::MAY_SLOW_DOWN, 0),
        ] {
            taken.change(node, id, off);
        }
        // What is sharpened has its edges elsewhere: corners of tags move by tenths of a pixel.
        if let Some(sharpness) = taken.door(node).control_facts(id::SHARPNESS) {
            taken.change(node, id::SHARPNESS, sharpness.least);
        }
        taken.take_gain(node);
        taken.take_rate(node, size, frames_per_s);
        for id in [Some(taken.exposure.id), taken.gain.as_ref().map(|c| c.id)].into_iter().flatten() {
            if let Ok(value) = taken.door(node).control(id) {
                taken.found.push((id, value));
            }
        }
        taken
    }

    /// Whose controls these are.
    fn door<'a, N: VideoNode>(&'a self, node: &'a N) -> &'a dyn ControlNode {
        self.sensor.as_ref().map_or(node, |sensor| sensor.controls.as_ref())
    }

    /// A gain whose driver's own choice is 0 is a code, not a factor: it stays there.
    fn take_gain<N: VideoNode>(&mut self, node: &N) {
        let gains = [id::GAIN, id::ANALOGUE_GAIN].into_iter();
        let gain = gains
            .filter_map(|id| self.door(node).control_facts(id))
            .find(|c| c.can_be_set && c.most > c.least);
        let Some(gain) = gain else { return };
        let of_one = gain.default.clamp(gain.least, gain.most);
        if of_one > 0 {
            self.gain_of_one = f64::from(of_one);
            self.gain = Some(gain);
        } else {
            self.change(node, gain.id, of_one);
        }
    }

    /// A sensor of lines has no other rate than that of its lines and of the pause between frames.
    fn take_rate<N: VideoNode>(&mut self, node: &N, [_, height]: [u32; 2], frames_per_s: f64) {
        let Some(pause) =
            self.door(node).control_facts(id::BETWEEN_FRAMES).filter(|_| self.exposure.id == id::LINES)
        else {
            return;
        };
        let lines = 1.0 / (frames_per_s * self.unit_s) - f64::from(height);
        self.change(node, pause.id, on_steps(&pause, lines));
        // The longest exposure follows the pause.
        if let Some(exposure) = self.door(node).control_facts(id::LINES) {
            self.exposure = exposure;
        }
    }

    /// Writes a control and remembers what it was; a camera without it is left alone.
    fn change<N: VideoNode>(&mut self, node: &N, id: u32, value: i32) {
        let door = self.door(node);
        let Some(facts) = door.control_facts(id).filter(|c| c.can_be_set) else { return };
        let Ok(found) = door.control(id) else { return };
        if found != value
            && facts.least <= value
            && value <= facts.most
            && door.set_control(id, value).is_ok()
        {
            self.found.push((id, found));
        }
    }

    /// What can be asked for.
    pub fn limits(&self) -> ExposureLimits {
        let time = |value: i32| f64::from(value.max(1)) * self.unit_s;
        let gain = |pick: fn(&ControlFacts) -> i32| {
            self.gain.as_ref().map_or(1.0, |c| f64::from(pick(c).max(1)) / self.gain_of_one)
        };
        ExposureLimits {
            shortest_s: time(self.exposure.least),
            longest_s: time(self.exposure.most),
            step_s: f64::from(self.exposure.step) * self.unit_s,
            least_gain: gain(|c| c.least),
            most_gain: gain(|c| c.most),
        }
    }

    /// What a wish becomes within the camera's steps and limits. Gain is taken to be in proportion to the driver's number,
    /// 1 at the driver's own choice; `halflight calibrate` may find another rule.
    pub fn nearest(&self, wish: Exposure) -> Exposure {
        let time = on_steps(&self.exposure, wish.time_s / self.unit_s);
        let gain = self
            .gain
            .as_ref()
            .map_or(1.0, |c| f64::from(on_steps(c, wish.gain * self.gain_of_one)) / self.gain_of_one);
        Exposure { time_s: f64::from(time) * self.unit_s, gain }
    }

    /// Writes an exposure; returns what the camera took, which it may have clamped. A transfer of some 10 ms.
    pub fn set<N: VideoNode>(&self, node: &N, wish: Exposure) -> io::Result<Exposure> {
        let door = self.door(node);
        let time = on_steps(&self.exposure, wish.time_s / self.unit_s);
        let taken = door.set_control(self.exposure.id, time)?;
        let mut gain = 1.0;
        if let Some(facts) = &self.gain {
            let value = on_steps(facts, wish.gain * self.gain_of_one);
            gain = f64::from(door.set_control(facts.id, value)?) / self.gain_of_one;
        }
        Ok(Exposure { time_s: f64::from(taken) * self.unit_s, gain })
    }

    /// Puts all back as it was found, last change first: values before the automatism that would refuse them.
    pub fn restore<N: VideoNode>(&mut self, node: &N) {
        let found = std::mem::take(&mut self.found);
        for (id, value) in found.into_iter().rev() {
            // A camera that is gone cannot be put back.
            let _ = self.door(node).set_control(id, value);
        }
    }
}

/// The control of the exposure time and its unit, seconds. A sensor's line lasts (columns + pause) / rate of pixels.
fn time_of(door: &dyn ControlNode, [width, _]: [u32; 2]) -> Option<(ControlFacts, f64)> {
    let of = |id: u32| door.control_facts(id).filter(|c| c.can_be_set && c.most > c.least);
    if let Some(exposure) = of(id::EXPOSURE) {
        return Some((exposure, EXPOSURE_UNIT_S));
    }
    let lines = of(id::LINES)?;
    let pixels = f64::from(width) + f64::from(door.control(id::BETWEEN_LINES).ok()?);
    let line_s = pixels / door.wide_control(id::PIXEL_RATE).ok()? as f64;
    (line_s > 0.0 && line_s < LONGEST_LINE_S).then_some((lines, line_s))
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
pub fn listed(node: &dyn ControlNode) -> Vec<(ControlFacts, Option<i32>)> {
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
