//! Turns a camera's picture of any format into 8-bit RGB through a response, or into linear light, in one pass.
//!
//! Rows are worked on in parallel; the result does not depend on the number of threads. Nothing is allocated once buffers
//! have their size, but for MJPEG, whose decoder takes memory of its own.

use crate::math::widest::widest;
use crate::model::{
    image::{RadianceImage, Rgb8Image},
    pixels::{FramePixels, PixelFormat},
    response::Response,
    sensor::{SensorImage, UNSEEN},
};
use bayer::Sensor;
use codes::NearestValues;
use rayon::prelude::*;
use std::sync::Arc;
use yuv::{CHUNK, YuvChunk, YuvToRgb};

mod bayer;
mod codes;
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

/// From so much of the way from black to white on a sensor's value counts as saturated: noise blurs the end of the scale.
const SATURATED: f32 = 0.98;

/// A frame's picture, to be shared.
#[derive(Clone, Debug)]
pub struct Developed {
    /// 8-bit RGB through the response.
    pub pixels: Arc<Rgb8Image>,
    /// As the sensor gave it, where that is finer than 8 bits.
    pub sensor: Option<Arc<SensorImage>>,
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
    nearest: NearestValues,
    /// Pictures made for frames; those that nobody else holds are used again.
    made: Vec<Arc<Rgb8Image>>,
    /// The same for pictures at the sensor's fineness.
    made_of_sensor: Vec<Arc<SensorImage>>,
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
            nearest: NearestValues::new(&response.thresholds()),
            made: Vec::new(),
            made_of_sensor: Vec::new(),
            samples: Vec::new(),
            decoded: Rgb8Image::default(),
        })
    }

    /// The picture in 8-bit RGB, to be shared: where it is an image of ours already, that image; else one made in memory that
    /// was used for an earlier frame and that nobody holds any more. With it the picture at the sensor's fineness, where that
    /// is finer: both are made in one pass.
    pub fn develop(&mut self, pixels: &FramePixels) -> Result<Developed, DevelopError> {
        if let Some(image) = pixels.as_image() {
            return Ok(Developed { pixels: Arc::clone(image), sensor: None });
        }
        let is_fine = matches!(pixels.layout().format, PixelFormat::Bayer(_, depth) if depth.white() > 255);
        let mut image = take_free(&mut self.made);
        let mut sensor = is_fine.then(|| take_free(&mut self.made_of_sensor));
        let result = match (Arc::get_mut(&mut image), sensor.as_mut().map(Arc::get_mut)) {
            (Some(image), Some(Some(sensor))) => {
                self.both(pixels, image, sensor);
                Ok(())
            }
            (Some(image), None) => self.rgb8(pixels, image),
            // Nobody else holds them.
            _ => Ok(()),
        };
        self.made.push(Arc::clone(&image));
        self.made_of_sensor.extend(sensor.as_ref().map(Arc::clone));
        result.map(|()| Developed { pixels: image, sensor })
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
        let nearest = &self.nearest;
        out.reshape(pixels.width(), pixels.height(), [0; 3]);
        let rows = out.pixels_mut().par_chunks_mut(pixels.width()).with_min_len(ROWS_AT_ONCE);
        match self.sensor(pixels) {
            Some(sensor) => rows.enumerate().for_each(|(y, row)| {
                widest(
                    #[inline(always)]
                    || sensor.each_pixel(y, |x, exposure, _| row[x] = nearest.of(exposure)),
                );
            }),
            None => rows.enumerate().for_each(|(y, row)| {
                widest(
                    #[inline(always)]
                    || each_value(pixels, y, |x, value| row[x] = value),
                );
            }),
        }
        Ok(())
    }

    /// A Bayer sensor's picture in 8-bit RGB as [`Developer::rgb8`] makes it, and in 16 bits: there black is not taken off, and a
    /// channel is clipped where one of the values that it is the mean of is saturated.
    fn both(&self, pixels: &FramePixels, image: &mut Rgb8Image, fine: &mut SensorImage) {
        let Some(sensor) = self.sensor(pixels) else { return };
        let nearest = &self.nearest;
        let (width, height) = (pixels.width(), pixels.height());
        image.reshape(width, height, [0; 3]);
        fine.values.reshape(width, height, [UNSEEN; 3]);
        fine.scale = sensor.scale_of_values();
        let rows = image.pixels_mut().par_chunks_mut(width).with_min_len(ROWS_AT_ONCE);
        rows.zip(fine.values.pixels_mut().par_chunks_mut(width)).enumerate().for_each(|(y, (row, fine))| {
            widest(
                #[inline(always)]
                || {
                    sensor.each_pixel(y, |x, exposure, values| {
                        row[x] = nearest.of(exposure);
                        fine[x] = values;
                    });
                },
            );
        });
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
        let rows = out.pixels_mut().par_chunks_mut(pixels.width()).with_min_len(ROWS_AT_ONCE);
        match self.sensor(pixels) {
            Some(sensor) => rows.enumerate().for_each(|(y, row)| {
                widest(
                    #[inline(always)]
                    || sensor.each_pixel(y, |x, exposure, _| row[x] = exposure),
                );
            }),
            None => rows.enumerate().for_each(|(y, row)| {
                widest(
                    #[inline(always)]
                    || each_value(pixels, y, |x, value| row[x] = exposure_of(value)),
                );
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
            saturated: (full * (black + SATURATED * (white - black))).ceil() as u32,
            scale: std::array::from_fn(|c| {
                self.exposure_of_value[c][255] * white_balance[c] / ((white - black) * full)
            }),
        })
    }
}

/// Rows that a thread takes at once, at least: a row alone is less work than to hand it over.
const ROWS_AT_ONCE: usize = 16;

/// Hands on the values of a row of an 8-bit format; nothing for other formats.
#[inline(always)]
fn each_value(pixels: &FramePixels, y: usize, mut put: impl FnMut(usize, [u8; 3])) {
    let (layout, row) = (pixels.layout(), pixels.row(y));
    let width = layout.width;
    let to_rgb = YuvToRgb::new(layout.range, layout.matrix);
    let chroma = match layout.format {
        PixelFormat::Rgb24 => {
            for (x, value) in row.chunks_exact(3).take(width).enumerate() {
                put(x, [value[0], value[1], value[2]]);
            }
            return;
        }
        PixelFormat::Nv12 => pixels.row(layout.height + y / 2),
        PixelFormat::Grey | PixelFormat::Yuyv | PixelFormat::Uyvy => row,
        PixelFormat::Bayer(..) | PixelFormat::Mjpeg => return,
    };
    for start in (0..width).step_by(CHUNK) {
        let chunk = YuvChunk::read(layout.format, row, chroma, start, (width - start).min(CHUNK));
        let [red, green, blue] = to_rgb.convert(&chunk);
        for i in 0..chunk.count {
            put(start + i, [red[i], green[i], blue[i]]);
        }
    }
}

/// A picture out of those made that nobody else holds, or a new one.
fn take_free<P: Default>(made: &mut Vec<Arc<P>>) -> Arc<P> {
    let free = made.iter_mut().position(|picture| Arc::get_mut(picture).is_some());
    free.map_or_else(Arc::default, |at| made.swap_remove(at))
}

#[cfg(test)]
mod tests;
