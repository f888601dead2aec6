//! A small room that is known: a window, faintly lit walls and a table, with objects on it and below.
#![allow(dead_code)]
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use glam::{Affine3A, DVec3, Vec3};
use halflight::{
    assets::shapes,
    math::{
        lens::{Distortion, Lens},
        pose::Pose,
    },
    model::{
        room::{Face, Room, RoomSun, RoomSurface},
        scene::{Material, Mesh, Scene, VirtualObject},
    },
    nearfield::{
        field::Preparation,
        prepare::{KnownRoom, RoomLight, RoomSettings, prepare},
    },
};
use std::sync::Arc;

/// Sides of a box whose corners are numbered by their signs, x first; they look outwards.
const SIDES: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn cuboid(name: &str, low: [f32; 3], high: [f32; 3], inwards: bool, emitted: f32) -> RoomSurface {
    let corner = |i: usize| {
        let pick = |bit: usize| if i >> bit & 1 == 0 { low[bit] } else { high[bit] };
        Vec3::new(pick(0), pick(1), pick(2))
    };
    let side = |s: [u32; 4]| Face::Quad(if inwards { [s[3], s[2], s[1], s[0]] } else { s });
    RoomSurface {
        name: name.to_owned(),
        corners_world: (0..8).map(corner).collect(),
        faces: SIDES.map(side).to_vec(),
        reflectance_rgb: [0.6, 0.55, 0.5],
        emitted_rgb: [emitted, 0.9 * emitted, 0.8 * emitted],
    }
}

/// Which surface the sun shines in through.
const WINDOW: usize = 2;

/// 4 x 3 x 2.5 m, the table's top at z = 0; `sun`: through the window.
pub fn known_room(sun: bool) -> KnownRoom {
    let surfaces = vec![
        cuboid("walls", [-2.0, -1.5, -0.75], [2.0, 1.5, 1.75], true, 0.05),
        cuboid("table", [-0.6, -0.4, -0.04], [0.6, 0.4, 0.0], false, 0.0),
        cuboid("window", [-1.995, -0.7, 0.2], [-1.99, 0.5, 1.3], false, 6.0),
    ];
    let how = RoomSettings {
        patch_m: Some(0.25),
        preparation: Preparation { power_share: 1.0, ..Preparation::default() },
    };
    let mut known = prepare(Room { surfaces }, &how, RoomLight::Given, None, &|_| ()).unwrap();
    if sun {
        known.suns.push(RoomSun {
            to_light_world: Vec3::new(-0.9, 0.1, 0.35).normalize().to_array(),
            irradiance_rgb: [4.0, 3.6, 3.0],
            extent_rad: 0.01,
            apertures: vec![WINDOW as u32],
        });
    }
    known
}

fn object(name: &str, mesh: Mesh, at: Vec3) -> VirtualObject {
    VirtualObject {
        name: name.into(),
        mesh,
        material: Material::Lambert { albedo_rgb: [0.7, 0.4, 0.3] },
        world_from_object: Affine3A::from_translation(at),
        openness: Vec::new(),
    }
}

/// A ball over the table, a box that stands on it, and a ball on the floor before it.
pub fn scene(known: &Arc<KnownRoom>) -> Scene {
    Scene {
        objects: vec![
            object("ball", shapes::uv_sphere(0.09, 24, 12), Vec3::new(0.1, 0.05, 0.16)),
            object("box", shapes::cuboid(DVec3::new(0.08, 0.05, 0.11)), Vec3::new(-0.25, -0.05, 0.11)),
            object("low", shapes::uv_sphere(0.15, 24, 12), Vec3::new(0.3, -0.8, -0.58)),
        ],
        surfaces: Vec::new(),
        figures: Vec::new(),
        transfer: None,
        room: Some(Arc::new(known.room.clone())),
    }
}

/// A camera that looks down at the table.
pub fn camera(width: u32, height: u32, distortion: Distortion) -> (Lens, Pose) {
    let focal = 0.9 * f64::from(width);
    let (x, y) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    let lens = Lens { distortion, ..Lens::pinhole(width, height, focal, focal, x, y) };
    let pose = Pose::look_at(DVec3::new(0.9, -1.2, 0.95), DVec3::new(-0.05, -0.1, 0.0), DVec3::Z);
    (lens, pose)
}
