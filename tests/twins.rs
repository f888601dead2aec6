//! Each kernel on the device against its CPU twin, on every backend that is found. Software adapters will do.

mod support;

use std::sync::{Mutex, PoisonError};

use halflight::{
    engine::{
        Bracket, Engine,
        gpu::{Backend, GpuEngine},
    },
    hdr::merge_bracket::merge_bracket,
    math::sh::basis,
    model::{
        frame::Exposure,
        image::{HdrImage, Rgb8Image},
        light::RadianceSamples,
        response::Response,
    },
};

/// A small generator with a fixed seed (64-bit linear congruential, upper bits).
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }
}

fn merge_matches(engine: &mut GpuEngine) {
    let mut dice = Dice(1);
    // Not a multiple of 4 pixels, so that the last word is padded.
    let (width, height) = (161, 119);
    for count in [1usize, 3, 9] {
        let mut pictures: Vec<Rgb8Image> = (0..count)
            .map(|_| {
                let pixels = (0..width * height)
                    .map(|_| [(); 3].map(|()| (dice.next() * 300.0 - 22.0).clamp(0.0, 255.0) as u8))
                    .collect();
                Rgb8Image::from_pixels(width, height, pixels).unwrap()
            })
            .collect();
        // Pixels that are 0 and 255 in every combination.
        for (k, picture) in pictures.iter_mut().enumerate() {
            for i in 0..512 {
                picture.pixels_mut()[i] = [(); 3].map(|()| if i >> k & 1 == 1 { 255 } else { 0 });
            }
        }
        let exposures: Vec<_> =
            (0..count).map(|k| Exposure { time_s: 0.001 * 2f64.powi(k as i32), gain: 1.5 }).collect();
        let pictures: Vec<_> = pictures.iter().collect();
        let response = Response::srgb();
        let (mut device, mut twin) = (HdrImage::default(), HdrImage::default());
        let bracket = Bracket { pictures: &pictures, exposures: &exposures };
        engine.merge_bracket(&bracket, &response, &mut device).unwrap();
        merge_bracket(&pictures, &exposures, &response, &mut twin).unwrap();
        assert_eq!(device.flags, twin.flags);
        assert_eq!((device.radiance.width(), device.radiance.height()), (width, height));
        let worst = device
            .radiance
            .pixels()
            .as_flattened()
            .iter()
            .zip(twin.radiance.pixels().as_flattened())
            .map(|(d, t)| f64::from((d / t - 1.0).abs()))
            .fold(0.0, f64::max);
        println!("merge of {count}: {worst:.1e}");
        // Measured 1.2e-7: the same operations in the same order. A device may fuse multiply and add and divide
        // to 2.5 units in the last place; the logarithm (up to 8 in size) enters with its absolute error.
        assert!(worst < 1e-6, "merge of {count}: relative difference {worst}");
    }
}

fn projection_matches_and_repeats(engine: &mut GpuEngine) {
    let mut dice = Dice(2);
    for (count, order) in [(1usize, 6usize), (255, 2), (5000, 4), (70_001, 6)] {
        let mut samples = RadianceSamples::default();
        for _ in 0..count {
            let d = glam::Vec3::new(dice.next() - 0.5, dice.next() - 0.5, dice.next() - 0.5).normalize();
            samples.directions.push([d.x, d.y, d.z, dice.next() * 1e-3]);
            let bright = if dice.next() > 0.999 { 1e5 } else { 1.0 };
            samples.radiance.push([dice.next() * bright, dice.next(), dice.next(), 0.0]);
        }
        let device = engine.project_sh(&samples, order).unwrap();
        let mut exact = [[0.0f64; 3]; 36];
        let mut size = [0.0f64; 3];
        for (d, l) in samples.directions.iter().zip(&samples.radiance) {
            let mut y = [0.0f64; 36];
            basis::evaluate(order, [f64::from(d[0]), f64::from(d[1]), f64::from(d[2])], &mut y);
            for c in 0..3 {
                let weighted = f64::from(d[3]) * f64::from(l[c]);
                size[c] += weighted;
                for (sum, y) in exact.iter_mut().zip(y) {
                    sum[c] += weighted * y;
                }
            }
        }
        let mut worst = 0.0f64;
        for (row, want) in device.rows().iter().zip(exact) {
            for c in 0..3 {
                worst = worst.max((f64::from(row[c]) - want[c]).abs() / size[c]);
            }
        }
        println!("projection of {count} samples, order {order}: {worst:.1e}");
        // Measured 8e-8 of the summed light: sums of 16 in order, then a tree; the basis has up to 8e-7 (spec 1).
        assert!(worst < 5e-7, "{count} samples, order {order}: {worst}");
        assert!(device.rgb[order * order..].iter().all(|row| *row == [0.0; 3]));
        let again = engine.project_sh(&samples, order).unwrap();
        assert_eq!(device.rgb.map(|row| row.map(f32::to_bits)), again.rgb.map(|row| row.map(f32::to_bits)));
    }
}

/// Two software devices at work at once in one process slow each other down a hundredfold.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn all_kernels(backend: Backend) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let test = format!("twins on {}", backend.name());
    let mut engine = match GpuEngine::new(Some(backend)) {
        Ok(engine) => engine,
        Err(error) => return support::skip_gpu(&test, &error.to_string()),
    };
    println!("{}", engine.description());
    merge_matches(&mut engine);
    projection_matches_and_repeats(&mut engine);
    let mut timings = Vec::new();
    engine.take_timings(&mut timings);
    println!("{timings:?}");
}

#[test]
fn vulkan_matches_the_twins() {
    all_kernels(Backend::Vulkan);
}

#[test]
fn gl_matches_the_twins() {
    all_kernels(Backend::Gl);
}
