//! Merges at a sensor's fineness: against sums in f64, at the ends of the scale, and against the 8-bit way.

use super::*;
use crate::hdr::{
    develop::{Developer, SensorOptions},
    sliding::SlidingMerge,
};
use crate::math::{dice::Dice, lens::Lens};
use crate::model::{
    frame::RawFrame,
    image::Image,
    pixels::{BayerDepth, BayerOrder, FramePixels, PixelFormat, PixelLayout},
    response::Response,
    sensor::{CLIPPED, SensorScale},
    time::Timestamp,
};
use proptest::prelude::*;
use std::sync::Arc;

const SCALE: SensorScale =
    SensorScale { black: 1024.0, saturated: 60_000, step: 16.0, exposure_per_value: [2e-5, 1e-5, 3e-5] };

fn picture(values: &[[u16; 3]]) -> SensorImage {
    SensorImage { values: Image::from_pixels(values.len(), 1, values.to_vec()).unwrap(), scale: SCALE }
}

fn seconds(times_s: &[f64]) -> Vec<Exposure> {
    times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect()
}

fn merge(rows: &[&[[u16; 3]]], times_s: &[f64]) -> HdrImage {
    let pictures: Vec<_> = rows.iter().map(|row| picture(row)).collect();
    let mut out = HdrImage::default();
    merge_sensor(&pictures.iter().collect::<Vec<_>>(), &seconds(times_s), &mut out).unwrap();
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A line through black by least squares, in f64, where no value is near saturation.
    #[test]
    fn sums_are_those_in_f64(
        values in prop::collection::vec(prop::array::uniform3(1100u16..40_000), 1..9),
        first_ms in 0.1f64..20.0, ratio in 1.1f64..8.0, gain in 1.0f64..8.0,
    ) {
        let pictures: Vec<_> = values.iter().map(|v| picture(&[*v])).collect();
        let exposures: Vec<_> = (0..values.len())
            .map(|k| Exposure { time_s: 1e-3 * first_ms * ratio.powi(k as i32), gain: if k == 1 { gain } else { 1.0 } })
            .collect();
        let mut out = HdrImage::default();
        merge_sensor(&pictures.iter().collect::<Vec<_>>(), &exposures, &mut out).unwrap();
        for c in 0..3 {
            let (mut above, mut below) = (0.0, 0.0);
            for (v, e) in values.iter().zip(&exposures) {
                let exposure = (f64::from(v[c]) - f64::from(SCALE.black)) * f64::from(SCALE.exposure_per_value[c]);
                above += e.time_s * exposure;
                below += e.time_s * e.effective_s();
            }
            let found = f64::from(out.radiance.at(0, 0)[c]);
            prop_assert!((found / (above / below) - 1.0).abs() < 2e-6, "{found} {}", above / below);
        }
        prop_assert_eq!(*out.flags.at(0, 0), 0);
    }

    /// Whatever the values and times: finite, not negative, and the same in any company.
    #[test]
    fn every_output_is_finite_and_alone_the_same(
        rows in prop::collection::vec(prop::collection::vec(prop::array::uniform3(any::<u16>()), 300), 1..10),
        exponents in prop::array::uniform9(-9i32..9),
    ) {
        let times: Vec<f64> = exponents.iter().map(|e| 10f64.powi(*e)).take(rows.len()).collect();
        let rows: Vec<&[[u16; 3]]> = rows.iter().map(Vec::as_slice).collect();
        let whole = merge(&rows, &times);
        prop_assert!(whole.radiance.pixels().as_flattened().iter().all(|e| e.is_finite() && *e >= 0.0));
        for i in [0, 127, 128, 299] {
            let one: Vec<&[[u16; 3]]> = rows.iter().map(|row| &row[i..=i]).collect();
            let one = merge(&one, &times);
            prop_assert_eq!(whole.radiance.at(i, 0), one.radiance.at(0, 0));
            prop_assert_eq!(whole.flags.at(i, 0), one.flags.at(0, 0));
        }
    }
}

