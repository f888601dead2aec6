//! Y, Cb, Cr to 8-bit RGB.

use crate::model::pixels::{YuvMatrix, YuvRange};

/// A matrix made ready: numbers in units of the 8-bit result.
#[derive(Clone, Copy, Debug)]
pub struct YuvToRgb {
    luma: (f32, f32),
    red_of_cr: f32,
    green_of_cb: f32,
    green_of_cr: f32,
    blue_of_cb: f32,
}

impl YuvToRgb {
    /// Of a range and a matrix: R = Y + 2 (1 - k_r) Cr, B = Y + 2 (1 - k_b) Cb, and G so that Y is the weighted mean
    /// (ITU-R BT.601 and BT.709).
    pub fn new(range: YuvRange, matrix: YuvMatrix) -> Self {
        let (kr, kb) = matrix.red_and_blue();
        let kg = 1.0 - kr - kb;
        let (black, luma, chroma) = match range {
            YuvRange::Full => (0.0, 1.0, 1.0),
            YuvRange::Limited => (16.0, 255.0 / 219.0, 255.0 / 224.0),
        };
        let of = |factor: f64| (factor * chroma) as f32;
        Self {
            luma: (black, luma as f32),
            red_of_cr: of(2.0 * (1.0 - kr)),
            green_of_cb: of(-2.0 * kb * (1.0 - kb) / kg),
            green_of_cr: of(-2.0 * kr * (1.0 - kr) / kg),
            blue_of_cb: of(2.0 * (1.0 - kb)),
        }
    }

    /// Rounded to the nearest, clipped to 0..=255.
    pub fn convert(&self, y: u8, cb: u8, cr: u8) -> [u8; 3] {
        let y = (f32::from(y) - self.luma.0) * self.luma.1;
        let (cb, cr) = (f32::from(cb) - 128.0, f32::from(cr) - 128.0);
        let rgb = [
            y + self.red_of_cr * cr,
            y + self.green_of_cb * cb + self.green_of_cr * cr,
            y + self.blue_of_cb * cb,
        ];
        rgb.map(|value| (value + 0.5) as u8)
    }
}
