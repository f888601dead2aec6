//! The room as it would be measured and photographed for shadows of near light: rough geometry, and a probe's picture.

use super::{
    furnish::RoomPlan,
    paint::Paint,
    room::{Solid, SyntheticBallView, SyntheticRoom},
    shapes::SyntheticShape,
};
use crate::math::sphere::equirect_direction;
use crate::model::{
    image::RadianceImage,
    light::{EnvironmentMap, MapLayout},
    room::{Face, Room, RoomSurface},
};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Pieces of furniture are part of it from this length of their longest edge on, metres.
const LEAST_M: f64 = 0.2;
/// The window's pane stands so far before the wall, metres: its sky is mapped onto it and not onto the wall.
const PANE_M: f64 = 2e-3;
/// Rays along each side of a probe's texel.
const PROBE_RAYS: usize = 4;

/// Corners of a box, numbered by their signs, x first, and its sides seen from outside.
const SIDES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Walls, furniture on the floor, the table, window and lamp. What stands on the table and what is small is left out; each
/// side has the albedo of its paint's middle.
pub fn room(plan: &RoomPlan) -> Room {
    let mut surfaces = Vec::new();
    for (index, solid) in plan.solids.iter().enumerate() {
        match &solid.shape {
            SyntheticShape::Room { min, max } => {
                let corner = corners((*min + *max) / 2.0, (*max - *min) / 2.0, DVec2::X);
                for (face, side) in SIDES.iter().enumerate() {
                    let inwards = [side[3], side[2], side[1], side[0]].map(|i| corner[i]);
                    surfaces.push(quad(format!("wall {face}"), inwards, middle_albedo(solid, face)));
                }
            }
            SyntheticShape::Block { centre, half, turn }
                if !solid.on_table && 2.0 * half.max_element() >= LEAST_M =>
            {
                let corner = corners(*centre, *half, *turn);
                for (face, side) in SIDES.iter().enumerate() {
                    let name = format!("piece {index} side {face}");
                    surfaces.push(quad(name, side.map(|i| corner[i]), middle_albedo(solid, face)));
                }
            }
            SyntheticShape::Sphere { centre, radius } if solid.shines => {
                surfaces.push(globe("lamp", *centre, *radius));
            }
            _ => {}
        }
    }
    let w = &plan.window;
    let at = |u: f64, v: f64| w.point(DVec2::new(u, v)) + DVec3::X * PANE_M;
    surfaces.push(quad(
        "window".into(),
        [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)],
        DVec3::ZERO,
    ));
    Room { surfaces }
}

fn corners(centre: DVec3, half: DVec3, turn: DVec2) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let (x, y) = (sign(0) * half.x, sign(1) * half.y);
        centre + DVec3::new(turn.x * x - turn.y * y, turn.y * x + turn.x * y, sign(2) * half.z)
    })
}

fn quad(name: String, corners: [DVec3; 4], albedo: DVec3) -> RoomSurface {
    RoomSurface {
        name,
        corners_world: corners.map(|c| c.as_vec3()).to_vec(),
        faces: vec![Face::Quad([0, 1, 2, 3])],
        reflectance_rgb: albedo.as_vec3().to_array(),
        emitted_rgb: [0.0; 3],
    }
}

/// A globe of 128 triangles about a little more than the radius, so that it has the globe's area.
fn globe(name: &str, centre: DVec3, radius: f64) -> RoomSurface {
    let (rings, segments) = (8usize, 8usize);
    let mut corners_world = Vec::new();
    for i in 0..=rings {
        for k in 0..segments {
            let (a, b) = (
                std::f64::consts::PI * i as f64 / rings as f64,
                std::f64::consts::TAU * k as f64 / segments as f64,
            );
            let d = DVec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos());
            corners_world.push((centre + d * radius * 1.04).as_vec3());
        }
    }
    let at = |i: usize, k: usize| (i * segments + k % segments) as u32;
    let mut faces = Vec::new();
    for i in 0..rings {
        for k in 0..segments {
            if i > 0 {
                faces.push(Face::Triangle([at(i, k), at(i + 1, k + 1), at(i, k + 1)]));
            }
            if i + 1 < rings {
                faces.push(Face::Triangle([at(i, k), at(i + 1, k), at(i + 1, k + 1)]));
            }
        }
    }
    RoomSurface { name: name.into(), corners_world, faces, reflectance_rgb: [0.0; 3], emitted_rgb: [0.0; 3] }
}

/// Mean over a few places of a side.
fn middle_albedo(solid: &Solid, face: usize) -> DVec3 {
    let paint: Paint = solid.paints[face.min(solid.paints.len() - 1)];
    let size = solid.shape.face_size(face);
    let side = 9;
    let mut sum = DVec3::ZERO;
    for k in 0..side * side {
        let uv = DVec2::new((k % side) as f64 + 0.5, (k / side) as f64 + 0.5) / side as f64;
        sum += paint.albedo(uv, size, solid.shape.face_point(face, uv).0);
    }
    sum / (side * side) as f64
}

/// An equirectangular picture, world axes, from a place.
pub fn probe(room: &SyntheticRoom, position_world: DVec3, height: usize) -> EnvironmentMap {
    let (width, height) = (2 * height.max(1), height.max(1));
    let mut radiance = RadianceImage::default();
    radiance.reshape(width, height, [0.0; 3]);
    radiance.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let mut sum = DVec3::ZERO;
            for k in 0..PROBE_RAYS * PROBE_RAYS {
                let part = |k: usize| (k as f64 + 0.5) / PROBE_RAYS as f64;
                let u = (column as f64 + part(k % PROBE_RAYS)) / width as f64;
                let v = (row as f64 + part(k / PROBE_RAYS)) / height as f64;
                sum += room.radiance(position_world, equirect_direction(u, v), SyntheticBallView::Present).0;
            }
            let mean: Vec3 = (sum / (PROBE_RAYS * PROBE_RAYS) as f64).as_vec3();
            *pixel = mean.to_array();
        }
    });
    EnvironmentMap { layout: MapLayout::Equirect, radiance }
}

#[cfg(test)]
mod tests {
    use super::super::{SyntheticSubject, furnish::furnish};
    use super::*;

    #[test]
    fn the_rough_room_is_sound_and_looks_inwards() {
        let plan = furnish(SyntheticSubject::Room);
        let room = room(&plan);
        let middle = Vec3::new(-0.3, 0.1, 0.5);
        let normal = |s: &RoomSurface, f: &Face| {
            let [a, b, c] = [0, 1, 2].map(|k| s.corners_world[f.corners()[k] as usize]);
            ((b - a).cross(c - a), a)
        };
        for surface in &room.surfaces {
            assert!(surface.reflectance_rgb.iter().all(|c| (0.0..1.0).contains(c)), "{}", surface.name);
            for face in &surface.faces {
                let (n, at) = normal(surface, face);
                assert!(n.length() > 1e-6, "{}", surface.name);
                if surface.name.starts_with("wall") || surface.name == "window" {
                    assert!(n.dot(middle - at) > 0.0, "{}", surface.name);
                }
                if surface.name == "lamp" {
                    assert!(n.dot(at - plan.lamp.centre.as_vec3()) > 0.0);
                }
            }
        }
        let lamp: f32 = (room.surfaces.iter().filter(|s| s.name == "lamp"))
            .flat_map(|s| s.faces.iter().map(|f| 0.5 * normal(s, f).0.length()))
            .sum();
        let globe = 4.0 * std::f32::consts::PI * (plan.lamp.radius as f32).powi(2);
        assert!((lamp / globe - 1.0).abs() < 0.05, "{}", lamp / globe);
    }
}
