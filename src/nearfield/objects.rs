//! A known room's light on virtual objects: all of it from the irradiance volume, and of that the frame's lights with the
//! shadows that objects throw on themselves and on one another, from the same maps (Sections 7.2 and 7.3 of [Gib03]).

use super::{frame::NearFrame, irradiance::IrradianceVolume, prepare::KnownRoom};
use crate::{
    model::{
        light::{HardLight, Lights},
        room::{Room, RoomSun},
    },
    visibility::point_maps,
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
        let visible = match frame.maps().get(k) {
            Some((camera, map)) => match camera.map(point_world) {
                Some(mapped) => {
                    // Vertices lie in no plane: a little before the surface nothing of it is in the way.
                    let slope = camera.slope(point_world, normal);
                    point_maps::visibility(map.depth(), camera, &frame.places()[k], mapped, slope)
                }
                None => 1.0,
            },
            None => 1.0,
        };
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
/// as the room lets it through to the place (a world point, metres).
pub fn lights_at(known: &KnownRoom, point_world: Vec3) -> Lights {
    let mut lights = Lights::soft(known.volume.sample(point_world));
    for sun in &known.suns {
        let share = if hides_sun(&known.room, sun, point_world) { LEAST_SHARE } else { 1.0 };
        lights.hard.push(HardLight {
            to_light_world: sun.to_light_world,
            irradiance_rgb: sun.irradiance_rgb.map(|e| e * share),
            extent_rad: sun.extent_rad,
        });
    }
    lights
}

/// Whether the room stands between a place and a sun. Looks at every face: for one place a frame.
fn hides_sun(room: &Room, sun: &RoomSun, from: Vec3) -> bool {
    let towards = Vec3::from(sun.to_light_world);
    let stands = |index: usize| !sun.apertures.contains(&(index as u32));
    room.surfaces.iter().enumerate().filter(|(index, _)| stands(*index)).any(|(_, surface)| {
        let corner = |i: u32| surface.corners_world.get(i as usize).copied();
        surface.faces.iter().any(|face| {
            let list = face.corners();
            (1..list.len() - 1).any(|k| {
                let [Some(a), Some(b), Some(c)] = [list[0], list[k], list[k + 1]].map(corner) else {
                    return false;
                };
                meets(from, towards, [a, b, c])
            })
        })
    })
}

/// Whether a ray meets a triangle from either side, edges counting.
fn meets(from: Vec3, towards: Vec3, [a, b, c]: [Vec3; 3]) -> bool {
    let (ab, ac) = (b - a, c - a);
    let across = towards.cross(ac);
    let volume = ab.dot(across);
    if volume.abs() < 1e-12 {
        return false;
    }
    let to = from - a;
    let u = to.dot(across) / volume;
    let up = to.cross(ab);
    let v = towards.dot(up) / volume;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && ac.dot(up) / volume > 1e-5
}
