//! What a camera delivers.

use super::{
    image::Rgb8Image, pixels::FramePixels, response::Response, sensor::SensorImage, time::Timestamp,
};
use std::sync::Arc;

/// What the sensor truly applied to one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Exposure time in seconds.
    pub time_s: f64,
    /// Analogue times digital gain, 1 = none.
    pub gain: f64,
}

impl Exposure {
    /// Time times gain: what scales the picture, in seconds at unit gain.
    pub fn effective_s(self) -> f64 {
        self.time_s * self.gain
    }
}

/// One camera frame, ready for the stages: 8-bit RGB, and what the sensor gave.
#[derive(Clone, Debug)]
pub struct RawFrame {
    /// Counts every frame that the camera made; a gap means frames were lost.
    pub sequence: u64,
    /// Middle of the exposure on the monotonic clock.
    pub t_mid: Timestamp,
    /// As truly applied.
    pub exposure: Exposure,
    /// 8-bit RGB through the camera's response.
    pub pixels: Arc<Rgb8Image>,
    /// The same picture as finely as the sensor gave it, where that is finer than 8 bits: frames are merged by it then.
    pub sensor: Option<Arc<SensorImage>>,
    /// Seconds from the exposure of one row to that of the next (rolling shutter); 0: all rows at once. `t_mid` is the middle
    /// row's.
    pub row_time_s: f64,
    /// What the 8-bit values mean, where the device found it out while running; the same for all frames until it is another.
    /// `None`: what the device states.
    pub response: Option<Arc<Response>>,
}

/// One camera frame as its driver gives it, in any format; `device::developed` makes a [`RawFrame`] of it.
#[derive(Clone, Debug)]
pub struct CapturedFrame {
    /// Counts every frame that the camera made; a gap means frames were lost.
    pub sequence: u64,
    /// Middle of the exposure of the middle row, on the monotonic clock.
    pub t_mid: Timestamp,
    /// As truly applied.
    pub exposure: Exposure,
    /// The bytes, their format, and the time from row to row.
    pub pixels: FramePixels,
}
