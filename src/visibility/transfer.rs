//! Precomputed transfer of matt objects that never move (Eq. 20 of [Now11]), by our own rays.

use crate::math::{
    bvh::Bvh,
    sh::{MAX_COEFFICIENTS, MAX_ORDER, basis, zonal},
};
use crate::model::transfer::ObjectTransfer;
use glam::Vec3;
use half::f16;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Raised whenever the same geometry would give other numbers.
pub const VERSION: u32 = 1;
/// Rays a vertex where nothing else is said: an unblocked vertex is exact, one half blocked is off by 0.01 of its light.
pub const DEFAULT_RAYS: u32 = 256;
/// Rays start this share of the scene's diagonal above the vertex, so that they clear its own triangles.
const LIFT: f32 = 1e-4;
/// Vertices that one task takes.
const CHUNK: usize = 32;

/// A mesh where it stands.
#[derive(Clone, Copy, Debug)]
pub struct Standing<'a> {
    /// World frame, metres.
    pub positions_world: &'a [Vec3],
    /// Unit normals, world frame; a vertex without one is open to all light.
    pub normals_world: &'a [Vec3],
    /// Indices of vertices.
    pub triangles: &'a [[u32; 3]],
}

/// For each vertex of each mesh t_i = integral of V(w) max(0, n.w) / pi y_i(w), bands below `order` (taken into 1..=6),
/// world frame; all meshes block each other, both sides of triangles.
///
/// t = the exact lobe about n less the mean of y_i over those of `rays` cosine-distributed rays (a fixed spiral about the
/// normal) that are blocked: where nothing blocks it is the Lambert lobe itself, rounded to 16 bits. Does not depend on
/// threads. `progress` is told the share done, 0 to 1, from several threads, in no strict order.
pub fn bake(
    meshes: &[Standing<'_>],
    order: usize,
    rays: u32,
    progress: &(dyn Fn(f32) + Sync),
) -> Vec<ObjectTransfer> {
    let order = order.clamp(1, MAX_ORDER);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let base = positions.len() as u32;
        positions.extend_from_slice(mesh.positions_world);
        let sound =
            mesh.triangles.iter().filter(|t| t.iter().all(|&i| (i as usize) < mesh.positions_world.len()));
        triangles.extend(sound.map(|t| t.map(|i| i + base)));
    }
    let bvh = Bvh::build(&positions, &triangles);
    let diagonal = bvh.bounds().map_or(0.0, |(low, high)| low.distance(high));
    let baker = Baker { bvh, lift: LIFT * diagonal, order, lambert: lambert(order), spiral: spiral(rays) };
    let total = positions.len().max(1);
    let done = AtomicUsize::new(0);
    let count = order * order;
    meshes
        .iter()
        .map(|mesh| {
            let mut rows = vec![f16::ZERO; mesh.positions_world.len() * count];
            rows.par_chunks_mut(CHUNK * count).enumerate().for_each(|(chunk, rows)| {
                for (k, row) in rows.chunks_mut(count).enumerate() {
                    let vertex = chunk * CHUNK + k;
                    let normal = mesh.normals_world.get(vertex).copied().unwrap_or(Vec3::ZERO);
                    baker.vertex(mesh.positions_world[vertex], normal, row);
                }
                let now = done.fetch_add(rows.len() / count, Ordering::Relaxed) + rows.len() / count;
                progress(now as f32 / total as f32);
            });
            ObjectTransfer { rows }
        })
        .collect()
}

struct Baker {
    bvh: Bvh,
    lift: f32,
    order: usize,
    /// sqrt(4 pi / (2 l + 1)) z_l.
    lambert: [f64; MAX_ORDER],
    spiral: Vec<Vec3>,
}

impl Baker {
    fn vertex(&self, position: Vec3, normal: Vec3, row: &mut [f16]) {
        let Some(normal) = normal.try_normalize().filter(|_| position.is_finite()) else {
            // Open to all light alike: half of the mean radiance from everywhere.
            row[0] = f16::from_f64(zonal_mean());
            return;
        };
        let mut sums = [0.0f64; MAX_COEFFICIENTS];
        let mut y = [0.0f64; MAX_COEFFICIENTS];
        basis::evaluate(self.order, normal.as_dvec3().to_array(), &mut y);
        for (i, (sum, y)) in sums.iter_mut().zip(y).enumerate().take(row.len()) {
            *sum = self.lambert[i.isqrt()] * y;
        }
        let (side, other) = normal.any_orthonormal_pair();
        let origin = position + normal * self.lift;
        let share = 1.0 / self.spiral.len().max(1) as f64;
        for d in &self.spiral {
            let along = side * d.x + other * d.y + normal * d.z;
            if self.bvh.occluded(origin, along, 0.0, f32::INFINITY) {
                basis::evaluate(self.order, along.as_dvec3().to_array(), &mut y);
                sums.iter_mut().zip(y).for_each(|(sum, y)| *sum -= share * y);
            }
        }
        for (slot, sum) in row.iter_mut().zip(sums) {
            *slot = f16::from_f64(sum);
        }
    }
}

/// t_0 of an open vertex.
fn zonal_mean() -> f64 {
    lambert(1)[0] * 0.25f64.sqrt() / std::f64::consts::PI.sqrt()
}

fn lambert(order: usize) -> [f64; MAX_ORDER] {
    let mut bands = [0.0f64; MAX_ORDER];
    zonal::lambert(order, &mut bands);
    for (l, z) in bands.iter_mut().enumerate() {
        *z *= (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt();
    }
    bands
}

/// Directions about +z whose density is the cosine: a spiral by the golden angle, equal areas of the unit disc.
fn spiral(rays: u32) -> Vec<Vec3> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..rays)
        .map(|i| {
            let r2 = (f64::from(i) + 0.5) / f64::from(rays);
            let (sine, cosine) = (golden_angle * f64::from(i)).sin_cos();
            Vec3::new((r2.sqrt() * cosine) as f32, (r2.sqrt() * sine) as f32, (1.0 - r2).sqrt() as f32)
        })
        .collect()
}

#[cfg(test)]
mod tests;
