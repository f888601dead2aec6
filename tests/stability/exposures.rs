//! Brackets: every pair of 8-bit values, one picture, equal and false times.

use crate::engines;
use halflight::{
    engine::{Bracket, Engine, EngineError},
    hdr::{
        attribute::{ExposureVerdict, Tolerance, check_exposures},
        response::{ResponseOrigin, SolveOptions, solve},
    },
    model::{
        frame::Exposure,
        image::{HdrImage, LOWER_BOUND, Rgb8Image, UPPER_BOUND},
        response::Response,
    },
};

fn seconds(times_s: &[f64]) -> Vec<Exposure> {
    times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect()
}

fn merge(engine: &mut dyn Engine, pictures: &[Rgb8Image], times_s: &[f64]) -> Result<HdrImage, EngineError> {
    let pictures: Vec<_> = pictures.iter().collect();
    let mut out = HdrImage::default();
    let bracket = Bracket { pictures: &pictures, exposures: &seconds(times_s) };
    engine.merge_bracket(&bracket, &Response::srgb(), &mut out)?;
    Ok(out)
}

/// Every value against every other: 256 x 256 pixels, the other two channels mixed.
fn pairs() -> [Rgb8Image; 2] {
    let of = |pick: fn(usize, usize) -> u8| {
        let pixels = (0..65_536)
            .map(|k| {
                let (x, y) = (k % 256, k / 256);
                [pick(x, y), pick(255 - x, y), pick(y, x)]
            })
            .collect();
        Rgb8Image::from_pixels(256, 256, pixels).expect("as many as were made")
    };
    [of(|x, _| x as u8), of(|_, y| y as u8)]
}

/// Finite and above 0 for every pair of values, flagged where no value has a weight.
fn bounds(engine: &mut dyn Engine) {
    let pictures = pairs();
    for times_s in [[0.1, 0.001], [0.01, 0.01], [1e-9, 1e9], [1e-300, 1e300], [5e-324, 1e-3]] {
        let out = merge(engine, &pictures, &times_s).expect("times above 0");
        for (k, (rgb, flags)) in out.radiance.pixels().iter().zip(out.flags.pixels()).enumerate() {
            let values: [[u8; 3]; 2] = [pictures[0].pixels()[k], pictures[1].pixels()[k]];
            assert!(rgb.iter().all(|c| c.is_finite() && *c > 0.0), "{values:?} at {times_s:?}: {rgb:?}");
            let unweighted = (0..3).any(|c| values.iter().all(|z| [0, 255].contains(&z[c])));
            assert_eq!(*flags & (LOWER_BOUND | UPPER_BOUND) != 0, unweighted, "{values:?}: {flags}");
        }
    }
    // One picture of all values.
    let ramp = Rgb8Image::from_pixels(256, 1, (0..=255).map(|z| [z; 3]).collect()).expect("256");
    let out = merge(engine, &[ramp], &[0.01]).expect("one picture");
    let rising = out.radiance.pixels().windows(2).all(|pair| pair[1][0] >= pair[0][0]);
    assert!(rising, "a brighter value is no less light");
    assert!(out.radiance.pixels().iter().flatten().all(|c| c.is_finite() && *c > 0.0));
}

/// Times scaled by a factor scale radiance by its inverse; the order of the pictures and of channels does not matter.
fn invariance(engine: &mut dyn Engine) {
    let [a, b] = pairs();
    let one = merge(engine, &[a.clone(), b.clone()], &[0.1, 0.004]).expect("sound");
    for factor in [1e-6, 1e6] {
        let other = merge(engine, &[a.clone(), b.clone()], &[0.1 * factor, 0.004 * factor]).expect("sound");
        assert_eq!(other.flags, one.flags);
        for (x, y) in other.radiance.pixels().iter().flatten().zip(one.radiance.pixels().iter().flatten()) {
            // Logarithms of up to 20 are rounded to 1e-6.
            assert!((f64::from(*x) * factor / f64::from(*y) - 1.0).abs() < 4e-6, "{x} {y}");
        }
    }
    let back = merge(engine, &[b, a], &[0.004, 0.1]).expect("sound");
    assert_eq!(back.flags, one.flags);
    for (x, y) in back.radiance.pixels().iter().flatten().zip(one.radiance.pixels().iter().flatten()) {
        assert!((x / y - 1.0).abs() < 2e-6, "{x} {y}");
    }
    let swap = |p: &Rgb8Image| {
        let pixels = p.pixels().iter().map(|[r, g, b]| [*b, *r, *g]).collect();
        Rgb8Image::from_pixels(256, 256, pixels).expect("as many")
    };
    let [a, b] = pairs();
    let swapped = merge(engine, &[swap(&a), swap(&b)], &[0.1, 0.004]).expect("sound");
    for (x, y) in swapped.radiance.pixels().iter().zip(one.radiance.pixels()) {
        assert_eq!(*x, [y[2], y[0], y[1]]);
    }
}

