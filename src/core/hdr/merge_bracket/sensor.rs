//! Merges pictures at their sensor's own fineness: no response is needed, as a sensor is linear.

use super::{BLOCK, MAX_PICTURES, MergeError, TASK, check_sizes};
use crate::model::{
    frame::Exposure,
    image::{HdrImage, LOWER_BOUND, UPPER_BOUND},
    sensor::{SensorImage, UNSEEN},
};
use rayon::prelude::*;

/// From so much of the way from black to saturation on, a value counts less and less: exposures that are stated a little
/// wrong leave no edge where one saturates.
const TRUSTED: f32 = 0.75;
/// The least weight of a picture beside the one that counts most.
const LEAST_WEIGHT: f64 = 1e-20;
/// No number beyond these ends is worked with.
const FACTORS: std::ops::RangeInclusive<f64> = 1e-30..=1e30;

/// What a merge needs to know of one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorTerms {
    /// How much its values count below [`SensorTerms::saturated`].
    pub weight: f32,
    /// Value of no light.
    pub black: f32,
    /// Value from which a channel is saturated.
    pub saturated: f32,
    /// Weight lost for each value towards saturation, from where it is lost.
    pub fall: f32,
    /// For each channel the radiance of a value of 1.
    pub factor: [f32; 3],
    /// Half a step of the sensor, in values.
    pub half_step: f32,
}

impl SensorTerms {
    /// Those of each picture. Times differ and gains differ: a picture counts by time x (time x gain), so that the sum is a
    /// least-squares line through black where noise is that of reading, and near the best where it is that of light.
    pub fn of(pictures: &[&SensorImage], exposures: &[Exposure]) -> [Self; MAX_PICTURES] {
        let counts = |e: &Exposure| e.time_s * e.effective_s();
        let most = exposures.iter().map(counts).fold(f64::MIN_POSITIVE, f64::max);
        let mut all = [Self::default(); MAX_PICTURES];
        for (terms, (picture, exposure)) in all.iter_mut().zip(pictures.iter().zip(exposures)) {
            let scale = &picture.scale;
            let (black, saturated) = (scale.black, f32::from(scale.saturated));
            let bounded = |v: f64| v.max(*FACTORS.start()).min(*FACTORS.end()) as f32;
            *terms = Self {
                weight: (counts(exposure) / most).clamp(LEAST_WEIGHT, 1.0) as f32,
                black,
                saturated,
                fall: 1.0 / ((1.0 - TRUSTED) * (saturated - black)).max(1.0),
                factor: scale.exposure_per_value.map(|x| bounded(f64::from(x) / exposure.effective_s())),
                half_step: 0.5 * scale.step,
            };
        }
        all
    }
}

/// Merges 1 to [`MAX_PICTURES`] pictures of one view: E = sum w (z - black) f / sum w in each channel, f = exposure of a
/// value over time x gain, w = time x (time x gain), falling to 0 by a square over the last quarter before saturation: a
/// long exposure counts a hundred times a short one, and a straight fall would end in a step. `out` is reshaped.
///
/// Where all that was seen is saturated, E is what the shortest exposure's saturation says, and `LOWER_BOUND`. Less than half a
/// step of the sensor in the longest exposure has `UPPER_BOUND`; E stays the sum, so that the mean of many dark pixels is
/// right, but never below 0. What no picture saw is 0 with both. A pixel's flags are those of its channels together.
/// *Every output is finite and not negative, and does not depend on the number of threads.*
/// No allocation once `out` has its size.
/// Twin: `merge_sensor` in `shaders/hdr/merge_bracket.wgsl`.
pub fn merge_sensor(
    pictures: &[&SensorImage],
    exposures: &[Exposure],
    out: &mut HdrImage,
) -> Result<(), MergeError> {
    let (width, height) = check_sensor(pictures, exposures)?;
    let terms = SensorTerms::of(pictures, exposures);
    out.radiance.reshape(width, height, [0.0; 3]);
    out.flags.reshape(width, height, 0);
    let radiance = out.radiance.pixels_mut().par_chunks_mut(TASK);
    radiance.zip(out.flags.pixels_mut().par_chunks_mut(TASK)).enumerate().for_each(
        |(task, (radiance, flags))| {
            let blocks = radiance.chunks_mut(BLOCK).zip(flags.chunks_mut(BLOCK));
            for (block, (radiance, flags)) in blocks.enumerate() {
                let start = task * TASK + block * BLOCK;
                let mut sums = SensorSums::new();
                for (picture, terms) in pictures.iter().zip(&terms) {
                    sums.add(terms, &picture.values.pixels()[start..start + radiance.len()]);
                }
                sums.finish(radiance, flags);
            }
        },
    );
    Ok(())
}

/// Width and height, if the bracket fits together.
pub fn check_sensor(pictures: &[&SensorImage], exposures: &[Exposure]) -> Result<(usize, usize), MergeError> {
    check_sizes(pictures.iter().map(|picture| picture.size()), exposures)
}

/// Sums over the pictures, for up to [`BLOCK`] pixels.
struct SensorSums {
    radiance: [[f32; 3]; BLOCK],
    weight: [[f32; 3]; BLOCK],
    /// The most that saturated values say.
    at_least: [[f32; 3]; BLOCK],
    /// The least that is told from no light.
    least: [[f32; 3]; BLOCK],
}

impl SensorSums {
    fn new() -> Self {
        Self {
            radiance: [[0.0; 3]; BLOCK],
            weight: [[0.0; 3]; BLOCK],
            at_least: [[0.0; 3]; BLOCK],
            least: [[f32::MAX; 3]; BLOCK],
        }
    }

    fn add(&mut self, terms: &SensorTerms, values: &[[u16; 3]]) {
        for (i, values) in values.iter().enumerate() {
            for c in 0..3 {
                let z = f32::from(values[c]);
                let factor = terms.factor[c];
                let is_seen = values[c] != UNSEEN;
                let below = ((terms.saturated - z) * terms.fall).clamp(0.0, 1.0);
                let weight = if is_seen { terms.weight * below * below } else { 0.0 };
                let counts = weight > 0.0;
                self.radiance[i][c] += weight * ((z - terms.black) * factor);
                self.weight[i][c] += weight;
                let bound = (terms.saturated - terms.black) * factor;
                let at_least = if is_seen && !counts { bound } else { 0.0 };
                self.at_least[i][c] = self.at_least[i][c].max(at_least);
                let least = if counts { terms.half_step * factor } else { f32::MAX };
                self.least[i][c] = self.least[i][c].min(least);
            }
        }
    }

    fn finish(&self, radiance: &mut [[f32; 3]], flags: &mut [u8]) {
        for (i, (out, flags)) in radiance.iter_mut().zip(flags).enumerate() {
            *flags = 0;
            for (c, out) in out.iter_mut().enumerate() {
                let (weight, at_least, least) = (self.weight[i][c], self.at_least[i][c], self.least[i][c]);
                if weight > 0.0 {
                    let mean = self.radiance[i][c] / weight;
                    *flags |= if mean < least { UPPER_BOUND } else { 0 };
                    *out = mean.max(0.0);
                } else {
                    *flags |= if at_least > 0.0 { LOWER_BOUND } else { LOWER_BOUND | UPPER_BOUND };
                    *out = at_least;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
