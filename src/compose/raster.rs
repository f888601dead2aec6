//! The CPU's triangle rasteriser: coverage samples through the real lens, whatever its distortion.
//!
//! Instead of flat triangles in the picture, each sample's own ray is tested against the three planes
//! through the eye and the triangle's edges (homogeneous rasterisation). That is exact for every lens, needs
//! no near plane, and its edge values are perspective-correct barycentrics. The nearest triangle of each
//! sample stays; then each pixel is shaded once for every triangle that it still sees, at the mean of that
//! triangle's samples, so that an edge pixel is never shaded beside its triangle.
//! On the GPU the rasteriser of the hardware does this work with the same four samples.

use super::geometry::ObjectGeometry;
use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
};
use crate::model::image::Image;
use glam::{DVec2, Mat3, Vec3};
use rayon::prelude::*;

/// Where the four coverage samples lie in a pixel (the standard pattern of four); their mean is its centre.
pub const SAMPLES: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];
/// Rows of one unit of parallel work; fixed, so that no result depends on the number of threads.
const BAND_ROWS: usize = 8;
/// Where triangles that reach behind the camera are cut to find their part of the picture, metres.
const NEAR_M: f32 = 1e-3;
/// No triangle.
const NONE: u32 = u32::MAX;

/// The rays of a lens, in the camera's frame: kept as long as the lens stays.
#[derive(Clone, Debug, Default)]
pub struct Rays {
    lens: Option<Lens>,
    samples_a_pixel: usize,
    centres: Vec<Vec3>,
    samples: Vec<Vec3>,
    /// Largest angle between a sample's ray and the axis, radians.
    half_angle_rad: f32,
}

impl Rays {
    /// Rays of a lens with 1 or 4 samples a pixel (other counts become 4); free where nothing has changed.
    /// Where the lens cannot be inverted the ray is zero and hits nothing.
    pub fn update(&mut self, lens: &Lens, coverage_samples: u32) {
        let count = if coverage_samples == 1 { 1 } else { 4 };
        if self.lens.as_ref() == Some(lens) && self.samples_a_pixel == count {
            return;
        }
        let (width, height) = (lens.width as usize, lens.height as usize);
        self.centres.resize(width * height, Vec3::ZERO);
        self.samples.resize(width * height * count, Vec3::ZERO);
        let ray = |x: usize, y: usize, at: [f32; 2]| {
            let pixel = DVec2::new(x as f64 + f64::from(at[0]), y as f64 + f64::from(at[1]));
            lens.unproject(pixel).map_or(Vec3::ZERO, |d| d.as_vec3())
        };
        let rows = self.centres.par_chunks_mut(width.max(1));
        rows.zip(self.samples.par_chunks_mut((width * count).max(1))).enumerate().for_each(
            |(y, (centres, samples))| {
                for (x, centre) in centres.iter_mut().enumerate() {
                    *centre = ray(x, y, [0.5, 0.5]);
                }
                for (k, sample) in samples.iter_mut().enumerate() {
                    let at = if count == 1 { [0.5, 0.5] } else { SAMPLES[k % 4] };
                    *sample = ray(k / count, y, at);
                }
            },
        );
        let cosine = self.samples.iter().filter(|d| **d != Vec3::ZERO).fold(1.0f32, |c, d| c.min(d.z));
        self.half_angle_rad = cosine.clamp(-1.0, 1.0).acos();
        self.samples_a_pixel = count;
        self.lens = Some(*lens);
    }

    /// Picture width in pixels.
    pub fn width(&self) -> usize {
        self.lens.map_or(0, |l| l.width as usize)
    }

    /// Picture height in pixels.
    pub fn height(&self) -> usize {
        self.lens.map_or(0, |l| l.height as usize)
    }

    /// Unit rays through the pixel centres, row by row; zero where there is none.
    pub fn centres(&self) -> &[Vec3] {
        &self.centres
    }
}

/// Camera pose in f32, as the kernels use it.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Camera to world.
    pub world_from_camera: Mat3,
    /// Camera's position, world frame, metres.
    pub eye: Vec3,
}

impl View {
    /// Of a pose.
    pub fn of(pose: &Pose) -> Self {
        Self { world_from_camera: Mat3::from_quat(pose.rotation.as_quat()), eye: pose.translation.as_vec3() }
    }
}

