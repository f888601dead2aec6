//! What can be set in `synthetic:key=value,..`.

use crate::model::frame::Exposure;
use crate::{DeviceError, parameters::Parameters};

/// The keys, in the order of `Options`.
pub const KEYS: [&str; 11] = [
    "frames",
    "seed",
    "size",
    "fps",
    "exposures",
    "noise",
    "motion",
    "imu_offset_s",
    "texel_mm",
    "samples",
    "view",
];

/// What the camera looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SyntheticSubject {
    /// The table's top, with the tag at the origin and the mirror ball beside it.
    #[default]
    Desk,
    /// The table and the floor before and under it, with a larger tag on a board that stands on the table.
    Room,
}

/// All that defines a run: equal options give equal pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntheticOptions {
    /// How many frames until the source ends (key `frames`, 1..=1000000, default 90).
    pub frames: u64,
    /// Of the noise and the movement (key `seed`, default 1).
    pub seed: u64,
    /// Width and height in pixels (key `size`, e.g. 640x480, each 16..=4096).
    pub size: (u32, u32),
    /// Frames a second (key `fps`, 1..=240, default 30).
    pub fps: f64,
    /// Exposures used in turn (key `exposures`, seconds, divided by `:`, e.g. 1/4500:1/500:1/60; 1 to 9).
    pub exposures: Vec<Exposure>,
    /// Strength of the sensors' noise and biases (key `noise`, 0..=10, default 1).
    pub noise: f64,
    /// Strength of the camera's movement (key `motion`, 0..=3, default 1).
    pub motion: f64,
    /// Stated minus true time of the IMU samples (key `imu_offset_s`, -0.1..=0.1, default 0.004).
    pub imu_offset_s: f64,
    /// Texel of the baked shadows on the table (key `texel_mm`, 0.5..=20, default 1).
    pub texel_mm: f64,
    /// Rays along each side of an edge pixel (key `samples`, 2..=16, default 4); the ball takes twice as many.
    pub samples: u32,
    /// What the camera looks at (key `view`, `desk` or `room`, default `desk`).
    pub view: SyntheticSubject,
}

/// Shortest exposure, seconds.
pub const SHORTEST_S: f64 = 1e-5;

impl Default for SyntheticOptions {
    fn default() -> Self {
        Self {
            frames: 90,
            seed: 1,
            size: (640, 480),
            fps: 30.0,
            exposures: [4500.0, 500.0, 60.0].map(|rate| Exposure { time_s: 1.0 / rate, gain: 1.0 }).to_vec(),
            noise: 1.0,
            motion: 1.0,
            imu_offset_s: 0.004,
            texel_mm: 1.0,
            samples: 4,
            view: SyntheticSubject::Desk,
        }
    }
}

impl SyntheticOptions {
    /// Reads the part of a device name after `synthetic:`.
    pub fn parse(text: &str) -> Result<Self, DeviceError> {
        let device = format!("synthetic:{text}");
        let p = Parameters::parse(&device, text, &KEYS)?;
        let d = Self::default();
        let size = match p.text("size") {
            None => d.size,
            Some(text) => parse_size(text).ok_or_else(|| {
                p.refuse("size", text, "must be WIDTHxHEIGHT, each within 16..=4096 pixels")
            })?,
        };
        let fps = p.number("fps", d.fps, 1.0, 240.0, " frames a second")?;
        let exposures = match p.text("exposures") {
            None => d.exposures,
            Some(text) => {
                parse_exposures(text, 1.0 / fps).map_err(|why| p.refuse("exposures", text, &why))?
            }
        };
        let view = match p.text("view") {
            None | Some("desk") => SyntheticSubject::Desk,
            Some("room") => SyntheticSubject::Room,
            Some(other) => return Err(p.refuse("view", other, "must be desk or room")),
        };
        Ok(Self {
            view,
            frames: p.number("frames", d.frames, 1, 1_000_000, " frames")?,
            seed: p.number("seed", d.seed, 0, u64::MAX, "")?,
            size,
            fps,
            exposures,
            noise: p.number("noise", d.noise, 0.0, 10.0, "")?,
            motion: p.number("motion", d.motion, 0.0, 3.0, "")?,
            imu_offset_s: p.number("imu_offset_s", d.imu_offset_s, -0.1, 0.1, " s")?,
            texel_mm: p.number("texel_mm", d.texel_mm, 0.5, 20.0, " mm")?,
            samples: p.number("samples", d.samples, 2, 16, "")?,
        })
    }
}

/// `WIDTHxHEIGHT`, each within 16..=4096.
pub fn parse_size(text: &str) -> Option<(u32, u32)> {
    let (w, h) = text.split_once('x')?;
    let side = |t: &str| t.parse::<u32>().ok().filter(|n| (16..=4096).contains(n));
    Some((side(w)?, side(h)?))
}

/// One to nine times in seconds, divided by `:`; `1/480` and `0.002` are both good. The error says what is allowed.
pub fn parse_exposures(text: &str, longest_s: f64) -> Result<Vec<Exposure>, String> {
    let allowed = format!(
        "must be 1 to 9 times divided by \":\", each within {SHORTEST_S}..={longest_s:.6} s, e.g. 1/480"
    );
    let time = |t: &str| match t.split_once('/') {
        Some((a, b)) => Some(a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?),
        None => t.trim().parse::<f64>().ok(),
    };
    let times: Option<Vec<f64>> = text.split(':').map(time).collect();
    let times = times.filter(|all| {
        (1..=9).contains(&all.len()) && all.iter().all(|t| (SHORTEST_S..=longest_s).contains(t))
    });
    times.map(|all| all.into_iter().map(|time_s| Exposure { time_s, gain: 1.0 }).collect()).ok_or(allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_and_full_names() {
        assert_eq!(SyntheticOptions::parse("").unwrap(), SyntheticOptions::default());
        let o = SyntheticOptions::parse("frames=5,seed=7,size=320x240,exposures=1/100:0.02,noise=0").unwrap();
        assert_eq!((o.frames, o.seed, o.size, o.noise), (5, 7, (320, 240), 0.0));
        assert_eq!(o.exposures.iter().map(|e| e.time_s).collect::<Vec<_>>(), vec![0.01, 0.02]);
    }

    #[test]
    fn errors_name_key_and_range() {
        for (text, part) in [
            ("size=640", "WIDTHxHEIGHT"),
            ("size=4x4", "16..=4096"),
            ("exposures=1/0", "1 to 9 times"),
            ("exposures=1", "0.033333 s"),
            ("frames=0", "1..=1000000"),
            ("noise=NaN", "0..=10"),
            ("view=garden", "must be desk or room"),
            ("exposure=1/60", "did you mean \"exposures\""),
        ] {
            let error = SyntheticOptions::parse(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
