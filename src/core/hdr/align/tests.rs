use super::*;
use crate::math::dice::Dice;
use proptest::prelude::*;

/// A place with texture of many sizes, continuous: radiance at a point.
fn place(p: DVec2) -> f64 {
    let wave = |kx: f64, ky: f64, phase: f64| (kx * p.x + ky * p.y + phase).sin();
    let soft =
        wave(0.031, 0.017, 0.3) + wave(-0.013, 0.041, 1.1) + wave(0.11, -0.07, 2.0) + wave(0.05, 0.13, 0.7);
    let fine = wave(0.41, 0.23, 0.2) + wave(-0.29, 0.37, 1.9);
    let blocks = ((p.x / 37.0).floor() * 12.9898 + (p.y / 29.0).floor() * 78.233).sin();
    (0.7 * soft + 0.25 * fine + 0.8 * blocks).exp()
}

/// Seen through sRGB with a drift, at an exposure; the mean of 2 x 2 points of each pixel.
fn photograph(width: usize, height: usize, drift: &Drift, exposure: f64, noise_dn: f64) -> Rgb8Image {
    let response = Response::srgb();
    let middle = 0.5 * DVec2::new(width as f64, height as f64);
    // The picture shows at q what the reference shows at p: turn back.
    let back = |q: DVec2| middle + DVec2::from_angle(-drift.turn_rad).rotate(q - drift.shift_px - middle);
    // Noise of its own for each photograph.
    let mut dice = Dice::new((1e6 * (exposure + 7.0 * drift.shift_px.x)) as i64 as u64);
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let light: f64 = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]
                .iter()
                .map(|(dx, dy)| 0.25 * place(back(DVec2::new(x as f64 + dx, y as f64 + dy))))
                .sum();
            let jitter = noise_dn * (dice.unit() - 0.5) * 2.0;
            let z = f64::from(response.value_of(1, (light * exposure) as f32)) + jitter;
            pixels.push([z.round().clamp(0.0, 255.0) as u8; 3]);
        }
    }
    Rgb8Image::from_pixels(width, height, pixels).unwrap()
}

#[test]
fn shift_and_turn_are_found_across_exposures() {
    for (shift, turn) in [((0.0, 0.0), 0.0), ((2.4, -1.7), 0.002), ((-37.3, 21.6), -0.004), ((0.5, 0.5), 0.0)]
    {
        let truth = Drift { shift_px: DVec2::from(shift), turn_rad: turn };
        let reference = photograph(480, 320, &Drift::default(), 0.08, 2.0);
        for exposure in [0.02, 0.08, 0.32] {
            let moved = photograph(480, 320, &truth, exposure, 2.0);
            let found = drift(&reference, &moved).unwrap();
            let error = found.shift_px.distance(truth.shift_px);
            let turned = (found.turn_rad - truth.turn_rad).abs();
            println!("{truth:?} x {exposure}: off by {error:.3} px, {turned:.1e} rad");
            // A turn by 4 mrad moves a window's own pixels by 0.1 px across it: parabolas are no better than that.
            assert!(error < 0.12 && turned < 4e-4, "{truth:?} {exposure}: {found:?}");
        }
    }
}

#[test]
fn a_bumped_bracket_merges_as_one_that_stood_still() {
    let exposures = [0.32, 0.08, 0.02].map(|time_s| Exposure { time_s, gain: 1.0 });
    let drifts = [
        Drift { shift_px: DVec2::new(-1.2, 0.6), turn_rad: 0.001 },
        Drift::default(),
        Drift { shift_px: DVec2::new(1.7, -2.3), turn_rad: 0.0 },
    ];
    let take = |bumped: bool| -> Vec<Rgb8Image> {
        let of = |k: usize| if bumped { drifts[k] } else { Drift::default() };
        (0..3).map(|k| photograph(320, 240, &of(k), exposures[k].time_s, 0.0)).collect()
    };
    let (still, bumped) = (take(false), take(true));
    let aligned = align(&bumped.each_ref_vec(), &exposures, &Response::srgb());
    for (found, truth) in aligned.drifts.iter().zip(&drifts) {
        assert!(found.shift_px.distance(truth.shift_px) < 0.12, "{found:?} {truth:?}");
    }
    let difference = |pictures: &[Rgb8Image]| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (a, b) in pictures.iter().zip(&still) {
            for y in 8..232 {
                for x in 8..312 {
                    sum += f64::from(a.at(x, y)[0].abs_diff(b.at(x, y)[0]));
                    count += 1.0;
                }
            }
        }
        sum / count
    };
    let (before, after) = (difference(&bumped), difference(&aligned.pictures));
    println!("mean difference from the pictures that stood still: {before:.2} DN, aligned {after:.2} DN");
    // What is left is interpolation over the edges of the blocks.
    assert!(after < 0.3 * before, "{before} {after}");
}

#[test]
fn what_cannot_be_told_stays_as_it_is() {
    let flat = Rgb8Image::filled(200, 150, [90; 3]);
    let textured = photograph(200, 150, &Drift::default(), 0.08, 1.0);
    assert_eq!(drift(&flat, &flat), None);
    assert_eq!(drift(&flat, &textured), None);
    assert_eq!(drift(&textured, &Rgb8Image::filled(150, 200, [90; 3])), None);
    assert_eq!(drift(&Rgb8Image::filled(8, 8, [1; 3]), &Rgb8Image::filled(8, 8, [1; 3])), None);
    let exposures = [0.1, 0.4].map(|time_s| Exposure { time_s, gain: 1.0 });
    let kept = align(&[&flat, &textured], &exposures, &Response::srgb());
    assert_eq!((&kept.pictures[0], kept.drifts[1]), (&flat, Drift::default()));
    assert!(align(&[], &[], &Response::srgb()).pictures.is_empty());
}

#[test]
fn saturated_ends_are_cleaned() {
    let mut picture = Rgb8Image::filled(64, 64, [100; 3]);
    *picture.at_mut(5, 5) = [253, 252, 254];
    let exposures = [Exposure { time_s: 0.1, gain: 1.0 }];
    let kept = align(&[&picture], &exposures, &Response::srgb());
    assert_eq!(*kept.pictures[0].at(5, 5), [255, 252, 255]);
}

trait EachRef {
    fn each_ref_vec(&self) -> Vec<&Rgb8Image>;
}

impl EachRef for Vec<Rgb8Image> {
    fn each_ref_vec(&self) -> Vec<&Rgb8Image> {
        self.iter().collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn any_two_pictures_are_survived(
        width in 1usize..90, height in 1usize..90, seed in any::<u32>(), same in any::<bool>()
    ) {
        let mut dice = Dice::new(u64::from(seed));
        let mut noise = || [(dice.bits() >> 56) as u8; 3];
        let a = Rgb8Image::from_pixels(width, height, (0..width * height).map(|_| noise()).collect()).unwrap();
        let b = if same { a.clone() } else { Rgb8Image::filled(width, height, noise()) };
        if let Some(found) = drift(&a, &b) {
            prop_assert!(found.shift_px.is_finite() && found.turn_rad.is_finite());
            prop_assert!(!same || found.largest_px(width, height) < 0.3, "{found:?}");
        }
    }
}
