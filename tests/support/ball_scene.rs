//! A small exact renderer of one scene: a mirror ball that stands on the Lambert plane z = 0 under a distant
//! environment. No interreflection: the ball takes light from the plane but throws none.
#![allow(dead_code)]

use glam::{DVec2, DVec3};
use halflight::math::dice;
use halflight::math::lens::Lens;
use halflight::math::pose::Pose;
use halflight::model::image::{HdrImage, Image, RadianceImage};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

const COLUMNS: usize = 256;
const ROWS: usize = 128;

/// An equirectangular environment whose texels are patches of constant radiance; row 0 is straight up.
pub struct Environment {
    texels: Vec<DVec3>,
    directions: Vec<DVec3>,
    /// Irradiance of an upward surface that sees all of it.
    irradiance_up: DVec3,
}

impl Environment {
    /// From a picture of four times the size, turned about z by whole texels and scaled so that the gray irradiance of
    /// an upward surface is pi.
    pub fn new(picture: &RadianceImage, turn_texels: usize) -> Self {
        assert_eq!((picture.width(), picture.height()), (4 * COLUMNS, 4 * ROWS));
        let texels = (0..ROWS * COLUMNS)
            .map(|i| {
                let (column, row) = ((i + turn_texels) % COLUMNS, i / COLUMNS);
                let block = (0..16).map(|k| picture.at(4 * column + k % 4, 4 * row + k / 4));
                block.map(|p| DVec3::from_array(p.map(f64::from))).sum::<DVec3>() / 16.0
            })
            .collect();
        let directions = (0..ROWS * COLUMNS).map(|i| Self::direction(i / COLUMNS, i % COLUMNS)).collect();
        let mut environment = Self { texels, directions, irradiance_up: DVec3::ZERO };
        let scale = PI / environment.blocked(DVec3::Z, PI).dot(DVec3::new(0.3, 0.59, 0.11));
        environment.texels.iter_mut().for_each(|t| *t *= scale);
        environment.irradiance_up = environment.blocked(DVec3::Z, PI);
        environment
    }

    fn radiance(&self, d: DVec3) -> DVec3 {
        let row = (d.z.clamp(-1.0, 1.0).acos() / PI * ROWS as f64) as usize;
        let column = ((d.y.atan2(d.x) + PI) / TAU * COLUMNS as f64) as usize;
        self.texels[row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)]
    }

    fn direction(row: usize, column: usize) -> DVec3 {
        let (theta, phi) =
            (PI * (row as f64 + 0.5) / ROWS as f64, TAU * (column as f64 + 0.5) / COLUMNS as f64 - PI);
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    fn solid_angle(row: usize) -> f64 {
        let cosine = |row: usize| (PI * row as f64 / ROWS as f64).cos();
        (cosine(row) - cosine(row + 1)) * TAU / COLUMNS as f64
    }

    /// What a cone about `axis` takes from an upward surface. A texel counts by the share of it that lies within, its
    /// border with the cone taken as straight.
    fn blocked(&self, axis: DVec3, half_angle: f64) -> DVec3 {
        let step = PI / ROWS as f64;
        let polar = axis.z.clamp(-1.0, 1.0).acos();
        let first = ((polar - half_angle) / step - 1.0).max(0.0) as usize;
        let last = (((polar + half_angle) / step + 1.0) as usize).min(ROWS / 2 - 1);
        let middle = axis.y.atan2(axis.x);
        let (inner, outer) = ((half_angle - step).max(0.0).cos(), (half_angle + step).min(PI).cos());
        let mut sum = DVec3::ZERO;
        for row in first..=last {
            let (sin, cos) = (step * (row as f64 + 0.5)).sin_cos();
            // Columns that a cone half a texel's diagonal wider can reach in this row.
            let wide = (half_angle + step).min(PI).cos();
            let reach = (wide - cos * polar.cos()) / (sin * polar.sin()).max(1e-9);
            let reach = if reach <= -1.0 {
                PI
            } else if reach >= 1.0 {
                0.0
            } else {
                reach.acos()
            } + step;
            let columns = ((2.0 * reach / step).ceil() as usize).min(COLUMNS);
            let start = ((middle - reach + PI) / step).floor() as i64;
            let mut in_row = DVec3::ZERO;
            for k in 0..columns as i64 {
                let column = (start + k).rem_euclid(COLUMNS as i64) as usize;
                let cosine = self.directions[row * COLUMNS + column].dot(axis);
                let share = if cosine >= inner {
                    1.0
                } else if cosine <= outer {
                    0.0
                } else {
                    ((half_angle - cosine.clamp(-1.0, 1.0).acos()) / step + 0.5).clamp(0.0, 1.0)
                };
                in_row += self.texels[row * COLUMNS + column] * share;
            }
            sum += in_row * (Self::solid_angle(row) * cos);
        }
        sum
    }

    /// First moment of each channel, of the upper hemisphere with the unshadowed plane below: rows r, g, b.
    pub fn moments(&self, albedo: DVec3) -> [DVec3; 3] {
        let plane = albedo * self.irradiance_up / PI;
        std::array::from_fn(|c| {
            let mut sum = DVec3::new(0.0, 0.0, -PI * plane[c]);
            for row in 0..ROWS / 2 {
                for column in 0..COLUMNS {
                    let weight = self.texels[row * COLUMNS + column][c] * Self::solid_angle(row);
                    sum += Self::direction(row, column) * weight;
                }
            }
            sum
        })
    }
}

