//! A picture of the environment that follows it over time: texels of a cube fixed in the world, each with its flux,
//! where in the texel that comes from, and how much of the texel has been seen.

use crate::math::{color, sphere};
use crate::model::light::RadianceSamples;
use glam::Vec3;
use std::f32::consts::PI;

/// Fewest and most texels a side of a face: 5.6 and 1.4 degrees wide in the mean.
const SIDES: (usize, usize) = (16, 64);

/// What is known of a texel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct GridTexel {
    /// Integral of radiance over the part of the texel that was seen.
    flux_rgb: [f32; 3],
    /// Sum of directions, each weighted by luminous flux.
    moment: Vec3,
    /// The part that was seen, steradians.
    solid_angle_sr: f32,
}

/// A texel, ready to look at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Unit vector to the centroid of its flux, world frame.
    pub direction: Vec3,
    /// Mean radiance of what was seen of it.
    pub radiance_rgb: [f32; 3],
    /// How much was seen of it, steradians.
    pub solid_angle_sr: f32,
}

/// The picture, and memory for the newest one.
#[derive(Clone, Debug, Default)]
pub struct LightGrid {
    side: usize,
    cells: Vec<GridTexel>,
    newest: Vec<GridTexel>,
}

impl LightGrid {
    /// Lets new samples in with weight `alpha`, within (0, 1]; the first ones with 1. The number of texels follows the
    /// first samples' number. Samples that are not finite or have no solid angle are passed over.
    ///
    /// Every quantity is a sum that is linear in the samples, and so is what the filter makes of it: a light that
    /// moves across the border of two texels goes over smoothly.
    pub fn blend(&mut self, samples: &RadianceSamples, alpha: f32) {
        let count = samples.directions.len().min(samples.radiance.len());
        if self.cells.is_empty() || alpha >= 1.0 {
            self.side = ((count as f32 / 6.0).sqrt() as usize).clamp(SIDES.0, SIDES.1);
            self.cells.clear();
            self.cells.resize(6 * self.side * self.side, GridTexel::default());
        }
        self.newest.clear();
        self.newest.resize(self.cells.len(), GridTexel::default());
        for (d, r) in samples.directions.iter().zip(&samples.radiance) {
            let direction = Vec3::new(d[0], d[1], d[2]);
            let flux_rgb = [r[0] * d[3], r[1] * d[3], r[2] * d[3]];
            let sound = direction.is_finite() && d[3] > 0.0 && flux_rgb.iter().all(|c| c.is_finite());
            if !sound {
                continue;
            }
            let cell = &mut self.newest[index_of(direction, self.side)];
            for (sum, c) in cell.flux_rgb.iter_mut().zip(flux_rgb) {
                *sum += c.max(0.0);
            }
            cell.moment += direction * color::luminance(flux_rgb).max(0.0);
            cell.solid_angle_sr += d[3];
        }
        let seen_before = self.cells.iter().any(|c| c.solid_angle_sr > 0.0);
        let alpha = if seen_before { alpha.clamp(0.0, 1.0) } else { 1.0 };
        for (cell, new) in self.cells.iter_mut().zip(&self.newest) {
            for (c, n) in cell.flux_rgb.iter_mut().zip(new.flux_rgb) {
                *c += alpha * (n - *c);
            }
            cell.moment += alpha * (new.moment - cell.moment);
            cell.solid_angle_sr += alpha * (new.solid_angle_sr - cell.solid_angle_sr);
        }
    }

    /// The texels of which something was seen, in a fixed order, into `out` (memory is kept).
    pub fn texels(&self, out: &mut Vec<Texel>) {
        out.clear();
        let least = 1e-6 * self.texel_sr();
        for (index, cell) in self.cells.iter().enumerate() {
            if cell.solid_angle_sr > least {
                out.push(Texel {
                    direction: cell.moment.try_normalize().unwrap_or_else(|| centre_of(index, self.side)),
                    radiance_rgb: cell.flux_rgb.map(|c| c / cell.solid_angle_sr),
                    solid_angle_sr: cell.solid_angle_sr,
                });
            }
        }
    }

