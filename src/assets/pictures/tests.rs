use super::*;
use proptest::prelude::*;
use std::{fmt::Write as _, io::Cursor};

fn name() -> &'static Path {
    Path::new("some.hdr")
}

/// A run-length encoded row, as scanners of the format expect it: runs of 3 or more, the rest literal.
fn rle_row(row: &[[u8; 4]]) -> Vec<u8> {
    let mut out = vec![2, 2, (row.len() >> 8) as u8, row.len() as u8];
    for component in 0..4 {
        let mut x = 0;
        while x < row.len() {
            let byte = row[x][component];
            let run = row[x..].iter().take(127).take_while(|p| p[component] == byte).count();
            if run > 2 {
                out.extend([128 + run as u8, byte]);
                x += run;
            } else {
                out.extend([1, byte]);
                x += 1;
            }
        }
    }
    out
}

fn hdr_file(header: &str, width: usize, rows: &[Vec<[u8; 4]>]) -> Vec<u8> {
    let mut text = String::new();
    write!(text, "{header}\n\n-Y {} +X {width}\n", rows.len()).unwrap();
    let mut bytes = text.into_bytes();
    rows.iter().for_each(|row| bytes.extend(rle_row(row)));
    bytes
}

fn gradient(width: usize, height: usize) -> RadianceImage {
    let pixels = (0..width * height)
        .map(|i| [0.01 + i as f32, 1.0 / (1.0 + i as f32), if i % 3 == 0 { 0.0 } else { 700.0 }])
        .collect();
    Image::from_pixels(width, height, pixels).unwrap()
}

#[test]
fn a_line_before_the_identifier_is_read_and_without_identifier_is_refused() {
    let rows = vec![vec![[128, 64, 32, 129]; 9]; 2];
    let good = hdr_file("VIEW= -vtv -vh 90\n#?RADIANCE\nFORMAT=32-bit_rle_rgbe", 9, &rows);
    let picture = decode_radiance(name(), &good).unwrap();
    assert_eq!(picture.hdr.radiance.pixels(), [[1.0, 0.5, 0.25]; 18]);
    let bad = hdr_file("FORMAT=32-bit_rle_rgbe\n#?OTHER", 9, &rows);
    assert!(decode_radiance(name(), &bad).unwrap_err().to_string().contains("#?RADIANCE"));
}

#[test]
fn exposure_is_divided_out_and_foreign_headers_are_refused() {
    let rows = vec![vec![[128, 64, 32, 129]; 8]];
    let picture =
        decode_radiance(name(), &hdr_file("#?RADIANCE\nEXPOSURE=2\nEXPOSURE= 2.0", 8, &rows)).unwrap();
    assert_eq!(picture.hdr.radiance.at(0, 0), &[0.25, 0.125, 0.0625]);
    for line in ["EXPOSURE=0", "EXPOSURE=nan", "FORMAT=32-bit_rle_xyze", "GAMMA=2.2", "COLORCORR=1 2"] {
        let error = decode_radiance(name(), &hdr_file(&format!("#?RADIANCE\n{line}"), 8, &rows)).unwrap_err();
        let key = line.split('=').next().unwrap();
        assert!(error.to_string().contains(key), "{error}");
    }
    let crlf = b"#?RADIANCE\r\n\r\n-Y 1 +X 8\r\n".to_vec();
    assert!(decode_radiance(name(), &crlf).unwrap_err().to_string().contains("CR LF"));
}

#[test]
fn flat_pixels_and_old_repeats_are_read_and_flips_undone() {
    let mut bytes = b"#?RGBE\n\n+Y 2 -X 4\n".to_vec();
    bytes.extend([[128, 0, 0, 129], [1, 1, 1, 3]].concat());
    bytes.extend([[0, 128, 0, 129], [0, 0, 128, 129], [1, 1, 1, 2]].concat());
    let picture = decode_radiance(name(), &bytes).unwrap().hdr.radiance;
    assert_eq!(picture.row(0), [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]);
    assert_eq!(picture.row(1), [[1.0, 0.0, 0.0]; 4]);
}

#[test]
fn a_header_that_lies_about_the_size_is_refused_before_memory_is_taken() {
    for size in ["-Y 100000 +X 100000", "-Y 0 +X 8", "-Y -3 +X 8", "-Y 16384 +X 16384", "+X 8 -Y 8", "-Y 8"] {
        let bytes = format!("#?RADIANCE\n\n{size}\n");
        assert!(decode_radiance(name(), bytes.as_bytes()).is_err(), "{size}");
    }
    // A PNG that claims 60000 x 60000, with a sound checksum of its header.
    let mut png = Vec::new();
    image::DynamicImage::new_rgb8(2, 2)
        .write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png)
        .unwrap();
    png[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let crc = png_crc(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    let error = decode_rgb8(name(), &png).unwrap_err().to_string();
    assert!(error.contains("limit") || error.contains("16384"), "{error}");
}

fn png_crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    })
}

