//! Turns a camera's picture of any format into 8-bit RGB through a response, or into linear light, in one pass.
//!
//! Rows are worked on in parallel; the result does not depend on the number of threads. Nothing is allocated once buffers
//! have their size, but for MJPEG, whose decoder takes memory of its own.

use crate::model::{
    image::{RadianceImage, Rgb8Image},
    pixels::{BayerDepth, BayerOrder, FramePixels, PixelFormat},
    response::Response,
};
use rayon::prelude::*;
use std::sync::Arc;
use yuv::YuvToRgb;

mod jpeg;
mod yuv;

/// What a Bayer sensor's values mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorOptions {
    /// Value of no light, as a share of the format's largest value, 0 to 0.5.
    pub black: f32,
    /// Value at which the sensor saturates, as a share of the format's largest value, above `black` and up to 1.
    pub white: f32,
    /// Factors of red, green and blue, 1 to 16; the least is usually 1. Below 1 a saturated channel would look unsaturated.
    pub white_balance: [f32; 3],
}

impl Default for SensorOptions {
    fn default() -> Self {
        Self { black: 0.0, white: 1.0, white_balance: [1.0; 3] }
    }
}

/// Why a picture cannot be developed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DevelopError {
    /// Options that no sensor has.
    #[error(
        "sensor options {0:?}: black must be within 0..=0.5, white above black and at most 1, each factor of the white balance within 1..=16"
    )]
    Options(SensorOptions),
    /// The JPEG file is not whole, or not of the layout's size.
    #[error("MJPEG picture of {length} bytes: {why}")]
    Jpeg {
        /// Length of the file.
        length: usize,
        /// What is wrong.
        why: String,
    },
}

/// Develops pictures of one camera. 8-bit formats hold values of the response already; a Bayer sensor is linear, and its
/// values are put through the response so that its saturation is the value 255.
#[derive(Clone, Debug)]
pub struct Developer {
    options: SensorOptions,
    /// For each channel and value the exposure that makes it.
    exposure_of_value: [[f32; 256]; 3],
    /// For each channel and value the exposure from which the next value is given.
    thresholds: [[f32; 256]; 3],
    /// Pictures made for frames; those that nobody else holds are used again.
    made: Vec<Arc<Rgb8Image>>,
    /// MJPEG's samples.
    samples: Vec<u8>,
    /// MJPEG's picture on its way to linear light.
    decoded: Rgb8Image,
}

impl Developer {
    /// For pictures of this response. An error unless the options are a sensor's.
    pub fn new(response: &Response, options: SensorOptions) -> Result<Self, DevelopError> {
        let SensorOptions { black, white, white_balance } = options;
        let is_sound = (0.0..=0.5).contains(&black)
            && white > black
            && white <= 1.0
            && white_balance.iter().all(|factor| (1.0..=16.0).contains(factor));
        if !is_sound {
            return Err(DevelopError::Options(options));
        }
        Ok(Self {
            options,
            exposure_of_value: response.log_exposure().map(|g| g.map(f32::exp)),
            thresholds: response.thresholds(),
            made: Vec::new(),
            samples: Vec::new(),
            decoded: Rgb8Image::default(),
        })
    }

    /// The picture in 8-bit RGB, to be shared: where it is an image of ours already, that image; else one made in memory that
    /// was used for an earlier frame and that nobody holds any more.
    pub fn develop(&mut self, pixels: &FramePixels) -> Result<Arc<Rgb8Image>, DevelopError> {
        if let Some(image) = pixels.as_image() {
            return Ok(Arc::clone(image));
        }
        let free = self.made.iter_mut().position(|image| Arc::get_mut(image).is_some());
        let mut image = match free {
            Some(at) => self.made.swap_remove(at),
            None => Arc::default(),
        };
        let result = match Arc::get_mut(&mut image) {
            Some(out) => self.rgb8(pixels, out),
            None => Ok(()),
        };
        self.made.push(Arc::clone(&image));
        result.map(|()| image)
    }

    /// Pictures that were made so far, held or free.
    pub fn pictures_made(&self) -> usize {
        self.made.len()
    }

    /// The picture in 8-bit RGB through the response; `out` is reshaped.
    ///
    /// `Rgb24` is copied. Y, Cb, Cr are converted by their matrix and range and rounded; each chroma value holds for all pixels
    /// that share it. `Grey` gives three equal channels. Bayer: black taken off, the missing channels the mean of their
    /// neighbours (3 x 3), times the white balance, then the response's nearest value.
    pub fn rgb8(&mut self, pixels: &FramePixels, out: &mut Rgb8Image) -> Result<(), DevelopError> {
        if pixels.layout().format == PixelFormat::Mjpeg {
            return jpeg::decode(pixels, &mut self.samples, out);
        }
        let thresholds = &self.thresholds;
        out.reshape(pixels.width(), pixels.height(), [0; 3]);
        let rows = out.pixels_mut().par_chunks_mut(pixels.width());
        match self.sensor(pixels) {
            Some(sensor) => rows.enumerate().for_each(|(y, row)| {
                for (x, pixel) in row.iter_mut().enumerate() {
                    let exposure = sensor.exposure(x, y);
                    for (c, value) in pixel.iter_mut().enumerate() {
                        *value = thresholds[c].partition_point(|edge| *edge <= exposure[c]).min(255) as u8;
                    }
                }
            }),
            None => rows.enumerate().for_each(|(y, row)| {
                each_value(pixels, y, |x, value| row[x] = value);
            }),
        }
        Ok(())
    }

