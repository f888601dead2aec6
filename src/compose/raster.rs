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
/// Cosine of 3 degrees, see `bounds`.
const EDGE_STEP_COSINE: f64 = 0.998_629_534_754_573_9;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::scene::{Material, Mesh, Scene, VirtualObject};
    use glam::{Affine3A, DVec3};

    fn scene(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> ObjectGeometry {
        let object = VirtualObject {
            name: "test".into(),
            mesh: Mesh { positions, triangles, ..Mesh::default() },
            material: Material::Lambert { albedo_rgb: [1.0; 3] },
            world_from_object: Affine3A::IDENTITY,
            openness: Vec::new(),
        };
        let mut geometry = ObjectGeometry::default();
        geometry.load(&Scene { objects: vec![object], surfaces: Vec::new() });
        geometry
    }

    fn draw(lens: &Lens, pose: &Pose, geometry: &ObjectGeometry, samples: u32) -> Image<[f32; 4]> {
        let mut rays = Rays::default();
        rays.update(lens, samples);
        let mut out = Image::default();
        let shade = |f: &Fragment| f.point_world.to_array();
        Raster::default().draw(&rays, &View::of(pose), geometry, |_, _| false, shade, &mut out);
        out
    }

    fn lenses() -> [Lens; 3] {
        let pinhole = Lens::pinhole(96, 64, 70.0, 72.0, 47.0, 33.5);
        let radial = Distortion::RadialTangential([-0.25, 0.06, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
        let fisheye = Distortion::Equidistant([0.02, 0.001, 0.0, 0.0]);
        [
            pinhole,
            Lens { distortion: radial, ..pinhole },
            Lens { distortion: fisheye, fx: 30.0, fy: 30.0, ..pinhole },
        ]
    }

    /// A big box around the camera: six faces of 2 triangles each.
    fn room() -> ObjectGeometry {
        let positions = (0..8)
            .map(|k| {
                Vec3::new(
                    (k & 1) as f32 * 4.0 - 2.0,
                    (k >> 1 & 1) as f32 * 6.0 - 3.0,
                    (k >> 2) as f32 * 5.0 - 2.0,
                )
            })
            .collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        scene(positions, quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect())
    }

    #[test]
    fn a_closed_room_covers_every_sample_through_every_lens() {
        let geometry = room();
        let poses = [
            Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z),
            Pose::look_at(DVec3::new(-1.5, 2.0, 2.5), DVec3::new(0.0, -2.0, -1.0), DVec3::Z),
        ];
        for lens in lenses() {
            for pose in &poses {
                for samples in [1, 4] {
                    let layer = draw(&lens, pose, &geometry, samples);
                    for pixel in layer.pixels() {
                        assert_eq!(pixel[3], 1.0, "{:?}", lens.distortion);
                    }
                }
            }
        }
    }

    #[test]
    fn a_fragment_lies_on_its_triangle_where_the_pixels_ray_meets_it() {
        let geometry = room();
        let pose = Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z);
        for lens in lenses() {
            let layer = draw(&lens, &pose, &geometry, 1);
            for (k, pixel) in layer.pixels().iter().enumerate() {
                let centre = DVec2::new((k % 96) as f64 + 0.5, (k / 96) as f64 + 0.5);
                let ray = pose.rotate(lens.unproject(centre).unwrap());
                let point = Vec3::from_slice(pixel).as_dvec3();
                let aside = (point - pose.translation).cross(ray).length();
                assert!(aside < 1e-5, "{aside}");
                let walls = [point.x.abs() - 2.0, point.y.abs() - 3.0, (point.z - 0.5).abs() - 2.5];
                let nearest = walls.map(f64::abs).into_iter().fold(f64::MAX, f64::min);
                assert!(nearest < 1e-5, "{point}");
            }
        }
    }

    #[test]
    fn coverage_adds_up_to_the_area_and_edges_are_shared() {
        // Two triangles that share an edge, over a grid of offsets: the pair covers what the square covers.
        let lens = Lens::pinhole(64, 64, 50.0, 50.0, 32.0, 32.0);
        let mut total = 0.0;
        for k in 0..20 {
            let (dx, dy) = (0.0137 * k as f32, 0.0093 * k as f32);
            let p = |x: f32, y: f32| Vec3::new(x + dx, y + dy, 2.0);
            let geometry = scene(
                vec![p(-0.4, -0.4), p(0.4, -0.4), p(0.4, 0.4), p(-0.4, 0.4)],
                vec![[0, 1, 2], [0, 2, 3]],
            );
            let layer = draw(&lens, &Pose::IDENTITY, &geometry, 4);
            total += layer.pixels().iter().map(|p| p[3]).sum::<f32>() / 20.0;
            assert!(layer.pixels().iter().all(|p| p[3] <= 1.0));
        }
        // 0.8 m at 2 m and 50 px: 20 x 20 px; four samples a pixel over 20 offsets.
        assert!((total - 400.0).abs() < 2.0, "{total}");
    }

    #[test]
    fn what_is_behind_the_camera_or_hidden_is_not_drawn() {
        let lens = Lens::pinhole(32, 32, 30.0, 30.0, 16.0, 16.0);
        let square = |z: f32| {
            let p = |x: f32, y: f32| Vec3::new(x, y, z);
            scene(vec![p(-1.0, -1.0), p(1.0, -1.0), p(1.0, 1.0), p(-1.0, 1.0)], vec![[0, 1, 2], [0, 2, 3]])
        };
        let behind = draw(&lens, &Pose::IDENTITY, &square(-1.0), 4);
        assert!(behind.pixels().iter().all(|p| *p == [0.0; 4]));
        let mut rays = Rays::default();
        rays.update(&lens, 4);
        let mut out = Image::default();
        let view = View::of(&Pose::IDENTITY);
        let hidden = |ray: Vec3, distance: f32| ray.x * distance < 0.0;
        Raster::default().draw(&rays, &view, &square(1.0), hidden, |_| [1.0; 3], &mut out);
        for (k, pixel) in out.pixels().iter().enumerate() {
            assert_eq!(pixel[3], if k % 32 < 16 { 0.0 } else { 1.0 }, "column {}", k % 32);
        }
    }

    #[test]
    fn a_triangle_through_the_cameras_plane_is_drawn_where_it_is_in_front() {
        // The ground, from 3 m behind to 50 m in front of a camera at 1 m height that looks level.
        let geometry = scene(
            vec![
                Vec3::new(-40.0, 1.0, -3.0),
                Vec3::new(40.0, 1.0, -3.0),
                Vec3::new(40.0, 1.0, 50.0),
                Vec3::new(-40.0, 1.0, 50.0),
            ],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        for lens in lenses() {
            let layer = draw(&lens, &Pose::IDENTITY, &geometry, 4);
            for y in 0..64 {
                let pixel = layer.at(48, y)[3];
                let level = lens.project(DVec3::new(0.0, 1.0, 50.0)).unwrap().y;
                if (y as f64) > level + 1.0 {
                    assert_eq!(pixel, 1.0, "{:?} row {y}", lens.distortion);
                } else if ((y + 1) as f64) < level - 1.0 {
                    assert_eq!(pixel, 0.0, "{:?} row {y}", lens.distortion);
                }
            }
        }
    }
}
