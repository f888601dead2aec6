//! Precomputed transfer of objects that never move (Eq. 20 of [Now11]; for gloss the visibility itself, Eq. 19), by our
//! own rays.

use crate::math::{
    bvh::Bvh,
    sh::{MAX_COEFFICIENTS, MAX_ORDER, basis, zonal},
    spiral,
};
use crate::model::transfer::ObjectTransfer;
use glam::Vec3;
use half::f16;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Raised whenever the same geometry would give other numbers.
pub const VERSION: u32 = 2;
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
    /// Whether its visibility is wanted, too.
    pub is_glossy: bool,
}

/// For each vertex of each mesh t_i = integral of V(w) max(0, n.w) / pi y_i(w), bands below `order` (taken into 1..=6),
/// world frame; all meshes block each other, both sides of triangles.
///
/// t = the exact lobe about n less the mean of y_i over those of `rays` cosine-distributed rays (a fixed spiral about the
/// normal) that are blocked: where nothing blocks it is the Lambert lobe itself, rounded to 16 bits. Does not depend on
/// threads. `progress` is told the share done, 0 to 1, from several threads, in no strict order.
///
/// For each vertex of a glossy mesh b = 1 - V, too, by as many rays spread evenly over the hemisphere about the normal:
/// exactly 0 where nothing blocks. What a mesh's own back hides is no shadow, so V goes on below the horizon as its
/// mirror image above: without a step there, which few bands would carry far into the hemisphere that counts (cut to
/// order 4, a step would leave 0.81 of the light from straight above).
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
    let [lobe, even] = [spiral::by_cosine, spiral::evenly].map(|radius| spiral::upper(rays as usize, radius));
    let baker = Baker { bvh, lift: LIFT * diagonal, order, lambert: lambert(order), lobe, even };
    let glossy = meshes.iter().filter(|mesh| mesh.is_glossy).map(|mesh| mesh.positions_world.len());
    let total = (positions.len() + glossy.sum::<usize>()).max(1);
    let done = AtomicUsize::new(0);
    let count = order * order;
    let all_rows = |mesh: &Standing<'_>, of: &(dyn Fn(Vec3, Vec3, &mut [f16]) + Sync)| {
        let mut rows = vec![f16::ZERO; mesh.positions_world.len() * count];
        rows.par_chunks_mut(CHUNK * count).enumerate().for_each(|(chunk, rows)| {
            for (k, row) in rows.chunks_mut(count).enumerate() {
                let vertex = chunk * CHUNK + k;
                let normal = mesh.normals_world.get(vertex).copied().unwrap_or(Vec3::ZERO);
                of(mesh.positions_world[vertex], normal, row);
            }
            let now = done.fetch_add(rows.len() / count, Ordering::Relaxed) + rows.len() / count;
            progress(now as f32 / total as f32);
        });
        rows
    };
    let bake_one = |mesh: &Standing<'_>| ObjectTransfer {
        rows: all_rows(mesh, &|position, normal, row| baker.vertex(position, normal, row)),
        blocked: if mesh.is_glossy {
            all_rows(mesh, &|position, normal, row| baker.blocked(position, normal, row))
        } else {
            Vec::new()
        },
    };
    meshes.iter().map(bake_one).collect()
}

struct Baker {
    bvh: Bvh,
    lift: f32,
    order: usize,
    /// sqrt(4 pi / (2 l + 1)) z_l.
    lambert: [f64; MAX_ORDER],
    /// Directions about +z: as dense as the cosine, and evenly.
    lobe: Vec<Vec3>,
    even: Vec<Vec3>,
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
        let share = 1.0 / self.lobe.len().max(1) as f64;
        for d in &self.lobe {
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

    fn blocked(&self, position: Vec3, normal: Vec3, row: &mut [f16]) {
        for (slot, sum) in row.iter_mut().zip(self.hidden(position, normal)) {
            *slot = f16::from_f64(sum);
        }
    }

    /// 1 - V before it is rounded.
    fn hidden(&self, position: Vec3, normal: Vec3) -> [f64; MAX_COEFFICIENTS] {
        let mut sums = [0.0f64; MAX_COEFFICIENTS];
        let Some(normal) = normal.try_normalize().filter(|_| position.is_finite()) else { return sums };
        let mut y = [0.0f64; MAX_COEFFICIENTS];
        let (side, other) = normal.any_orthonormal_pair();
        let origin = position + normal * self.lift;
        let solid_angle = 2.0 * std::f64::consts::PI / self.even.len().max(1) as f64;
        for d in &self.even {
            let flat = side * d.x + other * d.y;
            let up = normal * d.z;
            if self.bvh.occluded(origin, flat + up, 0.0, f32::INFINITY) {
                for along in [flat + up, flat - up] {
                    basis::evaluate(self.order, along.as_dvec3().to_array(), &mut y);
                    sums.iter_mut().zip(y).for_each(|(sum, y)| *sum += solid_angle * y);
                }
            }
        }
        sums
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

#[cfg(test)]
mod tests;
