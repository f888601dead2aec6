//! Every format against a plain reference in f64.

use super::*;
use crate::math::dice::Dice;
use crate::model::pixels::{BayerDepth, BayerOrder, PixelLayout, PixelPool, YuvMatrix, YuvRange};
use crate::model::sensor::CLIPPED;
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
use proptest::prelude::*;

fn developer(options: SensorOptions) -> Developer {
    Developer::new(&Response::srgb(), options).unwrap()
}

fn pixels_of(layout: PixelLayout, bytes: Vec<u8>) -> FramePixels {
    let used = bytes.len();
    FramePixels::new(layout, Arc::new(bytes), used).unwrap()
}

/// Bytes without a pattern.
fn bytes(seed: u64, count: usize) -> Vec<u8> {
    let mut dice = Dice::new(seed);
    (0..count).map(|_| (dice.bits() >> 56) as u8).collect()
}

/// Y, Cb, Cr at a pixel, straight from the definition of the format.
fn yuv_at(pixels: &FramePixels, x: usize, y: usize) -> [u8; 3] {
    let (layout, all) = (*pixels.layout(), pixels.bytes());
    let at = |row: usize, byte: usize| all[row * layout.stride + byte];
    let even = x - x % 2;
    match layout.format {
        PixelFormat::Yuyv => [at(y, 2 * x), at(y, 2 * even + 1), at(y, 2 * even + 3)],
        PixelFormat::Uyvy => [at(y, 2 * x + 1), at(y, 2 * even), at(y, 2 * even + 2)],
        PixelFormat::Nv12 => {
            let chroma = layout.height + y / 2;
            [at(y, x), at(chroma, even), at(chroma, even + 1)]
        }
        _ => [at(y, x), 128, 128],
    }
}

