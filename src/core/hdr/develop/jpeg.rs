//! One JPEG file of a stream. A file that is cut is an error here; one that leaves its Huffman tables out
//! is read with the standard ones.

use super::DevelopError;
use crate::model::{image::Rgb8Image, jpeg, pixels::FramePixels};
use image::{ColorType, ImageDecoder, codecs::jpeg::JpegDecoder};
use std::io::Cursor;

/// Decodes into `out`, which is reshaped; `samples` keeps its memory.
pub fn decode(pixels: &FramePixels, samples: &mut Vec<u8>, out: &mut Rgb8Image) -> Result<(), DevelopError> {
    let bytes = pixels.bytes();
    let fail = |why: String| DevelopError::Jpeg { length: bytes.len(), why };
    let file = jpeg::whole(bytes).map_err(fail)?;
    let decoder = JpegDecoder::new(Cursor::new(file.with_tables())).map_err(|e| fail(e.to_string()))?;
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
