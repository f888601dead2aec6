//! Soft shadows on real surfaces, at pixels or at vertices.

use super::{Twins, fragments::surface_normals};
use crate::compose::{
    raster::{self, Fragment},
    soft_shadow::{self, CoarsePoint},
};
use crate::frame::{FrameJob, FrameState};
use crate::model::quality::SoftAt;
use rayon::prelude::*;

impl Twins {
    /// What is taken of the soft light, in a coarse picture.
    pub(super) fn soft_shadow(&mut self, job: &FrameJob<'_>, state: &mut FrameState) {
        state.prepare_blockers(job);
        self.coarse_rays.update(&job.coarse_lens(), 1);
        if job.quality.soft_at == SoftAt::Vertex {
            state.lay_grid(job);
            return self.soft_at_vertices(job, state);
        }
        let view = &job.camera;
        let surfaces = &state.surfaces;
        self.coarse_surfaces.prepare(&self.coarse_rays, view, &surfaces.positions, &surfaces.triangles);
        let (blockers, transfer, planes) = (&state.blockers, &state.transfer, &state.planes);
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
        state.results.soft.reshape(width, height, [0.0; 4]);
        let rows = state.results.soft.pixels_mut().par_chunks_mut(width.max(1));
        rows.zip(self.coarse.pixels().par_chunks(width.max(1))).for_each(|(out, row)| {
            soft_shadow::taken_in_row(blockers, transfer, planes, row, out);
        });
    }

    /// The coarse picture from what is taken at the grid's vertices.
    fn soft_at_vertices(&mut self, job: &FrameJob<'_>, state: &mut FrameState) {
        let view = &job.camera;
        state.grid.evaluate(&state.blockers, &state.transfer, &state.planes);
        let grid = &state.grid;
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
            &mut state.results.soft,
        );
    }
}