/// RGB as the standard's two steps have it: to analog values, then the inverse of the matrix Y = k . rgb.
fn rgb_reference(yuv: [u8; 3], range: YuvRange, matrix: YuvMatrix) -> [f64; 3] {
    let [y, cb, cr] = yuv.map(f64::from);
    let (y, cb, cr) = match range {
        YuvRange::Full => (y / 255.0, (cb - 128.0) / 255.0, (cr - 128.0) / 255.0),
        YuvRange::Limited => ((y - 16.0) / 219.0, (cb - 128.0) / 224.0, (cr - 128.0) / 224.0),
    };
    let (kr, kb) = match matrix {
        YuvMatrix::Bt601 => (0.299, 0.114),
        YuvMatrix::Bt709 => (0.2126, 0.0722),
    };
    let red = y + cr * 2.0 * (1.0 - kr);
    let blue = y + cb * 2.0 * (1.0 - kb);
    let green = (y - kr * red - kb * blue) / (1.0 - kr - kb);
    [red, green, blue].map(|v| (v * 255.0).clamp(0.0, 255.0))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// YUYV, UYVY, NV12 and GREY of any size and stride, in both ranges and matrices.
    #[test]
    fn yuv_is_the_standards_to_half_a_value(
        which in 0usize..4, width in 1usize..24, height in 1usize..12, padding in 0usize..7,
        limited: bool, bt709: bool, seed: u64,
    ) {
        let format = [PixelFormat::Yuyv, PixelFormat::Uyvy, PixelFormat::Nv12, PixelFormat::Grey][which];
        let mut layout = PixelLayout::packed(format, width, height);
        layout.stride += padding;
        layout.range = if limited { YuvRange::Limited } else { YuvRange::Full };
        layout.matrix = if bt709 { YuvMatrix::Bt709 } else { YuvMatrix::Bt601 };
        let pixels = pixels_of(layout, bytes(seed, layout.least_bytes()));
        let mut developer = developer(SensorOptions::default());
        let (mut image, mut light) = (Rgb8Image::default(), RadianceImage::default());
        developer.rgb8(&pixels, &mut image).unwrap();
        developer.linear(&pixels, &mut light).unwrap();
        let response = Response::srgb();
        for y in 0..height {
            for x in 0..width {
                let exact = rgb_reference(yuv_at(&pixels, x, y), layout.range, layout.matrix);
                for c in 0..3 {
                    let value = image.at(x, y)[c];
                    // Half a value by rounding; 1e-3 by f32 in a sum of numbers up to 500.
                    prop_assert!((f64::from(value) - exact[c]).abs() <= 0.501, "{x} {y} {c}: {value} {}", exact[c]);
                    prop_assert_eq!(light.at(x, y)[c], response.log_exposure()[c][usize::from(value)].exp());
                }
            }
        }
    }

    /// RGB24 with any stride is copied.
    #[test]
    fn rgb_is_copied(width in 1usize..24, height in 1usize..12, padding in 0usize..7, seed: u64) {
        let mut layout = PixelLayout::packed(PixelFormat::Rgb24, width, height);
        layout.stride += padding;
        let pixels = pixels_of(layout, bytes(seed, layout.least_bytes()));
        let mut image = Rgb8Image::default();
        developer(SensorOptions::default()).rgb8(&pixels, &mut image).unwrap();
        for y in 0..height {
            prop_assert_eq!(image.row(y).as_flattened(), pixels.row(y));
        }
    }

    /// Bayer of any order, depth, size and stride, against the mean of neighbours in f64.
    #[test]
    fn bayer_is_the_mean_of_neighbours(
        order in 0usize..4, depth in 0usize..6, width in 1usize..14, height in 1usize..10, padding in 0usize..5,
        black in 0.0f32..0.3, seed: u64,
    ) {
        let (order, depth) = (BayerOrder::ALL[order], BayerDepth::ALL[depth]);
        let mut layout = PixelLayout::packed(PixelFormat::Bayer(order, depth), width, height);
        layout.stride += padding;
        let pixels = pixels_of(layout, bytes(seed, layout.least_bytes()));
        let options = SensorOptions { black, white: 0.9, white_balance: [1.7, 1.0, 2.2] };
        let mut developer = developer(options);
        let (mut image, mut light) = (Rgb8Image::default(), RadianceImage::default());
        developer.rgb8(&pixels, &mut image).unwrap();
        developer.linear(&pixels, &mut light).unwrap();
        let developed = developer.develop(&pixels).unwrap();
        prop_assert!(*developed.pixels == image);
        prop_assert_eq!(developed.sensor.is_some(), depth != BayerDepth::Bits8);
        let white = f64::from(depth.white());
        let linear = |x: usize, y: usize| {
            let raw = f64::from(depth.value(pixels.row(y), x)) - f64::from(black) * white;
            raw.max(0.0) / ((0.9 - f64::from(black)) * white)
        };
        let response = Response::srgb();
        for y in 0..height {
            for x in 0..width {
                for c in 0..3 {
                    let near = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
                    let same: Vec<f64> = near(y, height)
                        .flat_map(|v| near(x, width).map(move |u| (u, v)))
                        .filter(|&(u, v)| order.channel(u, v) == c)
                        .map(|(u, v)| linear(u, v))
                        .collect();
                    let is_own = order.channel(x, y) == c || same.is_empty();
                    let mean = if is_own { linear(x, y) } else { same.iter().sum::<f64>() / same.len() as f64 };
                    let exact = mean * f64::from(options.white_balance[c]);
                    let found = f64::from(light.at(x, y)[c]);
                    // sRGB's exposure at 255 is 1. f32: a few units of 6e-8, of numbers up to 65535 / 39321 x 2.2 with black.
                    prop_assert!((found - exact).abs() <= 3e-6 * (1.0 + exact), "{x} {y} {c}: {found} {exact}");
                    let value = f32::from(image.at(x, y)[c]);
                    let wanted = response.value_of(c, light.at(x, y)[c]);
                    prop_assert!((value - wanted).abs() <= 0.51, "{value} {wanted}");
                    let Some(sensor) = &developed.sensor else { continue };
                    // As the sensor gave it: nothing is cut off below black, and what is saturated takes its neighbours along.
                    let own_or_near: Vec<f64> = near(y, height)
                        .flat_map(|v| near(x, width).map(move |u| (u, v)))
                        .filter(|&(u, v)| if is_own { (u, v) == (x, y) } else { order.channel(u, v) == c })
                        .map(|(u, v)| f64::from(depth.value(pixels.row(v), u)))
                        .collect();
                    let found = sensor.values.at(x, y)[c];
                    let level = f64::from(black) + 0.98 * (0.9 - f64::from(black));
                    let margin = own_or_near.iter().map(|raw| raw / white - level).fold(f64::MIN, f64::max);
                    if margin.abs() * white <= 1.0 {
                        continue;
                    }
                    prop_assert_eq!(found == CLIPPED, margin > 0.0);
                    if margin < 0.0 {
                        let raw = own_or_near.iter().sum::<f64>() / own_or_near.len() as f64;
                        let exact = (raw - f64::from(black) * white) / ((0.9 - f64::from(black)) * white)
                            * f64::from(options.white_balance[c]);
                        let scale = &sensor.scale;
                        let exposure = f64::from(scale.exposure_per_value[c]) * (f64::from(found) - f64::from(scale.black));
                        // Half a value of rounding, and one that is kept for what is unseen.
                        let allowed = f64::from(scale.exposure_per_value[c]) * 1.01 + 1e-6;
                        prop_assert!((exposure - exact).abs() <= allowed, "{x} {y} {c}: {exposure} {exact}");
                    }
                }
            }
        }
    }

    /// No bytes make the JPEG reader panic.
    #[test]
    fn broken_jpegs_are_errors(cut in 0usize..2000, flips in prop::collection::vec((0usize..2000, 0u8..255), 0..4), drop_end: bool) {
        let mut file = jpeg(24, 16, 80);
        for (at, with) in flips {
            let at = at % file.len();
            file[at] ^= with;
        }
        if drop_end {
            file.truncate((cut % file.len()).max(4));
        }
        let layout = PixelLayout::packed(PixelFormat::Mjpeg, 24, 16);
        let mut image = Rgb8Image::default();
        // Flipped bits may still give a picture: of the right size.
        if developer(SensorOptions::default()).rgb8(&pixels_of(layout, file), &mut image).is_ok() {
            prop_assert_eq!((image.width(), image.height()), (24, 16));
        }
    }
}

