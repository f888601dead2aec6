//! Light from infinity, and directions drawn in proportion to it.
//!
//! Between four texel centres the picture is bilinear; such a cell is drawn by its mean gray radiance times its solid angle
//! (by rows, then along the row, which keeps neighbouring numbers neighbours), and the point in it by the bilinear gray
//! itself. So the density of a direction is its gray radiance times a constant, but for the sine of its row's middle.

use super::{scene::Environment, sequence::Sequence};
use crate::math::{color::gray, octahedral};
use crate::model::image::RadianceImage;
use glam::{Mat3, Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, PI};

/// Shares of directions that a matt surface draws itself, where the sky draws the rest. Powers of two keep stratified points
/// a net on either side. Larger ones are worse than their second moment says: points drawn by the sky are the better
/// stratified ones (measured on the reference's four skies: noise of 0.005, 0.009, 0.011, 0.006 with the better of these
/// two, and 0.008, 0.011, 0.012, 0.010 with a half).
const SURFACE_SHARES: [f32; 2] = [0.125, 0.25];
/// Normals a side of the octahedral square for which the best share is found; odd, so that straight up is one of them.
const NORMALS: usize = 9;
/// Directions that decide it, drawn half from the sky and half evenly.
const TRIALS: u32 = 1024;

/// The environment made ready.
#[derive(Debug)]
pub struct Sky {
    constant: Vec3,
    picture: Option<SkyPicture>,
    /// For each normal.
    surface_shares: Vec<f32>,
}

#[derive(Debug)]
struct SkyPicture {
    width: usize,
    height: usize,
    /// r, g, b, gray.
    texels: Vec<[f32; 4]>,
    map_from_world: Mat3,
    world_from_map: Mat3,
    /// Cumulated shares of the rows of cells: height + 2.
    rows: Vec<f32>,
    /// Cumulated shares within each row: (height + 1) x (width + 1).
    columns: Vec<f32>,
    /// For each row of cells what gray / sin(theta) is multiplied with to give the density.
    density: Vec<f32>,
    /// Integral of gray radiance over the sphere.
    power: f32,
}

/// Radiance from a direction.
#[derive(Clone, Copy, Debug, Default)]
pub struct FromSky {
    /// Linear RGB.
    pub radiance: Vec3,
    /// Density with which `Sky::draw` gives the direction, per steradian.
    pub density: f32,
}

impl Sky {
    /// Makes an environment ready. Texels that are not finite or are negative count as black.
    pub fn new(environment: &Environment) -> Self {
        let mut sky = Self { constant: Vec3::ZERO, picture: None, surface_shares: Vec::new() };
        match environment {
            Environment::Dark => {}
            Environment::Constant(rgb) => sky.constant = Vec3::from(*rgb),
            Environment::Picture { radiance, map_from_world } => {
                sky.picture = SkyPicture::new(radiance, *map_from_world);
            }
        }
        sky.find_shares();
        sky
    }

    /// For each normal the share by which the second moment of a matt surface's samples is least: the integral of
    /// (L cos / pi)^2 over the mixture's density.
    fn find_shares(&mut self) {
        let trials: Vec<(Vec3, FromSky)> = (0..TRIALS)
            .filter_map(|i| {
                let [u, v] = Sequence::new(0, 0, 0, i / 2).pair(i % 2);
                if i % 2 == 0 {
                    return self.draw([u, v]);
                }
                let (z, (sine, cosine)) = (1.0 - 2.0 * u, (2.0 * PI * v).sin_cos());
                let radius = (1.0 - z * z).max(0.0).sqrt();
                let direction = Vec3::new(radius * cosine, radius * sine, z);
                Some((direction, self.look(direction)))
            })
            .collect();
        if !(self.power() > 0.0) {
            return;
        }
        let share = |index: usize| {
            let normal = octahedral::direction(octahedral::centre(index % NORMALS, index / NORMALS, NORMALS));
            let moment = |share: f32| -> f32 {
                let terms = trials.iter().map(|(direction, seen)| {
                    let cosine = FRAC_1_PI * normal.dot(*direction).max(0.0);
                    let density = share * cosine + (1.0 - share) * seen.density;
                    let drawn = 0.5 * seen.density + 0.125 * FRAC_1_PI;
                    let sent = cosine * gray(seen.radiance.to_array());
                    if density > 0.0 { sent * (sent / density) / drawn } else { 0.0 }
                });
                terms.sum()
            };
            let best = SURFACE_SHARES.into_iter().min_by(|a, b| moment(*a).total_cmp(&moment(*b)));
            best.unwrap_or(0.25)
        };
        self.surface_shares = (0..NORMALS * NORMALS).map(share).collect();
    }

