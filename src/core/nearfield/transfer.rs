//! What each source patch sends to each receiver vertex (Section 5 of [Gib03]): its form factor times the share of it
//! that the room itself leaves visible.
//!
//! With T = F V of a source of radiance L, a vertex of diffuse reflectance rho is lit by it to the radiance rho L T (the
//! pi of the irradiance pi L F and that of the reflectance rho / pi cancel).

use super::form_factor::form_factor;
use crate::{
    math::bvh::Bvh,
    model::room::{Room, RoomPatch, RoomPatches},
};
use glam::{DVec3, Vec3};

/// A ray ends this share of its length before its source, so that the source's own surface does not hide it.
const SHORT_OF_SOURCE: f32 = 1e-3;
/// The room as what hides.
pub struct Statics {
    bvh: Bvh,
    /// Of each triangle, towards its front; of any length.
    normals: Vec<Vec3>,
}

impl Statics {
    /// Of all the room's faces; both sides hide.
    pub fn new(room: &Room) -> Self {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for surface in &room.surfaces {
            let base = positions.len() as u32;
            positions.extend_from_slice(&surface.corners_world);
            for face in &surface.faces {
                let corners = face.corners();
                for k in 1..corners.len() - 1 {
                    triangles.push([corners[0], corners[k], corners[k + 1]].map(|i| i.saturating_add(base)));
                }
            }
        }
        let normal = |t: &[u32; 3]| {
            let corner = |k: usize| positions.get(t[k] as usize).copied().unwrap_or(Vec3::ZERO);
            (corner(1) - corner(0)).cross(corner(2) - corner(0))
        };
        let normals = triangles.iter().map(normal).collect();
        Self { bvh: Bvh::build(&positions, &triangles), normals }
    }

    /// Whether something stands between two places; what is just before the second does not count.
    pub fn hides(&self, from: Vec3, to: Vec3) -> bool {
        self.bvh.occluded(from, to - from, 0.0, 1.0 - SHORT_OF_SOURCE)
    }
}

impl Statics {
    /// Distance to what a ray meets first, and whether it meets its back; `towards` is unit.
    pub fn first(&self, from: Vec3, towards: Vec3) -> Option<(f32, bool)> {
        let hit = self.bvh.intersect(from, towards, 1e-5, f32::INFINITY)?;
        Some((hit.t, self.normals.get(hit.triangle as usize).is_some_and(|n| n.dot(towards) > 0.0)))
    }
}

/// A source patch, made ready.
pub struct SourceOutline {
    corners: [DVec3; 4],
    count: usize,
    centre: Vec3,
    normal: Vec3,
    /// Index that its samples are drawn by.
    seed: u32,
}

impl SourceOutline {
    /// A patch's outline, world frame.
    pub fn new(patches: &RoomPatches, patch: &RoomPatch, seed: u32) -> Self {
        let (corners, count) = patches.outline_world(patch);
        Self {
            corners: corners.map(|c| c.as_dvec3()),
            count,
            centre: patch.centre_world,
            normal: patch.normal_world,
            seed,
        }
    }

    /// T at a vertex: the exact form factor, and visibility by about `rays` rays to stratified places on the patch (1,
    /// 4, 9, ..), shifted from vertex to vertex so that neighbours do not share their mistakes.
    pub fn transfer(&self, statics: &Statics, at: Vec3, normal: Vec3, vertex: u32, side: u32) -> f32 {
        let to = self.centre - at;
        if self.faces_away(at) || normal.dot(to) <= -self.reach() {
            return 0.0;
        }
        let factor = form_factor(at.as_dvec3(), normal.as_dvec3(), &self.corners[..self.count]) as f32;
        if factor <= 0.0 {
            return 0.0;
        }
        factor * self.visible_share(statics, at, normal, vertex, side)
    }

    fn faces_away(&self, at: Vec3) -> bool {
        self.normal.dot(at - self.centre) <= 0.0
    }

    /// No corner is farther from the centre.
    fn reach(&self) -> f32 {
        let centre = self.centre.as_dvec3();
        self.corners.iter().map(|c| c.distance_squared(centre)).fold(0.0, f64::max).sqrt() as f32
    }

    fn visible_share(&self, statics: &Statics, at: Vec3, normal: Vec3, vertex: u32, side: u32) -> f32 {
        let shift = shifts(self.seed, vertex);
        let (mut seen, mut asked) = (0u32, 0u32);
        for k in 0..side * side {
            let cell = [k % side, k / side];
            let [u, v] = [0, 1].map(|i| f64::from((cell[i] as f32 + shift[i]) / side as f32));
            let place = self.place(u, v).as_vec3();
            // What lies below the receiver's horizon sends it nothing.
            if normal.dot(place - at) <= 0.0 {
                continue;
            }
            asked += 1;
            seen += u32::from(!statics.hides(at, place));
        }
        if asked > 0 { seen as f32 / asked as f32 } else { f32::from(!statics.hides(at, self.centre)) }
    }

    /// Even over a triangle and a parallelogram.
    fn place(&self, u: f64, v: f64) -> DVec3 {
        let [a, b, c, d] = self.corners;
        if self.count == 4 {
            return a.lerp(b, u).lerp(d.lerp(c, u), v);
        }
        let root = u.sqrt();
        a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v)
    }
}

/// Two numbers in (0, 1) for a source and a vertex: steps of a plastic-number sequence along both, which neighbours
/// spread evenly.
fn shifts(seed: u32, vertex: u32) -> [f32; 2] {
    // 2^32 / p and 2^32 / p^2, p^3 = p + 1.
    const STEPS: [u32; 2] = [3_242_174_889, 2_447_445_414];
    let index = vertex.wrapping_mul(31).wrapping_add(seed.wrapping_mul(97));
    STEPS.map(|step| {
        let turned = index.wrapping_mul(step).wrapping_add(step / 2);
        ((turned >> 9) as f32 + 0.5) / (1u32 << 23) as f32
    })
}

#[cfg(test)]
mod tests;
