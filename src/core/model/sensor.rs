//! A camera's picture as finely as its sensor gives it.

use super::image::Image;

/// The value of a pixel that the camera did not see.
pub const UNSEEN: u16 = 0;
/// The value of a channel that is saturated for certain.
pub const CLIPPED: u16 = u16::MAX;

/// What the values of a [`SensorImage`] mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorScale {
    /// Value of no light. Noise falls below it, too, so that the mean of dark pixels is right.
    pub black: f32,
    /// Value from which a channel counts as saturated; above `black`.
    pub saturated: u16,
    /// One step of the sensor, in values: less light than half of it is not told from none.
    pub step: f32,
    /// For each channel the exposure (radiance times effective exposure in seconds, as the response has it) of a value of 1
    /// above black.
    pub exposure_per_value: [f32; 3],
}

/// A picture of three channels of 16 bits, linear in light. [`UNSEEN`] and [`CLIPPED`] are no measured values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorImage {
    /// All channels at every pixel.
    pub values: Image<[u16; 3]>,
    /// What they mean.
    pub scale: SensorScale,
}

impl SensorImage {
    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.values.width(), self.values.height())
    }
}
