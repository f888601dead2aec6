//! Soft shadows on real surfaces, at pixels or at vertices.

use super::{Work, coarse_lens, surface_normals};
use crate::RelightInput;
use crate::animate::posed::Posed;
use crate::compose::{
    raster::{self, Fragment, View},
    shade_object::LightTerms,
    soft_shadow::{self, CoarsePoint},
};
use crate::model::quality::{Quality, SoftAt};
use rayon::prelude::*;

impl Work {
    /// Takes over the spheres and the light of a frame.
    pub(crate) fn prepare_blockers(
        &mut self,
        input: &RelightInput<'_>,
        light: &LightTerms,
        quality: &Quality,
    ) {
        self.transfer.update(light);
        let spheres = input.posed.map_or(&[][..], Posed::spheres);
        self.blockers.prepare(spheres, quality.rung, light.order, quality.directions);
        self.planes.prepare(&self.blockers, &self.transfer);
        self.coarse_rays.update(&coarse_lens(input.lens, quality.soft_step_px), 1);
    }

    pub(crate) fn soft_shadow(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        quality: &Quality,
    ) {
        self.prepare_blockers(input, light, quality);
        if quality.soft_at == SoftAt::Vertex {
            self.lay_grid(input, view);
            return self.soft_at_vertices(view);
        }
        let surfaces = &self.surfaces;
        self.coarse_surfaces.prepare(&self.coarse_rays, view, &surfaces.positions, &surfaces.triangles);
        let (blockers, transfer, planes) = (&self.blockers, &self.transfer, &self.planes);
        let forward = view.world_from_camera.z_axis;
        let see = |fragment: &Fragment| CoarsePoint {
            point_world: fragment.point_world,
            normal: surface_normals(surfaces, fragment).0,
            inverse_depth: 1.0 / forward.dot(fragment.point_world - view.eye),
            receiver: surfaces.receives[fragment.triangle].then_some(fragment.triangle as u32),
        };
        raster::draw_surfaces(
            &self.coarse_rays,
            view,
            &self.coarse_surfaces,
            CoarsePoint::default(),
            see,
            &mut self.samples,
            &mut self.coarse,
        );
        let (width, height) = (self.coarse.width(), self.coarse.height());
        self.soft.reshape(width, height, [0.0; 4]);
        let rows = self.soft.pixels_mut().par_chunks_mut(width.max(1));
        rows.zip(self.coarse.pixels().par_chunks(width.max(1))).for_each(|(out, row)| {
            soft_shadow::taken_in_row(blockers, transfer, planes, row, out);
        });
    }

    /// Lays the grid for the spheres of a frame.
    pub(crate) fn lay_grid(&mut self, input: &RelightInput<'_>, view: &View) {
        let spheres = input.posed.map_or(&[][..], Posed::spheres);
        self.grid.lay(&self.surfaces, spheres, view.eye);
    }

    /// The coarse picture from what is taken at the grid's vertices.
    fn soft_at_vertices(&mut self, view: &View) {
        self.grid.evaluate(&self.blockers, &self.transfer, &self.planes);
        let grid = &self.grid;
        self.coarse_surfaces.prepare(&self.coarse_rays, view, grid.positions(), grid.triangles());
        let forward = view.world_from_camera.z_axis;
        let see = |fragment: &Fragment| {
            let inverse_depth = 1.0 / forward.dot(fragment.point_world - view.eye);
            grid.taken(fragment.triangle, fragment.barycentric, inverse_depth)
        };
        raster::draw_surfaces(
            &self.coarse_rays,
            view,
            &self.coarse_surfaces,
            [0.0; 4],
            see,
            &mut self.samples,
            &mut self.soft,
        );
    }
}
