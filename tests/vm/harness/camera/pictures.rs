//! What the camera sees: a pattern, or the pictures of a bundled recording, both as bright as the exposure makes them.

use super::controls::Settings;
use halflight_core::model::{frame::RawFrame, time::Timestamp};
use halflight_device::{
    ErrorKind, FrameSource,
    replay::{self, ReplayOptions},
};
use halflight_vm::Strip;

/// Pictures that are kept of a recording: ten rounds of three exposures.
const MOST_KEPT: usize = 30;
/// Exposures of a round in the recording.
const ROUND: usize = 3;
/// At this exposure (100 us) the pattern has its middle brightness.
const PATTERN_EXPOSURE: f64 = 100.0;

/// Where pictures come from.
pub enum Pictures {
    Pattern,
    Recording(Vec<RawFrame>),
}

impl Pictures {
    /// Reads the first pictures of a recording.
    pub fn of_recording(path: &str) -> Result<Self, String> {
        let options = ReplayOptions::parse(path).map_err(|e| e.to_string())?;
        let (mut source, _) = replay::open(&options).map_err(|e| e.to_string())?;
        let mut frames = Vec::new();
        while frames.len() < MOST_KEPT {
            match source.next(Timestamp::NEVER) {
                Ok(frame) => frames.push(frame),
                Err(error) if error.kind == ErrorKind::Ended => break,
                Err(error) => return Err(error.to_string()),
            }
        }
        if frames.len() < ROUND {
            Err(format!("{path}: too few pictures"))
        } else {
            Ok(Self::Recording(frames))
        }
    }

    /// The frame with this number as the camera sends it: YUYV of limited range, BT.601, with its strip.
    pub fn draw(&self, number: u64, settings: Settings, (width, height): (usize, usize)) -> Vec<u8> {
        let mut picture = match self {
            Self::Pattern => pattern(number, settings, width, height),
            Self::Recording(frames) => from_frame(chosen(frames, number, settings), settings, width, height),
        };
        Strip { number: number as u16, exposure: settings.exposure }.write(&mut picture, width);
        picture
    }
}

/// Exposure and gain together, 100 us.
fn effective(settings: Settings) -> f64 {
    f64::from(settings.exposure) * f64::from(settings.gain.max(1)) / 16.0
}

fn pattern(number: u64, settings: Settings, width: usize, height: usize) -> Vec<u8> {
    let scale = effective(settings) / PATTERN_EXPOSURE;
    let values: Vec<u8> = (0..256)
        .map(|value| {
            (16.0 + f64::from(value) * 0.5 * scale + f64::from(settings.brightness)).clamp(16.0, 235.0) as u8
        })
        .collect();
    let shift = number as usize * 7;
    let mut picture = Vec::with_capacity(2 * width * height);
    for y in 0..height {
        for x in 0..width {
            let chroma = if x % 2 == 0 { 118 } else { 138 };
            picture.extend([values[(x + y + shift) % 256], chroma]);
        }
    }
    picture
}

/// The picture of this frame's round whose exposure is the nearest.
fn chosen(frames: &[RawFrame], number: u64, settings: Settings) -> &RawFrame {
    let round = (number as usize / ROUND) % (frames.len() / ROUND) * ROUND;
    let wish = (effective(settings) * 1e-4).ln();
    let distance = |frame: &RawFrame| (frame.exposure.effective_s().ln() - wish).abs();
    let mut best = &frames[round];
    for frame in &frames[round..round + ROUND] {
        if distance(frame) < distance(best) {
            best = frame;
        }
    }
    best
}

/// sRGB's curve, both ways, and what a value becomes under more or less light.
fn relit(ratio: f64, brightness: f64) -> Vec<f64> {
    let linear = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    let coded = |v: f64| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (0..256)
        .map(|value| {
            // What is saturated stays so: nobody knows how bright it was.
            let light =
                if value == 255 && ratio < 1.0 { 1.0 } else { linear(f64::from(value) / 255.0) * ratio };
            (255.0 * coded(light.min(1.0)) + brightness).clamp(0.0, 255.0)
        })
        .collect()
}

fn from_frame(frame: &RawFrame, settings: Settings, width: usize, height: usize) -> Vec<u8> {
    let ratio = effective(settings) * 1e-4 / frame.exposure.effective_s();
    let values = relit(ratio, f64::from(settings.brightness));
    let image = &frame.pixels;
    let (across, down) = (image.width() / width, image.height() / height);
    let mean = |x: usize, y: usize, channel: usize| -> f64 {
        let mut sum = 0.0;
        for row in 0..down {
            for column in 0..across {
                sum += values[usize::from(image.at(x * across + column, y * down + row)[channel])];
            }
        }
        sum / (across * down) as f64
    };
    let mut picture = Vec::with_capacity(2 * width * height);
    for y in 0..height {
        for x in (0..width).step_by(2) {
            let two = [x, x + 1].map(|x| [0, 1, 2].map(|channel| mean(x, y, channel)));
            let luma = two.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b);
            let middle = (luma[0] + luma[1]) / 2.0;
            let blue = ((two[0][2] + two[1][2]) / 2.0 - middle) / 1.772;
            let red = ((two[0][0] + two[1][0]) / 2.0 - middle) / 1.402;
            let coded = luma.map(|luma| (16.5 + luma * 219.0 / 255.0) as u8);
            let [cb, cr] = [blue, red].map(|c| (128.5 + c * 224.0 / 255.0) as u8);
            picture.extend([coded[0], cb, coded[1], cr]);
        }
    }
    picture
}
