//! Pictures that are not compressed, in the encodings of Foxglove and ROS, as 8-bit RGB. Pure.

use crate::hdr::develop::{Developer, SensorOptions};
use crate::model::{
    image::Rgb8Image,
    pixels::{BayerDepth, BayerOrder, FramePixels, PixelFormat, PixelLayout, YuvRange},
    response::Response,
};
use std::sync::Arc;

/// A raw picture as its message has it.
pub(super) struct RawPicture<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) encoding: &'a str,
    /// Bytes from one row to the next.
    pub(super) step: u32,
    pub(super) data: &'a [u8],
    pub(super) is_big_endian: bool,
}

/// How an encoding's bytes become red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PixelEncoding {
    /// Bytes a pixel, and the places of red, green and blue among them.
    Bytes(usize, [usize; 3]),
    /// 16 bits of gray.
    Gray16,
    /// What a camera's driver gives.
    Camera(PixelFormat),
}

const KNOWN: &str = "rgb8, bgr8, rgba8, bgra8, mono8, mono16, yuv422, uyvy, yuyv, yuv422_yuy2, nv12, or bayer_ with rggb, bggr, gbrg or grbg and 8 or 16";

impl PixelEncoding {
    fn of(name: &str) -> Option<Self> {
        if let Some(bayer) = name.strip_prefix("bayer_") {
            let order = match bayer.get(..4)? {
                "rggb" => BayerOrder::Rggb,
                "bggr" => BayerOrder::Bggr,
                "gbrg" => BayerOrder::Gbrg,
                "grbg" => BayerOrder::Grbg,
                _ => return None,
            };
            let depth = match bayer.get(4..)? {
                "8" => BayerDepth::Bits8,
                "16" => BayerDepth::Bits16,
                _ => return None,
            };
            return Some(Self::Camera(PixelFormat::Bayer(order, depth)));
        }
        Some(match name {
            "rgb8" => Self::Bytes(3, [0, 1, 2]),
            "bgr8" | "8UC3" => Self::Bytes(3, [2, 1, 0]),
            "rgba8" => Self::Bytes(4, [0, 1, 2]),
            "bgra8" | "8UC4" => Self::Bytes(4, [2, 1, 0]),
            "mono8" | "8UC1" => Self::Bytes(1, [0, 0, 0]),
            "mono16" | "16UC1" => Self::Gray16,
            "yuv422" | "uyvy" => Self::Camera(PixelFormat::Uyvy),
            "yuyv" | "yuv422_yuy2" => Self::Camera(PixelFormat::Yuyv),
            "nv12" => Self::Camera(PixelFormat::Nv12),
            _ => return None,
        })
    }
}

/// Makes 8-bit RGB of raw pictures of one recording.
pub(super) struct RawReader {
    developer: Developer,
    range: YuvRange,
}

impl RawReader {
    /// `response` is what the camera's 8-bit values mean: a Bayer sensor is linear, and is put through it. `range` is that of Y,
    /// Cb and Cr.
    pub(super) fn new(response: &Response, range: YuvRange) -> Result<Self, String> {
        let developer = Developer::new(response, SensorOptions::default()).map_err(|e| e.to_string())?;
        Ok(Self { developer, range })
    }