/// What a pixel sees of one triangle.
#[derive(Clone, Copy, Debug)]
pub struct Fragment {
    /// Its number.
    pub triangle: usize,
    /// Weights of its corners, perspective-correct, sum 1.
    pub barycentric: [f32; 3],
    /// The point, world frame, metres.
    pub point_world: Vec3,
    /// Unit vector towards the camera, world frame.
    pub to_eye: Vec3,
}

/// A triangle ready to be tested: all signs such that inside is positive.
#[derive(Clone, Copy, Debug, Default)]
struct Setup {
    /// Corner j x corner k, for the edge opposite to corner i.
    edges: [Vec3; 3],
    /// Twice the triangle's area vector; `distance / (normal . ray)` is the distance along the ray.
    normal: Vec3,
    distance: f32,
    /// First and last column and row that it may cover; empty where the first exceeds the last.
    columns: [i32; 2],
    rows: [i32; 2],
}

/// The nearest triangle of a coverage sample.
#[derive(Clone, Copy, Debug)]
struct Sample {
    distance: f32,
    triangle: u32,
}

/// The rasteriser's memory.
#[derive(Clone, Debug, Default)]
pub struct Raster {
    vertices: Vec<(Vec3, Option<DVec2>)>,
    setups: Vec<Setup>,
    bin_ends: Vec<usize>,
    bins: Vec<u32>,
    samples: Vec<Sample>,
}

impl Raster {
    /// Draws objects into a layer of premultiplied radiance (r, g, b) and coverage (a).
    ///
    /// `hidden(ray_world, distance_m)` says whether something real lies in front, for a unit ray from the eye;
    /// it is asked for each covered sample. `shade` gives the radiance of a fragment. Both must be pure:
    /// the result is the same for any number of threads.
    pub fn draw(
        &mut self,
        rays: &Rays,
        view: &View,
        geometry: &ObjectGeometry,
        hidden: impl Fn(Vec3, f32) -> bool + Sync,
        shade: impl Fn(&Fragment) -> [f32; 3] + Sync,
        out: &mut Image<[f32; 4]>,
    ) {
        let (width, height) = (rays.width(), rays.height());
        out.reshape(width, height, [0.0; 4]);
        let Some(lens) = rays.lens else { return };
        self.set_up(&lens, rays.half_angle_rad, view, geometry);
        self.sort_into_bands(height);

        let count = rays.samples_a_pixel;
        self.samples.resize(width * height * count, Sample { distance: f32::INFINITY, triangle: NONE });
        let (setups, bins, ends) = (&self.setups, &self.bins, &self.bin_ends);
        let rows = out.pixels_mut().par_chunks_mut(BAND_ROWS * width.max(1));
        let samples = self.samples.par_chunks_mut((BAND_ROWS * width * count).max(1));
        let directions = rays.samples.par_chunks((BAND_ROWS * width * count).max(1));
        rows.zip(samples).zip(directions).enumerate().for_each(|(band, ((layer, samples), directions))| {
            layer.fill([0.0; 4]);
            let start = if band == 0 { 0 } else { ends[band - 1] };
            let bin = &bins[start..ends[band]];
            if bin.is_empty() {
                return;
            }
            samples.fill(Sample { distance: f32::INFINITY, triangle: NONE });
            for &triangle in bin {
                let setup = &setups[triangle as usize];
                cover(setup, triangle, band * BAND_ROWS, width, count, directions, samples);
            }
            let pixels = layer.iter_mut().zip(samples.chunks(count)).zip(directions.chunks(count));
            for ((pixel, samples), directions) in pixels {
                if samples.iter().any(|s| s.triangle != NONE) {
                    *pixel = resolve(setups, view, samples, directions, &hidden, &shade);
                }
            }
        });
    }

    fn set_up(&mut self, lens: &Lens, half_angle_rad: f32, view: &View, geometry: &ObjectGeometry) {
        let camera_from_world = view.world_from_camera.transpose();
        self.vertices.resize(geometry.positions.len(), (Vec3::ZERO, None));
        let chunks = self.vertices.par_chunks_mut(512).zip(geometry.positions.par_chunks(512));
        chunks.for_each(|(out, positions)| {
            for (slot, &p) in out.iter_mut().zip(positions) {
                let camera = camera_from_world * (p - view.eye);
                *slot = (camera, lens.project(camera.as_dvec3()));
            }
        });
        let vertices = &self.vertices;
        self.setups.resize(geometry.triangles.len(), Setup::default());
        let chunks = self.setups.par_chunks_mut(512).zip(geometry.triangles.par_chunks(512));
        chunks.for_each(|(out, triangles)| {
            for (setup, triangle) in out.iter_mut().zip(triangles) {
                *setup = prepare(lens, half_angle_rad, triangle.map(|i| vertices[i as usize]));
            }
        });
    }

