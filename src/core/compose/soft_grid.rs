//! Soft shadows on real surfaces found at vertices and interpolated (Section 6.2 of [Now11] evaluates per vertex): the
//! surfaces cut into a grid that is as fine as the shadow there may be. On the GPU the vertex stage of `soft_shadow` does the
//! same for the same grid.

use super::geometry::SurfaceGeometry;
use super::halving::{Halve, Halving, distance_to_segment};
use super::soft_shadow::{CoarsePoint, Planes, Transfer, taken_in_row};
use crate::model::blocker::BlockerSphere;
use crate::visibility::blockers::Blockers;
use glam::Vec3;
use rayon::prelude::*;

/// An edge is at most this share of its distance to the nearest sphere's centre: what a sphere takes changes over such
/// lengths. Measured on F1 of the reference (`tests/f1_table.rs`).
const FINENESS: f32 = 0.35;
/// Shorter edges are never cut, metres.
const SHORTEST_CUT_M: f32 = 1e-3;
/// Triangles at most after cutting.
const MOST_TRIANGLES: usize = 100_000;
/// Vertices that one task takes.
const CHUNK: usize = 256;

/// A vertex of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridVertex {
    /// World frame, metres.
    pub position_world: Vec3,
    /// World frame; unit but for what was halved.
    pub normal: Vec3,
    /// A triangle of the surfaces that it lies in; `u32::MAX`: no shadow falls there.
    pub receiver: u32,
}

impl Halve for GridVertex {
    fn position(&self) -> Vec3 {
        self.position_world
    }

    fn between(&self, other: &Self) -> Self {
        Self {
            position_world: 0.5 * (self.position_world + other.position_world),
            normal: 0.5 * (self.normal + other.normal),
            receiver: self.receiver,
        }
    }
}

/// The real surfaces of a frame as a grid, with what is taken at its vertices. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct SoftGrid {
    halving: Halving,
    vertices: Vec<GridVertex>,
    cut: Vec<([u32; 3], ())>,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    points: Vec<CoarsePoint>,
    taken: Vec<[f32; 4]>,
}

impl SoftGrid {
    /// Lays the grid over the surfaces for the spheres of a frame. Flat triangles that show their back to the eye count
    /// as turned round, as they do where each pixel is evaluated; round ones are taken from their front alone.
    pub fn lay(&mut self, surfaces: &SurfaceGeometry, spheres: &[BlockerSphere], eye_world: Vec3) {
        let lying = surfaces.positions.iter().zip(&surfaces.normals);
        self.vertices.clear();
        self.vertices.extend(lying.map(|(&position_world, &normal)| GridVertex {
            position_world,
            normal,
            receiver: u32::MAX,
        }));
        let vertices = &mut self.vertices;
        for (i, corners) in surfaces.triangles.iter().enumerate() {
            let facet = surfaces.facet_normals[i];
            let is_back = facet.dot(eye_world - surfaces.positions[corners[0] as usize]) < 0.0;
            for &corner in corners {
                let vertex = &mut vertices[corner as usize];
                if surfaces.receives[i] {
                    vertex.receiver = i as u32;
                }
                let normal = surfaces.normals[corner as usize];
                if is_back && normal.dot(facet) > 0.999_999 {
                    vertex.normal = -normal;
                }
            }
        }
        let sound = |s: &&BlockerSphere| s.centre_world.is_finite() && s.radius_m > 0.0;
        let limit_m = |a: Vec3, b: Vec3| {
            let near = spheres.iter().filter(sound).map(|s| distance_to_segment(s.centre_world, a, b));
            (FINENESS * near.fold(f32::INFINITY, f32::min)).max(SHORTEST_CUT_M)
        };
        let triangles = surfaces.triangles.iter().map(|&corners| (corners, ()));
        self.halving.cut(vertices, triangles, limit_m, |_| true, MOST_TRIANGLES, &mut self.cut);
        self.positions.clear();
        self.positions.extend(self.vertices.iter().map(|v| v.position_world));
        self.triangles.clear();
        self.triangles.extend(self.cut.iter().map(|(corners, ())| *corners));
    }

