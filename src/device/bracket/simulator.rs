//! A camera with every fault, on a scene with every change: what the scheduler is held against.
//!
//! The scene is 96 blocks of 4 samples; its radiance spans a factor of e^5. A sample's value is the response of radiance x
//! light x exposure plus noise of the sensor (shot noise and reading noise), rounded to 8 bits, as a sensor has it.

use super::thumbnail::{BLOCKS, COLUMNS, Thumbnail, ThumbnailReader};
use crate::model::{frame::Exposure, response::Response, time::Timestamp};
use halflight_math::dice::Dice;
use std::collections::VecDeque;

const WIDTH: usize = 2 * COLUMNS;
const SAMPLES: usize = 4 * BLOCKS;
/// Entries of the table of 8-bit values over ln X, and the span of ln X that it covers.
const TABLE: usize = 4096;
const TABLE_FROM: f64 = -12.0;
const TABLE_TO: f64 = 2.0;

/// What a driver says of exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metadata {
    /// Nothing.
    None,
    /// The truth.
    Honest,
    /// What was written last.
    LastWritten,
    /// The truth of the frame before, from the 2,000th frame on; the truth until then.
    LateAfterAWhile,
    /// One frame in twenty has another exposure stated than it had.
    SometimesWrong,
    /// One exposure for ever.
    Frozen,
}

/// What is wrong with the camera and the scene. The default is a sound camera before a scene at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Faults {
    /// Least and most frames that a write is in force later than with the next frame.
    pub delay: (u64, u64),
    /// Share of writes whose delay is drawn from that range; the others have the least.
    pub jitter: f64,
    /// Share of frames that are lost.
    pub lost: f64,
    /// Share of frames that come twice.
    pub twice: f64,
    /// Share of frames that come after the one behind them.
    pub reordered: f64,
    /// What is stated.
    pub metadata: Metadata,
    /// Longest effective exposure; longer ones are cut, seconds.
    pub most_s: f64,
    /// Exposure times are rounded to multiples of this, seconds; 0: they are not.
    pub step_s: f64,
    /// The driver reads back what was asked, not what it did.
    pub hides_changes: bool,
    /// Share of frames with which light changes everywhere by a factor of up to 16, for good.
    pub light_steps: f64,
    /// Share of frames with which all light changes for good by just the ratio of two exposures that were asked for.
    pub treacherous_steps: f64,
    /// Share of frames with which a lamp at the side is switched.
    pub lamp: f64,
    /// Share of frames with which a hand comes, for some 60 frames.
    pub hand: f64,
    /// Amplitude of slow changes of light, ln.
    pub drift: f64,
    /// Share by which light at 100 Hz swings about its mean.
    pub flicker: f64,
    /// Noise of reading, in X (the response's unit, white = 1 for sRGB).
    pub reading_noise: f64,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            delay: (2, 2),
            jitter: 0.0,
            lost: 0.0,
            twice: 0.0,
            reordered: 0.0,
            metadata: Metadata::None,
            most_s: f64::INFINITY,
            step_s: 0.0,
            hides_changes: false,
            light_steps: 0.0,
            treacherous_steps: 0.0,
            lamp: 0.0,
            hand: 0.0,
            drift: 0.0,
            flicker: 0.0,
            reading_noise: 0.002,
        }
    }
}

/// A frame of the simulated camera; its thumbnail was handed out with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedFrame {
    /// The driver's count.
    pub sequence: u64,
    /// Time of the frame, 30 a second.
    pub t: Timestamp,
    /// What the driver says.
    pub stated: Option<Exposure>,
    /// What the sensor did.
    pub truth: Exposure,
}

