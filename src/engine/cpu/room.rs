//! A known room in the frame: its lights, their maps, and what objects leave of them.

use super::{super::RelightInput, RUN, Work, points_of};
use crate::{
    compose::{
        geometry::{ObjectGeometry, SurfaceGeometry},
        raster::{self, Row, View},
        shade_object::LightTerms,
    },
    model::{quality::Quality, response::Response},
    nearfield::{
        frame::{NearFrame, NearQuality},
        objects as near_objects,
        prepare::KnownRoom,
        shaft::Aabb,
        subtract::{self, RoomPoints, SubtractFrame},
        subtract_displayed::{self, DisplayCurve, DisplayedFrame, DisplayedLights},
        sun_shadows::SunShadows,
    },
    visibility::proxies::{MOST_TRIANGLES, Proxies},
};
use std::sync::Arc;

/// Texels a side of the suns' maps of the room itself.
const SUN_TEXELS: u32 = 1024;
/// Near lights' maps have this share of `Quality::shadow_map_texels` a side: 256 of 1024, as in [Gib03].
const NEAR_TEXELS_DIVISOR: u32 = 4;
/// A vertex looks for its own shadow from this share of its object's size before the surface.
const CLEARANCE: f32 = 0.01;

/// A room that was loaded, and the memory of its frames.
#[derive(Default)]
pub(crate) struct RoomWork {
    known: Option<Arc<KnownRoom>>,
    proxies: Proxies,
    pub(crate) frame: NearFrame,
    pub(crate) suns: SunShadows,
    pub(crate) displayed: Displayed,
    /// Number of the room's first triangle among the surfaces, and its triangles' corners as vertices of the room.
    first_triangle: usize,
    triangles: Vec<[u32; 3]>,
}

/// Neighbours in a row of the picture.
struct Neighbours<'a> {
    row: &'a Row<'a>,
    first: usize,
}

impl Neighbours<'_> {
    /// Weights of the triangle's corners at neighbour `i`.
    fn weights(&self, i: usize) -> [f32; 3] {
        self.row.fragment(self.first + i).map_or([0.0; 3], |f| f.barycentric)
    }

    /// Number of its pixel in the picture.
    fn pixel(&self, i: usize) -> usize {
        self.row.pixel(self.first + i)
    }
}

/// What subtracting from displayed values asks for.
#[derive(Default)]
pub(crate) struct Displayed {
    pub(crate) lights: DisplayedLights,
    pub(crate) curve: Option<DisplayCurve>,
}

impl RoomWork {
    /// Takes a room, or none; [`RoomWork::place`] has to follow.
    pub(crate) fn take(&mut self, known: Option<Arc<KnownRoom>>) {
        self.suns = SunShadows::default();
        self.triangles.clear();
        if let Some(known) = &known {
            self.suns.load(&known.room, &known.suns, &known.field, SUN_TEXELS);
            let patches = &known.field.patches.patches;
            self.triangles.extend(patches.iter().flat_map(|patch| patch.triangles()));
        }
        self.known = known;
    }

    /// Adds the room to the real surfaces and finds stand-ins for the objects.
    pub(crate) fn place(&mut self, objects: &ObjectGeometry, surfaces: &mut SurfaceGeometry) {
        let Some(known) = &self.known else { return };
        self.first_triangle = surfaces.add_room(&known.field.patches);
        let ranges = objects.ranges.iter().map(|(_, triangles)| triangles.clone());
        self.proxies = Proxies::build(&objects.positions, &objects.triangles, ranges, MOST_TRIANGLES);
    }

    /// The room, where there is one.
    pub(crate) fn known(&self) -> Option<&Arc<KnownRoom>> {
        self.known.as_ref()
    }

    /// Triangles of the objects' stand-ins, corners as numbers of the frame's casters.
    pub(crate) fn casters(&self) -> &[[u32; 3]] {
        self.proxies.triangles()
    }

    /// Number of the room's first triangle among the surfaces, and its triangles' corners as vertices of the room.
    pub(crate) fn triangles(&self) -> (usize, &[[u32; 3]]) {
        (self.first_triangle, &self.triangles)
    }

    /// Finds the frame's lights, near ones and suns, and fits the near ones' maps.
    pub(crate) fn find_lights(
        &mut self,
        objects: &ObjectGeometry,
        input: &RelightInput<'_>,
        quality: &Quality,
    ) {
        let Some(known) = &self.known else { return };
        let near = NearQuality {
            lights: quality.shadow_maps,
            texels: (quality.shadow_map_texels / NEAR_TEXELS_DIVISOR).max(64),
            places: quality.pcf_taps,
        };
        let camera = (input.lens, input.world_from_camera);
        self.frame.update_under(&self.suns, &known.field, &self.proxies, &objects.positions, camera, &near);
    }

