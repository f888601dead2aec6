//! What objects leave of a known room's light, at every pixel.

use super::{Twins, twins::points_of};
use crate::{
    compose::{
        carried::RUN,
        raster::{self, Row},
    },
    frame::{FrameJob, FrameState},
    nearfield::subtract::{self, RoomPoints, SubtractFrame},
};

/// Neighbours in a row of the picture.
pub(super) struct Neighbours<'a> {
    row: &'a Row<'a>,
    first: usize,
}

impl Neighbours<'_> {
    /// Weights of the triangle's corners at neighbour `i`.
    pub(super) fn weights(&self, i: usize) -> [f32; 3] {
        self.row.fragment(self.first + i).map_or([0.0; 3], |f| f.barycentric)
    }

    /// Number of its pixel in the picture.
    pub(super) fn pixel(&self, i: usize) -> usize {
        self.row.pixel(self.first + i)
    }
}

impl Twins {
    /// The ratio at every pixel: `at_points` gives it to each run of neighbours that see the front of a triangle of the room from
    /// which something may be taken; elsewhere it is 1.
    pub(super) fn draw_room(
        &mut self,
        job: &FrameJob<'_>,
        state: &mut FrameState,
        at_points: impl Fn(&SubtractFrame<'_>, &RoomPoints<'_, RUN>, &Neighbours<'_>, &mut [[f32; 3]]) + Sync,
    ) {
        self.project_surfaces(job, state);
        state.room.list(true);
        let Some(known) = state.room.known() else { return };
        debug_assert!(job.light.hard().len() >= state.shadows.cameras().len());
        let with = SubtractFrame {
            field: &known.field,
            frame: &state.room.frame,
            suns: &state.room.suns,
            sun_shadows: &state.shadows,
            taps: job.quality.pcf_taps,
        };
        let (first, triangles) = state.room.triangles();
        let surfaces = &state.surfaces;
        let shade_row = |row: &Row<'_>, out: &mut [[f32; 3]]| {
            let mut k = 0;
            while k < out.len() {
                let end = (k + row.run(k, RUN).max(1)).min(out.len());
                let of_room = row.triangle(k).and_then(|t| Some((t, t.checked_sub(first)?)));
                let of_room = of_room.filter(|(_, own)| subtract::may_take(&with, *own));
                let corners = of_room.and_then(|(_, own)| triangles.get(own).copied());
                let seen = of_room.zip(corners).zip(points_of(row, k, end - k));
                if let Some((((t, triangle), corners), points)) = seen {
                    let normal = surfaces.facet_normals[t];
                    if points.see_front(normal) {
                        let points_world = &points.point_world;
                        let run = RoomPoints { triangle, corners, normal, points_world };
                        at_points(&with, &run, &Neighbours { row, first: k }, &mut out[k..end]);
                    }
                }
                k = end;
            }
        };
        raster::draw_rows(
            &self.rays,
            &job.camera,
            &self.seen_surfaces,
            [1.0; 3],
            shade_row,
            &mut self.samples,
            &mut state.results.ratios,
        );
    }
}
