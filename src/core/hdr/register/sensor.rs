//! Older frames at their sensor's fineness: all taps are blended in linear light.

use super::{FRACTION, ONE, Warped, coded::bilinear_weights};
use crate::model::sensor::{CLIPPED, SensorImage, UNSEEN};

/// An older frame.
pub(super) struct SensorWarp<'a>(pub &'a SensorImage);

impl SensorWarp<'_> {
    /// Blends four taps; what is measured stays apart from the two values that are not.
    fn blend(&self, taps: [[u16; 3]; 4], x: i32, y: i32) -> [u16; 3] {
        let weights = bilinear_weights(x, y).map(|weight| weight as u32);
        std::array::from_fn(|c| {
            let mut sum = 1 << 11;
            let mut most = 0;
            for (tap, weight) in taps.iter().zip(weights) {
                sum += u32::from(tap[c]) * weight;
                most = tap[c].max(most);
            }
            let mean = ((sum >> 12) as u16).clamp(UNSEEN + 1, CLIPPED - 1);
            if most >= self.0.scale.saturated { CLIPPED } else { mean }
        })
    }
}

impl Warped for SensorWarp<'_> {
    type Pixel = [u16; 3];

    fn inside(&self, at: [i32; 2]) -> [u16; 3] {
        let (x, y) = (at[0] - ONE / 2, at[1] - ONE / 2);
        let values = &self.0.values;
        let first = (y >> FRACTION) as usize * values.width() + (x >> FRACTION) as usize;
        let (upper, lower) = (&values.pixels()[first..], &values.pixels()[first + values.width()..]);
        self.blend([upper[0], upper[1], lower[0], lower[1]], x, y)
    }

    fn sample(&self, at: [i32; 2], _on_ball: bool) -> Option<[u16; 3]> {
        let values = &self.0.values;
        let (width, height) = (values.width() as i32, values.height() as i32);
        if at[0] < 0 || at[1] < 0 || at[0] >= width * ONE || at[1] >= height * ONE {
            return None;
        }
        // Pixel centres are at +0.5; at the border the outermost pixel goes on.
        let (x, y) = (at[0] - ONE / 2, at[1] - ONE / 2);
        let (i, j) = (x >> FRACTION, y >> FRACTION);
        let columns = [i.max(0) as usize, (i + 1).min(width - 1) as usize];
        let rows = [values.row(j.max(0) as usize), values.row((j + 1).min(height - 1) as usize)];
        let taps = [rows[0][columns[0]], rows[0][columns[1]], rows[1][columns[0]], rows[1][columns[1]]];
        Some(self.blend(taps, x, y))
    }

    fn unseen(&self, _x: usize, _y: usize) -> [u16; 3] {
        [UNSEEN; 3]
    }
}
