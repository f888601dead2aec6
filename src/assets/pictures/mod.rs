//! Pictures from and to files: 8-bit (PNG, JPEG) and linear radiance (Radiance HDR). The laboratory reads OpenEXR.
mod ingest;
mod ldr;
mod radiance;

pub use ingest::{LARGEST_RADIANCE, LoadedRadiance, Replaced, ingest};

use super::{
    error::{AssetError, read_file},
    whole,
};
use crate::{
    math::color::srgb_decode,
    model::image::{Image, RadianceImage, Rgb8Image},
};
use std::path::Path;

pub use crate::model::limits::MAX_SIDE;
/// Most pixels of a picture: 67 million, 0.8 GB as radiance.
pub const MAX_PIXELS: usize = 1 << 26;

/// What a file is, by its first bytes (the name's ending is not asked).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PictureFormat {
    Png,
    Jpeg,
    OpenExr,
    Radiance,
}

/// How far into a Radiance file its `#?RADIANCE` line may stand (programs put their own lines before it).
const RADIANCE_HEADER_BYTES: usize = 4096;

fn format_of(file: &Path, bytes: &[u8]) -> Result<PictureFormat, AssetError> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return Ok(PictureFormat::Png);
    }
    if bytes.starts_with(&[0xff, 0xd8, 0xff]) {
        return Ok(PictureFormat::Jpeg);
    }
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return Ok(PictureFormat::OpenExr);
    }
    let head = &bytes[..bytes.len().min(RADIANCE_HEADER_BYTES)];
    if head.windows(2).any(|pair| pair == b"#?") {
        return Ok(PictureFormat::Radiance);
    }
    let first: Vec<String> = bytes.iter().take(4).map(|b| format!("{b:02x}")).collect();
    Err(AssetError::new(file, "first bytes")
        .value(first.join(" "))
        .allowed("a PNG, JPEG, OpenEXR or Radiance picture"))
}

/// Refuses sizes beyond `MAX_SIDE` and `MAX_PIXELS` and empty pictures, before anything is allocated.
///
/// # Errors
/// File and size are named.
pub fn check_size(file: &Path, width: usize, height: usize) -> Result<(), AssetError> {
    let sound = (1..=MAX_SIDE).contains(&width)
        && (1..=MAX_SIDE).contains(&height)
        && width.saturating_mul(height) <= MAX_PIXELS;
    sound.then_some(()).ok_or_else(|| {
        AssetError::new(file, "picture size")
            .value(format!("{width} x {height}"))
            .allowed(format!("1 to {MAX_SIDE} pixels a side and at most {MAX_PIXELS} in all"))
    })
}

/// Loads an 8-bit RGB picture as the camera gave it (PNG or JPEG). Grey becomes three equal channels, alpha is
/// dropped, 16-bit PNG is rounded. An orientation tag is not applied: the lens belongs to the stored pixels.
///
/// # Errors
/// The file cannot be read, is of another kind, is damaged, or exceeds the size limits.
pub fn load_rgb8(file: &Path) -> Result<Rgb8Image, AssetError> {
    decode_rgb8(file, &read_file(file)?)
}

/// `load_rgb8` from bytes; `file` only names them in errors.
pub fn decode_rgb8(file: &Path, bytes: &[u8]) -> Result<Rgb8Image, AssetError> {
    match format_of(file, bytes)? {
        PictureFormat::Png => ldr::rgb8(file, bytes, image::ImageFormat::Png),
        PictureFormat::Jpeg => ldr::rgb8(file, bytes, image::ImageFormat::Jpeg),
        other => Err(AssetError::new(file, "picture format")
            .value(format!("{other:?}"))
            .allowed("PNG or JPEG where an 8-bit picture is wanted")),
    }
}

/// Loads an 8-bit grey picture such as a mask (PNG or JPEG). Colour becomes luma.
///
/// # Errors
/// As `load_rgb8`.
pub fn load_gray8(file: &Path) -> Result<Image<u8>, AssetError> {
    let bytes = read_file(file)?;
    match format_of(file, &bytes)? {
        PictureFormat::Png => ldr::gray8(file, &bytes, image::ImageFormat::Png),
        PictureFormat::Jpeg => ldr::gray8(file, &bytes, image::ImageFormat::Jpeg),
        other => Err(AssetError::new(file, "picture format")
            .value(format!("{other:?}"))
            .allowed("PNG or JPEG where an 8-bit picture is wanted")),
    }
}

/// Loads linear radiance: Radiance (.hdr, .pic), and PNG or JPEG taken as sRGB with 255 = 1. Texels that are not finite or negative are replaced,
/// flagged and counted (`ingest`).
///
/// # Errors
/// The file cannot be read, is of another kind, is damaged, or exceeds the size limits.
pub fn load_radiance(file: &Path) -> Result<LoadedRadiance, AssetError> {
    decode_radiance(file, &read_file(file)?)
}

/// `load_radiance` from bytes; `file` only names them in errors.
pub fn decode_radiance(file: &Path, bytes: &[u8]) -> Result<LoadedRadiance, AssetError> {
    decode_raw(file, bytes).map(ingest)
}

/// Loads floating-point RGB exactly as the file holds it, whatever the sign: for difference pictures, which are
/// no radiance. Everything else loads with `load_radiance`.
///
/// # Errors
/// As `load_radiance`.
pub fn load_raw(file: &Path) -> Result<RadianceImage, AssetError> {
    decode_raw(file, &read_file(file)?)
}

/// `load_raw` from bytes; `file` only names them in errors.
///
/// # Errors
/// As `load_radiance`.
pub fn decode_raw(file: &Path, bytes: &[u8]) -> Result<RadianceImage, AssetError> {
    match format_of(file, bytes)? {
        PictureFormat::Png => ldr::linear(file, bytes, image::ImageFormat::Png, srgb_decode),
        PictureFormat::Jpeg => ldr::linear(file, bytes, image::ImageFormat::Jpeg, srgb_decode),
        PictureFormat::OpenExr => Err(AssetError::new(file, "picture format").value("OpenEXR").allowed(
            "Radiance, PNG or JPEG here; `halflight` reads OpenEXR, and `halflight light FILE --out FILE.hdr` converts it",
        )),
        PictureFormat::Radiance => radiance::decode(file, bytes),
    }
}

/// Writes an 8-bit RGB picture as PNG.
///
/// # Errors
/// An empty picture, or the file cannot be written.
pub fn save_png(file: &Path, picture: &Rgb8Image) -> Result<(), AssetError> {
    ldr::save(
        file,
        picture.pixels().as_flattened(),
        picture.width(),
        picture.height(),
        image::ExtendedColorType::Rgb8,
    )
}

/// Writes an 8-bit grey picture as PNG.
///
/// # Errors
/// As `save_png`.
pub fn save_png_gray(file: &Path, picture: &Image<u8>) -> Result<(), AssetError> {
    ldr::save(file, picture.pixels(), picture.width(), picture.height(), image::ExtendedColorType::L8)
}

/// Writes linear radiance as a Radiance picture (8-bit mantissas, 1 % steps).
///
/// # Errors
/// An empty picture, or the file cannot be written.
pub fn save_hdr(file: &Path, picture: &RadianceImage) -> Result<(), AssetError> {
    check_size(file, picture.width(), picture.height())?;
    whole::write(file, radiance::encode(picture))
}

#[cfg(test)]
mod tests;
