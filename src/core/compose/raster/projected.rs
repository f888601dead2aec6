//! Triangles through a lens: their planes, and which part of the picture each may cover.

use super::{BAND_ROWS, Fragment, NONE, Rays, View};
use crate::math::lens::{Distortion, Lens};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Where triangles that reach behind the camera are cut to find their part of the picture, metres.
const NEAR_M: f32 = 1e-3;
/// Cosine of 3 degrees, see `bounds`.
const EDGE_STEP_COSINE: f64 = 0.998_629_534_754_573_9;

/// A triangle ready to be tested: all signs such that inside is positive.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TriangleSetup {
    /// Corner j x corner k, for the edge opposite to corner i.
    pub(super) edges: [Vec3; 3],
    /// Twice the triangle's area vector; `distance / (normal . ray)` is the distance along the ray.
    pub(super) normal: Vec3,
    pub(super) distance: f32,
    /// First and last column and row that it may cover; empty where the first exceeds the last.
    pub(super) columns: [i32; 2],
    pub(super) rows: [i32; 2],
}

/// Triangles as one picture sees them, sorted into bands of rows. Keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Projected {
    vertices: Vec<(Vec3, Option<DVec2>)>,
    pub(super) setups: Vec<TriangleSetup>,
    bin_ends: Vec<usize>,
    bins: Vec<u32>,
}

impl Projected {
    /// Projects triangles (world frame, metres) through the lens of the rays.
    pub fn prepare(&mut self, rays: &Rays, view: &View, positions: &[Vec3], triangles: &[[u32; 3]]) {
        let Some(lens) = rays.lens else { return };
        let camera_from_world = view.world_from_camera.transpose();
        self.vertices.resize(positions.len(), (Vec3::ZERO, None));
        let chunks = self.vertices.par_chunks_mut(512).zip(positions.par_chunks(512));
        chunks.for_each(|(out, positions)| {
            for (slot, &p) in out.iter_mut().zip(positions) {
                let camera = camera_from_world * (p - view.eye);
                *slot = (camera, lens.project(camera.as_dvec3()));
            }
        });
        let vertices = &self.vertices;
        self.setups.resize(triangles.len(), TriangleSetup::default());
        let chunks = self.setups.par_chunks_mut(512).zip(triangles.par_chunks(512));
        chunks.for_each(|(out, triangles)| {
            for (setup, triangle) in out.iter_mut().zip(triangles) {
                *setup = prepare(&lens, rays.half_angle_rad, triangle.map(|i| vertices[i as usize]));
            }
        });
        self.sort_into_bands(rays.height());
    }

    /// Lists for each band of rows the triangles that may touch it, in their order.
    fn sort_into_bands(&mut self, height: usize) {
        let bands = height.div_ceil(BAND_ROWS);
        self.bin_ends.clear();
        self.bin_ends.resize(bands, 0);
        let touched = |s: &TriangleSetup| {
            if s.columns[0] > s.columns[1] || s.rows[0] > s.rows[1] {
                0..0
            } else {
                s.rows[0] as usize / BAND_ROWS..s.rows[1] as usize / BAND_ROWS + 1
            }
        };
        for setup in &self.setups {
            for band in touched(setup) {
                self.bin_ends[band] += 1;
            }
        }
        let mut sum = 0;
        for end in &mut self.bin_ends {
            sum += *end;
            *end = sum - *end;
        }
        self.bins.resize(sum, NONE);
        for (i, setup) in self.setups.iter().enumerate() {
            for band in touched(setup) {
                self.bins[self.bin_ends[band]] = i as u32;
                self.bin_ends[band] += 1;
            }
        }
    }

    pub(super) fn bin(&self, band: usize) -> &[u32] {
        let start = if band == 0 { 0 } else { self.bin_ends[band - 1] };
        &self.bins[start..self.bin_ends[band]]
    }

    pub(super) fn fragment(&self, view: &View, triangle: u32, ray: Vec3) -> Fragment {
        let setup = &self.setups[triangle as usize];
        let e = setup.edges.map(|edge| edge.dot(ray).max(0.0));
        let sum = e[0] + e[1] + e[2];
        let world = view.world_from_camera * ray;
        Fragment {
            triangle: triangle as usize,
            barycentric: if sum > 0.0 { e.map(|e| e / sum) } else { [1.0 / 3.0; 3] },
            point_world: view.eye + world * (setup.distance / setup.normal.dot(ray)),
            to_eye: -world,
            pixel: 0,
        }
    }
}

