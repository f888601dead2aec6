//! The rule by which radiance enters: nothing that is not finite or negative gets past.

use crate::model::image::{HdrImage, Image, NOT_FINITE, RadianceImage};

/// What an infinite channel is replaced by (spec 10): safely inside half floats.
pub const LARGEST_RADIANCE: f32 = 64_000.0;
/// Finite radiance above this is taken as damage: its square would leave f32 in later sums.
const ABSURD_RADIANCE: f32 = 1e15;

/// How many texels had to be changed. A texel with several bad channels counts once, under the worst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replaced {
    /// Had a channel that was NaN (became 0), infinite or absurd (became `LARGEST_RADIANCE`, or 0 if negative).
    pub not_finite_texels: u32,
    /// Had a negative channel (became 0).
    pub negative_texels: u32,
}

/// Radiance as loaded, and what was wrong with it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadedRadiance {
    /// Finite and not negative; replaced texels carry `NOT_FINITE`.
    pub hdr: HdrImage,
    /// Counts of what was replaced.
    pub replaced: Replaced,
}

/// Replaces what is not radiance: NaN and negative values become 0, infinite ones `LARGEST_RADIANCE`. Finite
/// values stay as they are, however bright. Each changed texel is flagged `NOT_FINITE` and counted.
pub fn ingest(mut radiance: RadianceImage) -> LoadedRadiance {
    let mut flags = Image::filled(radiance.width(), radiance.height(), 0u8);
    let mut replaced = Replaced::default();
    for (texel, flag) in radiance.pixels_mut().iter_mut().zip(flags.pixels_mut()) {
        let (mut not_finite, mut negative) = (false, false);
        for channel in texel.iter_mut() {
            let sound = (0.0..=ABSURD_RADIANCE).contains(channel);
            if sound {
                continue;
            }
            not_finite |= !channel.is_finite() || channel.abs() > ABSURD_RADIANCE;
            negative |= *channel < 0.0;
            *channel = if *channel > 0.0 { LARGEST_RADIANCE } else { 0.0 };
        }
        if not_finite || negative {
            *flag = NOT_FINITE;
            replaced.not_finite_texels += u32::from(not_finite);
            replaced.negative_texels += u32::from(negative && !not_finite);
        }
    }
    LoadedRadiance { hdr: HdrImage { radiance, flags }, replaced }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_texels_are_replaced_flagged_and_counted() {
        let texels = vec![
            [1.0, 2.0, 3.0],
            [f32::NAN, -1.0, 2.0],
            [f32::INFINITY, 0.0, 0.0],
            [-0.5, 0.5, 0.5],
            [f32::NEG_INFINITY, 1e30, 1.0],
            [1e6, 0.0, -0.0],
        ];
        let loaded = ingest(Image::from_pixels(3, 2, texels).unwrap());
        let expected = [
            [1.0, 2.0, 3.0],
            [0.0, 0.0, 2.0],
            [64_000.0, 0.0, 0.0],
            [0.0, 0.5, 0.5],
            [0.0, 64_000.0, 1.0],
            [1e6, 0.0, 0.0],
        ];
        assert_eq!(loaded.hdr.radiance.pixels(), expected);
        assert_eq!(loaded.hdr.flags.pixels(), [0, 4, 4, 4, 4, 0]);
        assert_eq!(loaded.replaced, Replaced { not_finite_texels: 3, negative_texels: 1 });
    }
}
