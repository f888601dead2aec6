//! The values at the dark end that tell nothing: the fog of film, stray light in the lens.

use super::merge_bracket::MAX_PICTURES;
use crate::model::{frame::Exposure, image::Rgb8Image};

/// Shares of a picture: its darkest part, and the part of the stuck pixels that the level covers.
const DARKEST: f64 = 0.005;
const COVERED: f64 = 0.98;
/// Exposures must differ at least by this before equal values can be called stuck.
const LEAST_RATIO: f64 = 4.0;
/// Values within which a dark end counts as the same: noise, compression.
const SAME: u8 = 3;
/// Levels up to here are what any camera has.
const USUAL: u8 = 4;

/// For each channel the highest value that means "black" in every picture, 0 where the dark end is in order.
///
/// A dark end is stuck when the darkest half percent of the shortest exposure has the same values, within 3, in a
/// picture of at least four times its exposure. The level is a quarter above what covers 98 % of the values that
/// those pixels have in the shortest exposure; where that is 4 or less, it is 0. To be used where exposures and pixels agree
/// (`attribute::check_exposures`): equal pictures look stuck, too.
pub fn black_level(pictures: &[&Rgb8Image], exposures: &[Exposure]) -> [u8; 3] {
    let count = pictures.len().min(exposures.len()).min(MAX_PICTURES);
    let seconds = |k: &usize| exposures[*k].effective_s();
    let Some(shortest) = (0..count).min_by(|a, b| seconds(a).total_cmp(&seconds(b))) else { return [0; 3] };
    let size = |k: usize| (pictures[k].width(), pictures[k].height());
    std::array::from_fn(|channel| {
        // Zeros are black already: they have no weight.
        let dark_end_of =
            |k: usize| quantile(pictures[k].pixels().iter().map(|p| p[channel]).filter(|z| *z > 0), DARKEST);
        let dark_end = dark_end_of(shortest);
        // The longest exposure that still has it.
        let stuck = (0..count)
            .filter(|k| size(*k) == size(shortest) && seconds(k) >= LEAST_RATIO * seconds(&shortest))
            .map(|k| (k, dark_end_of(k)))
            .filter(|(_, end)| *end <= dark_end.saturating_add(SAME))
            .max_by(|a, b| seconds(&a.0).total_cmp(&seconds(&b.0)));
        let Some((longest, end)) = stuck else { return 0 };
        let values = pictures[shortest]
            .pixels()
            .iter()
            .zip(pictures[longest].pixels())
            .filter(|(short, long)| short[channel] > 0 && long[channel] <= end.saturating_add(SAME))
            .map(|(short, _)| short[channel]);
        let level = quantile(values, COVERED);
        // A quarter more: there the fog is still most of what is seen.
        if level > USUAL { level.saturating_add(level / 4) } else { 0 }
    })
}

/// The picture with everything up to the level set to 0, which has no weight in a merge.
pub fn clip_black(picture: &Rgb8Image, level: [u8; 3]) -> Rgb8Image {
    let mut clipped = picture.clone();
    for pixel in clipped.pixels_mut() {
        for (z, level) in pixel.iter_mut().zip(level) {
            if *z <= level {
                *z = 0;
            }
        }
    }
    clipped
}

/// The value that a share of all values does not exceed; 0 of none.
fn quantile(values: impl Iterator<Item = u8>, share: f64) -> u8 {
    let mut histogram = [0usize; 256];
    values.for_each(|z| histogram[usize::from(z)] += 1);
    let total: usize = histogram.iter().sum();
    let wanted = (total as f64 * share).ceil().max(1.0) as usize;
    let mut below = 0;
    let position = histogram.iter().position(|count| {
        below += count;
        below >= wanted
    });
    position.map_or(0, |z| z as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Radiance over e^9, seen through a root, never darker than `fog`.
    fn pictures(times_s: &[f64], fog: f64) -> (Vec<Rgb8Image>, Vec<Exposure>) {
        let see = |t: &f64| {
            let pixels = (0..100 * 100).map(|i| {
                let radiance = (9.0 * (i as f64 / 10_000.0 - 0.7)).exp();
                let grain = f64::from(i * 7 % 5) - 2.0;
                let z = 255.0 * (radiance * t).sqrt().min(1.0);
                [(z.max(fog) + grain).clamp(0.0, 255.0) as u8, z as u8, z.max(100.0) as u8]
            });
            Rgb8Image::from_pixels(100, 100, pixels.collect()).unwrap()
        };
        let exposures = times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect();
        (times_s.iter().map(see).collect(), exposures)
    }

    #[test]
    fn fog_is_found_in_the_channels_that_have_it() {
        let (pictures, exposures) = pictures(&[0.01, 0.1, 1.0], 17.0);
        let pictures: Vec<_> = pictures.iter().collect();
        // The grain is the same in all three, so its brightest pixels are not among the darkest of the longest: 18
        // and a quarter of it.
        assert_eq!(black_level(&pictures, &exposures), [22, 0, 125]);
        let clipped = clip_black(pictures[0], [19, 0, 100]);
        assert_eq!(*clipped.at(0, 0), [0, pictures[0].at(0, 0)[1], 0]);
        assert_eq!(*clipped.at(99, 99), [pictures[0].at(99, 99)[0], pictures[0].at(99, 99)[1], 0]);
    }

    #[test]
    fn bright_pictures_and_near_exposures_have_none() {
        let (bright, exposures) = pictures(&[30.0, 300.0], 0.0);
        assert_eq!(black_level(&bright.iter().collect::<Vec<_>>(), &exposures)[1], 0);
        let (near, exposures) = pictures(&[0.1, 0.2], 17.0);
        assert_eq!(black_level(&near.iter().collect::<Vec<_>>(), &exposures), [0; 3]);
        assert_eq!(black_level(&[], &[]), [0; 3]);
    }
}
