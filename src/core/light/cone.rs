//! How sure the dominant direction of one picture is, where there is no second picture to compare with.

use super::split::{SplitOptions, dominant};
use crate::model::{
    image::{FILLED, LOWER_BOUND, NOT_FINITE},
    light::{RadianceSamples, RadianceSh},
};
use glam::DVec3;
use std::f64::consts::PI;

/// Half angle, in radians, of a cone about the dominant direction of `total` (the projection of `samples`) that should
/// hold the true direction 19 times of 20; pi where there is no direction.
///
/// It is a bound from what was not measured, not a statistic: samples that were filled or replaced may be wrong by as
/// much as they hold; samples that are saturated may be brighter without bound, which turns the direction at most to
/// theirs; and the light sits somewhere in its texels. Noise of the picture is not in it (see `follow` for that).
pub fn cone_of_samples(samples: &RadianceSamples, total: &RadianceSh, options: &SplitOptions) -> f64 {
    let found = dominant(total.rows(), options.gray_weights, options.least_anisotropy);
    let Some(direction) = found.direction.map(|d| DVec3::from(d.map(f64::from))) else { return PI };
    let mut moment = DVec3::ZERO;
    let mut saturated = DVec3::ZERO;
    let (mut flux, mut guessed_flux, mut flux_texels) = (0.0, 0.0, 0.0);
    for (d, c) in samples.directions.iter().zip(&samples.radiance) {
        let omega = f64::from(d[3]);
        let gray: f64 = (0..3).map(|k| f64::from(c[k]) * f64::from(options.gray_weights[k])).sum();
        let to_light = DVec3::new(f64::from(d[0]), f64::from(d[1]), f64::from(d[2]));
        let bits = c[3] as u8;
        flux += gray * omega;
        flux_texels += gray * omega * omega;
        moment += to_light * (gray * omega);
        if bits & (FILLED | NOT_FINITE) != 0 {
            guessed_flux += gray * omega;
        } else if bits & LOWER_BOUND != 0 {
            saturated += to_light * (gray * omega);
        }
    }
    let length = moment.length();
    if !(guessed_flux < length && length.is_finite()) {
        return PI;
    }
    let texel = if flux > 0.0 { (flux_texels / flux / PI).max(0.0).sqrt() } else { 0.0 };
    let towards_saturated =
        if saturated.length_squared() > 0.0 { direction.angle_between(saturated) } else { 0.0 };
    (texel + (guessed_flux / length).asin() + towards_saturated).min(PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::project_sh::project_sh;

    fn cone(entries: &[([f32; 3], f32, f32, u8)]) -> f64 {
        let mut samples = RadianceSamples::default();
        for (d, omega, light, bits) in entries {
            samples.directions.push([d[0], d[1], d[2], *omega]);
            samples.radiance.push([*light, *light, *light, f32::from(*bits)]);
        }
        cone_of_samples(&samples, &project_sh(&samples, 3), &SplitOptions::default())
    }

    #[test]
    fn a_clean_light_is_as_sure_as_its_texel_is_small() {
        let sure = cone(&[([0.0, 0.0, 1.0], 0.01, 50.0, 0)]);
        // A cap of 0.01 sr has a radius of 0.0564 rad.
        assert!((sure - 0.05642).abs() < 1e-5, "{sure}");
    }

    #[test]
    fn what_was_guessed_opens_the_cone() {
        let up = ([0.0, 0.0, 1.0], 1e-6, 1e6, 0);
        let side = |light, bits| ([1.0, 0.0, 0.0], 1e-6, light, bits);
        let clean = cone(&[up, side(1e5, 0)]);
        let filled = cone(&[up, side(1e5, FILLED)]);
        assert!(clean < 1e-3 && (0.09..0.11).contains(&filled), "{clean} {filled}");
        // Without the guess the light would come from the other side.
        assert_eq!(cone(&[up, ([0.0, 0.0, -1.0], 1e-6, 3e6, FILLED)]), PI);
        // A saturated light can at most pull the direction to itself.
        let saturated = cone(&[up, side(1e6, LOWER_BOUND)]);
        assert!((saturated - PI / 4.0).abs() < 1e-3, "{saturated}");
    }

    #[test]
    fn no_direction_no_cone() {
        assert_eq!(cone(&[]), PI);
        assert_eq!(cone(&[([0.0, 0.0, 1.0], 1.0, 1.0, 0), ([0.0, 0.0, -1.0], 1.0, 1.0, 0)]), PI);
    }
}
