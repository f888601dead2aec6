//! Rows of a picture of surfaces, and what neighbours in a row see of one triangle, side by side.

use super::{Fragment, NONE, Projected, View};
use glam::Vec3;

/// Part of a picture's pixels, row by row, and the nearest triangle of each.
pub struct Row<'a> {
    pub(super) surfaces: &'a Projected,
    pub(super) view: &'a View,
    /// Number of the first pixel in the picture.
    pub(super) first: usize,
    pub(super) triangles: &'a [u32],
    pub(super) rays: [&'a [f32]; 3],
}

/// What N neighbours see of one triangle, coordinate by coordinate.
#[derive(Clone, Copy, Debug)]
pub struct Points<const N: usize> {
    /// The points, world frame, metres.
    pub point_world: [[f32; N]; 3],
    /// Unit vectors away from the camera, world frame.
    pub away: [[f32; N]; 3],
}

impl<const N: usize> Points<N> {
    /// The first point.
    pub fn first(&self) -> Vec3 {
        Vec3::from_array(self.point_world.map(|axis| axis[0]))
    }

    /// Whether the camera sees all of them from the side of a facet's normal.
    #[inline(always)]
    pub fn see_front(&self, facet_normal: Vec3) -> bool {
        let [x, y, z] = &self.away;
        let mut front = true;
        for i in 0..N {
            front &= facet_normal.dot(-Vec3::new(x[i], y[i], z[i])) >= 0.0;
        }
        front
    }
}

impl Row<'_> {
    /// Number of pixel `k` of the row in the picture.
    pub fn pixel(&self, k: usize) -> usize {
        self.first + k
    }

    /// The triangle that pixel `k` sees.
    pub fn triangle(&self, k: usize) -> Option<usize> {
        self.triangles.get(k).filter(|&&t| t != NONE).map(|&t| t as usize)
    }

    /// How many pixels from `k` on see the same as pixel `k`, at most `most`.
    pub fn run(&self, k: usize, most: usize) -> usize {
        let rest = self.triangles.get(k..).unwrap_or(&[]);
        rest.iter().take(most).take_while(|&&t| Some(&t) == rest.first()).count()
    }

    /// What pixel `k` sees.
    pub fn fragment(&self, k: usize) -> Option<Fragment> {
        let triangle = self.triangle(k)?;
        let ray = Vec3::from_array(self.rays.map(|axis| axis[k]));
        let fragment = self.surfaces.fragment(self.view, triangle as u32, ray);
        Some(Fragment { pixel: self.first + k, ..fragment })
    }

    /// What `count` pixels from `k` on see, all of one triangle: the numbers of [`Row::fragment`], bit for bit. The last one
    /// stands in for those that are missing of N.
    #[inline(always)]
    pub fn points<const N: usize>(&self, k: usize, count: usize) -> Option<Points<N>> {
        let setup = &self.surfaces.setups[self.triangle(k)?];
        let last = k + count.clamp(1, N) - 1;
        let [x, y, z]: [[f32; N]; 3] = self.rays.map(|axis| {
            let mut lanes = [axis[last]; N];
            let known = &axis[k..=last];
            lanes[..known.len()].copy_from_slice(known);
            lanes
        });
        let (m, eye, normal) = (&self.view.world_from_camera, self.view.eye, setup.normal);
        let mut points = Points { point_world: [[0.0; N]; 3], away: [[0.0; N]; 3] };
        for i in 0..N {
            let ray = Vec3::new(x[i], y[i], z[i]);
            let world = *m * ray;
            let point = eye + world * (setup.distance / normal.dot(ray));
            for axis in 0..3 {
                points.point_world[axis][i] = point[axis];
                points.away[axis][i] = world[axis];
            }
        }
        Some(points)
    }
}