    /// The picture, which must be of this size: nothing is made of one that is not.
    pub(super) fn read(
        &mut self,
        raw: &RawPicture<'_>,
        size: (usize, usize),
    ) -> Result<Rgb8Image, PictureError> {
        let found = (raw.width as usize, raw.height as usize);
        if found != size {
            return Err(PictureError::Size(found));
        }
        let encoding = PixelEncoding::of(raw.encoding)
            .ok_or_else(|| format!("encoding = \"{}\": must be one of {KNOWN}", raw.encoding))?;
        let format = match encoding {
            PixelEncoding::Bytes(..) | PixelEncoding::Gray16 => PixelFormat::Grey,
            PixelEncoding::Camera(format) => format,
        };
        let step = raw.step as usize;
        let mut layout = PixelLayout::packed(format, size.0, size.1);
        let row_bytes = match encoding {
            PixelEncoding::Bytes(count, _) => count * size.0,
            PixelEncoding::Gray16 => 2 * size.0,
            PixelEncoding::Camera(_) => layout.row_bytes(),
        };
        let rows = layout.rows_in_memory();
        if step < row_bytes {
            return Err(format!(
                "step = {step}: must be at least {row_bytes} bytes for {} pixels of {}",
                size.0, raw.encoding
            )
            .into());
        }
        let least = (rows - 1).saturating_mul(step).saturating_add(row_bytes);
        if raw.data.len() < least {
            return Err(format!(
                "cut: data has {} bytes, {rows} rows of step {step} need {least}",
                raw.data.len()
            )
            .into());
        }
        if raw.is_big_endian && matches!(format, PixelFormat::Bayer(_, BayerDepth::Bits16)) {
            return Err(format!("is_bigendian = 1 with {}: must be 0", raw.encoding).into());
        }
        let rows = || raw.data.chunks(step).take(size.1);
        let pixels: Vec<[u8; 3]> = match encoding {
            PixelEncoding::Bytes(count, places) => rows()
                .flat_map(|row| row[..row_bytes].chunks_exact(count))
                .map(|pixel| places.map(|place| pixel[place]))
                .collect(),
            PixelEncoding::Gray16 => rows()
                .flat_map(|row| row[..row_bytes].as_chunks::<2>().0)
                .map(|pair| {
                    let value =
                        if raw.is_big_endian { u16::from_be_bytes(*pair) } else { u16::from_le_bytes(*pair) };
                    // The nearest of 256 steps of 257.
                    [((u32::from(value) + 128) / 257) as u8; 3]
                })
                .collect(),
            PixelEncoding::Camera(_) => {
                (layout.stride, layout.range) = (step, self.range);
                let held = Arc::new(raw.data[..least].to_vec());
                let pixels = FramePixels::new(layout, held, least).map_err(|e| e.to_string())?;
                let mut image = Rgb8Image::default();
                self.developer.rgb8(&pixels, &mut image).map_err(|e| e.to_string())?;
                return Ok(image);
            }
        };
        let wrong = || PictureError::from("the picture has a wrong size".to_owned());
        Rgb8Image::from_pixels(size.0, size.1, pixels).ok_or_else(wrong)
    }
}

/// Why there is no picture.
#[derive(Clone, Debug, PartialEq)]
pub enum PictureError {
    /// It has another size than the calibration says: columns and rows.
    Size((usize, usize)),
    /// It cannot be understood.
    Unread(String),
}

