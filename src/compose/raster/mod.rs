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

pub use projected::Projected;
pub use rays::{Rays, SAMPLES};

use crate::math::pose::Pose;
use crate::model::image::Image;
use glam::{Mat3, Vec3};
use projected::Setup;
use rayon::prelude::*;

/// Rows of one unit of parallel work; fixed, so that no result depends on the number of threads.
const BAND_ROWS: usize = 8;
/// Real surfaces hide an object only if they are nearer by more than this share of the distance, so that
/// what stands on a surface is not hidden by it.
pub const CONTACT_SHARE: f32 = 1e-4;
/// No triangle.
const NONE: u32 = u32::MAX;

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
    /// Number of the pixel, row by row; only where surfaces are drawn (else 0).
    pub pixel: usize,
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
        for (k, ((pixel, sample), &ray)) in row.iter_mut().zip(samples).zip(directions).enumerate() {
            if sample.triangle != NONE {
                let fragment = surfaces.fragment(view, sample.triangle, ray);
                *pixel = shade(&Fragment { pixel: band * band_pixels + k, ..fragment });
            }
        }
    });
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
mod tests;
