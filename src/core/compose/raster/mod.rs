//! The CPU's triangle rasteriser: coverage samples through the real lens, whatever its distortion.
//!
//! Instead of flat triangles in the picture, each sample's own ray is tested against the three planes
//! through the eye and the triangle's edges (homogeneous rasterisation). That is exact for every lens, needs
//! no near plane, and its edge values are perspective-correct barycentrics. The nearest triangle of each
//! sample stays; then each pixel is shaded once for every triangle that it still sees, at the mean of that
//! triangle's samples, so that an edge pixel is never shaded beside its triangle.
//! On the GPU the rasteriser of the hardware does this work with the same four samples.

mod projected;
mod rays;
mod rows;

pub use projected::Projected;
pub use rays::{Rays, SAMPLES};
pub use rows::{Points, Row};

use crate::math::{pose::Pose, widest::widest};
use crate::model::image::Image;
use glam::{Mat3, Vec3};
use projected::TriangleSetup;
use rayon::prelude::*;

/// Rows of one unit of parallel work; fixed, so that no result depends on the number of threads.
const BAND_ROWS: usize = 8;
/// Real surfaces hide an object only if they are nearer by more than this share of the distance, so that
/// what stands on a surface is not hidden by it.
pub const CONTACT_SHARE: f32 = 1e-4;
/// No triangle.
const NONE: u32 = u32::MAX;

/// Camera pose in f32, as the kernels use it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Turns directions of the camera's frame into the world's.
    pub world_from_camera: Mat3,
    /// Camera's position, world frame, metres.
    pub eye: Vec3,
}

impl View {
    /// Takes the turn and the place of a camera in f32.
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
    /// Number of the pixel, row by row; only where surfaces are drawn (else 0).
    pub pixel: usize,
}

/// The nearest triangle of each coverage sample: working memory.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    distances: Vec<f32>,
    triangles: Vec<u32>,
}