/// A smooth picture as a JPEG file.
fn jpeg(width: usize, height: usize, quality: u8) -> Vec<u8> {
    let picture: Vec<u8> = (0..width * height)
        .flat_map(|i| [(5 * (i % width)) as u8 + 60, (6 * (i / width)) as u8 + 40, 100])
        .collect();
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, quality)
        .write_image(&picture, width as u32, height as u32, ExtendedColorType::Rgb8)
        .unwrap();
    file
}

#[test]
fn mjpeg_is_decoded_with_or_without_bytes_after_its_end() {
    let layout = PixelLayout::packed(PixelFormat::Mjpeg, 24, 16);
    let file = jpeg(24, 16, 95);
    let (mut image, mut light) = (Rgb8Image::default(), RadianceImage::default());
    let mut developer = developer(SensorOptions::default());
    developer.rgb8(&pixels_of(layout, file.clone()), &mut image).unwrap();
    for (i, pixel) in image.pixels().iter().enumerate() {
        let exact = [5 * (i % 24) + 60, 6 * (i / 24) + 40, 100];
        // Quality 95 and chroma of half size on a smooth ramp.
        assert!(
            pixel.iter().zip(exact).all(|(a, b)| (i32::from(*a) - b as i32).abs() <= 12),
            "{i} {pixel:?}"
        );
    }
    let padded = [file.as_slice(), &[0u8; 37]].concat();
    let mut again = Rgb8Image::default();
    developer.rgb8(&pixels_of(layout, padded.clone()), &mut again).unwrap();
    assert!(again == image);
    developer.linear(&pixels_of(layout, padded), &mut light).unwrap();
    let response = Response::srgb();
    let [r, ..] = *image.at(3, 5);
    assert_eq!(light.at(3, 5)[0], response.log_exposure()[0][usize::from(r)].exp());
}

#[test]
fn jpegs_that_are_cut_are_refused_with_the_reason_and_tables_are_not_needed() {
    let file = jpeg(24, 16, 80);
    let mut image = Rgb8Image::default();
    let mut refusal = |width: usize, bytes: Vec<u8>| {
        let layout = PixelLayout::packed(PixelFormat::Mjpeg, width, 16);
        developer(SensorOptions::default())
            .rgb8(&pixels_of(layout, bytes), &mut image)
            .unwrap_err()
            .to_string()
    };
    assert!(refusal(24, file[..file.len() - 40].to_vec()).contains("cut: it ends after"));
    assert!(refusal(24, file[..30].to_vec()).contains("cut: it ends after 30 bytes"));
    assert!(refusal(32, file.clone()).contains("it is 24 x 16, must be 32 x 16"));
    assert!(refusal(24, vec![0; 64]).contains("does not begin"));
    // The Huffman tables taken out, as many webcams do.
    let mut bare = file[..2].to_vec();
    let mut at = 2;
    while file[at + 1] != 0xda {
        let length = 2 + usize::from(u16::from_be_bytes([file[at + 2], file[at + 3]]));
        if file[at + 1] != 0xc4 {
            bare.extend_from_slice(&file[at..at + length]);
        }
        at += length;
    }
    bare.extend_from_slice(&file[at..]);
    let layout = PixelLayout::packed(PixelFormat::Mjpeg, 24, 16);
    let of = |bytes: Vec<u8>| {
        let mut image = Rgb8Image::default();
        developer(SensorOptions::default()).rgb8(&pixels_of(layout, bytes), &mut image).unwrap();
        image
    };
    assert!(of(bare) == of(file));
}

