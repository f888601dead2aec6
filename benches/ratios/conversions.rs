//! A camera's bytes to linear light, against OpenCV's conversion with its table for each format, and zune-jpeg's decoder.

use crate::opencv::{self, OpenCv};
use crate::timing::time_ms;
use halflight::{
    hdr::develop::{Developer, SensorOptions},
    math::dice::Dice,
    model::{
        image::RadianceImage,
        pixels::{BayerDepth, BayerOrder, FramePixels, PixelFormat, PixelLayout},
        response::Response,
    },
};
use std::{hint::black_box, sync::Arc};
use zune_jpeg::{JpegDecoder, zune_core::bytestream::ZCursor};

const RUNS: usize = 31;

/// Prints the figures.
pub fn run() {
    println!("camera formats to linear RGB (f32), {} threads", rayon::current_num_threads());
    for (width, height) in [(640, 480), (1920, 1080)] {
        for (name, format) in [
            ("YUYV", PixelFormat::Yuyv),
            ("NV12", PixelFormat::Nv12),
            ("Bayer10", PixelFormat::Bayer(BayerOrder::Rggb, BayerDepth::Bits10)),
            ("MJPEG", PixelFormat::Mjpeg),
        ] {
            let layout = PixelLayout::packed(format, width, height);
            let bytes = match format {
                PixelFormat::Mjpeg => jpeg(width, height),
                _ => ramp(&layout),
            };
            print(name, layout, &bytes);
        }
    }
}

fn print(name: &str, layout: PixelLayout, bytes: &[u8]) {
    let pixels =
        FramePixels::new(layout, Arc::new(bytes.to_vec()), bytes.len()).expect("as many bytes as it needs");
    let mut developer =
        Developer::new(&Response::srgb(), SensorOptions::default()).expect("usual options are a sensor's");
    let mut out = RadianceImage::default();
    let mut ours =
        || time_ms(RUNS, || developer.linear(black_box(&pixels), &mut out).expect("a sound picture")).0;
    let two = ours();
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let one = one_thread.install(&mut ours);
    let size = format!("{} x {}", layout.width, layout.height);
    print!("  {name:8}{size:>12}  ours {two:8.3} ms, one thread {one:8.3}");
    match opencv::convert(name, layout.width, layout.height, bytes) {
        Ok(OpenCv { median_ms, what, .. }) => {
            print!("   {what} {median_ms:8.3} ms, ratio {:5.2}", two / median_ms);
        }
        Err(why) => print!("   OpenCV SKIPPED: {why}"),
    }
    if layout.format == PixelFormat::Mjpeg {
        let (theirs, _) = time_ms(RUNS, || {
            let decoder = &mut JpegDecoder::new(ZCursor::new(black_box(bytes)));
            black_box(decoder.decode().expect("a sound file"));
        });
        print!("   zune-jpeg alone, to 8 bits {theirs:8.3} ms, ratio {:5.2}", one / theirs);
    }
    println!();
}

/// A slope with noise, in every plane.
fn ramp(layout: &PixelLayout) -> Vec<u8> {
    let mut dice = Dice::new(3);
    let values = (0..layout.least_bytes()).map(|i| {
        let slope = (i % layout.stride) as f32 / layout.stride as f32;
        (200.0 * slope + 40.0 * dice.unit_f32()) as u8
    });
    values.collect()
}

fn jpeg(width: usize, height: usize) -> Vec<u8> {
    let rgb = ramp(&PixelLayout::packed(PixelFormat::Rgb24, width, height));
    let mut file = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, 85);
    image::ImageEncoder::write_image(
        encoder,
        &rgb,
        width as u32,
        height as u32,
        image::ExtendedColorType::Rgb8,
    )
    .expect("memory takes every file");
    file
}
