//! How open each vertex of an object is to the light around it: its own self-shadow, found once when it is loaded.

use crate::{
    math::{bvh::Bvh, spiral},
    model::scene::Mesh,
};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Rays a vertex where nothing else is said. The cosine-weighted spiral errs by about 1 / (2 sqrt(rays)) at a
/// straight blocker's edge at worst: 0.02 typical here.
pub const DEFAULT_RAYS: u32 = 128;
/// Rays start this share of the object's diagonal above the vertex, so that they clear its own triangles.
const LIFT: f32 = 1e-4;
/// Vertices that one task takes.
const CHUNK: usize = 64;

/// For each vertex the cosine-weighted share, 0 to 1, of the hemisphere about its normal that the mesh itself
/// leaves open. A vertex of a convex mesh gets exactly 1. Both sides of triangles block; nothing else does (no table).
///
/// Deterministic: the directions are a fixed spiral, turned into each vertex's frame by its normal alone. This is the
/// factor by which the soft light is scaled (spec 5, "Self shadow").
/// `progress` is told the share done, 0 to 1, from several threads, in no strict order.
pub fn of_mesh(mesh: &Mesh, rays: u32, progress: &(dyn Fn(f32) + Sync)) -> Vec<f32> {
    of_parts(&[mesh], rays, progress).pop().unwrap_or_default()
}

/// As `of_mesh` for an object of several meshes in one common frame, which all block each other. One list for each mesh,
/// as long as its positions. Fewer than 1 ray gives 1 everywhere.
pub fn of_parts(meshes: &[&Mesh], rays: u32, progress: &(dyn Fn(f32) + Sync)) -> Vec<Vec<f32>> {
    if rays == 0 {
        return meshes.iter().map(|mesh| vec![1.0; mesh.positions.len()]).collect();
    }
    let mut positions: Vec<Vec3> = Vec::new();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for mesh in meshes {
        let base = positions.len() as u32;
        positions.extend(&mesh.positions);
        let sound = mesh.triangles.iter().filter(|t| t.iter().all(|&i| (i as usize) < mesh.positions.len()));
        triangles.extend(sound.map(|t| t.map(|i| i + base)));
    }
    let bvh = Bvh::build(&positions, &triangles);
    let diagonal = bvh.bounds().map_or(0.0, |(low, high)| low.distance(high));
    let spiral = spiral::upper(rays as usize, spiral::by_cosine);
    let total = meshes.iter().map(|mesh| mesh.positions.len()).sum::<usize>().max(1);
    let done = AtomicUsize::new(0);
    meshes
        .iter()
        .map(|mesh| {
            let mut open = vec![1.0f32; mesh.positions.len()];
            let vertices = mesh.positions.par_chunks(CHUNK).zip(mesh.normals.par_chunks(CHUNK));
            open.par_chunks_mut(CHUNK).zip(vertices).for_each(|(open, (positions, normals))| {
                for ((slot, &position), &normal) in open.iter_mut().zip(positions).zip(normals) {
                    *slot = share_open(&bvh, position + normal * (LIFT * diagonal), normal, &spiral);
                }
                let now = done.fetch_add(open.len(), Ordering::Relaxed) + open.len();
                progress(now as f32 / total as f32);
            });
            open
        })
        .collect()
}

fn share_open(bvh: &Bvh, origin: Vec3, normal: Vec3, spiral: &[Vec3]) -> f32 {
    let Some(normal) = normal.try_normalize() else { return 1.0 };
    let (side, other) = normal.any_orthonormal_pair();
    let blocked = spiral
        .iter()
        .filter(|d| bvh.occluded(origin, side * d.x + other * d.y + normal * d.z, 0.0, f32::INFINITY))
        .count();
    1.0 - blocked as f32 / spiral.len() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An icosahedron-like ball without leaning on another room: a coarse UV sphere.
    fn ball(radius: f32) -> Mesh {
        let mut mesh = Mesh::default();
        let (rings, segments) = (12u32, 24u32);
        for ring in 0..=rings {
            for s in 0..segments {
                let (st, ct) = (std::f32::consts::PI * ring as f32 / rings as f32).sin_cos();
                let (sp, cp) = (std::f32::consts::TAU * s as f32 / segments as f32).sin_cos();
                let n = Vec3::new(st * cp, st * sp, ct).normalize();
                mesh.positions.push(n * radius);
                mesh.normals.push(n);
            }
        }
        for ring in 0..rings {
            for s in 0..segments {
                let at = |r: u32, s: u32| r * segments + s % segments;
                mesh.triangles.push([at(ring, s), at(ring + 1, s), at(ring + 1, s + 1)]);
                mesh.triangles.push([at(ring, s), at(ring + 1, s + 1), at(ring, s + 1)]);
            }
        }
        mesh
    }

    /// A square facing up at z, half side e.
    fn sheet(z: f32, e: f32, up: f32) -> Mesh {
        Mesh {
            positions: [[-e, -e], [e, -e], [e, e], [-e, e]].map(|[x, y]| Vec3::new(x, y, z)).to_vec(),
            normals: vec![Vec3::Z * up; 4],
            tints_rgb: vec![[1.0; 3]; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    #[test]
    fn a_convex_object_is_exactly_open() {
        for radius in [1e-3, 1.0, 1e3] {
            let open = of_mesh(&ball(radius), 256, &|_| ());
            assert!(open.iter().all(|&o| o == 1.0), "{radius}: {open:?}");
        }
    }

    #[test]
    fn a_lid_takes_its_form_factor() {
        // A point under the middle of a parallel square of side 2 at height 1: F = 4 atan(1/sqrt 2)/(pi sqrt 2) = 0.5541.
        let mut floor = sheet(0.0, 10.0, 1.0);
        floor.positions.push(Vec3::ZERO);
        floor.normals.push(Vec3::Z);
        let lid = sheet(1.0, 1.0, -1.0);
        let open = of_parts(&[&floor, &lid], 1024, &|_| ());
        let expected = 1.0 - 0.5541;
        // The spiral of 1024 rays counts an area with 4 straight edges: 0.005 measured well inside.
        assert!((open[0][4] - expected).abs() < 0.01, "{}", open[0][4]);
        let few = of_parts(&[&floor, &lid], DEFAULT_RAYS, &|_| ());
        assert!((few[0][4] - expected).abs() < 0.02, "{}", few[0][4]);
        // The lid looks down at the floor and sees almost nothing else.
        assert!(open[1].iter().all(|&o| o < 0.05), "{:?}", open[1]);
    }

    #[test]
    fn the_result_does_not_depend_on_threads_and_progress_ends_at_one() {
        let (a, b) = (ball(1.0), sheet(-1.2, 2.0, 1.0));
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let last = std::sync::Mutex::new(0.0f32);
            let open = pool.install(|| {
                of_parts(&[&a, &b], 64, &|share| {
                    let mut last = last.lock().unwrap();
                    *last = last.max(share);
                })
            });
            assert_eq!(*last.lock().unwrap(), 1.0);
            open
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn empty_and_hopeless_meshes_are_taken() {
        assert!(of_mesh(&Mesh::default(), 16, &|_| ()).is_empty());
        let mut mesh = sheet(0.0, 1.0, 1.0);
        mesh.normals = vec![Vec3::ZERO; 4];
        mesh.triangles.push([0, 1, 99]);
        assert_eq!(of_mesh(&mesh, 16, &|_| ()), [1.0; 4]);
        assert_eq!(of_mesh(&mesh, 0, &|_| ()), [1.0; 4]);
    }
}
