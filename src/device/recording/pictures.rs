//! Pictures as messages: Foxglove's in protobuf are written; those, JSON and ROS 2's are read. Pure.

use super::channels::{Encoding, Message, SchemaKind};
use super::foxglove::{self, CompressedImage, RawImage};
use super::frames::{CAMERA, put_time};
use super::raw::{RawPicture, RawReader};
use super::wire::WireWriter;
use super::{
    cdr::{self, RosImage},
    exif,
};
use crate::model::{
    frame::Exposure, image::Rgb8Image, jpeg, pixels::YuvRange, response::Response, time::Timestamp,
};
use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, Limits, codecs};
use std::io::Cursor;

pub use super::raw::PictureError;

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
            w.bytes(7, CAMERA.as_bytes()).fixed32(2, width).fixed32(3, height).bytes(4, b"rgb8");
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
    w.bytes(4, CAMERA.as_bytes()).bytes(2, &coded).bytes(3, format.as_bytes());
    Ok(w.finish())
}

/// Reads the pictures of one recording.
pub struct PictureReader {
    raw: RawReader,
}

/// A picture, the camera's time of it (0 where the message does not say), and the exposure that its file states.
pub struct ReadPicture {
    /// 8-bit RGB, of the size that was asked for.
    pub image: Rgb8Image,
    /// As the message states it.
    pub t: Timestamp,
    /// As the file's Exif segment states it.
    pub exposure: Option<Exposure>,
}

impl PictureReader {
    /// `response` is what 8-bit values mean: a Bayer sensor is put through it. `range` is that of Y, Cb and Cr.
    ///
    /// # Errors
    /// What is wrong with the response.
    pub fn new(response: &Response, range: YuvRange) -> Result<Self, String> {
        Ok(Self { raw: RawReader::new(response, range)? })
    }

    /// The picture of a message, which must be `size` columns and rows large: that is seen before it is decoded.
    ///
    /// # Errors
    /// Its size, or why it cannot be understood.
    pub fn read(&mut self, message: &Message, size: (usize, usize)) -> Result<ReadPicture, PictureError> {
        let content = message.content.as_slice();
        match (message.kind(), message.encoding) {
            (SchemaKind::CompressedImage, Encoding::Protobuf) => {
                packed(&foxglove::compressed_of_protobuf(content)?, size)
            }
            (SchemaKind::CompressedImage, Encoding::Json) => {
                packed(&foxglove::compressed_of_json(content)?, size)
            }
            (SchemaKind::RosCompressedImage, Encoding::Cdr) => {
                let (t, format, data) = cdr::compressed_image(content)?;
                packed(&CompressedImage { t, format: format.to_owned(), data: data.into() }, size)
            }
            (SchemaKind::RawImage, Encoding::Protobuf) => {
                self.foxglove_raw(&foxglove::raw_of_protobuf(content)?, size)
            }
            (SchemaKind::RawImage, Encoding::Json) => {
                self.foxglove_raw(&foxglove::raw_of_json(content)?, size)
            }
            (SchemaKind::RosImage, Encoding::Cdr) => {
                let RosImage { t, width, height, encoding, is_big_endian, step, data } = cdr::image(content)?;
                let raw = RawPicture { width, height, encoding, step, data, is_big_endian };
                Ok(ReadPicture { image: self.raw.read(&raw, size)?, t, exposure: None })
            }
            _ => Err(message.unreadable().into()),
        }
    }

    fn foxglove_raw(
        &mut self,
        raw: &RawImage<'_>,
        size: (usize, usize),
    ) -> Result<ReadPicture, PictureError> {
        let RawImage { t, width, height, ref encoding, step, ref data } = *raw;
        let raw = RawPicture { width, height, encoding, step, data, is_big_endian: false };
        Ok(ReadPicture { image: self.raw.read(&raw, size)?, t, exposure: None })
    }
}

/// The exposure that the picture of a message states in its file.
pub fn stated_exposure(message: &Message) -> Option<Exposure> {
    let content = message.content.as_slice();
    match (message.kind(), message.encoding) {
        (SchemaKind::CompressedImage, Encoding::Protobuf) => {
            exif::exposure(&foxglove::compressed_of_protobuf(content).ok()?.data)
        }
        (SchemaKind::CompressedImage, Encoding::Json) => {
            exif::exposure(&foxglove::compressed_of_json(content).ok()?.data)
        }
        (SchemaKind::RosCompressedImage, Encoding::Cdr) => {
            exif::exposure(cdr::compressed_image(content).ok()?.2)
        }
        _ => None,
    }
}

/// Decodes a picture file. What it is, its first bytes say: `format` is written in many ways.
fn packed(message: &CompressedImage<'_>, size: (usize, usize)) -> Result<ReadPicture, PictureError> {
    let data = &*message.data;
    let unknown = || {
        let first: Vec<String> = data.iter().take(4).map(|b| format!("{b:02x}")).collect();
        format!(
            "format = \"{}\", first bytes {}: must be a JPEG, PNG or WebP picture",
            message.format,
            if first.is_empty() { "none".into() } else { first.join(" ") }
        )
    };
    let (format, bytes) = match data {
        [0xff, 0xd8, 0xff, ..] => (ImageFormat::Jpeg, jpeg::whole(data)?.with_tables()),
        [0x89, b'P', b'N', b'G', ..] => (ImageFormat::Png, data.into()),
        [b'R', b'I', b'F', b'F', a, b, c, d, b'W', b'E', b'B', b'P', rest @ ..] => {
            let stated = u32::from_le_bytes([*a, *b, *c, *d]) as usize;
            if stated > rest.len() + 4 {
                let there = data.len();
                return Err(format!("cut: {there} bytes of the {} that its head states", stated + 8).into());
            }
            (ImageFormat::WebP, data.into())
        }
        _ => return Err(unknown().into()),
    };
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(&*bytes), format);
        let mut limits = Limits::default();
        // 16-bit RGBA takes 8 bytes a pixel; room for what a decoder keeps beside.
        limits.max_alloc = Some(16 * (size.0 * size.1) as u64 + (1 << 20));
        reader.limits(limits);
        reader
    };
    let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
    let found = (width as usize, height as usize);
    if found != size {
        return Err(PictureError::Size(found));
    }
    let picture = reader().decode().map_err(|e| e.to_string())?.into_rgb8();
    let pixels = picture.as_raw().as_chunks::<3>().0.to_vec();
    let image = Rgb8Image::from_pixels(size.0, size.1, pixels)
        .ok_or_else(|| "the picture has a wrong size".to_owned())?;
    Ok(ReadPicture { image, t: message.t, exposure: exif::exposure(data) })
}
