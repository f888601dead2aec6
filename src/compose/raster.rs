//! The CPU's triangle rasteriser: coverage samples through the real lens, whatever its distortion.
//!
//! Instead of flat triangles in the picture, each sample's own ray is tested against the three planes
//! through the eye and the triangle's edges (homogeneous rasterisation). That is exact for every lens, needs
//! no near plane, and its edge values are perspective-correct barycentrics. The nearest triangle of each
//! sample stays; then each pixel is shaded once for every triangle that it still sees, at the mean of that
//! triangle's samples, so that an edge pixel is never shaded beside its triangle.
//! On the GPU the rasteriser of the hardware does this work with the same four samples.

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
/// Real surfaces hide an object only if they are nearer by more than this share of the distance, so that
/// what stands on a surface is not hidden by it.
pub const CONTACT_SHARE: f32 = 1e-4;
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
pub struct Sample {
    distance: f32,
    triangle: u32,
}

impl Default for Sample {
    /// Nothing met.
    fn default() -> Self {
        Self { distance: f32::INFINITY, triangle: NONE }
    }
}

/// Triangles as one picture sees them, sorted into bands of rows. Keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Projected {
    vertices: Vec<(Vec3, Option<DVec2>)>,
    setups: Vec<Setup>,
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
        self.setups.resize(triangles.len(), Setup::default());
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

    fn bin(&self, band: usize) -> &[u32] {
        let start = if band == 0 { 0 } else { self.bin_ends[band - 1] };
        &self.bins[start..self.bin_ends[band]]
    }

    fn fragment(&self, view: &View, triangle: u32, ray: Vec3) -> Fragment {
        let setup = &self.setups[triangle as usize];
        let e = setup.edges.map(|edge| edge.dot(ray).max(0.0));
        let sum = e[0] + e[1] + e[2];
        let world = view.world_from_camera * ray;
        Fragment {
            triangle: triangle as usize,
            barycentric: if sum > 0.0 { e.map(|e| e / sum) } else { [1.0 / 3.0; 3] },
            point_world: view.eye + world * (setup.distance / setup.normal.dot(ray)),
            to_eye: -world,
        }
    }
}

/// Draws objects into a layer of premultiplied radiance (r, g, b) and coverage (a). A sample of an object is
/// hidden where an `occluder` is nearer by more than `CONTACT_SHARE` of the distance. `shade` gives the
/// radiance of a fragment; it must be pure: the result is the same for any number of threads.
/// `samples` is working memory.
pub fn draw_objects(
    rays: &Rays,
    view: &View,
    objects: &Projected,
    occluders: &Projected,
    shade: impl Fn(&Fragment) -> [f32; 3] + Sync,
    samples: &mut Vec<Sample>,
    out: &mut Image<[f32; 4]>,
) {
    let (width, height, count) = (rays.width(), rays.height(), rays.samples_a_pixel);
    out.reshape(width, height, [0.0; 4]);
    samples.resize(width * height * count, Sample::default());
    let band_samples = (BAND_ROWS * width * count).max(1);
    let rows = out.pixels_mut().par_chunks_mut((BAND_ROWS * width).max(1));
    let samples = samples.par_chunks_mut(band_samples);
    let directions = rays.samples.par_chunks(band_samples);
    rows.zip(samples).zip(directions).enumerate().for_each(|(band, ((layer, samples), directions))| {
        layer.fill([0.0; 4]);
        if objects.bin(band).is_empty() {
            return;
        }
        samples.fill(Sample::default());
        let whole = Part { first_row: band * BAND_ROWS, width, count, columns: [0, width as i32 - 1] };
        let mut columns = [i32::MAX, -1];
        for &triangle in objects.bin(band) {
            let setup = &objects.setups[triangle as usize];
            columns = [columns[0].min(setup.columns[0]), columns[1].max(setup.columns[1])];
            cover(setup, &whole, directions, samples, |sample, distance| {
                if distance < sample.distance {
                    *sample = Sample { distance, triangle };
                }
            });
        }
        let touched = Part { columns, ..whole };
        for &triangle in occluders.bin(band) {
            let setup = &occluders.setups[triangle as usize];
            cover(setup, &touched, directions, samples, |sample, distance| {
                if distance < sample.distance * (1.0 - CONTACT_SHARE) {
                    sample.triangle = NONE;
                }
            });
        }
        let pixels = layer.iter_mut().zip(samples.chunks(count)).zip(directions.chunks(count));
        for ((pixel, samples), directions) in pixels {
            if samples.iter().any(|s| s.triangle != NONE) {
                *pixel = resolve(objects, view, samples, directions, &shade);
            }
        }
    });
}

