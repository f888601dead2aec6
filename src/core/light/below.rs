//! Light from below the horizon, for things that stand on a surface: an environment picture, or light that is stated, may
//! hold what is not there.

use crate::math::{octahedral, spiral};
use crate::model::{environment::EnvironmentPicture, light::RadianceSamples};
use std::f64::consts::PI;

/// Directions all over the sphere by which a surface's light is added.
const DIRECTIONS: usize = 4096;

/// What comes from below the horizon (z < 0).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum BelowHorizon {
    /// What was measured or stated.
    #[default]
    AsGiven,
    /// No light.
    Dark,
    /// What a wide matt surface z = 0 sends up with nothing in its way: its albedo / pi times its irradiance from above.
    Surface {
        /// Share of each channel that is thrown back, 0 to 1.
        albedo_rgb: [f32; 3],
    },
}

impl BelowHorizon {
    /// Puts it in place of the light that weighted directions (world frame) hold below the horizon. Returns the radiance
    /// from there where that is one for all directions. What comes from above stays as it is, in its order.
    pub fn put(self, samples: &mut RadianceSamples) -> Option<[f32; 3]> {
        if self == Self::AsGiven {
            return None;
        }
        let above: Vec<bool> = samples.directions.iter().map(|d| !(d[2] < 0.0)).collect();
        let mut keep = above.iter();
        samples.directions.retain(|_| keep.next() == Some(&true));
        let mut keep = above.iter();
        samples.radiance.retain(|_| keep.next() == Some(&true));
        let Self::Surface { albedo_rgb } = self else { return Some([0.0; 3]) };
        let radiance_rgb = radiance_of_surface(albedo_rgb, samples);
        spread(samples, |z| (z < 0.0).then_some(radiance_rgb));
        Some(radiance_rgb)
    }

    /// Gives all texels of a picture that look below the horizon one radiance.
    pub fn put_picture(radiance_rgb: [f32; 3], picture: &mut EnvironmentPicture) {
        let side = picture.all.side();
        for (i, texel) in picture.all.texels_mut().iter_mut().enumerate() {
            if octahedral::direction(octahedral::centre(i % side, i / side, side)).z < 0.0 {
                *texel = radiance_rgb;
            }
        }
    }
}

/// Radiance of a matt surface z = 0 under weighted directions: albedo / pi times the irradiance.
fn radiance_of_surface(albedo_rgb: [f32; 3], samples: &RadianceSamples) -> [f32; 3] {
    let mut sum = [0.0f64; 3];
    for (d, r) in samples.directions.iter().zip(&samples.radiance) {
        for (sum, c) in sum.iter_mut().zip(r) {
            *sum += f64::from(*c) * f64::from(d[2].max(0.0)) * f64::from(d[3]);
        }
    }
    std::array::from_fn(|c| (f64::from(albedo_rgb[c]) / PI * sum[c]) as f32)
}

/// Adds radiance from directions all over the sphere, as a function of their height; `None` adds nothing there.
pub fn spread(samples: &mut RadianceSamples, radiance_rgb: impl Fn(f64) -> Option<[f32; 3]>) {
    for j in 0..DIRECTIONS {
        let direction = spiral::direction(j, DIRECTIONS);
        let weight_sr = 4.0 * PI / DIRECTIONS as f64;
        if let Some([red, green, blue]) = radiance_rgb(direction.z) {
            samples.directions.push(direction.extend(weight_sr).as_vec4().to_array());
            samples.radiance.push([red, green, blue, 0.0]);
        }
    }
}

/// The same radiance from everywhere as weighted directions: rings of equal solid angle. Midpoints in z integrate the
/// polynomials of SH well.
pub fn uniform(radiance_rgb: [f32; 3], samples: &mut RadianceSamples) {
    let (rings, sectors) = (256, 32);
    let weight_sr = 4.0 * PI / f64::from(rings * sectors);
    let [red, green, blue] = radiance_rgb;
    for j in 0..rings {
        let z = 1.0 - 2.0 * (f64::from(j) + 0.5) / f64::from(rings);
        let r = (1.0 - z * z).sqrt();
        for i in 0..sectors {
            let phi = 2.0 * PI * (f64::from(i) + 0.5) / f64::from(sectors);
            samples.directions.push([r * phi.cos(), r * phi.sin(), z, weight_sr].map(|x| x as f32));
            samples.radiance.push([red, green, blue, 0.0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::project_sh::project_sh;

    /// Irradiance of a surface that faces up or down.
    fn irradiance(samples: &RadianceSamples, up: f32) -> f64 {
        let pairs = samples.directions.iter().zip(&samples.radiance);
        pairs.map(|(d, r)| f64::from(r[0] * (d[2] * up).max(0.0) * d[3])).sum()
    }

    fn sky() -> RadianceSamples {
        let mut samples = RadianceSamples::default();
        uniform([2.0, 1.0, 0.5], &mut samples);
        samples
    }

    #[test]
    fn a_uniform_sky_has_the_irradiance_of_pi_times_its_radiance() {
        let sky = sky();
        assert!((irradiance(&sky, 1.0) / (2.0 * PI) - 1.0).abs() < 1e-4);
        let band0 = project_sh(&sky, 3).rgb[0][1];
        assert!((band0 / (4.0 * std::f32::consts::PI).sqrt() - 1.0).abs() < 1e-5, "{band0}");
    }

    #[test]
    fn below_the_horizon_is_what_was_asked_for() {
        let mut given = sky();
        assert_eq!(BelowHorizon::AsGiven.put(&mut given), None);
        assert_eq!(given, sky());
        let mut dark = sky();
        assert_eq!(BelowHorizon::Dark.put(&mut dark), Some([0.0; 3]));
        assert_eq!(irradiance(&dark, -1.0), 0.0);
        assert_eq!(irradiance(&dark, 1.0), irradiance(&sky(), 1.0));
        // A white surface sends back all that it gets; seen from above it is a second sky.
        let mut white = sky();
        let radiance = BelowHorizon::Surface { albedo_rgb: [1.0, 1.0, 0.0] }.put(&mut white).unwrap();
        assert!((radiance[0] - 2.0).abs() < 1e-3 && radiance[2] == 0.0, "{radiance:?}");
        assert!((irradiance(&white, -1.0) / (2.0 * PI) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn pictures_change_below_the_horizon_alone() {
        let mut picture = EnvironmentPicture::default();
        picture.all.reshape(32);
        picture.all.texels_mut().fill([1.0; 3]);
        BelowHorizon::put_picture([0.25; 3], &mut picture);
        let below = picture.all.texels().iter().filter(|t| **t == [0.25; 3]).count();
        let above = picture.all.texels().iter().filter(|t| **t == [1.0; 3]).count();
        assert_eq!(below + above, 32 * 32);
        assert!((below as i64 - 512).abs() <= 64, "{below}");
    }
}