#[test]
fn both_ends_of_the_scale_and_what_was_not_seen_are_told() {
    let (dark, gray, unseen) = ([1024; 3], [11_024; 3], [UNSEEN; 3]);
    let long = [dark, [60_000; 3], [CLIPPED; 3], unseen, gray, unseen, [900; 3]];
    let short = [dark, gray, [CLIPPED; 3], gray, unseen, unseen, [1030; 3]];
    let out = merge(&[&short, &long], &[0.01, 0.1]);
    let both = LOWER_BOUND | UPPER_BOUND;
    assert_eq!(out.flags.pixels(), [UPPER_BOUND, 0, LOWER_BOUND, 0, 0, both, UPPER_BOUND]);
    let green: Vec<f32> = out.radiance.pixels().iter().map(|e| e[1]).collect();
    // 10,000 values above black are an exposure of 0.1; the saturation of 0.01 s is 5.8976.
    let wanted = [0.0, 10.0, 58.976, 10.0, 1.0, 0.0, 0.0];
    assert!(green.iter().zip(wanted).all(|(e, w)| (e - w).abs() <= 1e-5 * w), "{green:?}");
}

/// Near saturation a picture fades out: an exposure that is stated 3 % wrong leaves no step where it saturates.
#[test]
fn no_step_where_an_exposure_saturates() {
    let light: Vec<f64> = (0..2000).map(|i| 3.0 + 0.002 * f64::from(i)).collect();
    let row = |time_s: f64| -> Vec<[u16; 3]> {
        light.iter().map(|e| [(1024.0 + e * time_s / 1e-5).min(65_535.0) as u16; 3]).collect()
    };
    let out = merge(&[&row(0.01), &row(0.1 * 1.03)], &[0.01, 0.1]);
    let ratios: Vec<f64> =
        out.radiance.pixels().iter().zip(&light).map(|(e, l)| f64::from(e[1]) / l).collect();
    let worst = ratios.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    assert!(ratios.iter().all(|r| (0.999..1.031).contains(r)) && worst < 2e-3, "{worst}");
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let (a, b) = (picture(&[[1; 3]; 4]), picture(&[[1; 3]; 5]));
    let mut out = HdrImage::default();
    let mut run = |p: &[&SensorImage], t: &[f64]| merge_sensor(p, &seconds(t), &mut out);
    assert_eq!(run(&[], &[]), Err(MergeError::Pictures(0)));
    assert_eq!(run(&[&a], &[1.0; 2]), Err(MergeError::Exposures { pictures: 1, exposures: 2 }));
    assert!(matches!(run(&[&a, &b], &[1.0; 2]), Err(MergeError::Size { picture: 1, .. })));
    assert!(matches!(run(&[&SensorImage::default()], &[1.0]), Err(MergeError::Size { .. })));
    assert!(matches!(run(&[&a], &[f64::NAN]), Err(MergeError::Exposure { picture: 0, .. })));
}

/// Side of the pictures of the bracket below, and of the blocks that are compared.
const SIDE: usize = 128;
const BLOCK_SIDE: usize = 16;
/// Exposures of that bracket, seconds.
const TIMES_S: [f64; 3] = [0.25, 1.0, 4.0];

/// Radiance at a column: steps of one block, from `darkest` on, each `ratio` times the one before.
fn radiance(x: usize, darkest: f64, ratio: f64) -> f64 {
    darkest * ratio.powi((x / BLOCK_SIDE) as i32)
}

