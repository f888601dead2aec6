//! A place without a picture: its real surfaces in gray under the light, black beyond.

use crate::compose::{
    geometry::SurfaceGeometry,
    raster::{self, Fragment, Projected, Rays, Samples, View},
    shade_object::{LightTerms, soft_over_pi, unshadowed},
};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{image::HdrImage, light::Lights, scene::RealSurface};
use std::f32::consts::FRAC_1_PI;

/// Albedo of the surfaces.
pub const GRAY_ALBEDO: f32 = 0.5;

/// Draws such places; keeps its memory from picture to picture.
#[derive(Default)]
pub struct GrayPlace {
    surfaces: SurfaceGeometry,
    rays: Rays,
    seen: Projected,
    samples: Samples,
}

impl GrayPlace {
    /// Radiance of the surfaces as the camera sees them without virtual objects: matt, both sides lit, no shadow of
    /// one on another. Each half of the light by itself gives its part: radiance is linear in it, but for the clamp of
    /// soft light at 0.
    pub fn draw(
        &mut self,
        surfaces: &[RealSurface],
        lens: &Lens,
        world_from_camera: &Pose,
        light: &Lights,
        out: &mut HdrImage,
    ) {
        self.surfaces.load(surfaces);
        let view = View::of(world_from_camera);
        self.rays.update(lens, 1);
        self.seen.prepare(&self.rays, &view, &self.surfaces.positions, &self.surfaces.triangles);
        let terms = LightTerms::of(light);
        let geometry = &self.surfaces;
        let shade = |fragment: &Fragment| {
            let facet = geometry.facet_normals[fragment.triangle];
            let normal = if facet.dot(fragment.to_eye) < 0.0 { -facet } else { facet };
            let (direct, soft) = (unshadowed(&terms, normal), soft_over_pi(&terms, normal));
            std::array::from_fn(|c| (GRAY_ALBEDO * (direct[c] * FRAC_1_PI + soft[c])).max(0.0))
        };
        raster::draw_surfaces(
            &self.rays,
            &view,
            &self.seen,
            [0.0; 3],
            shade,
            &mut self.samples,
            &mut out.radiance,
        );
        out.flags.reshape(lens.width as usize, lens.height as usize, 0);
        out.flags.pixels_mut().fill(0);
    }
}
