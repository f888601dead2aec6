//! What fitting a blurred tag costs over following the edges of a sharp one.

use super::timing::{median, time_ms};
use glam::DVec2;
use halflight::model::image::Image;
use halflight::track::{
    blurred::{BlurredScratch, refine_blurred},
    drawing::{corners_of, draw_light},
    edges::{self, EdgeScratch},
};

const RUNS: usize = 15;
/// Pictures of all tags are squares of this side, pixels.
const SIDE: usize = 200;

/// Prints the figures.
pub fn run() {
    println!("corners of a tag: fitted with its blur, over following its edges where it is sharp");
    for side_px in [40.0, 70.0, 110.0] {
        let table = edges::srgb_table();
        let turns = [0.1, 0.45, 0.8];
        let time = |blur_px: f64, work: &mut dyn FnMut(&Image<u8>, &[DVec2; 4])| {
            let mut times = turns.map(|turn| {
                let corners = corners_of(DVec2::new(100.3, 99.6), side_px, turn);
                let gray = picture(&corners, blur_px);
                let start = corners.map(|c| c + DVec2::new(0.3, -0.2));
                time_ms(RUNS, || work(&gray, &start)).0
            });
            median(&mut times)
        };
        let mut scratch = EdgeScratch::default();
        let sharp_ms = time(0.3, &mut |gray, start| {
            std::hint::black_box(edges::refine_corners(gray, &table, start, 2.0, &mut scratch));
        });
        for blur_px in [0.7, 1.0, 2.0, 3.0] {
            let mut scratch = BlurredScratch::default();
            let blurred_ms = time(blur_px, &mut |gray, start| {
                std::hint::black_box(refine_blurred(gray, &table, start, blur_px, &mut scratch));
            });
            println!(
                "  {side_px:>3} px, blur {blur_px:.1} px: {blurred_ms:6.3} ms, sharp {sharp_ms:.3} ms, ratio {:.0}",
                blurred_ms / sharp_ms
            );
        }
    }
}

/// A tag out of focus, its light blurred by a Gaussian and then encoded by sRGB.
fn picture(corners: &[DVec2; 4], blur_px: f64) -> Image<u8> {
    let mut light = draw_light(SIDE, SIDE, 1, corners, [0.9, 0.45, 0.04]);
    let half = (3.5 * blur_px).ceil() as i64;
    let kernel: Vec<f64> = (-half..=half).map(|k| (-0.5 * (k as f64 / blur_px).powi(2)).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    for step in [(1, 0), (0, 1)] {
        let from = light.clone();
        for y in 0..SIDE {
            for x in 0..SIDE {
                let at = |t: usize, by: i64| (t as i64 + by).clamp(0, SIDE as i64 - 1) as usize;
                let value = |k: i64| *from.at(at(x, step.0 * k), at(y, step.1 * k));
                *light.at_mut(x, y) =
                    kernel.iter().zip(-half..).map(|(w, k)| w * value(k)).sum::<f64>() / sum;
            }
        }
    }
    let mut gray = Image::filled(SIDE, SIDE, 0u8);
    for (gray, light) in gray.pixels_mut().iter_mut().zip(light.pixels()) {
        let encoded = if *light <= 0.0031308 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
        *gray = (encoded * 255.0).round() as u8;
    }
    gray
}
