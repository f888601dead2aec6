//! The rays of a lens through pixel centres and coverage samples.

use crate::math::lens::Lens;
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Where the four coverage samples lie in a pixel (the standard pattern of four); their mean is its centre.
pub const SAMPLES: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];

/// The rays of a lens, in the camera's frame: kept as long as the lens stays.
#[derive(Clone, Debug, Default)]
pub struct Rays {
    pub(super) lens: Option<Lens>,
    pub(super) samples_a_pixel: usize,
    pub(super) centres: Vec<Vec3>,
    pub(super) samples: Vec<Vec3>,
    /// Largest angle between a sample's ray and the axis, radians.
    pub(super) half_angle_rad: f32,
}

impl Rays {
    /// Rays of a lens with 1 or 4 samples a pixel (other counts become 4); free where nothing has changed.
    /// Where the lens cannot be inverted the ray is zero and hits nothing.
    pub fn update(&mut self, lens: &Lens, coverage_samples: u32) {
        let count = if coverage_samples == 1 { 1 } else { 4 };
        if self.lens.as_ref() == Some(lens) && self.samples_a_pixel == count {
            return;
        }
        let (width, height) = (lens.width as usize, lens.height as usize);
        self.centres.resize(width * height, Vec3::ZERO);
        self.samples.resize(width * height * count, Vec3::ZERO);
        let ray = |x: usize, y: usize, at: [f32; 2]| {
            let pixel = DVec2::new(x as f64 + f64::from(at[0]), y as f64 + f64::from(at[1]));
            lens.unproject(pixel).map_or(Vec3::ZERO, |d| d.as_vec3())
        };
        let rows = self.centres.par_chunks_mut(width.max(1));
        rows.zip(self.samples.par_chunks_mut((width * count).max(1))).enumerate().for_each(
            |(y, (centres, samples))| {
                for (x, centre) in centres.iter_mut().enumerate() {
                    *centre = ray(x, y, [0.5, 0.5]);
                }
                for (k, sample) in samples.iter_mut().enumerate() {
                    let at = if count == 1 { [0.5, 0.5] } else { SAMPLES[k % 4] };
                    *sample = ray(k / count, y, at);
                }
            },
        );
        let cosine = self.samples.iter().filter(|d| **d != Vec3::ZERO).fold(1.0f32, |c, d| c.min(d.z));
        self.half_angle_rad = cosine.clamp(-1.0, 1.0).acos();
        self.samples_a_pixel = count;
        self.lens = Some(*lens);
    }

    /// Unit ray through the centre of pixel `i` (row by row), camera frame; zero where the lens has none.
    pub fn centre(&self, i: usize) -> Vec3 {
        self.centres.get(i).copied().unwrap_or(Vec3::ZERO)
    }

    /// Picture width in pixels.
    pub fn width(&self) -> usize {
        self.lens.map_or(0, |l| l.width as usize)
    }

    /// Picture height in pixels.
    pub fn height(&self) -> usize {
        self.lens.map_or(0, |l| l.height as usize)
    }
}
