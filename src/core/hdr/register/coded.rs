//! Older frames of 8-bit values.

use super::{FRACTION, ONE, Warped};
use crate::hdr::{linear_light::LinearLight, merge_bracket::weight};
use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};

/// An 8-bit value from which a tap counts as saturated (noise and compression blur the end of the scale).
pub const SATURATED: u8 = 253;

/// What stands in for pixels that the older frame did not see: a value of no weight where the newest frame knows the
/// radiance; where the newest frame is black or saturated, what the older exposure would have made of that bound.
/// *So the merge at such a pixel never claims more than the newest frame does.*
#[derive(Clone, Debug, PartialEq)]
pub struct BoundFill {
    /// For each channel: where the newest value is 0, and where it is 255.
    ends: [[u8; 2]; 3],
}

impl BoundFill {
    /// For an older frame's exposure beside the newest one's.
    pub fn new(response: &Response, newest: Exposure, older: Exposure) -> Self {
        let (newest_s, older_s) = (newest.effective_s(), older.effective_s());
        let seen_as = |channel: usize, z: usize| {
            let exposure = response.log_exposure()[channel][z].exp() * (older_s / newest_s) as f32;
            response.value_of(channel, exposure).round().clamp(1.0, 254.0) as u8
        };
        let ends = std::array::from_fn(|c| {
            let black = if older_s <= newest_s { 0 } else { seen_as(c, 0) };
            let saturated = if older_s >= newest_s { 255 } else { seen_as(c, 255) };
            [black, saturated]
        });
        Self { ends }
    }

    pub(super) fn pixel(&self, newest: [u8; 3]) -> [u8; 3] {
        std::array::from_fn(|c| match newest[c] {
            0 => self.ends[c][0],
            255 => self.ends[c][1],
            z if weight(z) > 0 && z < 128 => 0,
            _ => 255,
        })
    }
}

/// An older frame, and what else its pixels are made of.
pub(super) struct CodedWarp<'a> {
    pub older: &'a Rgb8Image,
    pub newest: &'a Rgb8Image,
    pub fill: &'a BoundFill,
    pub light: &'a LinearLight,
}

impl Warped for CodedWarp<'_> {
    type Pixel = [u8; 3];

    fn inside(&self, at: [i32; 2]) -> [u8; 3] {
        sample_inside(self.older.pixels().as_flattened(), self.older.width(), at)
    }

    fn sample(&self, at: [i32; 2], on_ball: bool) -> Option<[u8; 3]> {
        sample(self.older, at, on_ball.then_some(self.light))
    }

    fn unseen(&self, x: usize, y: usize) -> [u8; 3] {
        self.fill.pixel(*self.newest.at(x, y))
    }
}

/// The bilinear value at a continuous pixel position, in linear light where that is given; `None` outside the picture.
pub(in crate::hdr) fn sample(
    picture: &Rgb8Image,
    at: [i32; 2],
    light: Option<&LinearLight>,
) -> Option<[u8; 3]> {
    let (width, height) = (picture.width() as i32, picture.height() as i32);
    if at[0] < 0 || at[1] < 0 || at[0] >= width * ONE || at[1] >= height * ONE {
        return None;
    }
    // Pixel centres are at +0.5; at the border the outermost pixel goes on.
    let (x, y) = (at[0] - ONE / 2, at[1] - ONE / 2);
    let (i, j) = (x >> FRACTION, y >> FRACTION);
    let columns = [i.max(0) as usize, (i + 1).min(width - 1) as usize];
    let rows = [picture.row(j.max(0) as usize), picture.row((j + 1).min(height - 1) as usize)];
    let taps = [rows[0][columns[0]], rows[0][columns[1]], rows[1][columns[0]], rows[1][columns[1]]];
    let lanes = taps.map(|[r, g, b]| u64::from(r) | u64::from(g) << LANE | u64::from(b) << (2 * LANE));
    let mut pixel = blend(lanes, x, y);
    if let Some(light) = light {
        light.mend(taps, bilinear_weights(x, y), &mut pixel);
    }
    Some(pixel)
}

/// Weights of the four taps (left and right above, left and right below) in steps of 1/64 pixel; they sum to 4096.
pub(super) fn bilinear_weights(x: i32, y: i32) -> [u64; 4] {
    let part = |v: i32| ((v & (ONE - 1)) >> (FRACTION - 6)) as u64;
    let (s, t) = (part(x), part(y));
    [(64 - s) * (64 - t), s * (64 - t), (64 - s) * t, s * t]
}

/// As [`sample`] where all four taps lie within the picture, not in its last row: `bytes` are its pixels.
fn sample_inside(bytes: &[u8], width: usize, at: [i32; 2]) -> [u8; 3] {
    let (x, y) = (at[0] - ONE / 2, at[1] - ONE / 2);
    let first = 3 * ((y >> FRACTION) as usize * width + (x >> FRACTION) as usize);
    // Eight bytes hold the two pixels side by side.
    let pair = |start: usize| bytes[start..].first_chunk().map_or(0, |eight| u64::from_le_bytes(*eight));
    let spread = |p: u64| (p & 0xff) | (p & 0xff00) << (LANE - 8) | (p & 0xff_0000) << (2 * LANE - 16);
    let (upper, lower) = (pair(first), pair(first + 3 * width));
    blend([spread(upper), spread(upper >> 24), spread(lower), spread(lower >> 24)], x, y)
}

/// Bits of one channel in a word that holds all three: room for 8 bits times two 6-bit weights.
const LANE: u32 = 20;
/// A one in each channel.
const LANES: u64 = 1 | 1 << LANE | 1 << (2 * LANE);

/// Blends four taps with [`bilinear_weights`]; a channel in which one is saturated becomes 255.
fn blend(taps: [u64; 4], x: i32, y: i32) -> [u8; 3] {
    let sum: u64 = taps.iter().zip(bilinear_weights(x, y)).map(|(tap, weight)| tap * weight).sum::<u64>()
        + (LANES << 11);
    let mut pixel = [sum >> 12, sum >> (12 + LANE), sum >> (12 + 2 * LANE)].map(|v| v as u8);
    // A channel at or above the limit carries into its ninth bit.
    let carry = LANES * (256 - SATURATED as u64);
    let saturated = taps.iter().fold(0, |any, tap| any | (tap + carry)) & (LANES << 8);
    if saturated != 0 {
        for (channel, z) in pixel.iter_mut().enumerate() {
            if saturated >> (8 + LANE as usize * channel) & 1 == 1 {
                *z = 255;
            }
        }
    }
    pixel
}