    /// Finds what spheres take at every vertex.
    pub fn evaluate(&mut self, blockers: &Blockers, transfer: &Transfer, planes: &Planes) {
        self.points.clear();
        self.points.extend(self.vertices.iter().map(|v| CoarsePoint {
            point_world: v.position_world,
            normal: v.normal.normalize_or(Vec3::Z),
            inverse_depth: 0.0,
            receiver: (v.receiver != u32::MAX).then_some(v.receiver),
        }));
        self.taken.resize(self.points.len(), [0.0; 4]);
        let chunks = self.taken.par_chunks_mut(CHUNK).zip(self.points.par_chunks(CHUNK));
        chunks.for_each(|(out, points)| taken_in_row(blockers, transfer, planes, points, out));
    }

    /// In the order that the triangles refer to.
    pub fn vertices(&self) -> &[GridVertex] {
        &self.vertices
    }

    /// Where they are, world frame, metres.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Indices of vertices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// What is taken at a point of a triangle of the grid, interpolated, and an inverse depth.
    pub fn taken(&self, triangle: usize, barycentric: [f32; 3], inverse_depth: f32) -> [f32; 4] {
        let mut sum = [0.0, 0.0, 0.0, inverse_depth];
        for (&corner, w) in self.triangles[triangle].iter().zip(barycentric) {
            for (sum, c) in sum.iter_mut().zip(self.taken[corner as usize]).take(3) {
                *sum += w * c;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::shade_object::LightTerms;
    use crate::compose::soft_shadow::taken;
    use crate::model::{
        blocker::Rung,
        light::{Lights, RadianceSh},
        scene::{Mesh, RealSurface},
    };

    fn surface(mesh: Mesh, receives_shadow: bool) -> RealSurface {
        RealSurface { name: "s".into(), mesh, receives_shadow, albedo_rgb: None }
    }

    fn quad(at: Vec3, half: f32) -> Mesh {
        let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
        Mesh {
            positions: corners.map(|[x, y]| at + Vec3::new(x, y, 0.0)).to_vec(),
            normals: vec![Vec3::Z; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    /// A bowl around the spheres, open above: no triangle of it is flat.
    fn bowl() -> Mesh {
        let mut mesh = Mesh::default();
        for k in 0..13 * 24 {
            let (polar, around) =
                ((k / 24) as f32 * 0.1 + 0.2, (k % 24) as f32 / 24.0 * std::f32::consts::TAU);
            let out = Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), -polar.cos());
            mesh.positions.push(0.72 * out + Vec3::Z * 0.6);
            mesh.normals.push(-out);
        }
        for k in 0..12 * 24u32 {
            let next = k / 24 * 24 + (k + 1) % 24;
            mesh.triangles.extend([[k, k + 24, next], [next, k + 24, next + 24]]);
        }
        mesh
    }

    fn spheres() -> Vec<BlockerSphere> {
        [([0.0, 0.0, 0.1], 0.1), ([0.05, 0.1, 0.25], 0.08), ([0.3, -0.2, 0.05], 0.05)]
            .map(|(at, radius_m)| BlockerSphere { centre_world: at.into(), radius_m, body: 0 })
            .to_vec()
    }

    /// What is interpolated in the middle of each triangle against what is found there; worst and rms, in shares of the
    /// whole light, and the number of vertices.
    fn apart(surfaces: &SurfaceGeometry, rung: Rung) -> (f32, f32, usize) {
        let mut global = RadianceSh::zero(4);
        global.rgb[0] = [3.5; 3];
        global.rgb[2] = [1.0; 3];
        global.rgb[3] = [0.7, 0.3, -0.4];
        let light = LightTerms::of(&Lights::soft(global));
        let (mut transfer, mut blockers) = (Transfer::default(), Blockers::new());
        transfer.update(&light);
        blockers.prepare(&spheres(), rung, 4, 256);
        let (mut planes, mut grid) = (Planes::default(), SoftGrid::default());
        planes.find(surfaces);
        planes.prepare(&blockers, &transfer);
        grid.lay(surfaces, &spheres(), Vec3::new(0.0, 0.0, 5.0));
        grid.evaluate(&blockers, &transfer, &planes);
        let whole = crate::compose::shade_object::soft_over_pi(&light, Vec3::Z)[0];
        let (mut worst, mut sum, mut area) = (0.0f32, 0.0f32, 0.0f32);
        for (k, corners) in grid.triangles().iter().enumerate() {
            let [a, b, c] = corners.map(|i| grid.vertices()[i as usize]);
            if a.receiver == u32::MAX {
                continue;
            }
            let middle = (a.position_world + b.position_world + c.position_world) / 3.0;
            let normal = (a.normal + b.normal + c.normal).normalize();
            let exact = taken(&blockers, &transfer, None, middle, normal);
            let between = grid.taken(k, [1.0 / 3.0; 3], 1.0);
            let off = (between[0] - exact[0]).abs() / whole;
            let size =
                (b.position_world - a.position_world).cross(c.position_world - a.position_world).length();
            (worst, sum, area) = (worst.max(off), sum + size * off * off, area + size);
        }
        (worst, (sum / area).sqrt(), grid.vertices().len())
    }

    #[test]
    fn what_is_interpolated_is_what_would_be_found_there() {
        let mut flat = SurfaceGeometry::default();
        flat.load(&[surface(quad(Vec3::ZERO, 1.0), true), surface(quad(Vec3::Z * 3.0, 0.1), false)]);
        let mut round = SurfaceGeometry::default();
        round.load(&[surface(bowl(), true)]);
        // Measured 0.029 at worst, 0.003 in the root mean square, with 924 and 699 vertices.
        for (what, surfaces, most) in [("a table", &flat, 0.04), ("a bowl", &round, 0.04)] {
            for rung in [Rung::Directions, Rung::Hybrid] {
                let (worst, rms, vertices) = apart(surfaces, rung);
                println!("{what}, {}: worst {worst:.4}, rms {rms:.5}, {vertices} vertices", rung.name());
                assert!(worst < most && rms < 0.004, "{what}: {worst} {rms}");
                assert!(vertices < 10_000, "{what}: {vertices}");
            }
        }
    }

    #[test]
    fn backs_of_flat_surfaces_are_turned_round_and_nothing_is_cut_without_spheres() {
        let mut surfaces = SurfaceGeometry::default();
        surfaces.load(&[surface(quad(Vec3::ZERO, 1.0), true), surface(quad(Vec3::Z, 1.0), false)]);
        let mut grid = SoftGrid::default();
        grid.lay(&surfaces, &[], Vec3::new(0.0, 0.0, 0.5));
        assert_eq!((grid.vertices().len(), grid.triangles().len()), (8, 4));
        assert!(grid.vertices()[..4].iter().all(|v| v.normal == Vec3::Z && v.receiver < 2));
        assert!(grid.vertices()[4..].iter().all(|v| v.normal == Vec3::NEG_Z && v.receiver == u32::MAX));
        let hopeless = [
            BlockerSphere { centre_world: Vec3::NAN, radius_m: 1.0, body: 0 },
            BlockerSphere { centre_world: Vec3::ZERO, radius_m: f32::NAN, body: 0 },
        ];
        grid.lay(&surfaces, &hopeless, Vec3::NAN);
        assert_eq!(grid.triangles().len(), 4);
        grid.lay(&surfaces, &spheres(), Vec3::ZERO);
        assert!(grid.triangles().len() > 100 && grid.triangles().len() < MOST_TRIANGLES);
    }
}