/// The scene; the ball touches the plane at the origin.
pub struct BallScene {
    pub environment: Environment,
    pub radius_m: f64,
    pub albedo: DVec3,
}

impl BallScene {
    pub fn centre(&self) -> DVec3 {
        DVec3::new(0.0, 0.0, self.radius_m)
    }

    fn plane_radiance(&self, point: DVec3) -> DVec3 {
        let to_ball = self.centre() - point;
        let distance = to_ball.length();
        let taken = self.environment.blocked(to_ball / distance, (self.radius_m / distance).min(1.0).asin());
        self.albedo / PI * (self.environment.irradiance_up - taken)
    }

    /// Point and mirrored direction where a ray (unit) meets the ball.
    fn mirrored(&self, origin: DVec3, d: DVec3) -> Option<(DVec3, DVec3)> {
        let from_centre = origin - self.centre();
        let along = from_centre.dot(d);
        let rest = along * along - from_centre.length_squared() + self.radius_m * self.radius_m;
        (rest >= 0.0 && along < 0.0).then(|| {
            let point = origin + d * (-along - rest.sqrt());
            let normal = (point - self.centre()) / self.radius_m;
            (point, d - 2.0 * d.dot(normal) * normal)
        })
    }

    /// Mean over a pixel, by `rays` times `rays` rays where it shows the environment; the plane, which is smooth, by
    /// a sixteenth of 16 times 16 in the ball and a sixty-fourth beside it (and given as `plane` where it is known).
    fn pixel(&self, lens: &Lens, pose: &Pose, corner: DVec2, rays: u32, plane: Option<DVec3>) -> PixelMean {
        let (mut sky, mut sky_rays, mut brightest) = (DVec3::ZERO, 0.0, 0.0f64);
        let (mut ground, mut ground_rays, mut ground_seen) = (DVec3::ZERO, 0.0, 0.0);
        for sub in 0..rays * rays {
            let (x, y) = (sub % rays, sub / rays);
            let at = corner + DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / f64::from(rays);
            let d = pose.rotate(lens.unproject(at).unwrap());
            let mirrored = self.mirrored(pose.translation, d);
            let every = if mirrored.is_some() { 4 } else { 8 };
            let (origin, d) = mirrored.unwrap_or((pose.translation, d));
            if d.z >= 0.0 {
                let radiance = self.environment.radiance(d);
                brightest = brightest.max(radiance.max_element());
                sky += radiance;
                sky_rays += 1.0;
            } else {
                ground_rays += 1.0;
                if plane.is_none() && (x % every, y % every) == (1, 2) {
                    ground += self.plane_radiance(origin - d * (origin.z / d.z));
                    ground_seen += 1.0;
                }
            }
        }
        let plane = plane.unwrap_or(ground / f64::max(ground_seen, 1.0));
        let mean = (sky + plane * ground_rays) / f64::from(rays * rays);
        PixelMean { mean, plane, uneven: brightest > 2.0 * sky.max_element() / f64::max(sky_rays, 1.0) }
    }

    /// The picture with shot noise of `electrons` for each unit of radiance.
    pub fn picture(&self, lens: &Lens, pose: &Pose, electrons: f64, seed: u64) -> HdrImage {
        let (width, height) = (lens.width as usize, lens.height as usize);
        let pixels: Vec<[f32; 3]> = (0..width * height)
            .into_par_iter()
            .map(|i| {
                let corner = DVec2::new((i % width) as f64, (i / width) as f64);
                let first = self.pixel(lens, pose, corner, 16, None);
                // A sun smaller than the pixel wants more rays.
                let mean = if first.uneven {
                    self.pixel(lens, pose, corner, 96, Some(first.plane)).mean
                } else {
                    first.mean
                };
                std::array::from_fn(|c| {
                    let counted = mean[c] * electrons;
                    ((counted + counted.sqrt() * normal(seed, (3 * i + c) as u64)) / electrons).max(0.0)
                        as f32
                })
            })
            .collect();
        let radiance = Image::from_pixels(width, height, pixels).unwrap();
        HdrImage { radiance, flags: Image::filled(width, height, 0) }
    }
}

struct PixelMean {
    mean: DVec3,
    plane: DVec3,
    uneven: bool,
}

/// A standard normal number of a seed and a place (Box and Muller's).
fn normal(seed: u64, place: u64) -> f64 {
    let uniform = |k: u64| dice::unit(dice::mix(seed ^ (2 * place + k).wrapping_mul(dice::STEP)));
    (-2.0 * (1.0 - uniform(0)).ln()).sqrt() * (TAU * uniform(1)).cos()
}
