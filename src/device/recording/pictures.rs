//! Pictures as Foxglove's image messages (protobuf). Pure.

use super::messages::Time;
use super::schema::{COMPRESSED_IMAGE, RAW_IMAGE};
use super::wire::{WireField, WireWriter, fields};
use crate::model::{image::Rgb8Image, jpeg, time::Timestamp};
use image::{ExtendedColorType, ImageEncoder, ImageFormat, codecs};

/// How pictures are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureCoding {
    /// JPEG of quality 1 to 100; loses a little.
    Jpeg(u8),
    /// PNG, exact.
    Png,
    /// As they are, exact (the chunks are compressed all the same).
    Raw,
}

fn put_time(w: &mut WireWriter, t: Timestamp) {
    let Time { sec, nsec } = t.into();
    w.message(1, |w| {
        w.varint(1, sec as u64).varint(2, u64::from(nsec));
    });
}

/// A picture as `foxglove.CompressedImage` or `foxglove.RawImage`.
pub fn write_image(
    t: Timestamp,
    image: &Rgb8Image,
    coding: PictureCoding,
) -> Result<Vec<u8>, image::ImageError> {
    let (width, height) = (image.width() as u32, image.height() as u32);
    let pixels: &[u8] = bytemuck::cast_slice(image.pixels());
    let mut w = WireWriter::new();
    put_time(&mut w, t);
    let (format, coded) = match coding {
        PictureCoding::Raw => {
            w.bytes(7, b"camera").fixed32(2, width).fixed32(3, height).bytes(4, b"rgb8");
            w.fixed32(5, 3 * width).bytes(6, pixels);
            return Ok(w.finish());
        }
        PictureCoding::Jpeg(quality) => {
            let mut out = Vec::new();
            codecs::jpeg::JpegEncoder::new_with_quality(&mut out, quality.clamp(1, 100)).write_image(
                pixels,
                width,
                height,
                ExtendedColorType::Rgb8,
            )?;
            ("jpeg", out)
        }
        PictureCoding::Png => {
            let mut out = Vec::new();
            codecs::png::PngEncoder::new(&mut out).write_image(
                pixels,
                width,
                height,
                ExtendedColorType::Rgb8,
            )?;
            ("png", out)
        }
    };
    w.bytes(4, b"camera").bytes(2, &coded).bytes(3, format.as_bytes());
    Ok(w.finish())
}

/// The picture of an image message of this schema.
pub fn read_image(schema: &str, message: &[u8]) -> Result<Rgb8Image, String> {
    let mut found = [None; 8];
    for field in fields(message) {
        let (number, content) = field.ok_or("the message is not valid protobuf")?;
        if let Some(slot) = found.get_mut(number as usize) {
            *slot = Some(content);
        }
    }
    let bytes = |n: usize| match found[n] {
        Some(WireField::Bytes(b)) => b,
        _ => &[],
    };
    let fixed = |n: usize| match found[n] {
        Some(WireField::Fixed32(x)) => x as usize,
        _ => 0,
    };
    match schema {
        COMPRESSED_IMAGE => {
            let format = match bytes(3) {
                b"jpeg" | b"jpg" => ImageFormat::Jpeg,
                b"png" => ImageFormat::Png,
                other => {
                    let name = String::from_utf8_lossy(other).into_owned();
                    return Err(format!("format \"{name}\": must be jpeg or png"));
                }
            };
            if format == ImageFormat::Jpeg {
                jpeg::whole(bytes(2))?;
            }
            let picture = image::load_from_memory_with_format(bytes(2), format).map_err(|e| e.to_string())?;
            let picture = picture.into_rgb8();
            let (width, height) = (picture.width() as usize, picture.height() as usize);
            let pixels = picture.as_raw().chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
            Rgb8Image::from_pixels(width, height, pixels).ok_or_else(|| "the picture has a wrong size".into())
        }
        RAW_IMAGE => {
            let (width, height, step) = (fixed(2), fixed(3), fixed(5));
            let (encoding, pixels) = (bytes(4), bytes(6));
            let whole = width.checked_mul(3).is_some_and(|row| row <= step)
                && step.checked_mul(height).is_some_and(|all| all == pixels.len())
                && width > 0
                && height > 0;
            if encoding != b"rgb8" || !whole {
                return Err(format!(
                    "{width} x {height}, step {step}, encoding \"{}\", {} bytes: must be rgb8 and step x height bytes",
                    String::from_utf8_lossy(encoding),
                    pixels.len()
                ));
            }
            let rows = pixels.chunks_exact(step).flat_map(|row| row[..3 * width].chunks_exact(3));
            Rgb8Image::from_pixels(width, height, rows.map(|p| [p[0], p[1], p[2]]).collect())
                .ok_or_else(|| "the picture has a wrong size".into())
        }
        other => Err(format!("schema \"{other}\": must be {COMPRESSED_IMAGE} or {RAW_IMAGE}")),
    }
}
