//! Merges one bracket to linear radiance [DM97]: 8-bit values through a response, or what a sensor gave ([`merge_sensor`]).

mod sensor;

use crate::math::sh::Real;
use crate::model::{
    frame::Exposure,
    image::{HdrImage, LOWER_BOUND, Rgb8Image, UPPER_BOUND},
    response::Response,
};
use rayon::prelude::*;
pub use sensor::{SensorTerms, check_sensor, merge_sensor};

/// Most pictures that one merge takes. Live brackets have at most 9 (`Quality::brackets`).
pub const MAX_PICTURES: usize = 16;

/// Pixels that are worked on together: their sums stay in the first cache.
const BLOCK: usize = 128;
/// Pixels of one parallel task.
const TASK: usize = 64 * BLOCK;

/// Why a bracket cannot be merged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// Too few or too many pictures.
    #[error("merge of {0} pictures: 1 to {MAX_PICTURES} are allowed")]
    Pictures(usize),
    /// Pictures and exposures must pair up.
    #[error(
        "merge of {pictures} pictures with {exposures} exposures: one exposure for each picture is needed"
    )]
    Exposures {
        /// How many pictures.
        pictures: usize,
        /// How many exposures.
        exposures: usize,
    },
    /// An exposure that no camera can have.
    #[error("exposure of picture {picture} = {effective_s} s (time x gain): must be finite and above 0")]
    Exposure {
        /// Index of the picture.
        picture: usize,
        /// Its time times gain.
        effective_s: f64,
    },
    /// All pictures of a bracket show the same view.
    #[error(
        "picture {picture} has {} x {} pixels, picture 0 has {} x {}: they must be equal and not empty",
        size.0, size.1, first.0, first.1
    )]
    Size {
        /// Index of the picture.
        picture: usize,
        /// Its width and height.
        size: (usize, usize),
        /// Width and height of picture 0.
        first: (usize, usize),
    },
}

/// The hat weight: z up to 127, 255 - z above; 0 at both ends.
pub const fn weight(z: u8) -> u8 {
    if z <= 127 { z } else { 255 - z }
}

/// Merges 1 to [`MAX_PICTURES`] pictures of one view: ln E = sum w(z) (g(z) - ln t) / sum w(z) in each channel
/// (Eq. 6 of [DM97]) with w = [`weight`] and t = time x gain in seconds. `out` is reshaped; it gets E = exp(ln E).
///
/// Where every weight is 0: all 255 gives g(255) - ln t_min and `LOWER_BOUND`; all 0 gives g(0) - ln t_max and
/// `UPPER_BOUND`; where some pictures have 255 and the others 0, the middle of the tightest of these bounds, in
/// the logarithm, and both flags. A pixel's flags are those of its channels together.
/// *Every output is finite and not negative, and does not depend on the number of threads.*
/// No allocation once `out` has its size.
/// Twin: `shaders/hdr/merge_bracket.wgsl`.
pub fn merge_bracket(
    pictures: &[&Rgb8Image],
    exposures: &[Exposure],
    response: &Response,
    out: &mut HdrImage,
) -> Result<(), MergeError> {
    let (width, height) = check(pictures, exposures)?;
    let tables = ResponseTables::new(exposures, response.log_exposure());
    out.radiance.reshape(width, height, [0.0; 3]);
    out.flags.reshape(width, height, 0);
    let count = pictures.len();
    out.radiance
        .pixels_mut()
        .par_chunks_mut(TASK)
        .zip(out.flags.pixels_mut().par_chunks_mut(TASK))
        .enumerate()
        .for_each(|(task, (radiance, flags))| {
            for (block, (radiance, flags)) in
                radiance.chunks_mut(BLOCK).zip(flags.chunks_mut(BLOCK)).enumerate()
            {
                let start = task * TASK + block * BLOCK;
                let mut sources: [&[[u8; 3]]; MAX_PICTURES] = [&[]; MAX_PICTURES];
                for (source, picture) in sources.iter_mut().zip(pictures) {
                    *source = &picture.pixels()[start..start + radiance.len()];
                }
                tables.merge_block(&sources[..count], radiance, flags);
            }
        });
    Ok(())
}

