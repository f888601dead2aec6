//! What moved between the pictures of a bracket (a person, a leaf): there the reference's own value is kept.

use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};

/// Values that are well exposed.
const WELL_EXPOSED: std::ops::RangeInclusive<u8> = 16..=240;
/// Disagreement beyond noise, in ln light.
const LEAST_LOG: f64 = 0.5;
/// The same in 8-bit values: eight standard deviations of strong noise.
const LEAST_VALUES: f32 = 24.0;
/// Of a pixel and its eight neighbours, as many must disagree.
const LEAST_TOGETHER: u32 = 8;
/// Exposures farther apart than this share too little to be compared.
const LARGEST_RATIO: f64 = 32.0;
/// Shares of a picture that ghosts may have. Above, the picture or the response is wrong, not something in it.
const SHARES: std::ops::RangeInclusive<f64> = 1e-3..=0.3;
/// Values of the reference that are taken together, on either side, for what a picture shows where it shows them.
const VALUES_AROUND: usize = 4;
/// Fewest pixels that tell it.
const FEWEST_PIXELS: u32 = 100;

/// A picture of a bracket with what moved in it replaced by what the reference saw there.
#[derive(Clone, Debug, PartialEq)]
pub struct Mended {
    /// Which of the bracket.
    pub index: usize,
    /// The reference's values, as this picture's exposure would have shown them, where something had moved.
    pub picture: Rgb8Image,
    /// Share of its pixels that were replaced.
    pub share: f64,
}

/// Looks for what moved against the picture with most well-exposed pixels, which is given first, then each that had to be
/// mended. Pictures of one view and size, 1:1 with `exposures`; others are left as they are.
pub fn mend(pictures: &[&Rgb8Image], exposures: &[Exposure], response: &Response) -> (usize, Vec<Mended>) {
    let well = |p: &Rgb8Image| {
        p.pixels().iter().filter(|pixel| pixel.iter().all(|z| WELL_EXPOSED.contains(z))).count()
    };
    let mut reference = 0;
    for (k, picture) in pictures.iter().enumerate() {
        if well(picture) > well(pictures[reference]) {
            reference = k;
        }
    }
    let same = |k: usize| {
        (pictures[k].width(), pictures[k].height())
            == (pictures[reference].width(), pictures[reference].height())
    };
    let others = (0..pictures.len().min(exposures.len())).filter(|&k| k != reference && same(k));
    let mended = others.filter_map(|index| {
        let ratio = exposures[index].effective_s() / exposures[reference].effective_s();
        if !(1.0 / LARGEST_RATIO..=LARGEST_RATIO).contains(&ratio) {
            return None;
        }
        mend_one(pictures[index], pictures[reference], ratio, response).map(|(picture, share)| Mended {
            index,
            picture,
            share,
        })
    });
    (reference, mended.collect())
}

fn mend_one(
    picture: &Rgb8Image,
    reference: &Rgb8Image,
    ratio: f64,
    response: &Response,
) -> Option<(Rgb8Image, f64)> {
    let expected = expected_values(ratio, response);
    let usual = usual_values(picture, reference, &expected);
    let (width, height) = (picture.width(), picture.height());
    let mut differs = vec![false; width * height];
    for y in 0..height {
        for x in 0..width {
            differs[y * width + x] = disagrees(picture, reference, (x, y), &usual);
        }
    }
    let around = |x: usize, y: usize| {
        let (rows, columns) =
            (y.saturating_sub(1)..(y + 2).min(height), x.saturating_sub(1)..(x + 2).min(width));
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    };
    let together: Vec<bool> = (0..width * height)
        .map(|i| around(i % width, i / width).map(|j| u32::from(differs[j])).sum::<u32>() >= LEAST_TOGETHER)
        .collect();
    let mut mended = picture.clone();
    let mut count = 0usize;
    for y in 0..height {
        for x in 0..width {
            // Its own border as well, which is half of it and half of what is behind.
            let seen = reference.at(x, y);
            if around(x, y).any(|j| together[j]) && seen.iter().all(|z| WELL_EXPOSED.contains(z)) {
                *mended.at_mut(x, y) =
                    std::array::from_fn(|c| expected[c][usize::from(seen[c])].round() as u8);
                count += 1;
            }
        }
    }
    let share = count as f64 / (width * height).max(1) as f64;
    SHARES.contains(&share).then_some((mended, share))
}

/// What a picture of `ratio` times the exposure shows where the reference shows each value.
fn expected_values(ratio: f64, response: &Response) -> [[f32; 256]; 3] {
    let g = response.log_exposure();
    std::array::from_fn(|c| {
        std::array::from_fn(|z| response.value_of(c, (f64::from(g[c][z]).exp() * ratio) as f32))
    })
}