    /// The share of directions that a surface of a normal should draw itself, where this sky draws the rest.
    #[inline]
    pub fn surface_share(&self, normal: Vec3) -> f32 {
        let at = (octahedral::place(normal) + Vec2::ONE) * (0.5 * NORMALS as f32);
        let (x, y) = ((at.x as usize).min(NORMALS - 1), (at.y as usize).min(NORMALS - 1));
        self.surface_shares.get(y * NORMALS + x).copied().unwrap_or(1.0)
    }

    /// What there is to be drawn from: the integral of gray radiance over the sphere; 0 where nothing can be drawn (a
    /// constant sky is best met by the surface's own directions).
    pub fn power(&self) -> f32 {
        self.picture.as_ref().map_or(0.0, |p| p.power)
    }

    /// Radiance from a unit direction, world frame.
    #[inline]
    pub fn look(&self, direction: Vec3) -> FromSky {
        match &self.picture {
            Some(picture) => picture.look(direction),
            None => FromSky { radiance: self.constant, density: 0.0 },
        }
    }

    /// A unit direction in the world frame drawn by radiance, from two numbers in [0, 1); `None` where there is no power.
    #[inline]
    pub fn draw(&self, numbers: [f32; 2]) -> Option<(Vec3, FromSky)> {
        self.picture.as_ref().filter(|p| p.power > 0.0).map(|p| p.draw(numbers))
    }
}

/// The number t in [0, 1] below which a share `share` of a density lies that goes straight from a to b.
#[inline]
fn along(share: f32, a: f32, b: f32) -> f32 {
    let end = (a * a + share * (b * b - a * a)).max(0.0).sqrt();
    // (end - a) / (b - a) without the cancellation where a is near b.
    let sum = a + end;
    if sum > 0.0 { (share * (a + b) / sum).clamp(0.0, 1.0) } else { share }
}

/// The last entry of a rising list that is not above a number, and how far the number is on the way to the next.
#[inline]
fn find(list: &[f32], number: f32) -> (usize, f32) {
    let at = list.partition_point(|&share| share <= number).clamp(1, list.len() - 1) - 1;
    let (low, high) = (list[at], list[at + 1]);
    let rest = if high > low { (number - low) / (high - low) } else { 0.5 };
    (at, rest.clamp(0.0, 1.0))
}

impl SkyPicture {
    fn new(radiance: &RadianceImage, map_from_world: Mat3) -> Option<Self> {
        let (width, height) = (radiance.width(), radiance.height());
        if width == 0 || height == 0 {
            return None;
        }
        let sound = |c: f32| if c.is_finite() && c > 0.0 { c } else { 0.0 };
        let texels: Vec<[f32; 4]> = radiance
            .pixels()
            .iter()
            .map(|rgb| {
                let [r, g, b] = rgb.map(sound);
                [r, g, b, gray([r, g, b])]
            })
            .collect();
        let mut picture = Self {
            width,
            height,
            texels,
            map_from_world,
            world_from_map: map_from_world.transpose(),
            rows: vec![0.0],
            columns: Vec::with_capacity((height + 1) * (width + 1)),
            density: Vec::with_capacity(height + 1),
            power: 0.0,
        };
        let (mut sums, mut total) = (Vec::with_capacity(height + 1), 0.0f64);
        for row in 0..=height {
            let (top, bottom) = picture.span(row);
            let sine = f64::from((PI * 0.5 * (top + bottom)).sin());
            let mut list = vec![0.0f64];
            for column in 0..width {
                let [a, b, c, d] = picture.corners(column, row).map(|t| f64::from(t[3]));
                list.push(list[column] + 0.25 * (a + b + c + d));
            }
            let whole = list[width];
            // Where a row is black any column will do: it is never drawn.
            let share = |k: usize| if whole > 0.0 { list[k] / whole } else { k as f64 / width as f64 };
            picture.columns.extend((0..=width).map(|k| share(k) as f32));
            picture.density.push(sine as f32);
            total += whole * sine * f64::from(bottom - top);
            sums.push(total);
        }
        if !(total > 0.0 && total.is_finite()) {
            return Some(picture);
        }
        picture.rows.extend(sums.iter().map(|sum| (sum / total) as f32));
        // Per steradian: per unit of u and v (width columns of 1 / width), over 2 pi^2 sin(theta).
        for density in &mut picture.density {
            *density = (f64::from(*density) * width as f64 / total) as f32 / (2.0 * PI * PI);
        }
        picture.power = (total / width as f64) as f32 * 2.0 * PI * PI;
        Some(picture)
    }