/// The number type that a merge is made in: f32 in every frame, f64 where its rounding is to be told apart.
pub trait MergeReal: Real + From<i16> {
    /// e^x, finite and above 0 for every x.
    fn exp_bounded(self) -> Self;
}

impl MergeReal for f32 {
    #[inline(always)]
    fn exp_bounded(self) -> Self {
        exp(self)
    }
}

impl MergeReal for f64 {
    fn exp_bounded(self) -> Self {
        // Beyond these ends lie infinity and the numbers of fewer digits.
        self.clamp(-708.0, 709.0).exp()
    }
}

/// [`merge_bracket`]'s kernel in either number type, on up to 128 pixels: `pictures` hold the same pixels of each
/// picture, `log_exposure` is g for each channel, `radiance` and `flags` are as long as each picture. What is longer
/// stays as it is; `None` for more than [`MAX_PICTURES`] pictures, none, or lengths that differ.
/// *In f32 it gives the bits that [`merge_bracket`] gives.*
pub fn merge_pixels<T: MergeReal>(
    pictures: &[&[[u8; 3]]],
    exposures: &[Exposure],
    log_exposure: &[[T; 256]; 3],
    radiance: &mut [[T; 3]],
    flags: &mut [u8],
) -> Option<()> {
    let count = radiance.len();
    let fits = (1..=MAX_PICTURES).contains(&pictures.len())
        && pictures.len() == exposures.len()
        && pictures.iter().all(|picture| picture.len() == count)
        && flags.len() == count
        && count <= BLOCK;
    fits.then(|| ResponseTables::new(exposures, log_exposure).merge_block(pictures, radiance, flags))
}

/// Width and height, if the bracket fits together.
pub fn check(pictures: &[&Rgb8Image], exposures: &[Exposure]) -> Result<(usize, usize), MergeError> {
    check_sizes(pictures.iter().map(|picture| (picture.width(), picture.height())), exposures)
}

/// The same for pictures of any kind that have these sizes.
fn check_sizes(
    sizes: impl ExactSizeIterator<Item = (usize, usize)>,
    exposures: &[Exposure],
) -> Result<(usize, usize), MergeError> {
    let pictures = sizes.len();
    if pictures == 0 || pictures > MAX_PICTURES {
        return Err(MergeError::Pictures(pictures));
    }
    if pictures != exposures.len() {
        return Err(MergeError::Exposures { pictures, exposures: exposures.len() });
    }
    for (picture, exposure) in exposures.iter().enumerate() {
        let effective_s = exposure.effective_s();
        if !(effective_s.is_finite() && effective_s > 0.0) {
            return Err(MergeError::Exposure { picture, effective_s });
        }
    }
    let mut first = (0, 0);
    for (picture, size) in sizes.enumerate() {
        if picture == 0 {
            first = size;
        }
        if size != first || size.0 == 0 || size.1 == 0 {
            return Err(MergeError::Size { picture, size, first });
        }
    }
    Ok(first)
}

/// What a merge looks up instead of computing it for each pixel.
struct ResponseTables<T> {
    /// For each picture, channel and value: w(z) (g(z) - ln t).
    weighted: [[[T; 256]; 3]; MAX_PICTURES],
    /// For each picture and channel: g(255) - ln t.
    at_least: [[T; 3]; MAX_PICTURES],
    /// For each picture and channel: g(0) - ln t.
    at_most: [[T; 3]; MAX_PICTURES],
}

