//! Objects into their layer.

use super::{Twins, fragments::object_point};
use crate::compose::{
    geometry::MIRROR_EXPONENT,
    raster::{self, Fragment},
    shade_object,
};
use crate::frame::{FrameJob, FrameState};
use glam::Vec3;

impl Twins {
    /// Objects over nothing, hidden by real surfaces.
    pub(super) fn shade_object(&mut self, job: &FrameJob<'_>, state: &mut FrameState) {
        self.project_surfaces(job, state);
        state.light_vertices(job);
        let (view, light, pcf_taps) = (&job.camera, &job.light, job.quality.pcf_taps);
        let (objects, shadows, transferred) = (&state.objects, &state.shadows, &state.transferred);
        let surroundings = job.surroundings(&state.reflected);
        self.seen_objects.prepare(&self.rays, view, &objects.positions, &objects.triangles);
        let shade = |fragment: &Fragment| {
            let (point, facet) = object_point(objects, transferred, fragment);
            let material = objects.material_of_triangle[fragment.triangle];
            let terms = &objects.materials[material as usize];
            let is_mirror = terms.exponent == MIRROR_EXPONENT;
            shade_object::shade(light, &surroundings, terms, &point, |k, at, cosine| {
                // The bias follows the facet, which may lean further from the light than the interpolated normal.
                let to_light = Vec3::from(light.hard()[k].to_light_world);
                let cosine = if is_mirror { cosine } else { cosine.min(facet.dot(to_light)) };
                shadows.visibility(k, pcf_taps, at, cosine)
            })
        };
        raster::draw_objects(
            &self.rays,
            view,
            &self.seen_objects,
            &self.seen_surfaces,
            shade,
            &mut self.samples,
            &mut state.results.object_layer,
        );
    }
}
