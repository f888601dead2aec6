//! Y, Cb, Cr to 8-bit RGB.

use crate::model::pixels::{PixelFormat, YuvMatrix, YuvRange};
use std::array::from_fn;

/// Pixels that are converted side by side. Even, so that pairs that share chroma stay together.
pub const CHUNK: usize = 64;

/// Neighbouring pixels of a row, each with its own Y, Cb, Cr.
pub struct YuvChunk {
    luma: [u8; CHUNK],
    cb: [u8; CHUNK],
    cr: [u8; CHUNK],
    /// So many of them are pixels.
    pub count: usize,
}

impl YuvChunk {
    /// `count` pixels from the even column `start` on. `chroma` is the row of pairs where the format has one of its own. Gray where the format is none
    /// of these.
    #[inline(always)]
    pub fn read(format: PixelFormat, row: &[u8], chroma: &[u8], start: usize, count: usize) -> Self {
        let mut chunk = Self { luma: [0; CHUNK], cb: [128; CHUNK], cr: [128; CHUNK], count };
        match format {
            PixelFormat::Yuyv => chunk.pairs(&row[2 * start..], |four| [four[0], four[2], four[1], four[3]]),
            PixelFormat::Uyvy => chunk.pairs(&row[2 * start..], |four| [four[1], four[3], four[0], four[2]]),
            PixelFormat::Nv12 => {
                chunk.luma[..count].copy_from_slice(&row[start..start + count]);
                for (k, pair) in chroma[start..].chunks_exact(2).take(count.div_ceil(2)).enumerate() {
                    chunk.cb[2 * k..2 * k + 2].fill(pair[0]);
                    chunk.cr[2 * k..2 * k + 2].fill(pair[1]);
                }
            }
            _ => chunk.luma[..count].copy_from_slice(&row[start..start + count]),
        }
        chunk
    }

    /// Reads pairs of four bytes; `order` gives Y, Y, Cb, Cr.
    #[inline(always)]
    fn pairs(&mut self, bytes: &[u8], order: impl Fn(&[u8]) -> [u8; 4]) {
        for (k, four) in bytes.chunks_exact(4).take(self.count.div_ceil(2)).enumerate() {
            let [left, right, cb, cr] = order(four);
            self.luma[2 * k..2 * k + 2].copy_from_slice(&[left, right]);
            self.cb[2 * k..2 * k + 2].fill(cb);
            self.cr[2 * k..2 * k + 2].fill(cr);
        }
    }
}

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

    /// Red, green and blue, rounded to the nearest, clipped to 0..=255.
    #[inline(always)]
    pub fn convert(&self, chunk: &YuvChunk) -> [[u8; CHUNK]; 3] {
        let y: [f32; CHUNK] = from_fn(|i| (f32::from(chunk.luma[i]) - self.luma.0) * self.luma.1);
        let cb: [f32; CHUNK] = from_fn(|i| f32::from(chunk.cb[i]) - 128.0);
        let cr: [f32; CHUNK] = from_fn(|i| f32::from(chunk.cr[i]) - 128.0);
        [
            from_fn(|i| rounded(y[i] + self.red_of_cr * cr[i])),
            from_fn(|i| rounded(y[i] + self.green_of_cb * cb[i] + self.green_of_cr * cr[i])),
            from_fn(|i| rounded(y[i] + self.blue_of_cb * cb[i])),
        ]
    }
}

/// From this number on neighbouring f32 are 1 apart: the lowest bits of a sum with it are the other number.
const WHOLE_NUMBERS: f32 = 8_388_608.0;

/// As `(value + 0.5) as u8`, for numbers; that is not done on many at a time.
#[inline(always)]
fn rounded(value: f32) -> u8 {
    ((value + 0.5).clamp(0.0, 255.0).floor() + WHOLE_NUMBERS).to_bits() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_the_language_s() {
        for k in -4000..4000 {
            let value = k as f32 * 0.125;
            for value in [value.next_down(), value, value.next_up()] {
                assert_eq!(rounded(value), (value + 0.5) as u8, "{value}");
            }
        }
    }
}