impl<T: MergeReal> ResponseTables<T> {
    fn new(exposures: &[Exposure], log_exposure: &[[T; 256]; 3]) -> Self {
        let mut tables = Self {
            weighted: [[[T::zero(); 256]; 3]; MAX_PICTURES],
            at_least: [[T::zero(); 3]; MAX_PICTURES],
            at_most: [[T::zero(); 3]; MAX_PICTURES],
        };
        for (k, exposure) in exposures.iter().enumerate().take(MAX_PICTURES) {
            let log_t = exposure.effective_s().ln();
            for (c, g) in log_exposure.iter().enumerate() {
                // No radiance beyond e^1000 can come out; the bound keeps the sums finite for any response.
                let log_radiance =
                    |z: u8| (g[usize::from(z)].to_f64().unwrap_or(0.0) - log_t).clamp(-1e3, 1e3);
                for z in 0..=255u8 {
                    tables.weighted[k][c][usize::from(z)] = T::of(f64::from(weight(z)) * log_radiance(z));
                }
                tables.at_least[k][c] = T::of(log_radiance(255));
                tables.at_most[k][c] = T::of(log_radiance(0));
            }
        }
        tables
    }

    /// Merges up to [`BLOCK`] pixels; all slices have the same length.
    fn merge_block(&self, sources: &[&[[u8; 3]]], radiance: &mut [[T; 3]], flags: &mut [u8]) {
        let mut weights = [[0i16; 3]; BLOCK];
        let weights = &mut weights[..radiance.len()];
        // Sums of w (g - ln t): table look-ups, three pictures in one sweep.
        let mut done = 0;
        while done < sources.len() {
            match sources.len() - done {
                1 => self.add_weighted::<1>(done, sources, radiance),
                2 => self.add_weighted::<2>(done, sources, radiance),
                _ => self.add_weighted::<3>(done, sources, radiance),
            }
            done += (sources.len() - done).min(3);
        }
        // Sums of w: z and 255 - z cross between 127 and 128, so the hat is the smaller of the two.
        for source in sources {
            for (sum, &z) in weights.as_flattened_mut().iter_mut().zip(source.as_flattened()) {
                *sum += i16::from(z.min(255 - z));
            }
        }
        for (e, &sum) in radiance.as_flattened_mut().iter_mut().zip(weights.as_flattened()) {
            *e = (*e / <T as From<i16>>::from(sum.max(1))).exp_bounded();
        }
        flags.fill(0);
        if weights.as_flattened().iter().fold(i16::MAX, |low, &sum| low.min(sum)) == 0 {
            self.resolve_unweighted(sources, weights, radiance, flags);
        }
    }

    /// Adds w (g - ln t) of the next N pictures, in the order of the pictures; the first sweep starts from 0.
    fn add_weighted<const N: usize>(&self, done: usize, sources: &[&[[u8; 3]]], sums: &mut [[T; 3]]) {
        let tables: [&[[T; 256]; 3]; N] = std::array::from_fn(|k| &self.weighted[done + k]);
        let sources: [&[[u8; 3]]; N] = std::array::from_fn(|k| &sources[done + k][..sums.len()]);
        for (i, sum) in sums.iter_mut().enumerate() {
            let mut total = if done == 0 { [T::zero(); 3] } else { *sum };
            for (table, source) in tables.iter().zip(&sources) {
                for ((total, table), &z) in total.iter_mut().zip(*table).zip(&source[i]) {
                    *total += table[usize::from(z)];
                }
            }
            *sum = total;
        }
    }

    /// Fills the channels in which every picture is 0 or 255, and flags their pixels.
    fn resolve_unweighted(
        &self,
        sources: &[&[[u8; 3]]],
        weights: &[[i16; 3]],
        radiance: &mut [[T; 3]],
        flags: &mut [u8],
    ) {
        for (i, (weights, (radiance, flags))) in
            weights.iter().zip(radiance.iter_mut().zip(flags.iter_mut())).enumerate()
        {
            for c in (0..3).filter(|&c| weights[c] == 0) {
                let (mut at_least, mut at_most) = (T::neg_infinity(), T::infinity());
                for (k, source) in sources.iter().enumerate() {
                    if source[i][c] == 255 {
                        at_least = at_least.max(self.at_least[k][c]);
                    } else {
                        at_most = at_most.min(self.at_most[k][c]);
                    }
                }
                let (log_radiance, flag) = match (at_least.is_finite(), at_most.is_finite()) {
                    (true, false) => (at_least, LOWER_BOUND),
                    (false, _) => (at_most, UPPER_BOUND),
                    (true, true) => (T::of(0.5) * (at_least + at_most), LOWER_BOUND | UPPER_BOUND),
                };
                radiance[c] = log_radiance.exp_bounded();
                *flags |= flag;
            }
        }
    }
}