#[test]
fn hdr_comes_back_to_its_mantissa_and_png_as_it_is() {
    let folder = std::env::temp_dir().join(format!("halflight-pictures-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let picture = gradient(37, 19);
    let hdr = folder.join("a.hdr");
    save_hdr(&hdr, &picture).unwrap();
    for (a, b) in load_radiance(&hdr).unwrap().hdr.radiance.pixels().iter().zip(picture.pixels()) {
        let largest = b.iter().fold(0.0f32, |m, &c| m.max(c));
        // Half a mantissa step; the largest mantissa is at least 128.
        assert!((0..3).all(|c| (a[c] - b[c]).abs() <= largest / 255.0), "{a:?} {b:?}");
    }
    let png = folder.join("a.png");
    let bytes: Vec<[u8; 3]> = (0..60).map(|i| [i as u8, 255 - i as u8, 7]).collect();
    let small = Image::from_pixels(10, 6, bytes).unwrap();
    save_png(&png, &small).unwrap();
    // It says that it is sRGB, with the right checksum.
    let written = std::fs::read(&png).unwrap();
    assert_eq!(&written[37..41], b"sRGB");
    assert_eq!(written[42..46], png_crc(&written[37..42]).to_be_bytes());
    assert_eq!(load_rgb8(&png).unwrap(), small);
    assert!((load_radiance(&png).unwrap().hdr.radiance.at(0, 0)[1] - 1.0).abs() < 1e-6);
    let mask = Image::from_pixels(3, 2, vec![0u8, 1, 2, 253, 254, 255]).unwrap();
    save_png_gray(&png, &mask).unwrap();
    assert_eq!(load_gray8(&png).unwrap(), mask);
    assert!(load_rgb8(&hdr).unwrap_err().to_string().contains("PNG or JPEG"));
    assert!(save_png(&png, &Image::default()).is_err());
    std::fs::remove_dir_all(&folder).unwrap();
}

fn sources() -> Vec<Vec<u8>> {
    let picture = gradient(24, 9);
    let mut png = Vec::new();
    let mut jpeg = Vec::new();
    let ldr = image::DynamicImage::from(image::RgbImage::from_fn(24, 9, |x, y| {
        image::Rgb([x as u8 * 9, y as u8 * 20, (x * y) as u8])
    }));
    ldr.write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    ldr.write_to(&mut Cursor::new(&mut jpeg), image::ImageFormat::Jpeg).unwrap();
    let rows: Vec<Vec<[u8; 4]>> =
        (0..9u8).map(|y| (0..24u8).map(|x| [x / 5 * 9, 200, y, 120 + y]).collect()).collect();
    vec![png, jpeg, radiance::encode(&picture), hdr_file("#?RADIANCE", 24, &rows)]
}

/// No decoder fills in what is missing.
#[test]
fn a_cut_file_is_refused_or_has_lost_nothing() {
    for bytes in sources() {
        let whole = decode_radiance(name(), &bytes).unwrap();
        let mut refused = 0;
        for length in 0..bytes.len() {
            match decode_radiance(name(), &bytes[..length]) {
                Ok(loaded) => assert_eq!(loaded, whole, "{length} of {}", bytes.len()),
                Err(_) => refused += 1,
            }
        }
        // A PNG's end chunk of 12 bytes holds nothing, and its data's checksum stands before it.
        assert!(refused + 20 > bytes.len(), "{refused} of {}", bytes.len());
    }
}

#[test]
fn indented_keys_are_of_another_picture() {
    let rows = vec![vec![[128, 64, 32, 129]; 8]];
    let header = "#?RADIANCE\npfilt -x 8\n\tEXPOSURE=4\n\tFORMAT=32-bit_rle_xyze\n GAMMA=2.2\nEXPOSURE=2";
    let picture = decode_radiance(name(), &hdr_file(header, 8, &rows)).unwrap();
    assert_eq!(picture.hdr.radiance.at(0, 0), &[0.5, 0.25, 0.125]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn run_length_rows_come_back(rows in prop::collection::vec(prop::collection::vec(
        prop::array::uniform4(prop_oneof![Just(0u8), Just(7), any::<u8>()]), 20), 1..4)) {
        let picture = radiance::decode(name(), &hdr_file("#?RADIANCE", 20, &rows)).unwrap();
        for (row, bytes) in rows.iter().enumerate() {
            for (x, rgbe) in bytes.iter().enumerate() {
                let scale = if rgbe[3] == 0 { 0.0 } else { 2f64.powi(i32::from(rgbe[3]) - 136) };
                let expected = [0, 1, 2].map(|c| (f64::from(rgbe[c]) * scale) as f32);
                prop_assert_eq!(picture.at(x, row), &expected);
            }
        }
    }

    /// Whatever happens to the bytes: an error or a picture that is finite and not negative, and no panic.
    #[test]
    fn damaged_files_give_an_error_or_a_sound_picture(
        which in 0usize..4,
        keep in 0.0f64..1.2,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
    ) {
        let mut bytes = sources().swap_remove(which);
        let length = ((bytes.len() as f64 * keep) as usize).min(bytes.len());
        bytes.truncate(length);
        for (index, byte) in flips {
            if !bytes.is_empty() {
                let at = index.index(bytes.len());
                bytes[at] = byte;
            }
        }
        if let Ok(loaded) = decode_radiance(name(), &bytes) {
            let sound = loaded.hdr.radiance.pixels().as_flattened().iter().all(|c| c.is_finite() && *c >= 0.0);
            prop_assert!(sound);
        }
        let _ = decode_rgb8(name(), &bytes);
    }

    #[test]
    fn noise_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(decode_radiance(name(), &bytes).is_err());
    }
}