/// What the picture does show where the reference shows each value: the median over its pixels, so that neither a wrong
/// response nor a wrong time looks like something that moved. Where there are few, what is expected.
fn usual_values(picture: &Rgb8Image, reference: &Rgb8Image, expected: &[[f32; 256]; 3]) -> [[f32; 256]; 3] {
    let mut usual = *expected;
    for (c, usual) in usual.iter_mut().enumerate() {
        let mut counts = vec![[0u32; 256]; 256];
        for (seen, there) in picture.pixels().iter().zip(reference.pixels()) {
            counts[usize::from(there[c])][usize::from(seen[c])] += 1;
        }
        for (z, usual) in usual.iter_mut().enumerate() {
            let near = &counts[z.saturating_sub(VALUES_AROUND)..(z + VALUES_AROUND + 1).min(256)];
            let at = |value: usize| near.iter().map(|row| row[value]).sum::<u32>();
            let all: u32 = (0..256).map(at).sum();
            let mut below = 0;
            let middle = (0..256).find(|&value| {
                below += at(value);
                2 * below >= all
            });
            if let (Some(middle), true) = (middle, all >= FEWEST_PIXELS) {
                *usual = middle as f32;
            }
        }
    }
    usual
}

/// Whether a pixel shows another thing than the reference, beyond noise and beyond what lies beside it there.
fn disagrees(
    picture: &Rgb8Image,
    reference: &Rgb8Image,
    (x, y): (usize, usize),
    expected: &[[f32; 256]; 3],
) -> bool {
    let (width, height) = (picture.width(), picture.height());
    let seen = reference.at(x, y);
    if !seen.iter().all(|z| WELL_EXPOSED.contains(z)) {
        return false;
    }
    (0..3).any(|c| {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for j in y.saturating_sub(1)..(y + 2).min(height) {
            for i in x.saturating_sub(1)..(x + 2).min(width) {
                let value = expected[c][usize::from(reference.at(i, j)[c])];
                (low, high) = (low.min(value), high.max(value));
            }
        }
        let value = f32::from(picture.at(x, y)[c]);
        // A step of ln light is worth less of a value where the value is small; near to it by a curve like sRGB's.
        let slack = |of: f32| LEAST_VALUES.max(of * (1.0 - (-LEAST_LOG / 2.2).exp()) as f32);
        value < low - slack(low) || value > high + slack(high)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dice::Dice;

    /// A ramp of light, taken with these times; in the last picture a square of other light stands at (20, 20)..(44, 44).
    fn bracket(times_s: &[f64], noise: f64, square: Option<f32>) -> (Vec<Rgb8Image>, Vec<Exposure>) {
        let (response, mut dice) = (Response::srgb(), Dice::new(3));
        let mut pictures: Vec<Rgb8Image> = Vec::new();
        for (k, t) in times_s.iter().enumerate() {
            let mut picture = Rgb8Image::filled(96, 64, [0; 3]);
            for y in 0..64 {
                for x in 0..96 {
                    let inside = (20..44).contains(&x) && (20..44).contains(&y);
                    let moved = square.filter(|_| inside && k + 1 == times_s.len());
                    let light = moved.unwrap_or(0.02 + 0.3 * x as f32 / 96.0);
                    *picture.at_mut(x, y) = std::array::from_fn(|c| {
                        let value = f64::from(response.value_of(c, light * *t as f32));
                        (value + noise * dice.normal()).round().clamp(0.0, 255.0) as u8
                    });
                }
            }
            pictures.push(picture);
        }
        (pictures, times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect())
    }

    #[test]
    fn what_moved_takes_the_value_of_the_reference_and_noise_takes_none() {
        for noise in [0.0, 2.0, 3.0] {
            for times_s in [[1.0, 4.0], [2.0, 0.5], [1.0, 0.4]] {
                let (still, exposures) = bracket(&times_s, noise, None);
                let (_, none) = mend(&still.iter().collect::<Vec<_>>(), &exposures, &Response::srgb());
                assert!(none.is_empty(), "{times_s:?} {noise}: {}", none[0].share);
                let (moved, _) = bracket(&times_s, noise, Some(0.9));
                let refs: Vec<_> = moved.iter().collect();
                let (reference, mended) = mend(&refs, &exposures, &Response::srgb());
                assert_eq!(mended.len(), 1, "{times_s:?} {noise}");
                let (mended, other) = (&mended[0], 1 - reference);
                assert_eq!(mended.index, other);
                // 576 of 6144 pixels, and those around them.
                assert!((0.08..0.13).contains(&mended.share), "{times_s:?} {noise}: {}", mended.share);
            }
        }
    }
}
