//! The sun in a known room, which [Gib03] leaves out: light from a direction through the room's apertures. The room's own
//! shadow and the objects' shadows are maps of their own (spec 9, 10).

use super::{prepare::KnownRoom, sun_blockers::sun_blockers};
use crate::{
    model::light::HardLight,
    visibility::shadow_maps::{Receivers, ShadowMaps},
};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Taps a side of the filter over the room's own shadow.
const ROOM_TAPS: u32 = 4;

/// One sun of a room.
#[derive(Clone, Debug)]
struct Sun {
    light: HardLight,
    /// Depths of the room without the sun's apertures; drawn once.
    room: ShadowMaps,
}

/// The suns of a room and its own shadow under each.
#[derive(Clone, Debug, Default)]
pub struct SunShadows {
    suns: Vec<Sun>,
}

impl SunShadows {
    /// Draws the room's own maps, `texels` a side.
    pub fn load(&mut self, known: &KnownRoom, texels: u32) {
        self.suns.clear();
        self.suns.extend(known.suns.iter().map(|sun| {
            let light = HardLight {
                to_light_world: sun.to_light_world,
                irradiance_rgb: sun.irradiance_rgb,
                extent_rad: sun.extent_rad,
            };
            let (positions, triangles) = sun_blockers(&known.room, sun);
            let mut room = ShadowMaps::default();
            room.fit(&[light], &positions, &triangles, &Receivers::default(), texels, ROOM_TAPS);
            room.draw(&positions, &triangles);
            Sun { light, room }
        }));
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.suns.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.suns.is_empty()
    }

    /// Sun `k` and the room's map of it: the one map of its set.
    pub fn get(&self, k: usize) -> Option<(&HardLight, &ShadowMaps)> {
        self.suns.get(k).map(|sun| (&sun.light, &sun.room))
    }

    /// Share of sun `k` that the room lets through to a point of a receiver, 0 to 1; `cosine` between its normal and the sun.
    pub fn arrives(&self, k: usize, point_world: Vec3, cosine: f32) -> f32 {
        self.suns.get(k).map_or(0.0, |sun| sun.room.visibility(0, ROOM_TAPS, point_world, cosine))
    }

    /// Light of all suns at a point of a receiver of unit `normal`, irradiance over pi: what arrives in the room without
    /// objects, and what of it objects take. `objects` has one map for each sun, in their order, read by `taps` a side.
    pub fn at(&self, point_world: Vec3, normal: Vec3, objects: &ShadowMaps, taps: u32) -> [[f32; 3]; 2] {
        let mut sums = [[0.0f32; 3]; 2];
        for (k, sun) in self.suns.iter().enumerate() {
            let cosine = normal.dot(Vec3::from(sun.light.to_light_world));
            if !(cosine > 0.0) {
                continue;
            }
            let arrives = self.arrives(k, point_world, cosine);
            if arrives <= 0.0 {
                continue;
            }
            let taken = arrives * (1.0 - objects.visibility(k, taps, point_world, cosine));
            for c in 0..3 {
                let e = sun.light.irradiance_rgb[c] * cosine * FRAC_1_PI;
                sums[0][c] += e * arrives;
                sums[1][c] += e * taken;
            }
        }
        sums
    }
}