impl Samples {
    fn resize(&mut self, count: usize) {
        self.distances.resize(count, f32::INFINITY);
        self.triangles.resize(count, NONE);
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
    samples: &mut Samples,
    out: &mut Image<[f32; 4]>,
) {
    let (width, height, count) = (rays.width(), rays.height(), rays.samples_a_pixel);
    out.reshape(width, height, [0.0; 4]);
    samples.resize(width * height * count);
    let band_samples = (BAND_ROWS * width * count).max(1);
    let rows = out.pixels_mut().par_chunks_mut((BAND_ROWS * width).max(1));
    let distances = samples.distances.par_chunks_mut(band_samples);
    let triangles = samples.triangles.par_chunks_mut(band_samples);
    rows.zip(distances).zip(triangles).enumerate().for_each(|(band, ((layer, distances), triangles))| {
        layer.fill([0.0; 4]);
        if objects.bin(band).is_empty() {
            return;
        }
        let start = band * band_samples;
        let part = PictureStrip {
            first_row: band * BAND_ROWS,
            width,
            count,
            columns: [0, width as i32 - 1],
            rays: rays.samples.part(start..start + distances.len()),
        };
        let mut columns = [i32::MAX, -1];
        for &triangle in objects.bin(band) {
            let setup = &objects.setups[triangle as usize];
            columns = [columns[0].min(setup.columns[0]), columns[1].max(setup.columns[1])];
        }
        let touched = PictureStrip { columns, ..part };
        widest(
            #[inline(always)]
            || {
                distances.fill(f32::INFINITY);
                triangles.fill(NONE);
                for &triangle in objects.bin(band) {
                    let setup = &objects.setups[triangle as usize];
                    cover(setup, &part, distances, triangles, nearest(triangle));
                }
                for &triangle in occluders.bin(band) {
                    let setup = &occluders.setups[triangle as usize];
                    cover(setup, &touched, distances, triangles, |distance, seen| {
                        let hides = distance < seen.0 * (1.0 - CONTACT_SHARE);
                        (seen.0, if hides { NONE } else { seen.1 })
                    });
                }
            },
        );
        for (k, (pixel, triangles)) in layer.iter_mut().zip(triangles.chunks(count)).enumerate() {
            if triangles.iter().any(|&t| t != NONE) {
                let rays = part.rays.map(|axis| &axis[k * count..(k + 1) * count]);
                *pixel = resolve(objects, view, triangles, rays, &shade);
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
    samples: &mut Samples,
    out: &mut Image<P>,
) {
    let each = |row: &Row<'_>, out: &mut [P]| {
        for (k, pixel) in out.iter_mut().enumerate() {
            if let Some(fragment) = row.fragment(k) {
                *pixel = shade(&fragment);
            }
        }
    };
    draw_rows(rays, view, surfaces, background, each, samples, out);
}

/// [`draw_surfaces`] row by row: `shade` is given a row and its pixels, all `background`.
pub fn draw_rows<P: Copy + Send + Sync>(
    rays: &Rays,
    view: &View,
    surfaces: &Projected,
    background: P,
    shade: impl Fn(&Row<'_>, &mut [P]) + Sync,
    samples: &mut Samples,
    out: &mut Image<P>,
) {
    let (width, height) = (rays.width(), rays.height());
    out.reshape(width, height, background);
    samples.resize(width * height);
    let band_pixels = (BAND_ROWS * width).max(1);
    let rows = out.pixels_mut().par_chunks_mut(band_pixels);
    let distances = samples.distances.par_chunks_mut(band_pixels);
    let triangles = samples.triangles.par_chunks_mut(band_pixels);
    rows.zip(distances).zip(triangles).enumerate().for_each(|(band, ((out, distances), triangles))| {
        out.fill(background);
        let start = band * band_pixels;
        let part = PictureStrip {
            first_row: band * BAND_ROWS,
            width,
            count: 1,
            columns: [0, width as i32 - 1],
            rays: rays.centres.part(start..start + distances.len()),
        };
        widest(
            #[inline(always)]
            || {
                distances.fill(f32::INFINITY);
                triangles.fill(NONE);
                for &triangle in surfaces.bin(band) {
                    let setup = &surfaces.setups[triangle as usize];
                    cover(setup, &part, distances, triangles, nearest(triangle));
                }
            },
        );
        for (y, (out, triangles)) in out.chunks_mut(width).zip(triangles.chunks(width)).enumerate() {
            let rays = part.rays.map(|axis| &axis[y * width..(y + 1) * width]);
            shade(&Row { surfaces, view, first: start + y * width, triangles, rays }, out);
        }
    });
}

/// A part of the picture: some rows, and some of their columns; the rays of its rows.
#[derive(Clone, Copy)]
struct PictureStrip<'a> {
    first_row: usize,
    width: usize,
    count: usize,
    columns: [i32; 2],
    rays: [&'a [f32]; 3],
}

/// The nearer triangle stays, of equal ones the first.
#[inline(always)]
fn nearest(triangle: u32) -> impl Fn(f32, (f32, u32)) -> (f32, u32) {
    move |distance, seen| if distance < seen.0 { (distance, triangle) } else { seen }
}

/// For each sample of a part that a triangle covers, makes of the distance there and of what it has seen (distance and
/// triangle) what it sees now.
#[inline(always)]
fn cover(
    setup: &TriangleSetup,
    part: &PictureStrip<'_>,
    distances: &mut [f32],
    triangles: &mut [u32],
    see: impl Fn(f32, (f32, u32)) -> (f32, u32),
) {
    let PictureStrip { first_row, width, count, columns, rays } = *part;
    let columns = [setup.columns[0].max(columns[0]), setup.columns[1].min(columns[1])];
    if columns[0] > columns[1] {
        return;
    }
    let rows = distances.len() / (width * count);
    let top = (setup.rows[0] as usize).max(first_row) - first_row;
    let bottom = (setup.rows[1] as usize).min(first_row + rows - 1) - first_row;
    let ([a, b, c], normal) = (setup.edges, setup.normal);
    for y in top..=bottom {
        let start = (y * width + columns[0] as usize) * count;
        let end = (y * width + columns[1] as usize + 1) * count;
        let [x, y, z] = rays.map(|axis| &axis[start..end]);
        let seen = distances[start..end].iter_mut().zip(&mut triangles[start..end]);
        for (((distance, triangle), (x, y)), z) in seen.zip(x.iter().zip(y)).zip(z) {
            let ray = Vec3::new(*x, *y, *z);
            let facing = normal.dot(ray);
            let inside = (a.dot(ray) >= 0.0) & (b.dot(ray) >= 0.0) & (c.dot(ray) >= 0.0) & (facing > 0.0);
            let now = see(setup.distance / facing, (*distance, *triangle));
            *distance = if inside { now.0 } else { *distance };
            *triangle = if inside { now.1 } else { *triangle };
        }
    }
}

/// One pixel: each visible triangle is shaded once.
fn resolve(
    objects: &Projected,
    view: &View,
    triangles: &[u32],
    rays: [&[f32]; 3],
    shade: &impl Fn(&Fragment) -> [f32; 3],
) -> [f32; 4] {
    let weight = 1.0 / triangles.len() as f32;
    let mut pixel = [0.0f32; 4];
    for (k, &triangle) in triangles.iter().enumerate() {
        if triangle == NONE || triangles[..k].contains(&triangle) {
            continue;
        }
        let mut ray = Vec3::ZERO;
        let mut share = 0.0;
        for (i, _) in triangles.iter().enumerate().filter(|(_, other)| **other == triangle) {
            ray += Vec3::from_array(rays.map(|axis| axis[i]));
            share += weight;
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
mod tests;