    /// The range of v that a row of cells covers; the first and the last are half as high.
    fn span(&self, row: usize) -> (f32, f32) {
        let height = self.height as f32;
        (((row as f32 - 0.5) / height).max(0.0), ((row as f32 + 0.5) / height).min(1.0))
    }

    /// Texels at a cell's corners: top left, top right, bottom left, bottom right.
    #[inline]
    fn corners(&self, column: usize, row: usize) -> [[f32; 4]; 4] {
        let right = if column + 1 == self.width { 0 } else { column + 1 };
        let top = row.saturating_sub(1) * self.width;
        let bottom = row.min(self.height - 1) * self.width;
        [
            self.texels[top + column],
            self.texels[top + right],
            self.texels[bottom + column],
            self.texels[bottom + right],
        ]
    }

    #[inline]
    fn seen(&self, corners: &[[f32; 4]; 4], x: f32, y: f32, row: usize, sine: f32) -> FromSky {
        let [a, b, c, d] = corners;
        let blend = |k: usize| {
            let upper = a[k] + x * (b[k] - a[k]);
            let lower = c[k] + x * (d[k] - c[k]);
            upper + y * (lower - upper)
        };
        let density = if self.power > 0.0 { blend(3) * self.density[row] / sine.max(1e-7) } else { 0.0 };
        FromSky { radiance: Vec3::new(blend(0), blend(1), blend(2)), density }
    }

    fn look(&self, direction: Vec3) -> FromSky {
        let d = self.map_from_world * direction;
        let sine = (d.x * d.x + d.y * d.y).sqrt();
        let phi = if sine > 0.0 { d.y.atan2(d.x) } else { 0.0 };
        let (u, v) = (phi / (2.0 * PI) + 0.5, sine.atan2(d.z) / PI);
        let (x, y) = (u * self.width as f32 - 0.5, v * self.height as f32 + 0.5);
        let column = x.floor();
        let row = (y as usize).min(self.height);
        let index = if column < 0.0 { self.width - 1 } else { (column as usize).min(self.width - 1) };
        self.seen(&self.corners(index, row), x - column, y - y.floor(), row, sine)
    }