/// A frame of a 12-bit sensor with a black of 1/16 of its scale and a noise of about one step.
fn bayer(light: impl Fn(usize) -> f64, time_s: f64, noise: f64, dice: &mut Dice) -> FramePixels {
    let format = PixelFormat::Bayer(BayerOrder::Rggb, BayerDepth::Bits12);
    let layout = PixelLayout::packed(format, SIDE, SIDE);
    let mut bytes = Vec::new();
    for i in 0..SIDE * SIDE {
        // A sum of three has a deviation of 1/2.
        let noise = noise * 2.0 * ((0..3).map(|_| dice.unit()).sum::<f64>() - 1.5);
        let value = 256.0 + light(i % SIDE) * time_s * (4095.0 - 256.0) + noise;
        bytes.extend((value.round().clamp(0.0, 4095.0) as u16).to_le_bytes());
    }
    FramePixels::new(layout, Arc::new(bytes), 2 * SIDE * SIDE).unwrap()
}

/// Relative errors of the means of blocks (rms), merged from 8 bits and as the sensor gave it.
fn errors(darkest: f64, ratio: f64, noise: f64) -> [f64; 2] {
    let light = |x: usize| radiance(x, darkest, ratio);
    let response = Response::srgb();
    let options = SensorOptions { black: 256.0 / 4095.0, ..SensorOptions::default() };
    let mut developer = Developer::new(&response, options).unwrap();
    let lens = Lens::pinhole(SIDE as u32, SIDE as u32, 100.0, 100.0, 64.0, 64.0);
    [false, true].map(|is_fine| {
        let mut ring = SlidingMerge::new(3, &lens, None);
        let mut dice = Dice::new(13);
        for (k, time_s) in TIMES_S.into_iter().enumerate() {
            let developed = developer.develop(&bayer(light, time_s, noise, &mut dice)).unwrap();
            let frame = RawFrame {
                sequence: k as u64,
                t_mid: Timestamp(k as i64),
                exposure: Exposure { time_s, gain: 1.0 },
                pixels: developed.pixels,
                sensor: developed.sensor.filter(|_| is_fine),
                row_time_s: 0.0,
                response: None,
            };
            ring.push(&frame, None).unwrap();
        }
        assert_eq!(ring.registered_sensor().is_some(), is_fine);
        let mut out = HdrImage::default();
        ring.merge(&response, &mut out).unwrap();
        let (mut sum, mut count) = (0.0, 0.0);
        for block in 0..(SIDE / BLOCK_SIDE).pow(2) {
            let (x0, y0) =
                (block % (SIDE / BLOCK_SIDE) * BLOCK_SIDE, block / (SIDE / BLOCK_SIDE) * BLOCK_SIDE);
            // A pixel beside each step: there the neighbours' channels are mixed in.
            let inner = 1..BLOCK_SIDE - 1;
            let mut mean = 0.0;
            for (y, x) in inner.clone().flat_map(|y| inner.clone().map(move |x| (y, x))) {
                mean += out.radiance.at(x0 + x, y0 + y).iter().map(|e| f64::from(*e)).sum::<f64>() / 3.0;
            }
            let relative = mean / inner.len().pow(2) as f64 / light(x0) - 1.0;
            sum += relative * relative;
            count += 1.0;
        }
        f64::sqrt(sum / count)
    })
}

/// Shadows that 8 bits cannot tell apart: from half an 8-bit value to four in the longest exposure.
#[test]
fn shadows_below_eight_bits_keep_their_depth() {
    // One 8-bit value of sRGB next to black is an exposure of 3.04e-4, and a step of 12 bits 2.6e-4.
    let value = 1.0 / (255.0 * 12.92);
    let [coded, fine] = errors(0.5 * value / TIMES_S[2], 1.35, 1.0);
    println!("shadows: 8 bits {coded:.3}, sensor {fine:.3}");
    assert!(fine <= 0.25 * coded, "8 bits {coded}, sensor {fine}");
}

/// Where there is light enough, the sensor's way is at least as good.
#[test]
fn bright_places_are_as_good() {
    for darkest in [0.002, 0.05, 0.3] {
        let [coded, fine] = errors(darkest, 1.25, 1.0);
        println!("from {darkest}: 8 bits {coded:.5}, sensor {fine:.5}");
        assert!(fine <= coded, "from {darkest}: 8 bits {coded}, sensor {fine}");
    }
}
