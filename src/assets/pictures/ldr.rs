//! PNG and JPEG, through the image crate, under our size limits.

use super::{MAX_PIXELS, MAX_SIDE, check_size};
use crate::{
    error::AssetError,
    model::{
        image::{Image, RadianceImage, Rgb8Image},
        jpeg,
    },
    whole,
};
use image::{DynamicImage, ExtendedColorType, ImageFormat, ImageReader, Limits};
use std::{borrow::Cow, io::Cursor, path::Path};

fn open(file: &Path, bytes: &[u8], format: ImageFormat) -> Result<DynamicImage, AssetError> {
    let failed = |e: image::ImageError| AssetError::new(file, format!("decode {format:?}")).cause(e);
    let bytes = match format {
        ImageFormat::Jpeg => {
            jpeg::whole(bytes).map_err(|what| AssetError::new(file, "decode Jpeg").cause(what))?.with_tables()
        }
        _ => Cow::Borrowed(bytes),
    };
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(&*bytes), format);
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_SIDE as u32);
        limits.max_image_height = Some(MAX_SIDE as u32);
        // 16-bit RGBA takes 8 bytes a pixel.
        limits.max_alloc = Some(8 * MAX_PIXELS as u64);
        reader.limits(limits);
        reader
    };
    let (width, height) = reader().into_dimensions().map_err(failed)?;
    check_size(file, width as usize, height as usize)?;
    reader().decode().map_err(failed)
}

fn sized<P: Clone>(file: &Path, width: u32, height: u32, pixels: Vec<P>) -> Result<Image<P>, AssetError> {
    let found = pixels.len();
    Image::from_pixels(width as usize, height as usize, pixels).ok_or_else(|| {
        AssetError::new(file, "number of pixels").value(found).allowed(format!("{width} x {height}"))
    })
}

/// Decodes to 8-bit RGB.
pub fn rgb8(file: &Path, bytes: &[u8], format: ImageFormat) -> Result<Rgb8Image, AssetError> {
    let picture = open(file, bytes, format)?.into_rgb8();
    let (width, height) = picture.dimensions();
    sized(file, width, height, picture.pixels().map(|p| p.0).collect())
}

/// Decodes to 8-bit grey.
pub fn gray8(file: &Path, bytes: &[u8], format: ImageFormat) -> Result<Image<u8>, AssetError> {
    let picture = open(file, bytes, format)?.into_luma8();
    let (width, height) = picture.dimensions();
    sized(file, width, height, picture.into_raw())
}

/// Decodes to RGB within 0 to 1 and linearises each channel (16-bit files keep their precision).
pub fn linear(
    file: &Path,
    bytes: &[u8],
    format: ImageFormat,
    decode: impl Fn(f32) -> f32,
) -> Result<RadianceImage, AssetError> {
    let picture = open(file, bytes, format)?.into_rgb32f();
    let (width, height) = picture.dimensions();
    sized(file, width, height, picture.pixels().map(|p| p.0.map(&decode)).collect())
}

/// Bytes of a PNG file's signature and its first chunk, the header.
const HEADER_END: usize = 33;
/// The chunk by which a PNG file says that its values are sRGB: length, name, perceptual intent, checksum.
const SRGB_CHUNK: [u8; 13] = [0, 0, 0, 1, b's', b'R', b'G', b'B', 0, 0xae, 0xce, 0x1c, 0xe9];

/// Writes 8-bit samples as PNG.
pub fn save(
    file: &Path,
    samples: &[u8],
    width: usize,
    height: usize,
    color: ExtendedColorType,
) -> Result<(), AssetError> {
    check_size(file, width, height)?;
    let mut bytes = Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut bytes,
        samples,
        width as u32,
        height as u32,
        color,
        ImageFormat::Png,
    )
    .map_err(|e| AssetError::new(file, "write PNG").cause(e))?;
    let mut bytes = bytes.into_inner();
    // Behind the header, where other programs look for it.
    if bytes.len() > HEADER_END {
        bytes.splice(HEADER_END..HEADER_END, SRGB_CHUNK);
    }
    whole::write(file, bytes)
}
