//! One JPEG file of a stream. A file that is cut, or that leaves its Huffman tables out, is an error here.

use super::DevelopError;
use crate::model::{image::Rgb8Image, pixels::FramePixels};
use image::{ColorType, ImageDecoder, codecs::jpeg::JpegDecoder};
use std::io::Cursor;

/// Decodes into `out`, which is reshaped; `samples` keeps its memory.
pub fn decode(pixels: &FramePixels, samples: &mut Vec<u8>, out: &mut Rgb8Image) -> Result<(), DevelopError> {
    let bytes = pixels.bytes();
    let fail = |why: String| DevelopError::Jpeg { length: bytes.len(), why };
    let whole = whole_file(bytes).map_err(|why| fail(why.to_owned()))?;
    let decoder = JpegDecoder::new(Cursor::new(whole)).map_err(|e| fail(e.to_string()))?;
    let (width, height) = decoder.dimensions();
    let wanted = (pixels.width(), pixels.height());
    if (width as usize, height as usize) != wanted {
        return Err(fail(format!("it is {width} x {height}, must be {} x {}", wanted.0, wanted.1)));
    }
    let color = decoder.color_type();
    if !matches!(color, ColorType::Rgb8 | ColorType::L8) {
        return Err(fail(format!("its samples are {color:?}, must be gray or YCbCr of 8 bits")));
    }
    samples.clear();
    samples.resize(usize::try_from(decoder.total_bytes()).unwrap_or(0), 0);
    decoder.read_image(samples).map_err(|e| fail(e.to_string()))?;
    out.reshape(wanted.0, wanted.1, [0; 3]);
    match color {
        ColorType::L8 => out.pixels_mut().iter_mut().zip(&*samples).for_each(|(out, y)| *out = [*y; 3]),
        _ => out.pixels_mut().as_flattened_mut().copy_from_slice(samples),
    }
    Ok(())
}

/// The file from its first marker to its last; drivers may fill a buffer up with bytes after it. An error where it is cut or
/// cannot be decoded on its own.
fn whole_file(bytes: &[u8]) -> Result<&[u8], &'static str> {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return Err("it does not begin as a JPEG file");
    }
    let (mut at, mut has_tables, mut has_size) = (2, false, false);
    // Segments up to the scan: marker, length, content.
    loop {
        let Some(&[0xff, marker]) = bytes.get(at..at + 2) else { return Err("it ends before its scan") };
        match marker {
            // A fill byte before a marker.
            0xff => {
                at += 1;
                continue;
            }
            0xc4 => has_tables = true,
            0xc0..=0xc2 => has_size = true,
            0xd9 => return Err("it ends before its scan"),
            _ => {}
        }
        let Some(&[high, low]) = bytes.get(at + 2..at + 4) else { return Err("it ends before its scan") };
        let length = usize::from(u16::from_be_bytes([high, low]));
        if length < 2 {
            return Err("a segment has no length");
        }
        at += 2 + length;
        if marker == 0xda {
            break;
        }
    }
    if !has_size {
        return Err("it has no size before its scan");
    }
    if !has_tables {
        return Err("it has no Huffman tables");
    }
    let end = bytes.get(at..).and_then(|scan| scan.windows(2).rposition(|pair| pair == [0xff, 0xd9]));
    end.map(|end| &bytes[..at + end + 2]).ok_or("it is cut: it has no end")
}
