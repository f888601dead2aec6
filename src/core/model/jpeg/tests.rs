use super::*;
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};

fn segment(marker: u8, content: &[u8]) -> Vec<u8> {
    let length = (content.len() + 2) as u16;
    [&[0xff, marker], &length.to_be_bytes()[..], content].concat()
}

/// 32 x 16 pixels, 4:2:0, gray, a restart interval of one unit of 16 x 16, no tables; each unit is coded in 4 bytes.
fn picture(restarts: usize) -> Vec<u8> {
    let mut bytes = vec![0xff, 0xd8];
    bytes.extend(segment(0xe0, b"JFIF\0\xff\xd9"));
    bytes.extend(segment(0xc0, &[8, 0, 16, 0, 32, 3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1]));
    bytes.extend(segment(0xdd, &[0, 1]));
    bytes.extend(segment(0xda, &[3, 1, 0, 2, 0x11, 3, 0x11, 0, 63, 0]));
    for k in 0..=restarts {
        // Four times: no change (00), the end of the block (1010); twice: 00, 00.
        bytes.extend([0x28, 0xa2, 0x8a, 0x00]);
        if k < restarts {
            bytes.extend([0xff, 0xd0 + (k % 8) as u8]);
        }
    }
    bytes.extend([0xff, 0xd9]);
    bytes
}

/// A textured picture without restart intervals, and where its coded data begins and ends.
fn noisy(color: ExtendedColorType) -> (Vec<u8>, usize, usize) {
    let (width, height) = (144u32, 112u32);
    let channels = if color == ExtendedColorType::L8 { 1 } else { 3 };
    let value = |i: u32| (i.wrapping_mul(2_654_435_761) >> 28) as u8 + (i / channels % width) as u8;
    let samples: Vec<u8> = (0..width * height * channels).map(value).collect();
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
    encoder.write_image(&samples, width, height, color).unwrap();
    let scan = bytes.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
    let start = scan + 2 + usize::from(u16::from_be_bytes([bytes[scan + 2], bytes[scan + 3]]));
    let end = bytes.len() - 2;
    (bytes, start, end)
}

#[test]
fn a_whole_picture_is_whole_whatever_follows() {
    let mut bytes = picture(1);
    let length = bytes.len();
    bytes.extend([0xff, 0xd8, 1, 2, 3]);
    assert_eq!(whole(&bytes), Ok(WholeJpeg { bytes: &bytes[..length], has_huffman_tables: false }));
    for color in [ExtendedColorType::Rgb8, ExtendedColorType::L8] {
        let (bytes, ..) = noisy(color);
        assert_eq!(whole(&bytes), Ok(WholeJpeg { bytes: &bytes, has_huffman_tables: true }));
    }
}

#[test]
fn every_cut_is_noticed() {
    for bytes in [picture(1), noisy(ExtendedColorType::Rgb8).0] {
        for length in 0..bytes.len() {
            assert!(whole(&bytes[..length]).is_err(), "{length} of {}", bytes.len());
        }
    }
}

/// A bus that loses packets: data is missing in the middle, the end is there.
#[test]
fn data_lost_in_the_middle_is_noticed() {
    for color in [ExtendedColorType::Rgb8, ExtendedColorType::L8] {
        let (bytes, start, end) = noisy(color);
        for lost in [256, 512, 1024] {
            for from in (start..end - lost).step_by(37) {
                let left = [&bytes[..from], &bytes[from + lost..]].concat();
                assert!(whole(&left).is_err(), "{color:?}: {lost} bytes at {from} of {end}");
            }
        }
    }
}

#[test]
fn a_lost_interval_or_component_is_noticed() {
    assert_eq!(whole(&picture(0)), Err("cut: its scan holds 1 of 2 coded units".into()));
    // The scan is said to hold luminance alone: units of one block, of which there are 4 x 2.
    let mut bytes = picture(1);
    let scan = bytes.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
    bytes.splice(scan.., segment(0xda, &[1, 1, 0, 0, 63, 0]));
    // An interval of one unit: a restart marker after each block.
    for k in 0..8u8 {
        bytes.extend([0x28, 0xff, 0xd0 + k]);
    }
    bytes.extend([0xff, 0xd9]);
    assert_eq!(whole(&bytes), Err("cut: it holds 1 of its 3 components".into()));
}

/// Without its tables a file that was coded with the standard ones gives the same pixels once they are put in.
#[test]
fn standard_tables_stand_for_those_left_out() {
    let (bytes, ..) = noisy(ExtendedColorType::Rgb8);
    let mut bare = bytes.clone();
    while let Some(at) = bare.windows(2).position(|pair| pair == [0xff, 0xc4]) {
        let length = 2 + usize::from(u16::from_be_bytes([bare[at + 2], bare[at + 3]]));
        bare.drain(at..at + length);
    }
    assert!(bare.len() + 400 < bytes.len());
    let found = whole(&bare).unwrap();
    assert!(!found.has_huffman_tables);
    let decode = |bytes: &[u8]| {
        image::load_from_memory_with_format(bytes, image::ImageFormat::Jpeg).unwrap().into_rgb8()
    };
    assert_eq!(decode(&found.with_tables()), decode(&bytes));
    // Only one of them left out.
    let mut some = bytes.clone();
    let at = some.windows(2).position(|pair| pair == [0xff, 0xc4]).unwrap();
    let length = 2 + usize::from(u16::from_be_bytes([some[at + 2], some[at + 3]]));
    some.drain(at..at + length);
    let found = whole(&some).unwrap();
    assert!(!found.has_huffman_tables);
    assert_eq!(decode(&found.with_tables()), decode(&bytes));
    assert!(matches!(whole(&bytes).unwrap().with_tables(), Cow::Borrowed(_)));
}

#[test]
fn lengths_that_lie_do_not_panic() {
    for bytes in [picture(1), noisy(ExtendedColorType::L8).0[..700].to_vec()] {
        for at in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xd9, 0xff] {
                let mut changed = bytes.clone();
                changed[at] = value;
                let _ = whole(&changed);
            }
        }
    }
}
