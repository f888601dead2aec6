//! The sun in a known room, which [Gib03] leaves out: light from a direction through the room's apertures. The room's own
//! shadow and the objects' shadows are maps of their own (spec 9, 10).

use super::{field::NearField, sun_blockers::sun_blockers, sun_sources::SunSources};
use crate::{
    model::{
        light::HardLight,
        room::{Room, RoomSun},
    },
    visibility::shadow_maps::{Receivers, ShadowMapSet},
};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Taps a side of the filter over the room's own shadow.
const ROOM_TAPS: u32 = 4;

/// So many texels before a flat receiver the filter meets nothing of it, however it leans: 2.5 sqrt(2) times the sine of its
/// angle to the light.
const BEFORE_TEXELS: f32 = 4.0;

/// One sun of a room.
#[derive(Clone, Debug)]
struct ShadowedSun {
    light: HardLight,
    /// Depths of the room without the sun's apertures; drawn once.
    room: ShadowMapSet,
}

/// The suns of a room and its own shadow under each.
#[derive(Clone, Debug, Default)]
pub struct SunShadows {
    suns: Vec<ShadowedSun>,
    sources: SunSources,
}

impl SunShadows {
    /// Draws the room's own maps, `texels` a side, and finds what each sun reaches of its receivers.
    pub fn load(&mut self, room: &Room, suns: &[RoomSun], field: &NearField, texels: u32) {
        self.suns.clear();
        self.suns.extend(suns.iter().map(|sun| {
            let light = HardLight {
                to_light_world: sun.to_light_world,
                irradiance_rgb: sun.irradiance_rgb,
                extent_rad: sun.extent_rad,
            };
            let (positions, triangles) = sun_blockers(room, sun);
            let mut of_room = ShadowMapSet::default();
            of_room.fit(&[light], &positions, &triangles, &Receivers::default(), texels, ROOM_TAPS);
            of_room.draw(&positions, &triangles);
            ShadowedSun { light, room: of_room }
        }));
        self.sources = SunSources::of(field, self);
    }

    /// The suns as leaves of a source tree.
    pub fn sources(&self) -> &SunSources {
        &self.sources
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
    pub fn get(&self, k: usize) -> Option<(&HardLight, &ShadowMapSet)> {
        self.suns.get(k).map(|sun| (&sun.light, &sun.room))
    }

    /// Share of sun `k` that the room lets through to a point of a receiver, 0 to 1; `cosine` between its normal and the sun.
    pub fn arrives(&self, k: usize, point_world: Vec3, cosine: f32) -> f32 {
        self.suns.get(k).map_or(0.0, |sun| sun.room.visibility(0, ROOM_TAPS, point_world, cosine))
    }

    /// The same a little before a receiver of unit `normal`: there no bias lets light in where walls adjoin.
    pub fn arrives_before(&self, k: usize, point_world: Vec3, normal: Vec3) -> f32 {
        let camera = self.suns.get(k).and_then(|sun| sun.room.cameras().first().and_then(Option::as_ref));
        let before_m = camera.map_or(0.0, |camera| BEFORE_TEXELS * camera.texel_m);
        self.arrives(k, point_world + before_m * normal, 1.0)
    }

    /// Light of all suns at a point of a receiver of unit `normal`, irradiance over pi: what arrives in the room without
    /// objects, and what of it objects take. `objects` has a map for each sun that has one in this frame, in their order, read by
    /// `taps` a side; `maps` says whose map each sun is hidden by (`NearFrame::sun_maps`). What a sun sends goes through the
    /// room's map of its own, whichever that is: light is neither lost nor gained.
    pub fn at(
        &self,
        point_world: Vec3,
        normal: Vec3,
        maps: &[Option<u32>],
        objects: &ShadowMapSet,
        taps: u32,
    ) -> [[f32; 3]; 2] {
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
            let of = maps.get(k).copied().flatten().map(|of| of as usize);
            let visible = of.zip(of.and_then(|of| self.suns.get(of))).map_or(1.0, |(of, sun)| {
                let cosine = normal.dot(Vec3::from(sun.light.to_light_world));
                objects.visibility(of, taps, point_world, cosine)
            });
            let taken = arrives * (1.0 - visible);
            for c in 0..3 {
                let e = sun.light.irradiance_rgb[c] * cosine * FRAC_1_PI;
                sums[0][c] += e * arrives;
                sums[1][c] += e * taken;
            }
        }
        sums
    }
}
