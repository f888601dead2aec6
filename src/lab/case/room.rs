//! The known room of a case: its receivers and the quadrilaterals that shine.

use super::{Case, CaseEmitter, EmitterKind, ExactShape, GeometryRole};
use crate::model::{
    room::{Face, Room, RoomSurface},
    scene::Material,
};
use glam::{DQuat, DVec3, Vec3};

impl Case {
    /// Its receivers, each a surface of its name, then its quadrilateral emitters, which reflect nothing. Boxes look
    /// outwards. Spheres, meshes and lights of other kinds are no part of it; mirrors reflect nothing diffusely.
    pub fn room(&self) -> Room {
        let receivers = self.geometry.iter().filter(|g| g.role == GeometryRole::Receiver).filter_map(|g| {
            let (corners_world, faces) = match &g.shape {
                ExactShape::PlaneZ0 { half_extent: h } => {
                    let corner = |x: f64, y: f64| DVec3::new(x * h, y * h, 0.0);
                    quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
                }
                ExactShape::Quad { vertices } => quad(*vertices),
                ExactShape::Box { centre, half_size, yaw_rad } => cuboid(*centre, *half_size, *yaw_rad),
                ExactShape::Sphere { .. } | ExactShape::Mesh { .. } => return None,
            };
            let reflectance_rgb = match g.material {
                Material::Lambert { albedo_rgb } | Material::Phong { albedo_rgb, .. } => albedo_rgb,
                Material::Mirror { .. } => [0.0; 3],
            };
            Some(RoomSurface {
                name: g.name.clone(),
                corners_world,
                faces,
                reflectance_rgb,
                emitted_rgb: [0.0; 3],
            })
        });
        let emitters = self.emitters.iter().enumerate().filter_map(|(index, CaseEmitter { name, kind })| {
            let EmitterKind::Quad { vertices, radiance_rgb } = kind else { return None };
            let (corners_world, faces) = quad(*vertices);
            let name = name.clone().unwrap_or_else(|| format!("emitter {index}"));
            let emitted_rgb = radiance_rgb.map(|c| c as f32);
            Some(RoomSurface { name, corners_world, faces, reflectance_rgb: [0.0; 3], emitted_rgb })
        });
        Room { surfaces: receivers.chain(emitters).collect() }
    }
}

fn quad(corners: [DVec3; 4]) -> (Vec<Vec3>, Vec<Face>) {
    (corners.map(|c| c.as_vec3()).to_vec(), vec![Face::Quad([0, 1, 2, 3])])
}

fn cuboid(centre: DVec3, half: DVec3, yaw_rad: f64) -> (Vec<Vec3>, Vec<Face>) {
    let turn = DQuat::from_rotation_z(yaw_rad);
    let corner = |i: u32| {
        let sign = |bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
        (centre + turn * (half * DVec3::new(sign(0), sign(1), sign(2)))).as_vec3()
    };
    // Corners are numbered by their signs, x first; counter-clockwise seen from outside.
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    ((0..8).map(corner).collect(), sides.map(Face::Quad).to_vec())
}
