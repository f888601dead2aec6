//! A known room in the frame: its lights, their maps, and its light on objects.

use super::FrameState;
use crate::{
    NearChoice, RelightInput,
    compose::geometry::{ObjectGeometry, SurfaceGeometry},
    model::quality::Quality,
    nearfield::{
        frame::{NearFrame, NearQuality},
        objects as near_objects,
        prepare::KnownRoom,
        shaft::Aabb,
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
pub(crate) struct RoomState {
    known: Option<Arc<KnownRoom>>,
    proxies: Proxies,
    pub frame: NearFrame,
    pub suns: SunShadows,
    /// How many rooms were taken: what a device holds of one stays while this stays.
    pub taken: u64,
    /// Number of the room's first triangle among the surfaces, and its triangles' corners as vertices of the room.
    first_triangle: usize,
    triangles: Vec<[u32; 3]>,
}

impl RoomState {
    /// Takes a room, or none; [`RoomState::place`] has to follow.
    pub fn take(&mut self, known: Option<Arc<KnownRoom>>) {
        self.suns = SunShadows::default();
        self.taken += 1;
        self.triangles.clear();
        if let Some(known) = &known {
            self.suns.load(&known.room, &known.suns, &known.field, SUN_TEXELS);
            let patches = &known.field.patches.patches;
            self.triangles.extend(patches.iter().flat_map(|patch| patch.triangles()));
        }
        self.known = known;
    }

    /// Adds the room to the real surfaces and finds stand-ins for the objects.
    pub fn place(&mut self, objects: &ObjectGeometry, surfaces: &mut SurfaceGeometry) {
        let Some(known) = &self.known else { return };
        self.first_triangle = surfaces.add_room(&known.field.patches);
        let ranges = objects.ranges.iter().map(|(_, triangles)| triangles.clone());
        self.proxies = Proxies::build(&objects.positions, &objects.triangles, ranges, MOST_TRIANGLES);
    }

    /// The room, where there is one.
    pub fn known(&self) -> Option<&Arc<KnownRoom>> {
        self.known.as_ref()
    }

    /// Triangles of the objects' stand-ins, corners as numbers of the frame's casters.
    pub fn casters(&self) -> &[[u32; 3]] {
        self.proxies.triangles()
    }

    /// Number of the room's first triangle among the surfaces, and its triangles' corners as vertices of the room.
    pub fn triangles(&self) -> (usize, &[[u32; 3]]) {
        (self.first_triangle, &self.triangles)
    }

    /// Finds the frame's lights, near ones and suns, and fits the near ones' maps.
    pub fn find_lights(&mut self, objects: &ObjectGeometry, input: &RelightInput<'_>, quality: &Quality) {
        let Some(known) = &self.known else { return };
        let near = NearQuality {
            lights: quality.shadow_maps,
            left_rad: quality.near_width_rad(),
            texels: (quality.shadow_map_texels / NEAR_TEXELS_DIVISOR).max(64),
            places: quality.pcf_taps,
        };
        let camera = (input.lens, input.world_from_camera);
        self.frame.update_under(&self.suns, &known.field, &self.proxies, &objects.positions, camera, &near);
    }

    /// What the lights of the last frame were.
    pub fn near_choice(&self) -> NearChoice {
        NearChoice {
            lights: self.frame.lights().len(),
            suns: self
                .frame
                .sun_maps()
                .iter()
                .enumerate()
                .filter(|(k, map)| **map == Some(*k as u32))
                .count(),
            width_rad: self.frame.left_rad(),
        }
    }

    /// Draws the maps here.
    pub fn draw_maps(&mut self) {
        self.frame.draw(&self.proxies);
    }

    /// Lists which lights matter where; `is_drawn` as for [`NearFrame::list`].
    pub fn list(&mut self, is_drawn: bool) {
        if let Some(known) = &self.known {
            self.frame.list(&known.field, &self.triangles, is_drawn);
        }
    }
}

impl RoomState {
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

impl FrameState {
    /// Lights the objects' vertices by the room, where the scene stands in one.
    pub(super) fn light_by_room(&mut self) {
        let Some(known) = self.room.known().filter(|_| self.stands_in_room).cloned() else { return };
        let (room, objects) = (&self.room, &self.objects);
        self.transferred.put(|object, vertex| room.white_at(&known, objects, object, vertex));
    }
}