    /// Lists for each band of rows the triangles that may touch it, in their order.
    fn sort_into_bands(&mut self, height: usize) {
        let bands = height.div_ceil(BAND_ROWS);
        self.bin_ends.clear();
        self.bin_ends.resize(bands, 0);
        let touched = |s: &Setup| {
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
}

/// Planes of a triangle and the part of the picture that it may cover.
fn prepare(lens: &Lens, half_angle_rad: f32, corners: [(Vec3, Option<DVec2>); 3]) -> Setup {
    let mut setup = Setup { columns: [0, -1], ..Setup::default() };
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
            // Straight edges bow: follow them in steps of at most 16 pixels.
            pad = 0.5;
            for i in 0..3 {
                let j = (i + 1) % 3;
                let steps = ((p[i] - p[j]).length() / 16.0).ceil().clamp(1.0, 64.0) as i32;
                for k in 1..steps {
                    match lens.project(v[i].lerp(v[j], k as f32 / steps as f32).as_dvec3()) {
                        Some(q) => add(q),
                        None => return Some(everything),
                    }
                }
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

/// Keeps a triangle in the samples of a band where it is the nearest so far (the first one on a tie).
fn cover(
    setup: &Setup,
    triangle: u32,
    first_row: usize,
    width: usize,
    count: usize,
    directions: &[Vec3],
    samples: &mut [Sample],
) {
    let band_rows = samples.len() / (width * count);
    let top = (setup.rows[0] as usize).max(first_row) - first_row;
    let bottom = (setup.rows[1] as usize).min(first_row + band_rows - 1) - first_row;
    for y in top..=bottom {
        let start = (y * width + setup.columns[0] as usize) * count;
        let end = (y * width + setup.columns[1] as usize + 1) * count;
        for (sample, &ray) in samples[start..end].iter_mut().zip(&directions[start..end]) {
            let facing = setup.normal.dot(ray);
            if setup.edges[0].dot(ray) >= 0.0
                && setup.edges[1].dot(ray) >= 0.0
                && setup.edges[2].dot(ray) >= 0.0
                && facing > 0.0
            {
                let distance = setup.distance / facing;
                if distance < sample.distance {
                    *sample = Sample { distance, triangle };
                }
            }
        }
    }
}

/// One pixel: real things hide samples, each visible triangle is shaded once.
fn resolve(
    setups: &[Setup],
    view: &View,
    samples: &[Sample],
    directions: &[Vec3],
    hidden: &impl Fn(Vec3, f32) -> bool,
    shade: &impl Fn(&Fragment) -> [f32; 3],
) -> [f32; 4] {
    let mut open = [NONE; 4];
    for ((slot, sample), &ray) in open.iter_mut().zip(samples).zip(directions) {
        if sample.triangle != NONE && !hidden(view.world_from_camera * ray, sample.distance) {
            *slot = sample.triangle;
        }
    }
    let weight = 1.0 / samples.len() as f32;
    let mut pixel = [0.0f32; 4];
    for k in 0..samples.len() {
        let triangle = open[k];
        if triangle == NONE || open[..k].contains(&triangle) {
            continue;
        }
        let mut ray = Vec3::ZERO;
        let mut share = 0.0;
        for (&other, &direction) in open.iter().zip(directions) {
            if other == triangle {
                ray += direction;
                share += weight;
            }
        }
        let setup = &setups[triangle as usize];
        let ray = ray.normalize_or_zero();
        let e = setup.edges.map(|edge| edge.dot(ray).max(0.0));
        let sum = e[0] + e[1] + e[2];
        let world = view.world_from_camera * ray;
        let fragment = Fragment {
            triangle: triangle as usize,
            barycentric: if sum > 0.0 { e.map(|e| e / sum) } else { [1.0 / 3.0; 3] },
            point_world: view.eye + world * (setup.distance / setup.normal.dot(ray)),
            to_eye: -world,
        };
        let radiance = shade(&fragment);
        for (slot, c) in pixel.iter_mut().zip(radiance) {
            *slot += share * c;
        }
        pixel[3] += share;
    }
    pixel
}
