//! What the camera sees: a pattern, or the pictures of a bundled recording, both as bright as the exposure makes them.

use super::controls::Settings;
use halflight_core::model::{frame::RawFrame, response::Response, time::Timestamp};
use halflight_device::{
    ErrorKind, FrameSource,
    replay::{self, ReplayOptions},
};
use halflight_vm::Strip;

/// Exposures of a round in the recording. The first round is all that is used: this camera stands still.
const ROUND: usize = 3;
/// At this exposure (100 us) the pattern has its middle brightness.
const PATTERN_EXPOSURE: f64 = 100.0;

/// Where pictures come from.
pub enum Pictures {
    Pattern,
    /// Frames, and what their values mean.
    Recording(Vec<RawFrame>, Box<Response>),
}

impl Pictures {
    /// Reads the first round of a recording.
    pub fn of_recording(path: &str) -> Result<Self, String> {
        let options = ReplayOptions::parse(path).map_err(|e| e.to_string())?;
        let (mut source, _) = replay::open(&options).map_err(|e| e.to_string())?;
        let mut frames = Vec::new();
        while frames.len() < ROUND {
            match source.next(Timestamp::NEVER) {
                Ok(frame) => frames.push(frame),
                Err(error) if error.kind == ErrorKind::Ended => break,
                Err(error) => return Err(error.to_string()),
            }
        }
        if frames.len() < ROUND {
            Err(format!("{path}: too few pictures"))
        } else {
            let response = source.response().unwrap_or_else(Response::srgb);
            Ok(Self::Recording(frames, Box::new(response)))
        }
    }

    /// The frame with this number as the camera sends it: YUYV of limited range, BT.601, with its strip.
    pub fn draw(&self, number: u64, settings: Settings, (width, height): (usize, usize)) -> Vec<u8> {
        let mut picture = match self {
            Self::Pattern => pattern(number, settings, width, height),
            Self::Recording(frames, response) => {
                let frame = chosen(frames, settings);
                from_frame(frame, &relit(frame, response, settings), width, height)
            }
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

/// The picture whose exposure is the nearest.
fn chosen(frames: &[RawFrame], settings: Settings) -> &RawFrame {
    let wish = (effective(settings) * 1e-4).ln();
    let distance = |frame: &RawFrame| (frame.exposure.effective_s().ln() - wish).abs();
    let mut best = &frames[0];
    for frame in frames {
        if distance(frame) < distance(best) {
            best = frame;
        }
    }
    best
}

/// The camera's own curve, from light (1 = white) to 0 to 1: as bent as webcams are, and not sRGB.
fn curve(light: f64) -> f64 {
    let v = (light.clamp(0.0, 1.0) * 1.4 / (1.0 + 0.4 * light.clamp(0.0, 1.0))).powf(1.0 / 1.9);
    v + 0.2 * (v * v * (3.0 - 2.0 * v) - v)
}

/// What each value of a frame's channels becomes at another exposure, through this camera's curve.
fn relit(frame: &RawFrame, response: &Response, settings: Settings) -> [Vec<f64>; 3] {
    let ratio = effective(settings) * 1e-4 / frame.exposure.effective_s();
    response.log_exposure().map(|g| {
        let white = f64::from(g[255]);
        (0..256)
            .map(|value| {
                // What is saturated stays so: nobody knows how bright it was.
                let light = (f64::from(g[value]) - white).exp();
                let light = if value == 255 && ratio < 1.0 { 1.0 } else { light * ratio };
                (255.0 * curve(light) + f64::from(settings.brightness)).clamp(0.0, 255.0)
            })
            .collect()
    })
}

fn from_frame(frame: &RawFrame, values: &[Vec<f64>; 3], width: usize, height: usize) -> Vec<u8> {
    let image = &frame.pixels;
    let (across, down) = (image.width() / width, image.height() / height);
    let mean = |x: usize, y: usize, channel: usize| -> f64 {
        let mut sum = 0.0;
        for row in 0..down {
            for column in 0..across {
                let value = image.at(x * across + column, y * down + row)[channel];
                sum += values[channel][usize::from(value)];
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