    /// Draws the maps here.
    pub(crate) fn draw_maps(&mut self) {
        self.frame.draw(&self.proxies);
    }

    /// Deals the frame's lights out to their sets, and takes a display's response.
    pub(crate) fn deal_out(&mut self, response: &Response) {
        let Displayed { lights, curve } = &mut self.displayed;
        lights.update(&self.frame);
        curve.get_or_insert_with(|| DisplayCurve::of(response)).update(response);
    }

    /// Lists which lights matter where; `is_drawn` as for [`NearFrame::list`].
    pub(crate) fn list(&mut self, is_drawn: bool) {
        if let Some(known) = &self.known {
            self.frame.list(&known.field, &self.triangles, is_drawn);
        }
    }
}

impl RoomWork {
    /// What a white surface radiates at a vertex of an object in the room's light; the maps must be drawn.
    fn white_at(
        &self,
        known: &KnownRoom,
        objects: &ObjectGeometry,
        object: usize,
        vertex: usize,
    ) -> [f32; 3] {
        let (point, normal) = (objects.positions[vertex], objects.normals[vertex]);
        let size = self.frame.boxes().get(object).map_or(0.0, Aabb::diagonal);
        // Out of reach of its own stand-in.
        let before = point + normal * size * (self.proxies.error() + CLEARANCE);
        near_objects::white_at(&known.volume, &self.frame, before, normal, objects.tint_openness[vertex][3])
    }
}

impl Work {
    /// Lights the objects' vertices by the room, where the scene stands in one.
    pub(crate) fn light_by_room(&mut self) {
        let Some(known) = self.room.known().filter(|_| self.stands_in_room).cloned() else { return };
        let (room, objects) = (&self.room, &self.objects);
        self.transferred.put(|object, vertex| room.white_at(&known, objects, object, vertex));
    }

    pub(crate) fn find_room_lights(&mut self, input: &RelightInput<'_>, quality: &Quality) {
        if !self.held.near_is_fitted() {
            self.held.near_fitted();
            self.room.find_lights(&self.objects, input, quality);
        }
    }

    pub(crate) fn point_maps(&mut self, input: &RelightInput<'_>, quality: &Quality) {
        self.find_room_lights(input, quality);
        self.room.draw_maps();
        self.held.near_maps_drawn(self.room.frame.maps().cameras());
    }

    /// The ratio at every pixel that sees the front of the room; 1 elsewhere.
    pub(crate) fn subtract(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        quality: &Quality,
    ) {
        self.draw_room(input, view, light, quality, |with, run, of, out| {
            subtract::at_points(with, run, |i| of.weights(i), out);
        });
    }

    /// The same from the values that a display shows of the place.
    pub(crate) fn subtract_displayed(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        quality: &Quality,
    ) {
        self.room.deal_out(input.response);
        let Displayed { lights, curve } = std::mem::take(&mut self.room.displayed);
        if let Some(curve) = &curve {
            let (background, exposure_s) =
                (input.background.radiance.pixels(), input.shown_exposure.effective_s() as f32);
            let exposure = |pixel: usize| background[pixel].map(|c| c * exposure_s);
            self.draw_room(input, view, light, quality, |with, run, of, out| {
                let shared = DisplayedFrame { with: *with, lights: &lights, curve };
                subtract_displayed::at_points(
                    &shared,
                    run,
                    |i| of.weights(i),
                    |i| exposure(of.pixel(i)),
                    out,
                );
            });
        }
        self.room.displayed = Displayed { lights, curve };
    }

    /// Gives each run of neighbours that see the front of a triangle of the room from which something may be taken.
    fn draw_room(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        quality: &Quality,
        at_points: impl Fn(&SubtractFrame<'_>, &RoomPoints<'_, RUN>, &Neighbours<'_>, &mut [[f32; 3]]) + Sync,
    ) {
        self.project_surfaces(input, view, quality);
        self.room.list(true);
        let Some(known) = self.room.known() else { return };
        debug_assert!(light.hard().len() >= self.shadows.cameras().len());
        let with = SubtractFrame {
            field: &known.field,
            frame: &self.room.frame,
            suns: &self.room.suns,
            sun_shadows: &self.shadows,
            taps: quality.pcf_taps,
        };
        let (surfaces, first) = (&self.surfaces, self.room.first_triangle);
        let triangles = &self.room.triangles;
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
            view,
            &self.seen_surfaces,
            [1.0; 3],
            shade_row,
            &mut self.samples,
            &mut self.ratio,
        );
    }
}
