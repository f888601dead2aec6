//! Rays against a room's surfaces or patches: which is met first, and from which side.

use crate::{
    math::bvh::Bvh,
    model::room::{Room, RoomPatches},
};
use glam::Vec3;

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstMet {
    /// Index of the surface, or of the patch.
    pub index: u32,
    /// Whether it is met from its front.
    pub is_front: bool,
    /// In lengths of the direction.
    pub t: f32,
    /// Weights of the triangle's corners.
    pub barycentric: [f32; 3],
    /// Index of the triangle.
    pub triangle: u32,
}

/// Triangles that know what they belong to.
pub struct Faces {
    bvh: Bvh,
    owners: Vec<u32>,
    normals: Vec<Vec3>,
    /// Corners of the triangles: indices into the vertices that they were made from.
    triangles: Vec<[u32; 3]>,
}

impl Faces {
    /// A room's faces; the owners are its surfaces.
    pub fn of_room(room: &Room) -> Self {
        let (mut positions, mut triangles, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        for (index, surface) in room.surfaces.iter().enumerate() {
            let base = positions.len() as u32;
            positions.extend_from_slice(&surface.corners_world);
            for face in &surface.faces {
                let corners = face.corners();
                for k in 1..corners.len() - 1 {
                    triangles.push([corners[0], corners[k], corners[k + 1]].map(|i| i.saturating_add(base)));
                    owners.push(index as u32);
                }
            }
        }
        Self::new(&positions, triangles, owners)
    }

    /// The triangles that patches are drawn as; the owners are the patches.
    pub fn of_patches(patches: &RoomPatches) -> Self {
        let positions: Vec<Vec3> = patches.vertices.iter().map(|v| v.position_world).collect();
        let (mut triangles, mut owners) = (Vec::new(), Vec::new());
        for (index, patch) in patches.patches.iter().enumerate() {
            for triangle in patch.triangles() {
                triangles.push(triangle);
                owners.push(index as u32);
            }
        }
        Self::new(&positions, triangles, owners)
    }

    fn new(positions: &[Vec3], triangles: Vec<[u32; 3]>, owners: Vec<u32>) -> Self {
        let at = |i: u32| positions.get(i as usize).copied().unwrap_or(Vec3::ZERO);
        let normal = |t: &[u32; 3]| {
            let [a, b, c] = t.map(at);
            (b - a).cross(c - a)
        };
        let normals = triangles.iter().map(normal).collect();
        Self { bvh: Bvh::build(positions, &triangles), owners, normals, triangles }
    }

    /// The room's size; 0 for an empty one.
    pub fn diagonal(&self) -> f32 {
        self.bvh.bounds().map_or(0.0, |(low, high)| low.distance(high))
    }

    /// Share of all area that an owner's triangles have.
    pub fn area_share(&self, owner: u32) -> f32 {
        let area = |of: &dyn Fn(u32) -> bool| -> f32 {
            let each = self.normals.iter().zip(&self.owners);
            each.filter(|(n, o)| n.is_finite() && of(**o)).map(|(n, _)| n.length()).sum()
        };
        let all = area(&|_| true);
        if all > 0.0 { area(&|o| o == owner) / all } else { 0.0 }
    }

    /// Corners of a triangle: indices of vertices where these are patches.
    pub fn corners(&self, triangle: u32) -> [u32; 3] {
        self.triangles.get(triangle as usize).copied().unwrap_or_default()
    }

    /// What a ray meets first.
    pub fn first(&self, origin: Vec3, direction: Vec3) -> Option<FirstMet> {
        let hit = self.bvh.intersect(origin, direction, 0.0, f32::INFINITY)?;
        let index = *self.owners.get(hit.triangle as usize)?;
        let is_front = self.normals.get(hit.triangle as usize)?.dot(direction) < 0.0;
        Some(FirstMet { index, is_front, t: hit.t, barycentric: hit.barycentric, triangle: hit.triangle })
    }

    /// Whether a ray leaves the room: it meets nothing, or first one of the `apertures` (owners, ascending), behind which
    /// is outside, whatever stands there.
    pub fn leaves(&self, origin: Vec3, direction: Vec3, apertures: &[u32]) -> bool {
        self.first(origin, direction).is_none_or(|met| apertures.binary_search(&met.index).is_ok())
    }
}
