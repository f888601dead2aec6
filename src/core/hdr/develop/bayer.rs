//! A Bayer sensor's picture: three channels at every pixel.

use crate::model::{
    pixels::{BayerDepth, BayerOrder},
    sensor::{CLIPPED, SensorScale, UNSEEN},
};
use std::array::from_fn;

/// Pixels of a row that are worked on side by side.
const CHUNK: usize = 64;
/// With a neighbour at each end.
const WIDER: usize = CHUNK + 2;

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

/// Those of the first list where green is, those of the second elsewhere.
#[inline(always)]
fn in_turn<T: Copy>(is_green_first: bool, green: &[T; CHUNK], elsewhere: &[T; CHUNK]) -> [T; CHUNK] {
    from_fn(|i| if (i % 2 == 0) == is_green_first { green[i] } else { elsewhere[i] })
}

/// Red, green, blue from the colour of the row, green, and the other colour.
#[inline(always)]
fn by_channel<T>(colour: usize, own: T, green: T, other: T) -> [T; 3] {
    if colour == 0 { [own, green, other] } else { [other, green, own] }
}

fn sum(four: [u32; 4]) -> u32 {
    four[0] + four[1] + four[2] + four[3]
}

fn largest(four: [u32; 4]) -> u32 {
    four[0].max(four[1]).max(four[2]).max(four[3])
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
        let exposure = from_fn(|c| {
            let of = &around[c];
            let value = if is_own(c) { self.without_black(here) } else { of.sum / of.count as f32 };
            value * self.scale[c]
        });
        let step = self.step();
        let values = from_fn(|c| {
            let of = &around[c];
            let (sum, count, most) = if is_own(c) { (here, 1, here) } else { (of.raw, of.count, of.most) };
            let mean = (sum * step + count / 2) / count;
            if most >= self.saturated { CLIPPED } else { (mean as u16).clamp(UNSEEN + 1, CLIPPED - 1) }
        });
        (exposure, values)
    }

    /// Hands on what [`Sensor::pixel`] gives at each pixel of a row.
    #[inline(always)]
    pub fn each_pixel(&self, y: usize, mut put: impl FnMut(usize, [f32; 3], [u16; 3])) {
        let (width, height) = self.size;
        let is_inside = y > 0 && y + 1 < height && width > 2;
        let inside = if is_inside { 1..width - 1 } else { 0..0 };
        for x in (0..width).filter(|x| !inside.contains(x)) {
            let (exposure, values) = self.pixel(x, y);
            put(x, exposure, values);
        }
        for start in inside.clone().step_by(CHUNK) {
            self.chunk(start, (inside.end - start).min(CHUNK), y, &mut put);
        }
    }

    /// Pixels that have all their neighbours, at most [`CHUNK`]. Lists of one number each, so that all pixels go side by side;
    /// the order of every sum is that of [`Sensor::pixel`].
    #[inline(always)]
    fn chunk(&self, start: usize, count: usize, y: usize, put: &mut impl FnMut(usize, [f32; 3], [u16; 3])) {
        // A row has green and one colour in turn; the other one lies above and below.
        let is_green_first = self.order.channel(start, y) == 1;
        let colour = self.order.channel(start + usize::from(is_green_first), y);
        let mut raw = [[0u32; WIDER]; 3];
        for (k, line) in raw.iter_mut().enumerate() {
            self.read(&mut line[..count + 2], start - 1, y + k - 1);
        }
        let clean = raw.map(|line| line.map(|value| self.without_black(value)));
        let [above, here, below] = &clean;
        let own = from_fn(|i| here[i + 1]);
        let cross = from_fn(|i| (above[i + 1] + here[i] + here[i + 2] + below[i + 1]) / 4.0);
        let corners = from_fn(|i| (above[i] + above[i + 2] + below[i] + below[i + 2]) / 4.0);
        let beside = from_fn(|i| (here[i] + here[i + 2]) / 2.0);
        let upright = from_fn(|i| (above[i + 1] + below[i + 1]) / 2.0);
        let scaled = |values: [f32; CHUNK], channel: usize| values.map(|value| value * self.scale[channel]);
        let exposures = by_channel(
            colour,
            scaled(in_turn(is_green_first, &beside, &own), colour),
            scaled(in_turn(is_green_first, &own, &cross), 1),
            scaled(in_turn(is_green_first, &upright, &corners), 2 - colour),
        );
        let [above, here, below] = &raw;
        let own = from_fn(|i| self.fine(here[i + 1], 0, here[i + 1]));
        let cross = from_fn(|i| {
            let four = [above[i + 1], here[i], here[i + 2], below[i + 1]];
            self.fine(sum(four), 2, largest(four))
        });
        let corners = from_fn(|i| {
            let four = [above[i], above[i + 2], below[i], below[i + 2]];
            self.fine(sum(four), 2, largest(four))
        });
        let beside = from_fn(|i| self.fine(here[i] + here[i + 2], 1, here[i].max(here[i + 2])));
        let upright = from_fn(|i| self.fine(above[i + 1] + below[i + 1], 1, above[i + 1].max(below[i + 1])));
        let values = by_channel(
            colour,
            in_turn(is_green_first, &beside, &own),
            in_turn(is_green_first, &own, &cross),
            in_turn(is_green_first, &upright, &corners),
        );
        for i in 0..count {
            let exposure = [exposures[0][i], exposures[1][i], exposures[2][i]];
            put(start + i, exposure, [values[0][i], values[1][i], values[2][i]]);
        }
    }

    /// The mean of 2^`doublings` values in 16 bits, clipped where one of them is saturated.
    #[inline(always)]
    fn fine(&self, sum: u32, doublings: u32, most: u32) -> u16 {
        let mean = (sum * self.step() + (1 << doublings >> 1)) >> doublings;
        let inside = mean.clamp(u32::from(UNSEEN) + 1, u32::from(CLIPPED) - 1) as u16;
        if most >= self.saturated { CLIPPED } else { inside }
    }

    /// Values of a row from a column on.
    #[inline(always)]
    fn read(&self, line: &mut [u32], column: usize, y: usize) {
        let row = &self.bytes[y * self.stride..];
        match self.depth {
            BayerDepth::Bits10 | BayerDepth::Bits12 | BayerDepth::Bits16 => {
                let white = u32::from(self.depth.white());
                for (value, two) in line.iter_mut().zip(row[2 * column..].chunks_exact(2)) {
                    *value = u32::from(u16::from_le_bytes([two[0], two[1]])) & white;
                }
            }
            _ => line.iter_mut().enumerate().for_each(|(i, v)| *v = self.depth.value(row, column + i).into()),
        }
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

    #[inline(always)]
    fn value(&self, x: usize, y: usize) -> u32 {
        let start = y * self.stride;
        u32::from(self.depth.value(&self.bytes[start..], x))
    }

    #[inline(always)]
    fn without_black(&self, value: u32) -> f32 {
        (value as f32 - self.black).max(0.0)
    }
}