/// What comes out follows what went in, from black in all to white in all.
fn continuity(engine: &mut dyn Engine) {
    let response = Response::srgb();
    let times_s = [0.1, 0.01, 0.001];
    let radiance = |k: usize| (1e-3f64 * 1.01f64.powi(k as i32)) as f32;
    let pictures: Vec<_> = times_s
        .iter()
        .map(|t| {
            let value = |k: usize| response.value_of(1, radiance(k) * *t as f32).round() as u8;
            Rgb8Image::from_pixels(1600, 1, (0..1600).map(|k| [value(k); 3]).collect()).expect("1600")
        })
        .collect();
    let out = merge(engine, &pictures, &times_s).expect("sound");
    let found: Vec<f32> = out.radiance.pixels().iter().map(|rgb| rgb[1]).collect();
    let mut worst = 1.0f32;
    for (k, found) in found.iter().enumerate().filter(|(k, _)| (0.05..900.0).contains(&radiance(*k))) {
        worst = worst.max(found / radiance(k)).max(radiance(k) / found);
    }
    println!("within a factor of {worst:.3}");
    // Value 4 of 255, rounded, is known to an eighth; its weight is small.
    assert!(worst < 1.2, "{worst}");
    // Below value 1 in the longest exposure there are no steps between; above, a hundredth more light is no jump.
    let (steepest, flattest) = (found.windows(2).enumerate())
        .filter(|(k, _)| radiance(*k) > 0.05)
        .map(|(_, pair)| pair[1] / pair[0])
        .fold((1.0f32, 1.0f32), |(most, least), step| (most.max(step), least.min(step)));
    println!("steps of a factor of {flattest:.3} to {steepest:.3}");
    assert!(steepest < 1.1 && flattest > 0.95, "a jump: {flattest} {steepest}");
}

/// Times that no camera has are refused in words; nothing is merged.
fn refused(engine: &mut dyn Engine) {
    let pictures = [Rgb8Image::filled(3, 2, [90; 3]), Rgb8Image::filled(3, 2, [120; 3])];
    for bad in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        let error = merge(engine, &pictures, &[0.01, bad]).expect_err("no such time").to_string();
        assert!(error.contains("picture 1") && error.contains("above 0"), "{error}");
    }
    assert!(merge(engine, &[], &[]).is_err());
    assert!(merge(engine, &pictures, &[0.01]).is_err());
}

pub fn all(engine: &mut dyn Engine) {
    bounds(engine);
    invariance(engine);
    continuity(engine);
    refused(engine);
}

engines::on_each!("exposures::gl");

/// The response: with equal exposures, all saturated or all black nothing is solved, and the curve that stands in is sound.
#[test]
fn brackets_that_say_nothing_of_the_response_are_told() {
    let ramp =
        Rgb8Image::from_pixels(64, 64, (0..4096).map(|k| [(k % 256) as u8; 3]).collect()).expect("4096");
    let (white, black) = (Rgb8Image::filled(64, 64, [255; 3]), Rgb8Image::filled(64, 64, [0; 3]));
    let cases: [(&str, [&Rgb8Image; 2], [f64; 2]); 5] = [
        ("equal times", [&ramp, &ramp], [0.01, 0.01]),
        ("nearly equal times", [&ramp, &ramp], [0.01, 0.011]),
        ("all white", [&white, &white], [0.01, 0.04]),
        ("all black", [&black, &black], [0.01, 0.04]),
        ("false times", [&ramp, &ramp], [0.01, 0.08]),
    ];
    for (name, pictures, times_s) in cases {
        let found = solve(&pictures, &seconds(&times_s), &SolveOptions::default());
        match &found.origin {
            ResponseOrigin::Fallback { why } => assert!(!why.is_empty(), "{name}"),
            ResponseOrigin::Solved { residual_rms } => panic!("{name}: solved with {residual_rms}"),
        }
        assert_eq!(found.response, Response::srgb(), "{name}");
    }
}

/// Exposures that were exchanged are found out from the pixels.
#[test]
fn exchanged_times_are_contradicted() {
    let response = Response::srgb();
    let see = |t: f64| {
        let value = |k: usize| {
            response.value_of(0, ((8.0 * (k as f64 / 6144.0 - 0.5)).exp() * t) as f32).round() as u8
        };
        Rgb8Image::from_pixels(96, 64, (0..6144).map(|k| [value(k); 3]).collect()).expect("6144")
    };
    let pictures = [see(0.2), see(0.05), see(0.0125)];
    let pictures: Vec<_> = pictures.iter().collect();
    let true_times =
        check_exposures(&pictures, &seconds(&[0.2, 0.05, 0.0125]), &response, Tolerance::KNOWN_RESPONSE);
    assert!(true_times.sound());
    let exchanged =
        check_exposures(&pictures, &seconds(&[0.2, 0.0125, 0.05]), &response, Tolerance::KNOWN_RESPONSE);
    assert!(!exchanged.sound());
    assert!(exchanged.reports().iter().any(|r| r.verdict == ExposureVerdict::Contradicted));
    let nonsense =
        check_exposures(&pictures, &seconds(&[0.0, f64::NAN, -1.0]), &response, Tolerance::KNOWN_RESPONSE);
    assert!(!nonsense.sound());
}