    /// Solid angle of a texel in the mean, steradians.
    pub fn texel_sr(&self) -> f32 {
        4.0 * PI / self.cells.len().max(1) as f32
    }
}

impl LightGrid {
    /// What remains of each texel of which something was seen when light is taken out of it: `taken` says where (unit
    /// vectors) and how much flux. As weighted directions (texel centres), flags 0; `out` keeps its memory.
    pub fn left_over(&self, taken: impl Iterator<Item = (Vec3, [f32; 3])>, out: &mut RadianceSamples) {
        out.directions.clear();
        out.radiance.clear();
        for (index, cell) in self.cells.iter().enumerate() {
            let [r, g, b] = cell.flux_rgb;
            out.directions.push(centre_of(index, self.side).extend(cell.solid_angle_sr).to_array());
            out.radiance.push([r, g, b, 0.0]);
        }
        for (at, flux_rgb) in taken {
            if let Some(left) = out.radiance.get_mut(index_of(at, self.side)) {
                left.iter_mut().zip(flux_rgb).for_each(|(c, taken)| *c -= taken);
            }
        }
        // Flux to radiance. What is a little below 0 by rounding is 0.
        for (left, d) in out.radiance.iter_mut().zip(&out.directions) {
            *left = left.map(|c| if d[3] > 0.0 { (c / d[3]).max(0.0) } else { 0.0 });
        }
    }
}

fn index_of(direction: Vec3, side: usize) -> usize {
    let (face, u, v) = sphere::cube_face_uv(direction.as_dvec3());
    let place = |x: f64| (((0.5 * (x + 1.0)) * side as f64) as usize).min(side - 1);
    (face * side + place(v)) * side + place(u)
}

fn centre_of(index: usize, side: usize) -> Vec3 {
    let (face, row, column) = (index / (side * side), index / side % side, index % side);
    let place = |k: usize| 2.0 * (k as f64 + 0.5) / side as f64 - 1.0;
    sphere::cube_direction(face, place(column), place(row)).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_where_they_say_and_keep_what_they_get() {
        for side in [16, 33, 64] {
            for index in (0..6 * side * side).step_by(7) {
                assert_eq!(index_of(centre_of(index, side), side), index);
            }
        }
        let mut samples = RadianceSamples::default();
        for k in 0..5000 {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / 5000.0;
            let (s, c) = (2.4 * k as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            samples.directions.push([r * c, r * s, z, 4.0 * PI / 5000.0]);
            samples.radiance.push([1.0 + z, 0.5, if k == 77 { f32::NAN } else { 2.0 }, 0.0]);
        }
        let mut grid = LightGrid::default();
        grid.blend(&samples, 0.3);
        let mut texels = Vec::new();
        grid.texels(&mut texels);
        let flux = |c: usize| texels.iter().map(|t| t.radiance_rgb[c] * t.solid_angle_sr).sum::<f32>();
        assert!((flux(1) - 0.5 * 4.0 * PI).abs() < 0.002 * PI, "all but one sample: {}", flux(1));
        assert!((flux(0) - 4.0 * PI).abs() < 0.01, "{}", flux(0));
        // The same again changes nothing but rounding; darkness takes alpha of it away.
        grid.blend(&samples, 0.25);
        samples.radiance.iter_mut().for_each(|r| *r = [0.0; 4]);
        grid.blend(&samples, 0.25);
        let mut later = Vec::new();
        grid.texels(&mut later);
        let kept = later.iter().map(|t| t.radiance_rgb[1] * t.solid_angle_sr).sum::<f32>();
        assert!((kept / flux(1) - 0.75).abs() < 1e-4, "{kept}");
    }
}