/// For each pixel, what `shade` makes of the surface that the ray through its centre meets first; `background`
/// where it meets none. As `draw_objects` otherwise.
pub fn draw_surfaces<P: Copy + Send + Sync>(
    rays: &Rays,
    view: &View,
    surfaces: &Projected,
    background: P,
    shade: impl Fn(&Fragment) -> P + Sync,
    samples: &mut Vec<Sample>,
    out: &mut Image<P>,
) {
    let (width, height) = (rays.width(), rays.height());
    out.reshape(width, height, background);
    samples.resize(width * height, Sample::default());
    let band_pixels = (BAND_ROWS * width).max(1);
    let rows = out.pixels_mut().par_chunks_mut(band_pixels);
    let samples = samples.par_chunks_mut(band_pixels);
    let directions = rays.centres.par_chunks(band_pixels);
    rows.zip(samples).zip(directions).enumerate().for_each(|(band, ((row, samples), directions))| {
        row.fill(background);
        samples.fill(Sample::default());
        let whole = Part { first_row: band * BAND_ROWS, width, count: 1, columns: [0, width as i32 - 1] };
        for &triangle in surfaces.bin(band) {
            cover(&surfaces.setups[triangle as usize], &whole, directions, samples, |sample, distance| {
                if distance < sample.distance {
                    *sample = Sample { distance, triangle };
                }
            });
        }
        for ((pixel, sample), &ray) in row.iter_mut().zip(samples).zip(directions) {
            if sample.triangle != NONE {
                *pixel = shade(&surfaces.fragment(view, sample.triangle, ray));
            }
        }
    });
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

/// A part of the picture: some rows, and some of their columns.
#[derive(Clone, Copy)]
struct Part {
    first_row: usize,
    width: usize,
    count: usize,
    columns: [i32; 2],
}

/// Calls `meet` with each sample of a part that a triangle covers, and the distance there.
fn cover(
    setup: &Setup,
    part: &Part,
    directions: &[Vec3],
    samples: &mut [Sample],
    meet: impl Fn(&mut Sample, f32),
) {
    let Part { first_row, width, count, columns } = *part;
    let columns = [setup.columns[0].max(columns[0]), setup.columns[1].min(columns[1])];
    if columns[0] > columns[1] {
        return;
    }
    let rows = samples.len() / (width * count);
    let top = (setup.rows[0] as usize).max(first_row) - first_row;
    let bottom = (setup.rows[1] as usize).min(first_row + rows - 1) - first_row;
    for y in top..=bottom {
        let start = (y * width + columns[0] as usize) * count;
        let end = (y * width + columns[1] as usize + 1) * count;
        for (sample, &ray) in samples[start..end].iter_mut().zip(&directions[start..end]) {
            let facing = setup.normal.dot(ray);
            if setup.edges[0].dot(ray) >= 0.0
                && setup.edges[1].dot(ray) >= 0.0
                && setup.edges[2].dot(ray) >= 0.0
                && facing > 0.0
            {
                meet(sample, setup.distance / facing);
            }
        }
    }
}

/// One pixel: each visible triangle is shaded once.
fn resolve(
    objects: &Projected,
    view: &View,
    samples: &[Sample],
    directions: &[Vec3],
    shade: &impl Fn(&Fragment) -> [f32; 3],
) -> [f32; 4] {
    let weight = 1.0 / samples.len() as f32;
    let mut pixel = [0.0f32; 4];
    for (k, sample) in samples.iter().enumerate() {
        let triangle = sample.triangle;
        if triangle == NONE || samples[..k].iter().any(|s| s.triangle == triangle) {
            continue;
        }
        let mut ray = Vec3::ZERO;
        let mut share = 0.0;
        for (other, &direction) in samples.iter().zip(directions) {
            if other.triangle == triangle {
                ray += direction;
                share += weight;
            }
        }
        let radiance = shade(&objects.fragment(view, triangle, ray.normalize_or_zero()));
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
    use crate::compose::geometry::ObjectGeometry;
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

    fn project(rays: &Rays, view: &View, geometry: &ObjectGeometry) -> Projected {
        let mut projected = Projected::default();
        projected.prepare(rays, view, &geometry.positions, &geometry.triangles);
        projected
    }

    fn draw_behind(
        lens: &Lens,
        pose: &Pose,
        geometry: &ObjectGeometry,
        real: &ObjectGeometry,
        samples: u32,
    ) -> Image<[f32; 4]> {
        let mut rays = Rays::default();
        rays.update(lens, samples);
        let view = View::of(pose);
        let (objects, occluders) = (project(&rays, &view, geometry), project(&rays, &view, real));
        let mut out = Image::default();
        let shade = |f: &Fragment| f.point_world.to_array();
        draw_objects(&rays, &view, &objects, &occluders, shade, &mut Vec::new(), &mut out);
        out
    }

    fn draw(lens: &Lens, pose: &Pose, geometry: &ObjectGeometry, samples: u32) -> Image<[f32; 4]> {
        draw_behind(lens, pose, geometry, &ObjectGeometry::default(), samples)
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
        // A real screen over the left half, before the square, at its very place, and behind it.
        let screen = |z: f32| {
            let p = |x: f32, y: f32| Vec3::new(x * z, y * z, z);
            scene(vec![p(-1.0, -1.0), p(0.0, -1.0), p(0.0, 1.0), p(-1.0, 1.0)], vec![[0, 1, 2], [0, 2, 3]])
        };
        for (z, hidden) in [(0.5, true), (0.999, true), (1.0, false), (2.0, false)] {
            let layer = draw_behind(&lens, &Pose::IDENTITY, &square(1.0), &screen(z), 4);
            for (k, pixel) in layer.pixels().iter().enumerate() {
                let expected = if hidden && k % 32 < 16 { 0.0 } else { 1.0 };
                assert_eq!(pixel[3], expected, "screen at {z}, column {}", k % 32);
            }
        }
    }

    #[test]
    fn surfaces_are_met_at_pixel_centres_nearest_first() {
        let pose = Pose::look_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 2.0, 0.5), DVec3::Z);
        let geometry = room();
        for lens in lenses() {
            let mut rays = Rays::default();
            rays.update(&lens, 4);
            let view = View::of(&pose);
            let projected = project(&rays, &view, &geometry);
            let mut met = Image::default();
            let shade = |f: &Fragment| f.point_world.to_array();
            draw_surfaces(&rays, &view, &projected, [9.0; 3], shade, &mut Vec::new(), &mut met);
            let layer = draw(&lens, &pose, &geometry, 1);
            for (a, b) in met.pixels().iter().zip(layer.pixels()) {
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
            }
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
