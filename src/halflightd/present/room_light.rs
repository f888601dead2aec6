//! A known room's light where the objects are: for their matt parts, and as a small picture of the room for mirrors and
//! gloss, taken anew where the objects are now (Section 7.3 of [Gib03]).

use crate::{
    light::prefilter::{Prefilter, WantedEnvironment},
    math::octahedral,
    model::{
        environment::EnvironmentPicture,
        light::{Lights, RadianceSamples},
    },
    nearfield::{faces::Faces, irradiance::sent_out, objects, prepare::KnownRoom},
};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Texels a side of the picture.
const SIDE: usize = 48;
/// The picture is taken anew when the objects have gone so far, metres.
const MOVED_M: f32 = 0.02;

/// A room and what was last seen of it.
pub struct LightInRoom {
    known: Arc<KnownRoom>,
    surfaces: Faces,
    patches: Faces,
    prefilter: Prefilter,
    samples: RadianceSamples,
    picture: EnvironmentPicture,
    taken_at: Option<Vec3>,
}

impl LightInRoom {
    /// Of a room; no picture is taken yet.
    pub fn new(known: Arc<KnownRoom>) -> Self {
        Self {
            surfaces: Faces::of_room(&known.room),
            patches: Faces::of_patches(&known.field.patches),
            known,
            prefilter: Prefilter::default(),
            samples: RadianceSamples::default(),
            picture: EnvironmentPicture::default(),
            taken_at: None,
        }
    }

    /// Made ready, with its patches and their light.
    pub fn known(&self) -> &Arc<KnownRoom> {
        &self.known
    }

    /// Light at a place (world frame, metres).
    pub fn lights_at(&self, point_world: Vec3) -> Lights {
        objects::lights_at(&self.known, &self.surfaces, point_world)
    }

    /// The picture of the room from a place, where it is wanted. Texels of 4 degrees: sharp reflections are blurred. Suns
    /// are not in it; they are hard lights.
    pub fn picture_at(
        &mut self,
        point_world: Vec3,
        wanted: WantedEnvironment,
    ) -> Option<&EnvironmentPicture> {
        if !wanted.picture {
            return None;
        }
        let near = |before: Vec3| before.distance(point_world) < MOVED_M;
        if !self.taken_at.is_some_and(near) {
            self.take(point_world);
            self.prefilter.see(&self.samples, 1.0, &mut self.picture);
            if wanted.glossy {
                self.prefilter.levels(Some(&self.samples), &mut self.picture);
            }
            self.taken_at = Some(point_world);
        }
        Some(&self.picture)
    }

    /// Radiance of the patches that are seen, one ray a texel.
    fn take(&mut self, from: Vec3) {
        let Self { known, patches, samples, .. } = self;
        samples.directions.resize(SIDE * SIDE, [0.0; 4]);
        samples.radiance.resize(SIDE * SIDE, [0.0; 4]);
        let rows = samples.directions.par_chunks_mut(SIDE).zip(samples.radiance.par_chunks_mut(SIDE));
        rows.enumerate().for_each(|(row, (directions, radiance))| {
            for (column, (slot, seen)) in directions.iter_mut().zip(radiance).enumerate() {
                let towards = octahedral::direction(octahedral::centre(column, row, SIDE));
                *slot = towards.extend(octahedral::texel_sr(column, row, SIDE)).to_array();
                let met = patches.first(from, towards).filter(|met| met.is_front);
                let patch = met.and_then(|met| known.field.patches.patches.get(met.index as usize));
                let [r, g, b] = patch.map_or([0.0; 3], |patch| sent_out(&known.field, patch));
                *seen = [r, g, b, 0.0];
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        model::room::{Face, Room, RoomSurface},
        nearfield::prepare::{RoomLight as Source, RoomSettings, prepare},
    };

    /// A cube of 2 m seen from inside: +x sends out 3, the rest 1.
    fn cube() -> Room {
        let corner = |i: u32| {
            let sign = |bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
            Vec3::new(sign(0), sign(1), sign(2))
        };
        let sides = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let surfaces = sides.iter().enumerate().map(|(i, s)| RoomSurface {
            name: format!("side {i}"),
            corners_world: s.map(corner).to_vec(),
            faces: vec![Face::Quad([3, 2, 1, 0])],
            reflectance_rgb: if i == 0 { [1e-6; 3] } else { [0.0; 3] },
            emitted_rgb: if i == 1 { [3.0; 3] } else { [1.0; 3] },
        });
        Room { surfaces: surfaces.collect() }
    }

    #[test]
    fn mirrors_see_the_room_from_where_they_are() {
        let how = RoomSettings { patch_m: Some(0.5), ..RoomSettings::default() };
        let known = prepare(cube(), &how, Source::Given, None, &|_| ()).unwrap();
        let mut light = LightInRoom::new(Arc::new(known));
        let wanted = WantedEnvironment { picture: true, glossy: true };
        assert!(light.picture_at(Vec3::ZERO, WantedEnvironment { picture: false, glossy: false }).is_none());
        let picture = light.picture_at(Vec3::ZERO, wanted).unwrap();
        let first = picture.revision;
        let close = |d: Vec3, of: &EnvironmentPicture, value: f32| {
            let seen = of.all.look(d)[1];
            assert!((seen - value).abs() < 0.02, "{d}: {seen}, not {value}");
        };
        close(Vec3::X, picture, 3.0);
        close(Vec3::NEG_X, picture, 1.0);
        // 51 degrees off the axis the wall at +y is seen from the middle, but the one at +x from before it.
        let aside = Vec3::new(1.0, 1.25, 0.0).normalize();
        close(aside, picture, 1.0);
        assert!(!picture.glossy.is_empty());
        assert_eq!(light.picture_at(Vec3::new(0.0, 0.01, 0.0), wanted).unwrap().revision, first, "kept");
        let moved = light.picture_at(Vec3::new(0.7, 0.0, 0.0), wanted).unwrap();
        assert_ne!(moved.revision, first);
        close(aside, moved, 3.0);
        let lights = light.lights_at(Vec3::ZERO);
        assert!(lights.hard.as_slice().is_empty() && lights.global.rgb[0][0] > 3.0);
    }
}