/// The camera. The same seed and the same writes give the same frames.
#[derive(Clone, Debug)]
pub struct SimulatedCamera {
    faults: Faults,
    dice: Dice,
    reader: ThumbnailReader,
    /// 8-bit values by ln X.
    table: Vec<u8>,
    radiance: [f64; SAMPLES],
    /// A lamp's part of the radiance.
    lamp: [f64; SAMPLES],
    lamp_on: bool,
    light: f64,
    drift: f64,
    hand_until: u64,
    hand_at: f64,
    values: Vec<u8>,
    sequence: u64,
    /// Exposures with the frame from which each is in force.
    under_way: VecDeque<(u64, Exposure)>,
    in_force: Exposure,
    frame_before: Exposure,
    /// The last few that were asked for.
    asked: VecDeque<Exposure>,
    /// Frames that are to come, oldest first.
    ready: VecDeque<(SimulatedFrame, Thumbnail)>,
}

impl SimulatedCamera {
    /// A camera with these faults, its shutter at 5 ms.
    pub fn new(seed: u64, faults: Faults) -> Self {
        let mut dice = Dice::new(seed.wrapping_mul(halflight_math::dice::STEP));
        dice.bits();
        let response = Response::srgb();
        let ln_x = |k: usize| TABLE_FROM + (TABLE_TO - TABLE_FROM) * k as f64 / TABLE as f64;
        let table = (0..TABLE).map(|k| response.value_of(1, ln_x(k).exp() as f32).round() as u8).collect();
        // A 5 ms exposure sees the middle of the scene at a fifth of white.
        let blocks: [f64; BLOCKS] = std::array::from_fn(|_| 40.0 * dice.between(-2.5, 2.5).exp());
        let block_of = |k: usize| k / (2 * WIDTH) * COLUMNS + k % WIDTH / 2;
        let radiance: [f64; SAMPLES] =
            std::array::from_fn(|k| blocks[block_of(k)] * dice.between(-0.3, 0.3).exp());
        let lamp = std::array::from_fn(|k| {
            let x = (k % WIDTH) as f64 / WIDTH as f64;
            radiance[k] * 6.0 * (-4.0 * x).exp()
        });
        let in_force = Exposure { time_s: 0.005, gain: 1.0 };
        Self {
            faults,
            dice,
            reader: ThumbnailReader::new(&response),
            table,
            radiance,
            lamp,
            lamp_on: false,
            light: 1.0,
            drift: 0.0,
            hand_until: 0,
            hand_at: 0.0,
            values: vec![0; SAMPLES],
            sequence: 0,
            under_way: VecDeque::with_capacity(64),
            in_force,
            frame_before: in_force,
            asked: VecDeque::with_capacity(8),
            ready: VecDeque::with_capacity(8),
        }
    }

    /// Writes the control after the newest frame that the camera has made; returns what the driver reads back.
    pub fn write(&mut self, asked: Exposure) -> Exposure {
        let mut done = asked;
        if self.faults.step_s > 0.0 {
            let step_s = self.faults.step_s;
            done.time_s = ((done.time_s / step_s).round() * step_s).max(step_s);
        }
        done.time_s = done.time_s.min(self.faults.most_s / done.gain);
        let (least, most) = self.faults.delay;
        let drawn = self.dice.unit() < self.faults.jitter;
        let spread = if drawn { (self.dice.unit() * (most - least + 1) as f64) as u64 } else { 0 };
        // A newer write is never in force before an older one.
        let from = (self.sequence + least + spread).max(self.under_way.back().map_or(0, |(from, _)| *from));
        self.under_way.push_back((from, done));
        self.asked.push_back(done);
        if self.asked.len() > 6 {
            self.asked.pop_front();
        }
        if self.faults.hides_changes { asked } else { done }
    }

    /// The next frame that the driver delivers.
    pub fn next(&mut self, thumbnail: &mut Thumbnail) -> SimulatedFrame {
        loop {
            // A frame that is to be overtaken waits for the one behind it.
            if self.ready.len() > usize::from(self.faults.reordered > 0.0)
                && let Some((frame, small)) = self.ready.pop_front()
            {
                thumbnail.clone_from(&small);
                return frame;
            }
            self.expose(thumbnail);
        }
    }