#[test]
fn a_saturated_sensor_is_255_and_black_is_0() {
    let layout = PixelLayout::packed(PixelFormat::Bayer(BayerOrder::Grbg, BayerDepth::Bits10), 4, 4);
    let options = SensorOptions { black: 64.0 / 1023.0, white: 1.0, white_balance: [1.9, 1.0, 1.5] };
    let mut image = Rgb8Image::default();
    for (raw, wanted) in [(1023u16, [255; 3]), (64, [0; 3]), (10, [0; 3])] {
        let bytes = raw.to_le_bytes().repeat(16);
        developer(options).rgb8(&pixels_of(layout, bytes), &mut image).unwrap();
        assert!(image.pixels().iter().all(|pixel| *pixel == wanted), "{raw}: {:?}", image.at(0, 0));
    }
    for bad in [
        SensorOptions { black: -0.1, ..options },
        SensorOptions { white: 0.05, ..options },
        SensorOptions { white: f32::NAN, ..options },
        SensorOptions { white_balance: [0.9, 1.0, 1.0], ..options },
    ] {
        assert!(Developer::new(&Response::srgb(), bad).is_err(), "{bad:?}");
    }
}

#[test]
fn an_image_of_ours_stays_itself_and_others_share_a_few_pictures() {
    let mut developer = developer(SensorOptions::default());
    let image = Arc::new(Rgb8Image::filled(4, 2, [9, 8, 7]));
    assert!(Arc::ptr_eq(&developer.develop(&Arc::clone(&image).into()).unwrap().pixels, &image));
    assert_eq!(developer.pictures_made(), 0);
    // A camera with four buffers; whoever uses the pictures holds three of them.
    let layout = PixelLayout::packed(PixelFormat::Yuyv, 4, 2);
    let mut pool = PixelPool::new((0..4).map(|_| vec![0u8; layout.least_bytes()]));
    let mut held: Vec<Arc<Rgb8Image>> = Vec::new();
    for frame in 0..200u8 {
        let (k, memory) = pool.free().unwrap();
        memory.iter_mut().enumerate().for_each(|(i, b)| *b = if i % 2 == 0 { frame } else { 128 });
        let pixels = pool.lend(k, layout, layout.least_bytes()).unwrap().unwrap();
        let picture = developer.develop(&pixels).unwrap().pixels;
        assert!(picture.pixels().iter().all(|pixel| *pixel == [frame; 3]));
        held.push(picture);
        if held.len() > 3 {
            held.remove(0);
        }
        assert!(held.iter().rev().enumerate().all(|(age, p)| p.at(0, 0)[0] == frame - age as u8));
    }
    assert!(developer.pictures_made() <= 4, "{}", developer.pictures_made());
}

#[test]
fn wide_rows_are_what_single_pixels_give() {
    for order in BayerOrder::ALL {
        for depth in BayerDepth::ALL {
            for width in [3, 65, 66, 67, 200] {
                let layout = PixelLayout::packed(PixelFormat::Bayer(order, depth), width, 5);
                let pixels = pixels_of(layout, bytes(width as u64, layout.least_bytes()));
                let options = SensorOptions { black: 0.06, white: 0.9, white_balance: [1.7, 1.0, 1.3] };
                let developer = developer(options);
                let sensor = developer.sensor(&pixels).unwrap();
                for y in 0..5 {
                    let mut seen = vec![0; width];
                    sensor.each_pixel(y, |x, exposure, values| {
                        assert_eq!(
                            (exposure, values),
                            sensor.pixel(x, y),
                            "{order:?} {depth:?} {width} {x} {y}"
                        );
                        seen[x] += 1;
                    });
                    assert_eq!(seen, vec![1; width]);
                }
            }
        }
    }
}
