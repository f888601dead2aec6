//! `hdr::merge_bracket` against a plain f32 loop, and its bytes per second against a memory copy.

use crate::timing::time_ms;
use glam::DVec3;
use halflight::{
    hdr::{
        merge_bracket::{merge_bracket, weight},
        sliding::SlidingMerge,
    },
    math::{dice::Dice, lens::Lens, pose::Pose},
    model::{
        frame::{Exposure, RawFrame},
        image::{HdrImage, Rgb8Image},
        response::Response,
        rig::MirrorBall,
        time::Timestamp,
    },
};
use std::{hint::black_box, sync::Arc};

/// [DM97] as one would write it down: for each pixel and channel, a loop over the pictures.
fn merge_naive(pictures: &[&Rgb8Image], times_s: &[f32], response: &Response) -> Vec<[f32; 3]> {
    let g = response.log_exposure();
    (0..pictures[0].pixels().len())
        .map(|i| {
            std::array::from_fn(|c| {
                let (mut top, mut bottom) = (0.0f32, 0.0f32);
                for (picture, t) in pictures.iter().zip(times_s) {
                    let z = picture.pixels()[i][c];
                    let w = f32::from(weight(z));
                    top += w * (g[c][usize::from(z)] - t.ln());
                    bottom += w;
                }
                if bottom > 0.0 { (top / bottom).exp() } else { (g[c][255] - times_s[0].ln()).exp() }
            })
        })
        .collect()
}

/// A view with every brightness, at the exposure times `times_s`, with a little noise.
fn bracket(width: usize, height: usize, times_s: &[f32], response: &Response) -> Vec<Rgb8Image> {
    let mut dice = Dice::new(1);
    times_s
        .iter()
        .map(|&t| {
            let pixels = (0..width * height)
                .map(|i| {
                    let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
                    std::array::from_fn(|c| {
                        let noise = dice.unit_f32() - 0.5;
                        let radiance = (-3.0 + 9.0 * x * y + c as f32 * 0.2).exp();
                        (response.value_of(c, radiance * t) + 4.0 * noise).round().clamp(0.0, 255.0) as u8
                    })
                })
                .collect();
            Rgb8Image::from_pixels(width, height, pixels).expect("as many pixels as were made")
        })
        .collect()
}

/// Prints the figures.
pub fn run() {
    let (width, height, times_s) = (640, 480, [0.004f32, 0.016, 0.064]);
    let response = Response::srgb();
    let pictures = bracket(width, height, &times_s, &response);
    let pictures: Vec<&Rgb8Image> = pictures.iter().collect();
    let exposures = times_s.map(|t| Exposure { time_s: f64::from(t), gain: 1.0 });
    let mut out = HdrImage::default();
    let (ours, ours_best) = time_ms(101, || {
        merge_bracket(black_box(&pictures), &exposures, &response, &mut out).expect("a sound bracket");
    });
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let (single, _) = one_thread.install(|| {
        time_ms(51, || {
            merge_bracket(black_box(&pictures), &exposures, &response, &mut out).expect("a sound bracket");
        })
    });
    let (naive, _) = time_ms(21, || {
        black_box(merge_naive(black_box(&pictures), &times_s, &response));
    });
    // The copy moves as many bytes as the merge reads and writes: half of them are read, half written.
    let pixels = width * height;
    let bytes = pixels * (3 * times_s.len() + 12 + 1);
    let source = vec![1u8; bytes / 2];
    let mut target = vec![0u8; bytes / 2];
    let (copy, _) = time_ms(101, || black_box(&mut target).copy_from_slice(black_box(&source)));
    let gigabytes_s = |ms: f64| bytes as f64 / ms * 1e-6;
    println!(
        "merge_bracket, 3 exposures of {width} x {height} x 3, {} threads",
        rayon::current_num_threads()
    );
    println!("  ours          {ours:8.3} ms (best {ours_best:.3}), one thread {single:.3} ms");
    println!("  plain f32 loop{naive:8.3} ms   ratio {:.1} (one thread {:.1})", naive / ours, naive / single);
    match super::opencv::merge_debevec(&pictures, &times_s) {
        Ok(theirs) => println!(
            "  MergeDebevec  {:8.3} ms (best {:.3}; {})   ratio {:.1}, best against best {:.1}",
            theirs.median_ms,
            theirs.best_ms,
            theirs.what,
            theirs.median_ms / ours,
            theirs.best_ms / ours_best
        ),
        Err(why) => println!("  MergeDebevec  SKIPPED: {why}"),
    }
    println!(
        "  bytes         {:8.2} GB/s; memory copy {:.2} GB/s   ratio {:.2}",
        gigabytes_s(ours),
        gigabytes_s(copy),
        gigabytes_s(ours) / gigabytes_s(copy)
    );
    println!("  sliding merge {:8.3} ms: two older frames warped, ball of 150 px, and merged", sliding_ms());
}

/// Median time of a sliding merge of a moving camera.
fn sliding_ms() -> f64 {
    let (response, times_s) = (Response::srgb(), [0.004f32, 0.016, 0.064]);
    let pictures: Vec<_> = bracket(640, 480, &times_s, &response).into_iter().map(Arc::new).collect();
    let ball = MirrorBall {
        surface_radius_m: None,
        centre_world: DVec3::new(0.0, 0.0, 0.05),
        radius_m: 0.05,
        reflectance_rgb: [1.0; 3],
    };
    let mut ring = SlidingMerge::new(3, &Lens::pinhole(640, 480, 800.0, 800.0, 320.0, 240.0), Some(ball));
    let mut out = HdrImage::default();
    let mut sequence = 0u64;
    time_ms(61, || {
        let k = sequence as usize % 3;
        let eye = DVec3::new(0.002 * (sequence % 50) as f64, -0.4, 0.3);
        let frame = RawFrame {
            sequence,
            t_mid: Timestamp(0),
            exposure: Exposure { time_s: f64::from(times_s[k]), gain: 1.0 },
            pixels: Arc::clone(&pictures[k]),
            sensor: None,
            row_time_s: 0.0,
            response: None,
        };
        ring.push(&frame, Some(Pose::look_at(eye, DVec3::ZERO, DVec3::Z))).expect("a sound frame");
        ring.merge(&response, &mut out).expect("a sound bracket");
        sequence += 1;
    })
    .0
}