    /// Makes one frame, and puts what comes of it into the queue.
    fn expose(&mut self, thumbnail: &mut Thumbnail) {
        while self.under_way.front().is_some_and(|(from, _)| *from <= self.sequence) {
            self.in_force = self.under_way.pop_front().map_or(self.in_force, |(_, exposure)| exposure);
        }
        self.change_scene();
        let truth = self.in_force;
        self.draw(truth);
        self.reader.read_luminance(WIDTH, &self.values, thumbnail);
        let frame = SimulatedFrame {
            sequence: self.sequence,
            t: Timestamp(33_333_333 * self.sequence as i64),
            stated: self.state(truth),
            truth,
        };
        self.frame_before = truth;
        self.sequence += 1;
        if self.dice.unit() < self.faults.lost {
            return;
        }
        let overtakes = self.dice.unit() < self.faults.reordered;
        let at = self.ready.len() - usize::from(overtakes && !self.ready.is_empty());
        self.ready.insert(at, (frame, thumbnail.clone()));
        if self.dice.unit() < self.faults.twice {
            self.ready.push_back((frame, thumbnail.clone()));
        }
    }

    fn change_scene(&mut self) {
        let Faults { light_steps, treacherous_steps, lamp, hand, drift, .. } = self.faults;
        if self.dice.unit() < light_steps {
            let factor = self.dice.between(-2.77, 2.77).exp();
            self.set_light(self.light * factor);
        }
        if self.dice.unit() < treacherous_steps && self.asked.len() > 1 {
            let one = self.asked[(self.dice.unit() * self.asked.len() as f64) as usize];
            let other = self.asked[(self.dice.unit() * self.asked.len() as f64) as usize];
            self.set_light(self.light * one.effective_s() / other.effective_s());
        }
        if self.dice.unit() < lamp {
            self.lamp_on = !self.lamp_on;
        }
        if self.dice.unit() < hand {
            self.hand_until = self.sequence + 60;
        }
        self.hand_at = (self.hand_at + 0.3) % (COLUMNS as f64);
        self.drift += drift * 0.1 * self.dice.normal() - 0.01 * self.drift;
    }

    /// A light that would leave the scene's middle unseen is turned the other way.
    fn set_light(&mut self, light: f64) {
        self.light = if (0.2..5.0).contains(&light) { light } else { 1.0 };
    }

    fn draw(&mut self, exposure: Exposure) {
        let t_s = self.sequence as f64 / 30.0;
        // The mean of 1 + a sin(2 pi 100 t) over the exposure.
        let phase = std::f64::consts::TAU * 100.0 * t_s + 0.7 * (0.37 * t_s).sin() * 9.0;
        let half = std::f64::consts::PI * 100.0 * exposure.time_s;
        let swing = 1.0 + self.faults.flicker * (phase + half).sin() * half.sin() / half;
        let light = self.light * self.drift.exp() * swing * exposure.effective_s();
        let hand = self.sequence < self.hand_until;
        for k in 0..SAMPLES {
            let column = (k % WIDTH) as f64 / 2.0;
            let covered = hand && (column - self.hand_at).abs() < 1.7;
            let radiance = if covered { 25.0 } else { self.radiance[k] };
            let lamp = if self.lamp_on { self.lamp[k] } else { 0.0 };
            let x = (radiance + lamp) * light;
            let noise = (0.0004 * x + self.faults.reading_noise.powi(2)).sqrt() * self.dice.normal();
            let at = ((x + noise).max(1e-9).ln() - TABLE_FROM) / (TABLE_TO - TABLE_FROM) * TABLE as f64;
            self.values[k] = self.table[(at.max(0.0) as usize).min(TABLE - 1)];
        }
    }

    fn state(&mut self, truth: Exposure) -> Option<Exposure> {
        match self.faults.metadata {
            Metadata::None => None,
            Metadata::Honest => Some(truth),
            Metadata::LastWritten => Some(self.asked.back().copied().unwrap_or(truth)),
            Metadata::LateAfterAWhile if self.sequence >= 2000 => Some(self.frame_before),
            Metadata::LateAfterAWhile => Some(truth),
            Metadata::SometimesWrong if self.dice.unit() < 0.05 => self.asked.front().copied(),
            Metadata::SometimesWrong => Some(truth),
            Metadata::Frozen => Some(Exposure { time_s: 0.004, gain: 1.0 }),
        }
    }
}
