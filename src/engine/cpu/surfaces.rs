//! What virtual objects leave of the light on real surfaces, at every pixel.

use super::{Twins, fragments::surface_normals, twins::points_of};
use crate::compose::{
    carried::{Coarse, RUN, SeenPlane},
    geometry::SurfaceGeometry,
    raster::{self, Fragment, Row},
    shade_surface::{self, SurfaceFrame},
    soft_shadow::{self, Planes, Transfer},
};
use crate::frame::{FrameJob, FrameState};
use crate::plan::Product;
use crate::visibility::blockers::Blockers;
use glam::{Mat3, Vec3};

/// From so many neighbours of one triangle on they are shaded together.
const LEAST_RUN: usize = 4;

impl Twins {
    /// The ratio at every pixel that sees a real surface; 1 elsewhere.
    pub(super) fn shade_surface(&mut self, job: &FrameJob<'_>, state: &mut FrameState) {
        self.project_surfaces(job, state);
        let (view, quality) = (&job.camera, job.quality);
        let soft_drawn = job.uses.make(Product::SoftShadows);
        if soft_drawn {
            // They may have been made on a device.
            self.coarse_rays.update(&job.coarse_lens(), 1);
        }
        state.planes.prepare_light(&job.light, &state.shadows, quality.pcf_taps);
        let soft = &state.results.soft;
        let shader = SurfaceShader {
            frame: SurfaceFrame { light: &job.light, shadows: &state.shadows, pcf_taps: quality.pcf_taps },
            surfaces: &state.surfaces,
            planes: &state.planes,
            blockers: &state.blockers,
            transfer: &state.transfer,
            coarse: Coarse {
                pixels: soft.pixels(),
                width: soft.width(),
                height: soft.height(),
                rays: &self.coarse_rays,
                step: quality.soft_step_px as usize,
            },
            soft_drawn,
            camera_from_world: view.world_from_camera.transpose(),
            eye: view.eye,
            width: self.rays.width(),
        };
        raster::draw_rows(
            &self.rays,
            view,
            &self.seen_surfaces,
            [1.0; 3],
            |row: &Row<'_>, out: &mut [[f32; 3]]| shader.row(row, out),
            &mut self.samples,
            &mut state.results.ratios,
        );
    }
}

/// What shading a real surface reads.
struct SurfaceShader<'a> {
    frame: SurfaceFrame<'a>,
    surfaces: &'a SurfaceGeometry,
    planes: &'a Planes,
    blockers: &'a Blockers,
    transfer: &'a Transfer,
    /// What is taken of the soft light.
    coarse: Coarse<'a>,
    soft_drawn: bool,
    camera_from_world: Mat3,
    eye: Vec3,
    /// Columns of the picture.
    width: usize,
}

impl SurfaceShader<'_> {
    fn seen_plane(&self, facet: Vec3, point_world: Vec3) -> SeenPlane {
        SeenPlane {
            normal_camera: self.camera_from_world * facet,
            to_plane: facet.dot(point_world - self.eye),
        }
    }

    fn soft_taken(&self, fragment: &Fragment, normal: Vec3, facet: Vec3) -> [f32; 3] {
        let plane = self.seen_plane(facet, fragment.point_world);
        let carried = self.coarse.at(&plane, fragment.pixel % self.width, fragment.pixel / self.width);
        carried.unwrap_or_else(|| {
            let plane = self.planes.of(fragment.triangle, normal);
            soft_shadow::taken(self.blockers, self.transfer, plane, fragment.point_world, normal)
        })
    }

    fn one(&self, fragment: &Fragment) -> [f32; 3] {
        let (normal, facet) = surface_normals(self.surfaces, fragment);
        let is_front = self.surfaces.facet_normals[fragment.triangle].dot(fragment.to_eye) >= 0.0;
        let flat = self.planes.flat(fragment.triangle, is_front);
        let (normal, facet) = flat.map_or((normal, facet), |flat| (flat.normal, flat.normal));
        let taken = if self.soft_drawn { self.soft_taken(fragment, normal, facet) } else { [0.0; 3] };
        let whole_rgb = flat.map(|flat| flat.whole_rgb);
        shade_surface::at(&self.frame, fragment.point_world, normal, facet, taken, whole_rgb)
    }

    /// Shades neighbours on a flat triangle together; returns false where they need a look one by one.
    fn flat_run(&self, row: &Row<'_>, k: usize, out: &mut [[f32; 3]]) -> bool {
        let Some(flat) = row.triangle(k).and_then(|t| self.planes.flat(t, true)) else { return false };
        let Some(points) = points_of(row, k, out.len()) else { return false };
        let facet = self.surfaces.facet_normals[row.triangle(k).unwrap_or(0)];
        if !points.see_front(facet) {
            return false;
        }
        let mut taken = [[0.0; RUN]; 3];
        if self.soft_drawn {
            let plane = self.seen_plane(flat.normal, points.first());
            let (x, y) = (row.pixel(k) % self.width, row.pixel(k) / self.width);
            if !self.coarse.run(&plane, x, y, out.len(), &mut taken) {
                return false;
            }
        }
        let lights = self.planes.lights(flat);
        shade_surface::at_run(&self.frame, flat, lights, &points.point_world, &taken, out);
        true
    }

    fn row(&self, row: &Row<'_>, out: &mut [[f32; 3]]) {
        let mut k = 0;
        while k < out.len() {
            let end = (k + row.run(k, RUN).max(1)).min(out.len());
            let receives = row.triangle(k).is_some_and(|t| self.surfaces.receives[t]);
            if receives && !(end - k >= LEAST_RUN && self.flat_run(row, k, &mut out[k..end])) {
                for (i, pixel) in out.iter_mut().enumerate().take(end).skip(k) {
                    *pixel = row.fragment(i).map_or(*pixel, |fragment| self.one(&fragment));
                }
            }
            k = end;
        }
    }
}
