//! What brackets merge to against the light that they were made of: the case that was handed over, and others by rule.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::assets::pictures;
use halflight::hdr::{
    merge_bracket::merge_bracket,
    response::{ResponseOrigin, SolveOptions, solve},
};
use halflight::math::dice::Dice;
use halflight::model::{
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    response::Response,
};
use std::process::Command;

/// |log2| of what was merged over the truth, in all channels of the pixels that are no bounds, up to one factor for all:
/// of half of them, 9 of 10, and 99 of 100.
fn errors(merged: &HdrImage, truth: &[[f32; 3]]) -> [f64; 3] {
    let mut ratios: Vec<f64> = Vec::new();
    let sure = merged.radiance.pixels().iter().zip(merged.flags.pixels()).zip(truth);
    for ((radiance, _), truth) in sure.filter(|((_, flags), _)| **flags == 0) {
        let pairs = radiance.iter().zip(truth).filter(|(r, t)| **r > 0.0 && **t > 0.0);
        ratios.extend(pairs.map(|(r, t)| f64::from(r / t).log2()));
    }
    ratios.sort_by(f64::total_cmp);
    let middle = ratios[ratios.len() / 2];
    ratios.iter_mut().for_each(|r| *r = (*r - middle).abs());
    ratios.sort_by(f64::total_cmp);
    [0.5, 0.9, 0.99].map(|share| ratios[((ratios.len() - 1) as f64 * share) as usize])
}

fn merged(files: &[Rgb8Image], times_s: &[f64]) -> (HdrImage, ResponseOrigin) {
    let pictures: Vec<&Rgb8Image> = files.iter().collect();
    let exposures: Vec<Exposure> = times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect();
    let recovered = solve(&pictures, &exposures, &SolveOptions::default());
    let mut out = HdrImage::default();
    merge_bracket(&pictures, &exposures, &recovered.response, &mut out).unwrap();
    (out, recovered.origin)
}

/// The truth's numbers, by Python: they lie packed in a file of numpy's. `None` where there is no Python.
fn handed_truth(file: &std::path::Path) -> Option<Vec<[f32; 3]>> {
    let script = "import sys,struct,zipfile\n\
                  raw=zipfile.ZipFile(sys.argv[1]).read('radiance.npy')[128:]\n\
                  n=struct.unpack('<%de'%(len(raw)//2),raw)\n\
                  sys.stdout.buffer.write(struct.pack('<%df'%len(n),*n))";
    let done = Command::new("python3").args(["-c", script]).arg(file).output().ok()?;
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let numbers: Vec<f32> =
        done.stdout.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    Some(numbers.as_chunks::<3>().0.to_vec())
}

#[test]
fn the_handed_brackets_far_apart_are_near_the_truth() {
    let Some(shared) = support::shared("the_handed_brackets_far_apart") else { return };
    let folder = shared.join("cases/bracket-two-frames-far-apart");
    let Some(truth) = handed_truth(&folder.join("truth.npz")) else {
        return support::skipped("no python3 to unpack the truth");
    };
    // Measured: as much. Solved from the pictures, which cannot tell it, it was 0.257, 0.528, 0.725.
    for (name, times_s, most) in
        [("6ev", [8.0, 0.125], [0.053, 0.150, 0.262]), ("8ev", [16.0, 0.0625], [0.090, 0.277, 0.545])]
    {
        let files = ["long", "short"]
            .map(|which| pictures::load_rgb8(&folder.join(format!("{name}-{which}.png"))).unwrap());
        let (merged, origin) = merged(&files, &times_s);
        let found = errors(&merged, &truth);
        println!("{name}: {found:.3?}, {origin:?}");
        assert!(found.iter().zip(most).all(|(found, most)| *found <= most), "{name}: {found:.3?}");
    }
}

/// A bracket by rule: coloured patches over nine stops, shot noise and rounding.
fn made(seed: u64, times_s: &[f64], response: &Response) -> (Vec<Rgb8Image>, Vec<[f32; 3]>) {
    let (width, height) = (120, 90);
    let mut dice = Dice::new(seed * 7919 + 5);
    let middle = times_s.iter().map(|t| t.ln()).sum::<f64>() / times_s.len() as f64;
    let patches: Vec<[f64; 3]> = (0..width / 3 * (height / 3))
        .map(|_| {
            let light = (dice.between(-5.0, 1.2) - middle).exp();
            std::array::from_fn(|_| light * dice.between(0.6, 1.4))
        })
        .collect();
    let at = |k: usize| patches[k / width / 3 * (width / 3) + k % width / 3];
    let truth: Vec<[f32; 3]> = (0..width * height).map(|k| at(k).map(|light| light as f32)).collect();
    // The full range is as many electrons: what a small sensor holds.
    const FULL: f64 = 6000.0;
    let pictures = times_s.iter().map(|time_s| {
        let mut picture = Rgb8Image::filled(width, height, [0; 3]);
        for (k, pixel) in picture.pixels_mut().iter_mut().enumerate() {
            *pixel = std::array::from_fn(|c| {
                let exposed = at(k)[c] * time_s;
                let noisy = exposed + (exposed / FULL).sqrt() * dice.normal();
                f64::from(response.value_of(c, noisy.max(1e-7) as f32)).round().clamp(0.0, 255.0) as u8
            });
        }
        picture
    });
    (pictures.collect(), truth)
}

#[test]
fn made_brackets_are_near_their_truth() {
    let gamma = |exponent: f64| {
        let curve = std::array::from_fn(|z| (exponent * ((z as f64).max(0.5) / 255.0).ln()) as f32);
        Response::new([curve; 3]).unwrap()
    };
    let responses = [("srgb", Response::srgb()), ("2.2", gamma(2.2)), ("1.8", gamma(1.8))];
    // Bounds are a quarter above what was measured; what is left is the noise of shots. Six stops and more tell no response, and
    // the usual one stands in.
    let solved: [(&str, &[f64], [f64; 3]); 3] = [
        ("2 of 2 stops", &[0.4, 0.1], [0.040, 0.145, 0.345]),
        ("5 of 1 stop", &[0.4, 0.2, 0.1, 0.05, 0.025], [0.028, 0.083, 0.210]),
        ("3 of 3 stops", &[0.8, 0.1, 0.0125], [0.043, 0.110, 0.205]),
    ];
    let mut misses = Vec::new();
    let mut hold =
        |name: &str, times_s: &[f64], curve: &(&str, Response), is_solved: bool, most: [f64; 3]| {
            for seed in [71, 902] {
                let (pictures, truth) = made(seed, times_s, &curve.1);
                let (merged, origin) = merged(&pictures, times_s);
                let found = errors(&merged, &truth);
                println!("{name}, {}, seed {seed}: {found:.3?}", curve.0);
                if found.iter().zip(most).any(|(found, most)| *found > most)
                    || matches!(origin, ResponseOrigin::Solved { .. }) != is_solved
                {
                    misses.push(format!("{name}, {}, seed {seed}: {found:.3?}, {origin:?}", curve.0));
                }
            }
        };
    for (k, (name, times_s, most)) in solved.into_iter().enumerate() {
        // Each with two of the curves.
        for curve in [&responses[k], &responses[(k + 1) % 3]] {
            hold(name, times_s, curve, true, most);
        }
    }
    for (name, times_s, most) in [
        ("2 of 6 stops", [0.8, 0.0125], [0.052, 0.154, 0.310]),
        ("2 of 8 stops", [1.6, 0.00625], [0.068, 0.264, 0.610]),
    ] {
        hold(name, &times_s, &responses[0], false, most);
    }
    assert!(misses.is_empty(), "{misses:#?}");
}
