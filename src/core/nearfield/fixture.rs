//! A small room for the tests of this folder: four walls, a floor, a ceiling with a lamp, a table.

use super::{
    field::{NearField, Preparation},
    patches::{Subdivision, subdivide},
};
use crate::model::room::{Face, Room, RoomSurface};
use glam::Vec3;

fn surface(name: &str, corners: Vec<Vec3>, faces: &[[u32; 4]], reflects: f32, emits: f32) -> RoomSurface {
    RoomSurface {
        name: name.to_owned(),
        corners_world: corners,
        faces: faces.iter().map(|f| Face::Quad(*f)).collect(),
        reflectance_rgb: [reflects; 3],
        emitted_rgb: [emits, 0.9 * emits, 0.8 * emits],
    }
}

/// Corners of a box, numbered by their signs, x first.
fn corners(low: Vec3, high: Vec3) -> Vec<Vec3> {
    let pick = |i: u32, bit: u32, low: f32, high: f32| if i >> bit & 1 == 0 { low } else { high };
    (0..8)
        .map(|i| Vec3::new(pick(i, 0, low.x, high.x), pick(i, 1, low.y, high.y), pick(i, 2, low.z, high.z)))
        .collect()
}

const OUTWARDS: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// 4 x 3 x 2.5 m, z from -0.75, looking inwards.
pub fn walls(emits: f32) -> RoomSurface {
    let inwards = OUTWARDS.map(|[a, b, c, d]| [d, c, b, a]);
    surface("walls", corners(Vec3::new(-2.0, -1.5, -0.75), Vec3::new(2.0, 1.5, 1.75)), &inwards, 0.5, emits)
}

/// Walls, a table whose top is at z = 0, and a lamp of 0.6 m a side.
pub fn room() -> Room {
    let table = corners(Vec3::new(-0.6, -0.4, -0.04), Vec3::new(0.6, 0.4, 0.0));
    let lamp = corners(Vec3::new(0.3, -0.7, 1.74), Vec3::new(0.9, -0.1, 1.74));
    Room {
        surfaces: vec![
            walls(0.0),
            surface("table", table, &OUTWARDS, 0.6, 0.0),
            surface("lamp", lamp, &OUTWARDS[4..5], 0.0, 30.0),
        ],
    }
}

/// The room made ready.
pub fn field(room: &Room, patches: usize, how: &Preparation) -> NearField {
    let divided = subdivide(room, &Subdivision { patches, ..Subdivision::default() }, &|_| None).unwrap();
    NearField::build(room, divided, how, &|_| ()).unwrap()
}

/// All power, everything kept.
pub const ALL: Preparation = Preparation { power_share: 1.0, rays_side: 1, neglected: 0.0 };
