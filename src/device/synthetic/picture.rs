//! One frame of the camera: rays through each pixel, averaged, exposed and quantised.

use super::{
    film::{Quantiser, expose},
    room::{SyntheticBallView, SyntheticRoom},
};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{frame::Exposure, image::Rgb8Image};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// All that one frame depends on.
pub struct Shot<'a> {
    /// The place.
    pub room: &'a SyntheticRoom,
    /// A pinhole.
    pub lens: &'a Lens,
    /// Where the camera is.
    pub world_from_camera: Pose,
    /// As set.
    pub exposure: Exposure,
    /// Strength of the noise.
    pub noise: f64,
    /// Keys of the noise: seed and frame.
    pub key: [u64; 2],
    /// Rays along each side of an edge pixel.
    pub samples: u32,
}

/// Pixels whose first rays differ by more than this ratio get more rays.
const CONTRAST: f64 = 1.12;

impl Shot<'_> {
    /// Renders through the response. Rows are independent, so threads change nothing.
    pub fn take(&self, quantiser: &Quantiser) -> Rgb8Image {
        let (width, height) = (self.lens.width as usize, self.lens.height as usize);
        let mut image = Rgb8Image::filled(width, height, [0; 3]);
        image.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let radiance = self.pixel(x, y);
                *pixel = std::array::from_fn(|c| {
                    let key = [self.key[0], self.key[1], ((y * width + x) * 3 + c) as u64];
                    let Exposure { time_s, gain } = self.exposure;
                    quantiser.value(c, expose(radiance[c], time_s, gain, self.noise, key))
                });
            }
        });
        image
    }

    /// Mean radiance over a pixel.
    pub fn pixel(&self, x: usize, y: usize) -> DVec3 {
        let corner = DVec2::new(x as f64, y as f64);
        // Four rays of a turned square first.
        let first = [(0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875)]
            .map(|(u, v)| self.look(corner + DVec2::new(u, v)));
        let brightness = first.map(|(l, _)| l.element_sum());
        let low = brightness.iter().copied().fold(f64::INFINITY, f64::min);
        let high = brightness.iter().copied().fold(0.0, f64::max);
        let ball = first.iter().any(|(_, solid)| self.room.is_ball(*solid));
        let mixed = first.iter().any(|(_, solid)| *solid != first[0].1);
        if !ball && !mixed && high <= CONTRAST * low {
            return (first[0].0 + first[1].0 + first[2].0 + first[3].0) / 4.0;
        }
        let side = if ball && high > 1.5 * low { 2 * self.samples } else { self.samples };
        let mut sum = DVec3::ZERO;
        for k in 0..side * side {
            let sub = DVec2::new(f64::from(k % side) + 0.5, f64::from(k / side) + 0.5) / f64::from(side);
            sum += self.look(corner + sub).0;
        }
        sum / f64::from(side * side)
    }

    fn look(&self, pixel: DVec2) -> (DVec3, usize) {
        let l = self.lens;
        let d = DVec3::new((pixel.x - l.cx) / l.fx, (pixel.y - l.cy) / l.fy, 1.0).normalize();
        let pose = &self.world_from_camera;
        self.room.radiance(pose.translation, pose.rotate(d), SyntheticBallView::Present)
    }
}