/// Planes of a triangle and the part of the picture that it may cover.
fn prepare(lens: &Lens, half_angle_rad: f32, corners: [(Vec3, Option<DVec2>); 3]) -> TriangleSetup {
    let mut setup = TriangleSetup { columns: [0, -1], ..TriangleSetup::default() };
    let v = corners.map(|c| c.0);
    if !v.iter().all(|c| c.is_finite()) {
        return setup;
    }
    let Some([left, top, right, bottom]) = bounds(lens, half_angle_rad, &corners) else {
        return setup;
    };
    // In f64 the products are exact, so that two triangles agree on their common edge to the last bit.
    let d = v.map(|c| c.as_dvec3());
    let normal = (d[1] - d[0]).cross(d[2] - d[0]);
    let distance = normal.dot(d[0]);
    let sign = if distance < 0.0 { -1.0 } else { 1.0 };
    setup.edges = std::array::from_fn(|i| (sign * d[(i + 1) % 3].cross(d[(i + 2) % 3])).as_vec3());
    setup.normal = (sign * normal).as_vec3();
    setup.distance = (sign * distance) as f32;
    if setup.distance > 0.0 {
        let last = [i64::from(lens.width) - 1, i64::from(lens.height) - 1];
        let clip = |x: f64, last: i64| (x.floor().max(-1.0) as i64).min(last + 1);
        setup.columns = [clip(left, last[0]).max(0) as i32, clip(right, last[0]).min(last[0]) as i32];
        setup.rows = [clip(top, last[1]).max(0) as i32, clip(bottom, last[1]).min(last[1]) as i32];
    }
    setup
}

/// Left, top, right, bottom (continuous pixels) of a box that holds the triangle's image; `None` where it has none.
fn bounds(lens: &Lens, half_angle_rad: f32, corners: &[(Vec3, Option<DVec2>); 3]) -> Option<[f64; 4]> {
    let everything = [0.0, 0.0, f64::from(lens.width), f64::from(lens.height)];
    let mut low = DVec2::INFINITY;
    let mut high = DVec2::NEG_INFINITY;
    let mut pad = 0.01;
    let mut add = |p: DVec2| {
        low = low.min(p);
        high = high.max(p);
    };
    let v = corners.map(|c| c.0);
    if let [Some(a), Some(b), Some(c)] = corners.map(|c| c.1) {
        let p = [a, b, c];
        p.into_iter().for_each(&mut add);
        if lens.distortion != Distortion::None {
            // Straight edges bow: follow them along their great circles in steps of at most 3 degrees.
            pad = 0.5;
            for i in 0..3 {
                let (from, to) =
                    (v[i].as_dvec3().normalize_or_zero(), v[(i + 1) % 3].as_dvec3().normalize_or_zero());
                let cosine = from.dot(to);
                if cosine > EDGE_STEP_COSINE {
                    continue;
                }
                let angle = cosine.clamp(-1.0, 1.0).acos();
                let steps = (angle / EDGE_STEP_COSINE.acos()).ceil();
                for k in 1..steps as i32 {
                    let t = f64::from(k) / steps;
                    let ray = from * ((1.0 - t) * angle).sin() + to * (t * angle).sin();
                    match lens.project(ray) {
                        Some(q) => add(q),
                        None => return Some(everything),
                    }
                }
            }
            // A triangle around the direction straight behind a fisheye is not inside of its outline's image.
            let planes: [f32; 3] = std::array::from_fn(|i| v[(i + 1) % 3].cross(v[(i + 2) % 3]).z);
            let around = planes.iter().all(|&z| z >= 0.0) || planes.iter().all(|&z| z <= 0.0);
            if around && v.iter().any(|c| c.z < 0.0) {
                return Some(everything);
            }
        }
    } else if lens.distortion == Distortion::None {
        // Cut at the near plane: at most four corners are left.
        for i in 0..3 {
            let (from, to) = (v[i], v[(i + 1) % 3]);
            if from.z >= NEAR_M {
                lens.project(from.as_dvec3()).into_iter().for_each(&mut add);
            }
            if (from.z >= NEAR_M) != (to.z >= NEAR_M) {
                let t = (NEAR_M - from.z) / (to.z - from.z);
                let cut = from.lerp(to, t).with_z(NEAR_M);
                lens.project(cut.as_dvec3()).into_iter().for_each(&mut add);
            }
        }
    } else {
        let centre = (v[0] + v[1] + v[2]) / 3.0;
        let radius = v.iter().map(|c| c.distance(centre)).fold(0.0, f32::max);
        let distance = centre.length();
        if distance > radius {
            let off_axis = (centre.z / distance).clamp(-1.0, 1.0).acos();
            if off_axis > half_angle_rad + (radius / distance).asin() {
                return None;
            }
        }
        return Some(everything);
    }
    let all = [low.x - pad, low.y - pad, high.x + pad, high.y + pad];
    all.iter().all(|x| x.is_finite()).then_some(all)
}