    /// The picture's exposure X = radiance times effective exposure in seconds, as the response has it; `out` is reshaped.
    /// *For 8-bit formats it is the response's table at what [`Developer::rgb8`] gives*; a Bayer sensor keeps its own fineness.
    pub fn linear(&mut self, pixels: &FramePixels, out: &mut RadianceImage) -> Result<(), DevelopError> {
        let table = &self.exposure_of_value;
        let exposure_of = |value: [u8; 3]| std::array::from_fn(|c| table[c][usize::from(value[c])]);
        out.reshape(pixels.width(), pixels.height(), [0.0; 3]);
        if pixels.layout().format == PixelFormat::Mjpeg {
            jpeg::decode(pixels, &mut self.samples, &mut self.decoded)?;
            let values = self.decoded.pixels().par_iter();
            out.pixels_mut().par_iter_mut().zip(values).for_each(|(out, value)| *out = exposure_of(*value));
            return Ok(());
        }
        let rows = out.pixels_mut().par_chunks_mut(pixels.width());
        match self.sensor(pixels) {
            Some(sensor) => rows.enumerate().for_each(|(y, row)| {
                for (x, pixel) in row.iter_mut().enumerate() {
                    *pixel = sensor.exposure(x, y);
                }
            }),
            None => rows.enumerate().for_each(|(y, row)| {
                each_value(pixels, y, |x, value| row[x] = exposure_of(value));
            }),
        }
        Ok(())
    }

    fn sensor<'a>(&self, pixels: &'a FramePixels) -> Option<Sensor<'a>> {
        let PixelFormat::Bayer(order, depth) = pixels.layout().format else { return None };
        let full = f32::from(depth.white());
        let SensorOptions { black, white, white_balance } = self.options;
        Some(Sensor {
            bytes: pixels.bytes(),
            stride: pixels.layout().stride,
            size: (pixels.width(), pixels.height()),
            order,
            depth,
            black: black * full,
            scale: std::array::from_fn(|c| {
                self.exposure_of_value[c][255] * white_balance[c] / ((white - black) * full)
            }),
        })
    }
}

/// Hands on the values of a row of an 8-bit format; nothing for other formats.
fn each_value(pixels: &FramePixels, y: usize, mut put: impl FnMut(usize, [u8; 3])) {
    let (layout, row) = (pixels.layout(), pixels.row(y));
    let width = layout.width;
    match layout.format {
        PixelFormat::Rgb24 => {
            for (x, value) in row.chunks_exact(3).enumerate() {
                put(x, [value[0], value[1], value[2]]);
            }
        }
        PixelFormat::Grey => {
            let to_rgb = YuvToRgb::new(layout.range, layout.matrix);
            for (x, y) in row.iter().enumerate() {
                put(x, to_rgb.convert(*y, 128, 128));
            }
        }
        PixelFormat::Yuyv | PixelFormat::Uyvy => {
            let to_rgb = YuvToRgb::new(layout.range, layout.matrix);
            // Places of Y, Cb, Cr in four bytes.
            let (luma, blue, red) = match layout.format {
                PixelFormat::Yuyv => ([0, 2], 1, 3),
                _ => ([1, 3], 0, 2),
            };
            for x in 0..width {
                let four = &row[x / 2 * 4..x / 2 * 4 + 4];
                put(x, to_rgb.convert(four[luma[x % 2]], four[blue], four[red]));
            }
        }
        PixelFormat::Nv12 => {
            let to_rgb = YuvToRgb::new(layout.range, layout.matrix);
            let chroma = pixels.row(layout.height + y / 2);
            for x in 0..width {
                let pair = x / 2 * 2;
                put(x, to_rgb.convert(row[x], chroma[pair], chroma[pair + 1]));
            }
        }
        PixelFormat::Bayer(..) | PixelFormat::Mjpeg => {}
    }
}

/// A Bayer sensor's picture.
struct Sensor<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: (usize, usize),
    order: BayerOrder,
    depth: BayerDepth,
    black: f32,
    /// From a value without black to the exposure, for each channel.
    scale: [f32; 3],
}

impl Sensor<'_> {
    /// The exposure at a pixel: its own channel as it is, the others as the mean of those of the 3 x 3 around it that lie in
    /// the picture; where there are none (a picture one pixel wide), its own.
    fn exposure(&self, x: usize, y: usize) -> [f32; 3] {
        let (width, height) = self.size;
        let own = self.order.channel(x, y);
        let here = self.value(x, y);
        let (mut sum, mut count) = ([0.0f32; 3], [0.0f32; 3]);
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                let channel = self.order.channel(u, v);
                sum[channel] += self.value(u, v);
                count[channel] += 1.0;
            }
        }
        std::array::from_fn(|c| {
            let value = if c == own || count[c] == 0.0 { here } else { sum[c] / count[c] };
            value * self.scale[c]
        })
    }

    fn value(&self, x: usize, y: usize) -> f32 {
        let start = y * self.stride;
        (f32::from(self.depth.value(&self.bytes[start..], x)) - self.black).max(0.0)
    }
}

#[cfg(test)]
mod tests;