    fn draw(&self, numbers: [f32; 2]) -> (Vec3, FromSky) {
        let (row, rest_y) = find(&self.rows, numbers[1]);
        let list = row * (self.width + 1);
        let (column, rest_x) = find(&self.columns[list..=list + self.width], numbers[0]);
        let corners = self.corners(column, row);
        let [a, b, c, d] = corners.map(|t| t[3]);
        let y = along(rest_y, a + b, c + d);
        let x = along(rest_x, a + y * (c - a), b + y * (d - b));
        let (top, bottom) = self.span(row);
        let (sine, cosine) = (PI * (top + y * (bottom - top))).sin_cos();
        let turn = 2.0 * PI * ((column as f32 + 0.5 + x) / self.width as f32 - 0.5);
        let (sin_phi, cos_phi) = turn.sin_cos();
        let direction = self.world_from_map * Vec3::new(sine * cos_phi, sine * sin_phi, cosine);
        (direction, self.seen(&corners, x, y, row, sine.abs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::sequence::Sequence;

    /// A rough picture with a texel of a thousand times the rest and a black part.
    fn sky() -> Sky {
        let (width, height) = (24, 12);
        let pixels = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            match (x, y) {
                (17, 3) => [900.0, 1000.0, 800.0],
                (0..6, 5..) => [0.0; 3],
                _ => [1.0 + x as f32 * 0.1, 0.7, 0.2 * y as f32],
            }
        });
        let radiance = RadianceImage::from_pixels(width, height, pixels.collect()).unwrap();
        let turn = Mat3::from_rotation_y(0.4) * Mat3::from_rotation_z(1.0);
        Sky::new(&Environment::Picture { radiance, map_from_world: turn })
    }

    #[test]
    fn drawing_and_looking_agree() {
        let sky = sky();
        for i in 0..4096 {
            let Some((direction, drawn)) = sky.draw(Sequence::new(2, 0, 0, i).pair(0)) else {
                panic!("dark")
            };
            let seen = sky.look(direction);
            assert!((direction.length() - 1.0).abs() < 1e-5);
            // f32 angles: 1e-6 of a turn is 2e-5 of a cell, times a slope of 1000.
            assert!((seen.radiance - drawn.radiance).abs().max_element() < 0.05, "{seen:?} {drawn:?}");
            assert!(
                (seen.density - drawn.density).abs() < 1e-3 * (drawn.density + 1.0),
                "{seen:?} {drawn:?}"
            );
        }
    }

    #[test]
    fn the_density_is_one_over_the_sphere_and_follows_the_light() {
        let sky = sky();
        // Integral of the density by equal-area midpoints; and of radiance, against what drawing gives.
        let (rings, sectors) = (1200u16, 2400u16);
        let (mut density, mut light) = (0.0f64, [0.0f64; 3]);
        let weight = 4.0 * std::f64::consts::PI / (f64::from(rings) * f64::from(sectors));
        for j in 0..rings {
            let z = 1.0 - 2.0 * (f32::from(j) + 0.5) / f32::from(rings);
            let r = (1.0 - z * z).sqrt();
            for i in 0..sectors {
                let (sin, cos) = (2.0 * PI * (f32::from(i) + 0.5) / f32::from(sectors)).sin_cos();
                let seen = sky.look(Vec3::new(r * cos, r * sin, z));
                density += weight * f64::from(seen.density);
                for c in 0..3 {
                    light[c] += weight * f64::from(seen.radiance[c]);
                }
            }
        }
        // Measured 4e-5: the midpoint rule at kinks.
        assert!((density - 1.0).abs() < 2e-4, "{density}");
        assert!((f64::from(sky.power()) / gray(light) - 1.0).abs() < 2e-3, "{} {light:?}", sky.power());
        let mut sum = [0.0f64; 3];
        let count = 1 << 14;
        for i in 0..count {
            let Some((_, drawn)) = sky.draw(Sequence::new(7, 0, 0, i).pair(0)) else { panic!("dark") };
            for c in 0..3 {
                sum[c] += f64::from(drawn.radiance[c] / drawn.density) / f64::from(count);
            }
        }
        for c in 0..3 {
            assert!((sum[c] / light[c] - 1.0).abs() < 2e-3, "{sum:?} {light:?}");
        }
    }

    #[test]
    fn dark_and_broken_skies_draw_nothing() {
        let one = |rgb| {
            let radiance = RadianceImage::filled(3, 2, rgb);
            Sky::new(&Environment::Picture { radiance, map_from_world: Mat3::IDENTITY })
        };
        for rgb in [[0.0; 3], [f32::NAN; 3], [f32::INFINITY; 3], [-1.0; 3]] {
            assert!(one(rgb).draw([0.3, 0.4]).is_none());
            assert_eq!(one(rgb).look(Vec3::X).radiance, Vec3::ZERO);
        }
        assert!(Sky::new(&Environment::Constant([1.0; 3])).draw([0.1; 2]).is_none());
        let even = one([2.0; 3]);
        for direction in [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::NEG_X, Vec3::new(-0.6, -1e-9, 0.8)] {
            assert_eq!(even.look(direction).radiance, Vec3::splat(2.0));
        }
    }
}
