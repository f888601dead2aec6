//! A known room's light on virtual objects: all of it from the irradiance volume, and of that the frame's lights with the
//! shadows that objects throw on themselves and on one another, from the same maps (Sections 7.2 and 7.3 of [Gib03]).

use super::{faces::Faces, frame::NearFrame, irradiance::IrradianceVolume, prepare::KnownRoom};
use crate::{
    model::light::{HardLight, Lights},
    visibility::point_maps::{self, WHOLE},
};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// What a white matt surface radiates at a vertex (world frame, metres, unit normal), linear RGB: light of the frame's
/// lights as far as it arrives, and the rest of the volume's light times `openness`, the share of the hemisphere that the
/// object itself leaves open. The maps must be drawn.
///
/// A light counts as a small one in its middle: near a large one its part is too much, and is cut to what the volume has.
pub fn white_at(
    volume: &IrradianceVolume,
    frame: &NearFrame,
    point_world: Vec3,
    normal: Vec3,
    openness: f32,
) -> [f32; 3] {
    let whole = volume.white(point_world, normal);
    let (mut near, mut arrives) = ([0.0f32; 3], [0.0f32; 3]);
    for (k, (light, intensity)) in frame.lights().iter().zip(frame.intensities()).enumerate() {
        let to = light.middle_world - point_world;
        let square = to.length_squared();
        let towards = to.normalize_or_zero();
        let (cosine, ahead) = (normal.dot(towards), -light.normal_world.dot(towards));
        if !(cosine > 0.0 && ahead > 0.0 && square > 0.0) {
            continue;
        }
        let share = FRAC_1_PI * cosine * ahead / square;
        let visible = frame.maps().get(k).map_or(1.0, |(camera, maps)| {
            point_maps::visibility(maps, camera, WHOLE, point_world, Some(normal))
        });
        for c in 0..3 {
            let e = share * intensity[c];
            near[c] += e;
            arrives[c] += e * visible;
        }
    }
    std::array::from_fn(|c| {
        // The volume knows how much there is; the lights, which part of it is theirs.
        let part = if near[c] > whole[c] { whole[c] / near[c] } else { 1.0 };
        part * arrives[c] + (whole[c] - part * near[c]).max(0.0) * openness
    })
}

/// The least share of a sun that an object is lit with: a light of none would be left out, and the others' maps would be taken
/// for its.
const LEAST_SHARE: f32 = 1e-6;

/// A known room's light at a place, as objects there are lit with: the volume's, and every sun of the room in its order, as far
/// as the room (`faces`: its own) lets it through to the place (a world point, metres).
pub fn lights_at(known: &KnownRoom, faces: &Faces, point_world: Vec3) -> Lights {
    let mut lights = Lights::soft(known.volume.sample(point_world));
    for sun in &known.suns {
        let arrives = faces.leaves(point_world, Vec3::from(sun.to_light_world), &sun.apertures);
        let share = if arrives { 1.0 } else { LEAST_SHARE };
        lights.hard.push(HardLight {
            to_light_world: sun.to_light_world,
            irradiance_rgb: sun.irradiance_rgb.map(|e| e * share),
            extent_rad: sun.extent_rad,
        });
    }
    lights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::room::RoomSun;
    use crate::nearfield::{
        fixture,
        prepare::{RoomLight, RoomSettings, prepare},
    };

    fn known() -> KnownRoom {
        prepare(fixture::room(), &RoomSettings::default(), RoomLight::Given, None, &|_| ()).unwrap()
    }

    #[test]
    fn under_the_table_it_is_darker_than_on_it() {
        let known = known();
        let frame = NearFrame::default();
        let white = |at: Vec3| white_at(&known.volume, &frame, at, Vec3::Z, 1.0)[0];
        let (on, under) = (white(Vec3::new(0.3, -0.2, 0.2)), white(Vec3::new(0.0, 0.0, -0.5)));
        assert!(on > 0.0 && under < 0.4 * on, "{under} under, {on} on the table");
        // What the object itself leaves open counts where no light of the frame is known.
        let half = white_at(&known.volume, &frame, Vec3::new(0.3, -0.2, 0.2), Vec3::Z, 0.5)[0];
        assert!((half / on - 0.5).abs() < 1e-5);
    }

    #[test]
    fn suns_shine_where_the_room_lets_them() {
        let mut known = known();
        let sun = |z: f32, apertures: Vec<u32>| RoomSun {
            to_light_world: Vec3::new(-0.5, -0.3, z).normalize().to_array(),
            irradiance_rgb: [2.0, 1.8, 1.5],
            extent_rad: 0.005,
            apertures,
        };
        // The walls are surface 0: one sun through them, one that they hide.
        known.suns = vec![sun(1.0, vec![0]), sun(1.2, vec![])];
        let faces = Faces::of_room(&known.room);
        let on = lights_at(&known, &faces, Vec3::new(0.0, 0.0, 0.2));
        let strengths: Vec<f32> = on.hard.as_slice().iter().map(|h| h.irradiance_rgb[0]).collect();
        assert_eq!(strengths.len(), 2, "each keeps its place");
        assert!(strengths[0] == 2.0 && strengths[1] > 0.0 && strengths[1] < 1e-5, "{strengths:?}");
        let under = lights_at(&known, &faces, Vec3::new(0.0, 0.0, -0.3));
        assert!(under.hard.as_slice()[0].irradiance_rgb[0] < 1e-5, "the table hides it");
    }
}