impl From<String> for PictureError {
    fn from(why: String) -> Self {
        Self::Unread(why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(encoding: &str, step: u32, data: &[u8]) -> Result<Rgb8Image, PictureError> {
        let raw = RawPicture { width: 4, height: 2, encoding, step, data, is_big_endian: false };
        RawReader::new(&Response::srgb(), YuvRange::Full).unwrap().read(&raw, (4, 2))
    }

    /// Red, green, blue of a pixel.
    fn colour(x: usize, y: usize) -> [u8; 3] {
        [10 + 20 * x as u8, 200 - 50 * y as u8, 30 + (7 * x + 90 * y) as u8]
    }

    /// Two rows with three bytes after each.
    fn rows(pixel: impl Fn(usize, usize) -> Vec<u8>) -> (u32, Vec<u8>) {
        let mut data = Vec::new();
        let mut step = 0;
        for y in 0..2 {
            (0..4).for_each(|x| data.extend(pixel(x, y)));
            data.extend([9, 9, 9]);
            step = data.len() as u32 / (y as u32 + 1);
        }
        (step, data)
    }

    #[test]
    fn bytes_stand_where_their_encoding_says() {
        type Laid = fn([u8; 3]) -> Vec<u8>;
        let orders: [(&str, Laid); 4] = [
            ("rgb8", |[r, g, b]| vec![r, g, b]),
            ("bgr8", |[r, g, b]| vec![b, g, r]),
            ("rgba8", |[r, g, b]| vec![r, g, b, 77]),
            ("bgra8", |[r, g, b]| vec![b, g, r, 77]),
        ];
        for (encoding, order) in orders {
            let (step, data) = rows(|x, y| order(colour(x, y)));
            let image = read(encoding, step, &data).unwrap();
            for (i, pixel) in image.pixels().iter().enumerate() {
                assert_eq!(*pixel, colour(i % 4, i / 4), "{encoding}");
            }
            // The last row's padding may be missing, its pixels may not.
            assert_eq!(read(encoding, step, &data[..data.len() - 3]).unwrap(), image);
            let cut = read(encoding, step, &data[..data.len() - 4]).unwrap_err();
            assert!(matches!(cut, PictureError::Unread(why) if why.starts_with("cut:")), "{encoding}");
        }
    }

    #[test]
    fn gray_of_8_and_16_bits_is_the_same() {
        let value = |x: usize, y: usize| colour(x, y)[2];
        let (step, data) = rows(|x, y| vec![value(x, y)]);
        let gray = read("mono8", step, &data).unwrap();
        assert_eq!(*gray.at(3, 1), [value(3, 1); 3]);
        let (step, data) = rows(|x, y| (u16::from(value(x, y)) * 257).to_le_bytes().to_vec());
        assert_eq!(read("mono16", step, &data).unwrap(), gray);
        let (step, data) = rows(|x, y| (u16::from(value(x, y)) * 257).to_be_bytes().to_vec());
        let raw =
            RawPicture { width: 4, height: 2, encoding: "mono16", step, data: &data, is_big_endian: true };
        let mut reader = RawReader::new(&Response::srgb(), YuvRange::Full).unwrap();
        assert_eq!(reader.read(&raw, (4, 2)).unwrap(), gray);
    }

    #[test]
    fn both_orders_of_yuv_422_and_nv12_give_one_picture() {
        let y = |x: usize, row: usize| (60 + 30 * x + 10 * row) as u8;
        let (blue, red) = (100u8, 160u8);
        let pair = |x: usize| if x.is_multiple_of(2) { blue } else { red };
        let (step, uyvy) = rows(|x, row| vec![pair(x), y(x, row)]);
        let (_, yuyv) = rows(|x, row| vec![y(x, row), pair(x)]);
        let image = read("uyvy", step, &uyvy).unwrap();
        for (encoding, data) in [("yuv422", &uyvy), ("yuyv", &yuyv), ("yuv422_yuy2", &yuyv)] {
            assert_eq!(read(encoding, step, data).unwrap(), image, "{encoding}");
        }
        let mut nv12: Vec<u8> = (0..8).map(|i| y(i % 4, i / 4)).collect();
        nv12.extend([blue, red, blue, red]);
        assert_eq!(read("nv12", 4, &nv12).unwrap(), image);
        assert!(read("nv12", 4, &nv12[..11]).is_err());
        // ITU-R BT.601: red is Y + 1.402 (Cr - 128).
        assert_eq!(image.at(0, 0)[0], (60.0f64 + 1.402 * 32.0).round() as u8);
    }

    #[test]
    fn a_bayer_sensors_places_are_found() {
        for (name, order) in [
            ("bayer_rggb8", BayerOrder::Rggb),
            ("bayer_bggr8", BayerOrder::Bggr),
            ("bayer_gbrg8", BayerOrder::Gbrg),
            ("bayer_grbg8", BayerOrder::Grbg),
        ] {
            // Everything red.
            let (step, data) = rows(|x, y| vec![if order.channel(x, y) == 0 { 255 } else { 0 }]);
            let image = read(name, step, &data).unwrap();
            assert!(image.pixels().iter().all(|p| *p == [255, 0, 0]), "{name}: {:?}", image.at(0, 0));
        }
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let why = |encoding: &str, step: u32| match read(encoding, step, &[0; 64]).unwrap_err() {
            PictureError::Unread(why) => why,
            PictureError::Size(size) => panic!("{size:?}"),
        };
        assert!(why("32FC1", 16).contains("encoding = \"32FC1\": must be one of rgb8"));
        assert!(why("bayer_rgbg8", 4).contains("bayer_rgbg8"));
        assert!(why("bayer_é", 4).contains("bayer_é"));
        assert!(why("rgb8", 11).contains("step = 11: must be at least 12"));
        let raw = RawPicture {
            width: u32::MAX,
            height: u32::MAX,
            encoding: "rgb8",
            step: u32::MAX,
            data: &[],
            is_big_endian: false,
        };
        let error = RawReader::new(&Response::srgb(), YuvRange::Full).unwrap().read(&raw, (4, 2));
        assert_eq!(error, Err(PictureError::Size((u32::MAX as usize, u32::MAX as usize))));
    }
}
