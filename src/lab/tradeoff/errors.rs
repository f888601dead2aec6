//! How far a picture is from the truth.

use crate::compose::tonemap::ToneTable;
use crate::math::color::gray;
use crate::model::image::{HdrImage, Image, RadianceImage, Rgb8Image};
use crate::model::response::Response;

/// Pixels a degree of the viewer's eye: a monitor at arm's length, as the authors of FLIP have it.
const PIXELS_PER_DEGREE: f32 = nv_flip::DEFAULT_PIXELS_PER_DEGREE;

/// A pixel of the place counts as in shadow where objects leave less than this of its light, in truth.
pub const SHADOW_BELOW: f64 = 0.98;

/// What a picture is held against.
#[derive(Clone, Debug)]
pub struct PictureTruth {
    /// Linear radiance.
    pub radiance: RadianceImage,
    /// The place without objects, as the truth has it.
    pub without: RadianceImage,
    /// Share of each pixel that real surfaces fill: 1 where no virtual object is.
    pub place: Vec<f32>,
    /// Standard error of the truth itself, in the measure of `PictureErrors::shadow`; `None` where it is not known. It is taken out
    /// of that error: it is independent of it.
    pub noise: Option<f64>,
    /// What that noise can make of the difference of two errors at most (two standard errors); 0 where it is not known.
    pub difference_noise: f64,
    /// Where it comes from, for people.
    pub made_by: String,
}

/// Errors of one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureErrors {
    /// Root mean squared error of the share of light that objects leave on real surfaces, over the mean share that they take
    /// in shadow. Errors outside of the true shadow count as well. Less the truth's own noise, down to a tenth of it.
    pub shadow: f64,
    /// Mean of FLIP over the picture, 0 to 1.
    pub flip_mean: f64,
    /// Its 95th percentile.
    pub flip_p95: f64,
    /// Light that objects take from real surfaces over what they take in truth, less 1.
    pub energy: f64,
}

/// Errors of a picture with the FLIP of each pixel as a picture.
pub fn errors(
    radiance: &RadianceImage,
    background: &HdrImage,
    truth: &PictureTruth,
    shown: (&Rgb8Image, &Rgb8Image),
) -> (PictureErrors, Rgb8Image) {
    let (mut squares, mut in_shadow, mut depth, mut taken, mut true_taken) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let without = background.radiance.pixels();
    for (i, (ours, real)) in radiance.pixels().iter().zip(truth.radiance.pixels()).enumerate() {
        let place = gray(without[i].map(f64::from));
        let true_place = gray(truth.without.pixels()[i].map(f64::from));
        if truth.place[i] < 1.0 {
            continue;
        }
        let (a, b) = (gray(ours.map(f64::from)) / place, gray(real.map(f64::from)) / true_place);
        if !(a.is_finite() && b.is_finite()) {
            continue;
        }
        squares += (a - b) * (a - b);
        taken += (1.0 - a) * true_place;
        true_taken += (1.0 - b) * true_place;
        if b < SHADOW_BELOW {
            in_shadow += 1.0;
            depth += 1.0 - b;
        }
    }
    let (map, flip_mean, flip_p95) = flip(shown.0, shown.1);
    let shadow = if in_shadow > 0.0 { f64::sqrt(squares / in_shadow) / (depth / in_shadow) } else { 0.0 };
    let noise = truth.noise.filter(|n| n.is_finite()).unwrap_or(0.0);
    let shadow = (shadow * shadow - noise * noise).max(0.01 * noise * noise).sqrt();
    let energy = if true_taken > 0.0 { taken / true_taken - 1.0 } else { 0.0 };
    (PictureErrors { shadow, flip_mean, flip_p95, energy }, map)
}

/// FLIP of two pictures of one size: its map in colours (black: none), mean, 95th percentile.
fn flip(picture: &Rgb8Image, truth: &Rgb8Image) -> (Rgb8Image, f64, f64) {
    let (width, height) = (picture.width(), picture.height());
    if (width, height) != (truth.width(), truth.height()) || width * height == 0 {
        return (Image::filled(width, height, [0; 3]), f64::NAN, f64::NAN);
    }
    let of = |p: &Rgb8Image| {
        nv_flip::FlipImageRgb8::with_data(width as u32, height as u32, bytemuck::cast_slice(p.pixels()))
    };
    let map = nv_flip::flip(of(truth), of(picture), PIXELS_PER_DEGREE);
    let mut values = map.to_vec();
    let colours = map.apply_color_lut(&nv_flip::magma_lut()).to_vec();
    let pixels = colours.as_chunks::<3>().0.to_vec();
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
    values.sort_by(f32::total_cmp);
    let p95 = f64::from(values[(values.len() * 19 / 20).min(values.len() - 1)]);
    (Image::from_pixels(width, height, pixels).unwrap_or_default(), mean, p95)
}

/// Linear radiance as it is shown.
pub fn shown(radiance: &RadianceImage, response: &Response, exposure_s: f64) -> Rgb8Image {
    let table = ToneTable::of(response);
    let pixels = radiance
        .pixels()
        .iter()
        .map(|p| std::array::from_fn(|c| table.value(c, p[c] * exposure_s as f32)))
        .collect();
    Image::from_pixels(radiance.width(), radiance.height(), pixels).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixels: [f32; 4]) -> RadianceImage {
        Image::from_pixels(4, 1, pixels.map(|p| [p; 3]).to_vec()).unwrap()
    }

    #[test]
    fn a_shadow_half_as_deep_errs_by_half() {
        let background = HdrImage { radiance: picture([2.0; 4]), ..HdrImage::default() };
        let truth = PictureTruth {
            radiance: picture([2.0, 1.0, 1.0, 9.0]),
            without: picture([2.0; 4]),
            place: vec![1.0, 1.0, 1.0, 0.0],
            noise: None,
            difference_noise: 0.0,
            made_by: String::new(),
        };
        let show = |p: &RadianceImage| shown(p, &Response::srgb(), 0.4);
        let of = |p: RadianceImage| errors(&p, &background, &truth, (&show(&p), &show(&truth.radiance))).0;
        let half = of(picture([2.0, 1.5, 1.5, 9.0]));
        assert!((half.shadow - 0.5).abs() < 1e-6 && (half.energy + 0.5).abs() < 1e-6, "{half:?}");
        assert!(half.flip_mean > 0.0 && half.flip_p95 >= half.flip_mean, "{half:?}");
        let same = of(picture([2.0, 1.0, 1.0, 9.0]));
        assert_eq!(same, PictureErrors { shadow: 0.0, flip_mean: 0.0, flip_p95: 0.0, energy: 0.0 });
        // Noise of the truth is not ours.
        let noisy = PictureTruth { noise: Some(0.3), ..truth.clone() };
        let p = picture([2.0, 1.5, 1.5, 9.0]);
        let less = errors(&p, &background, &noisy, (&show(&p), &show(&truth.radiance))).0.shadow;
        assert!((less - 0.4).abs() < 1e-6, "{less}");
        // A shadow where there is none counts; what objects fill does not.
        let beside = of(picture([1.0, 1.0, 1.0, 0.0]));
        assert!((beside.shadow - (0.125f64).sqrt() / 0.5).abs() < 1e-6 && beside.energy > 0.4, "{beside:?}");
    }
}
