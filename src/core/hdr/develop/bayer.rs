//! A Bayer sensor's picture: three channels at every pixel.

use crate::model::{
    pixels::{BayerDepth, BayerOrder},
    sensor::{CLIPPED, SensorScale, UNSEEN},
};

/// A Bayer sensor's picture.
pub(super) struct Sensor<'a> {
    pub bytes: &'a [u8],
    pub stride: usize,
    pub size: (usize, usize),
    pub order: BayerOrder,
    pub depth: BayerDepth,
    pub black: f32,
    /// From this value on a pixel counts as saturated.
    pub saturated: u32,
    /// From a value without black to the exposure, for each channel.
    pub scale: [f32; 3],
}

/// What the pixels around one show of a channel.
#[derive(Clone, Copy, Default)]
struct BayerNeighbours {
    /// Sum of the values without black.
    sum: f32,
    /// Sum of the values as they are.
    raw: u32,
    count: u32,
    most: u32,
}

impl Sensor<'_> {
    /// The exposure at a pixel, and its values in 16 bits: its own channel as it is, the others as the mean of those of the 3 x 3
    /// around it that lie in the picture; where there are none (a picture one pixel wide), its own.
    pub fn pixel(&self, x: usize, y: usize) -> ([f32; 3], [u16; 3]) {
        let (width, height) = self.size;
        let own = self.order.channel(x, y);
        let here = self.value(x, y);
        let mut around = [BayerNeighbours::default(); 3];
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                let of = &mut around[self.order.channel(u, v)];
                let raw = self.value(u, v);
                of.sum += self.without_black(raw);
                of.raw += raw;
                of.count += 1;
                of.most = of.most.max(raw);
            }
        }
        let is_own = |c: usize| c == own || around[c].count == 0;
        let exposure = std::array::from_fn(|c| {
            let of = &around[c];
            let value = if is_own(c) { self.without_black(here) } else { of.sum / of.count as f32 };
            value * self.scale[c]
        });
        let step = self.step();
        let values = std::array::from_fn(|c| {
            let of = &around[c];
            let (sum, count, most) = if is_own(c) { (here, 1, here) } else { (of.raw, of.count, of.most) };
            let mean = (sum * step + count / 2) / count;
            if most >= self.saturated { CLIPPED } else { (mean as u16).clamp(UNSEEN + 1, CLIPPED - 1) }
        });
        (exposure, values)
    }

    /// What the values in 16 bits mean.
    pub fn scale_of_values(&self) -> SensorScale {
        let step = self.step() as f32;
        SensorScale {
            black: self.black * step,
            saturated: (self.saturated * self.step()).min(CLIPPED.into()) as u16,
            step,
            exposure_per_value: self.scale.map(|scale| scale / step),
        }
    }

    /// Values in 16 bits from one of the sensor's to the next: means of up to four keep their fraction.
    fn step(&self) -> u32 {
        65536 / (u32::from(self.depth.white()) + 1)
    }

    fn value(&self, x: usize, y: usize) -> u32 {
        let start = y * self.stride;
        u32::from(self.depth.value(&self.bytes[start..], x))
    }

    fn without_black(&self, value: u32) -> f32 {
        (value as f32 - self.black).max(0.0)
    }
}