/// e^x within 2e-7 of its value for x in -87..=88; x outside is taken as the nearer end, so the result is
/// finite and above 0. Only plain IEEE operations without a branch: the compiler can make vectors of it, and
/// every build gives the same bits.
fn exp(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    // ln 2 in two parts; the first has 9 bits, so that n times it is exact.
    const LN2_HIGH: f32 = 355.0 / 512.0;
    const LN2_LOW: f32 = (std::f64::consts::LN_2 - 355.0 / 512.0) as f32;
    // 1.5 x 2^23: adding it leaves the nearest whole number in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let shifted = x * LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * LN2_HIGH - n * LN2_LOW;
    // (e^r - 1 - r) / r^2 through its values at the Chebyshev nodes of |r| <= ln 2 / 2: e^r within 1.1e-8.
    let q = 0.5 + r * (0.166_665_77 + r * (0.041_666_556 + r * (0.008_363_173 + r * 0.001_392_617_6)));
    let power_of_two = f32::from_bits(shifted.to_bits().wrapping_add(127) << 23);
    (1.0 + (r + r * r * q)) * power_of_two
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixels: &[[u8; 3]]) -> Rgb8Image {
        Rgb8Image::from_pixels(pixels.len(), 1, pixels.to_vec()).unwrap()
    }

    fn seconds(times_s: &[f64]) -> Vec<Exposure> {
        times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect()
    }

    fn merge(rows: &[&[[u8; 3]]], times_s: &[f64], response: &Response) -> HdrImage {
        let pictures: Vec<_> = rows.iter().map(|row| picture(row)).collect();
        let pictures: Vec<_> = pictures.iter().collect();
        let mut out = HdrImage::default();
        merge_bracket(&pictures, &seconds(times_s), response, &mut out).unwrap();
        out
    }

    #[test]
    fn exp_is_within_its_stated_error() {
        let mut worst = 0.0f64;
        for i in 0..=1_750_000 {
            let x = (-87.0 + f64::from(i) * 1e-4) as f32;
            worst = worst.max((f64::from(exp(x)) / f64::from(x).exp() - 1.0).abs());
        }
        // Measured 1.4e-7: little more than one unit in the last place.
        assert!(worst < 2e-7, "{worst}");
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(exp(-500.0), exp(-87.0));
        assert_eq!(exp(500.0), exp(88.0));
        assert!(exp(88.0).is_finite() && exp(-87.0) > 0.0);
    }

    #[test]
    fn the_hat_is_the_smaller_of_z_and_255_minus_z() {
        for z in 0..=255u8 {
            assert_eq!(weight(z), z.min(255 - z), "{z}");
        }
    }

    #[test]
    fn values_and_weights_follow_the_equation() {
        let response = Response::srgb();
        let out = merge(&[&[[10, 100, 254]], &[[40, 200, 255]]], &[0.01, 0.04], &response);
        for (c, (z0, z1)) in [(10usize, 40usize), (100, 200), (254, 255)].into_iter().enumerate() {
            let g = |z: usize| f64::from(response.log_exposure()[c][z]);
            let w = |z: usize| f64::from(weight(z as u8));
            let top = w(z0) * (g(z0) - 0.01f64.ln()) + w(z1) * (g(z1) - 0.04f64.ln());
            let expected = (top / (w(z0) + w(z1))).exp();
            let got = f64::from(out.radiance.at(0, 0)[c]);
            // Rounding of ln E (about 5) to f32 and of exp.
            assert!((got / expected - 1.0).abs() < 2e-6, "channel {c}: {got} against {expected}");
        }
        assert_eq!(out.flags.pixels(), [0]);
    }

    #[test]
    fn pixels_without_weight_are_bounds() {
        let response = Response::srgb();
        let (g0, g255) = (response.log_exposure()[0][0], response.log_exposure()[0][255]);
        let out = merge(
            &[&[[255; 3], [0; 3], [0; 3], [255; 3]], &[[255; 3], [0; 3], [255; 3], [0; 3]]],
            &[0.01, 0.04],
            &response,
        );
        let (short, long) = (0.01f32.ln(), 0.04f32.ln());
        let expected = [
            g255 - short,
            g0 - long,
            0.5 * ((g0 - short) + (g255 - long)),
            0.5 * ((g255 - short) + (g0 - long)),
        ];
        for (got, expected) in out.radiance.pixels().iter().zip(expected) {
            assert!((got[0].ln() - expected).abs() < 2e-6, "{got:?}, ln {expected}");
        }
        let both = LOWER_BOUND | UPPER_BOUND;
        assert_eq!(out.flags.pixels(), [LOWER_BOUND, UPPER_BOUND, both, both]);
    }

    #[test]
    fn a_pixel_has_the_flags_of_all_its_channels() {
        let out = merge(&[&[[255, 0, 90]]], &[0.01], &Response::srgb());
        assert_eq!(out.flags.pixels(), [LOWER_BOUND | UPPER_BOUND]);
    }

    #[test]
    fn many_pictures_and_blocks_agree_with_one_pixel_at_a_time() {
        let width = 3 * BLOCK + 17;
        let rows: Vec<Vec<[u8; 3]>> = (0..MAX_PICTURES)
            .map(|k| (0..width).map(|i| [7, 13, 29].map(|a| (i * a + k * 31 + i * i) as u8)).collect())
            .collect();
        let times: Vec<f64> = (0..MAX_PICTURES).map(|k| 1e-3 * 1.7f64.powi(k as i32)).collect();
        for count in 1..=MAX_PICTURES {
            let rows: Vec<&[[u8; 3]]> = rows[..count].iter().map(Vec::as_slice).collect();
            let whole = merge(&rows, &times[..count], &Response::srgb());
            for i in [0, 1, BLOCK - 1, BLOCK, width - 1] {
                let one: Vec<&[[u8; 3]]> = rows.iter().map(|row| &row[i..=i]).collect();
                let one = merge(&one, &times[..count], &Response::srgb());
                assert_eq!(whole.radiance.at(i, 0), one.radiance.at(0, 0), "{count} pictures, pixel {i}");
                assert_eq!(whole.flags.at(i, 0), one.flags.at(0, 0));
            }
        }
    }

    #[test]
    fn extreme_exposures_and_responses_stay_finite() {
        let steep: [f32; 256] = std::array::from_fn(|z| (z as f32 - 128.0) * 1e36);
        let response = Response::new([steep; 3]).unwrap();
        let row: Vec<[u8; 3]> = (0..=255u8).map(|z| [z, 255 - z, z / 2]).collect();
        for times in [[1e-300, 1e300], [1e-9, 1e9], [1.0, 1.0]] {
            let out = merge(&[&row, &row], &times, &response);
            assert!(out.radiance.pixels().as_flattened().iter().all(|e| e.is_finite() && *e >= 0.0));
        }
    }

    #[test]
    fn what_does_not_fit_together_is_refused() {
        let (a, b) = (picture(&[[1; 3]; 4]), picture(&[[1; 3]; 5]));
        let response = Response::srgb();
        let mut out = HdrImage::default();
        let mut run = |p: &[&Rgb8Image], t: &[f64]| merge_bracket(p, &seconds(t), &response, &mut out);
        assert_eq!(run(&[], &[]), Err(MergeError::Pictures(0)));
        assert_eq!(run(&[&a; 17], &[1.0; 17]), Err(MergeError::Pictures(17)));
        assert_eq!(run(&[&a], &[1.0; 2]), Err(MergeError::Exposures { pictures: 1, exposures: 2 }));
        assert!(matches!(run(&[&a, &b], &[1.0; 2]), Err(MergeError::Size { picture: 1, .. })));
        assert!(matches!(run(&[&Rgb8Image::default()], &[1.0]), Err(MergeError::Size { .. })));
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = run(&[&a, &a], &[1.0, wrong]).unwrap_err();
            assert!(matches!(error, MergeError::Exposure { picture: 1, .. }), "{error}");
        }
    }
}
