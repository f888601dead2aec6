//! The rays of a lens through pixel centres and coverage samples.

use crate::math::lens::Lens;
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Where the four coverage samples lie in a pixel (the standard pattern of four); their mean is its centre.
pub const SAMPLES: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];

/// The rays of a lens, in the camera's frame: kept as long as the lens stays.
#[derive(Clone, Debug, Default)]
pub struct Rays {
    pub(super) lens: Option<Lens>,
    pub(super) samples_a_pixel: usize,
    pub(super) centres: RayDirections,
    pub(super) samples: RayDirections,
    /// Largest angle between a sample's ray and the axis, radians.
    pub(super) half_angle_rad: f32,
}

/// Unit vectors, each coordinate in a list of its own; zero: none.
#[derive(Clone, Debug, Default)]
pub(super) struct RayDirections {
    axes: [Vec<f32>; 3],
}

impl RayDirections {
    /// Rows of `length` vectors, `direction(row, k)` each.
    fn fill(&mut self, rows: usize, length: usize, direction: impl Fn(usize, usize) -> Vec3 + Sync) {
        for axis in &mut self.axes {
            axis.resize(rows * length, 0.0);
        }
        let [x, y, z] = self.axes.each_mut().map(|axis| axis.par_chunks_mut(length.max(1)));
        x.zip(y).zip(z).enumerate().for_each(|(row, ((x, y), z))| {
            for (k, ((x, y), z)) in x.iter_mut().zip(y).zip(z).enumerate() {
                [*x, *y, *z] = direction(row, k).to_array();
            }
        });
    }

    /// The vectors of a range, coordinate by coordinate.
    pub(super) fn part(&self, range: Range<usize>) -> [&[f32]; 3] {
        self.axes.each_ref().map(|axis| &axis[range.clone()])
    }
}

impl Rays {
    /// Rays of a lens with 1 or 4 samples a pixel (other counts become 4); free where nothing has changed.
    /// Where the lens cannot be inverted the ray is zero and hits nothing. Whether anything had changed.
    pub fn update(&mut self, lens: &Lens, coverage_samples: u32) -> bool {
        let count = if coverage_samples == 1 { 1 } else { 4 };
        if self.lens.as_ref() == Some(lens) && self.samples_a_pixel == count {
            return false;
        }
        let (width, height) = (lens.width as usize, lens.height as usize);
        let ray = |x: usize, y: usize, at: [f32; 2]| {
            let pixel = DVec2::new(x as f64 + f64::from(at[0]), y as f64 + f64::from(at[1]));
            lens.unproject(pixel).map_or(Vec3::ZERO, |d| d.as_vec3())
        };
        self.centres.fill(height, width, |y, x| ray(x, y, [0.5, 0.5]));
        self.samples.fill(height, width * count, |y, k| {
            let at = if count == 1 { [0.5, 0.5] } else { SAMPLES[k % 4] };
            ray(k / count, y, at)
        });
        let [x, y, z] = &self.samples.axes;
        let seen = x.iter().zip(y).zip(z).filter(|((x, y), z)| [**x, **y, **z] != [0.0; 3]);
        let cosine = seen.fold(1.0f32, |c, (_, z)| c.min(*z));
        self.half_angle_rad = cosine.clamp(-1.0, 1.0).acos();
        self.samples_a_pixel = count;
        self.lens = Some(*lens);
        true
    }

    /// Unit ray through the centre of pixel `i` (row by row), camera frame; zero where the lens has none.
    pub fn centre(&self, i: usize) -> Vec3 {
        let [x, y, z] = self.centres.axes.each_ref().map(|axis| axis.get(i).copied().unwrap_or(0.0));
        Vec3::new(x, y, z)
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
