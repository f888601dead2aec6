//! Light for programs that shade with directional lights and three bands of SH: how much of what is compact is worth a
//! light of its own there.
//!
//! Such a program's irradiance is that of three bands plus, for each directional light, E max(0, n.w). The bands lose the
//! light's own bands from 4 on; the directional light brings them back. So lights are taken from the picture (compact ones,
//! with their extent), and each is given the share of its flux, 0 to 1, that leaves the least square error of irradiance. A
//! share of 0 is three bands alone: no light makes it worse, and an overcast sky gets none.

use super::compact::CompactSplit;
use crate::math::spiral;
use crate::model::light::{DirectionalLight, RadianceSamples, RadianceSh, SplitLight};
use glam::{DVec3, Vec3};

/// Normals at which irradiance is compared.
const NORMALS: usize = 192;
/// Lights with less than this share of their flux are left to the bands.
const LEAST_SHARE: f64 = 0.02;

/// Up to `most` compact lights of a picture (weighted directions, world frame), the brightest first, each with the irradiance
/// that it should have beside three bands of SH of the rest.
pub fn compact_lights(samples: &RadianceSamples, most: usize) -> Vec<DirectionalLight> {
    let mut compact = CompactSplit::new();
    compact.keep_at_most(most);
    compact.update(samples, 1.0, 0.0, false);
    let lights = compact.lights(&RadianceSh::zero(1), most);
    let mut found: Vec<(DVec3, [f64; 3])> = lights
        .compact
        .iter()
        .flatten()
        .map(|light| {
            // The mean of unit vectors is shorter than 1 by half of their mean square angle.
            let facing = 1.0 - 0.5 * light.extent_rad * light.extent_rad;
            let to_light = Vec3::from(light.to_light_world).as_dvec3();
            (to_light, light.flux_rgb.map(|c| f64::from((c * facing * light.fade).max(0.0))))
        })
        .collect();
    found.sort_by(|(_, a), (_, b)| b.iter().sum::<f64>().total_cmp(&a.iter().sum()));
    if found.is_empty() {
        return Vec::new();
    }
    let normals: Vec<DVec3> = (0..NORMALS).map(|j| spiral::direction(j, NORMALS)).collect();
    let mut missing: Vec<[f64; 3]> =
        normals.iter().map(|normal| beyond_three_bands(samples, *normal)).collect();
    let mut out = Vec::new();
    for (to_light, irradiance) in found.into_iter().take(most) {
        let brought: Vec<f64> = normals.iter().map(|normal| kernel(normal.dot(to_light))).collect();
        let (mut wanted, mut own) = (0.0, 0.0);
        for (missing, brought) in missing.iter().zip(&brought) {
            for c in 0..3 {
                let of_light = irradiance[c] * brought;
                wanted += missing[c] * of_light;
                own += of_light * of_light;
            }
        }
        let share = if own > 0.0 { (wanted / own).clamp(0.0, 1.0) } else { 0.0 };
        if !(share >= LEAST_SHARE) {
            continue;
        }
        for (missing, brought) in missing.iter_mut().zip(&brought) {
            for c in 0..3 {
                missing[c] -= share * irradiance[c] * brought;
            }
        }
        out.push(DirectionalLight {
            to_light_world: to_light.as_vec3().to_array(),
            irradiance_rgb: irradiance.map(|e| (share * e) as f32),
            fade: share as f32,
        });
    }
    out
}

/// Light without its directional parts: total less E y(w) of each.
pub fn without(total: &RadianceSh, lights: &[DirectionalLight]) -> RadianceSh {
    let mut rest = *total;
    for light in lights {
        let mut y = [0.0f32; crate::math::sh::MAX_COEFFICIENTS];
        crate::math::sh::basis::evaluate(total.order, light.to_light_world, &mut y);
        for (row, y) in rest.rgb.iter_mut().zip(y).take(total.order * total.order) {
            for (c, e) in row.iter_mut().zip(light.irradiance_rgb) {
                *c -= e * y;
            }
        }
    }
    rest
}

/// The light in halves, as programs with one directional light take it.
pub fn split_of(total: &RadianceSh, lights: &[DirectionalLight]) -> SplitLight {
    let main = lights.first().copied();
    SplitLight { direct: main, global: without(total, main.as_slice()) }
}

/// Irradiance on a normal less that of bands 0 to 2.
fn beyond_three_bands(samples: &RadianceSamples, normal: DVec3) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (d, radiance) in samples.directions.iter().zip(&samples.radiance) {
        let cosine = normal.dot(DVec3::new(f64::from(d[0]), f64::from(d[1]), f64::from(d[2])));
        let weight = f64::from(d[3]) * kernel(cosine);
        for (sum, l) in sum.iter_mut().zip(radiance) {
            *sum += weight * f64::from(*l);
        }
    }
    sum
}

/// max(0, x) less its bands 0 to 2.
fn kernel(x: f64) -> f64 {
    x.max(0.0) - (0.25 + 0.5 * x + 5.0 / 32.0 * (3.0 * x * x - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::project_sh::project_sh;
    use crate::math::dice::Dice;

    /// A sky of blobs: `(towards, width in radians, radiance)` over an even light.
    fn sky(even: f32, blobs: &[(Vec3, f32, f32)]) -> RadianceSamples {
        let mut samples = RadianceSamples::default();
        let count = 20_000;
        for j in 0..count {
            let at = spiral::direction(j, count).as_vec3();
            let of = |(to, width, bright): &(Vec3, f32, f32)| {
                bright * (-(at.angle_between(*to) / width).powi(2)).exp()
            };
            let l = even + blobs.iter().map(of).sum::<f32>();
            samples.directions.push(at.extend(4.0 * std::f32::consts::PI / count as f32).to_array());
            samples.radiance.push([l, 0.8 * l, 0.6 * l, 0.0]);
        }
        samples
    }

    /// RMSE of irradiance over its mean, of three bands and lights, and of three bands alone.
    fn errors(samples: &RadianceSamples, most: usize) -> [f64; 2] {
        let lights = compact_lights(samples, most);
        let (mut ours, mut bands, mut mean) = (0.0, 0.0, 0.0);
        for j in 0..500 {
            let normal = spiral::direction(j, 500);
            let missing = beyond_three_bands(samples, normal);
            let of =
                |light: &DirectionalLight| kernel(normal.dot(Vec3::from(light.to_light_world).as_dvec3()));
            for c in 0..3 {
                let brought: f64 =
                    lights.iter().map(|light| f64::from(light.irradiance_rgb[c]) * of(light)).sum();
                ours += (missing[c] - brought).powi(2);
                bands += missing[c].powi(2);
            }
            let whole: f64 = samples
                .directions
                .iter()
                .zip(&samples.radiance)
                .step_by(16)
                .map(|(d, l)| {
                    normal.dot(Vec3::new(d[0], d[1], d[2]).as_dvec3()).max(0.0) * f64::from(d[3] * l[0])
                })
                .sum();
            mean += 16.0 * whole / 500.0;
        }
        [ours, bands].map(|sum| (sum / 1500.0).sqrt() / mean)
    }

    #[test]
    fn skies_with_a_sun_are_better_and_no_sky_is_worse() {
        for seed in 0..12 {
            let mut dice = Dice::new(seed);
            let mut to =
                || Vec3::new(dice.normal() as f32, dice.normal() as f32, dice.normal() as f32).normalize();
            let (sun, lamp, cloud) = (to(), to(), to());
            let width = 0.02 + 0.02 * seed as f32;
            let [ours, bands] = errors(&sky(0.2, &[(sun, width, 300.0), (cloud, 0.8, 1.5)]), 4);
            assert!(ours < 0.5 * bands, "sun {seed}: {ours} {bands}");
            let [ours, bands] = errors(&sky(0.1, &[(sun, 0.2, 10.0), (lamp, 0.1, 30.0)]), 1);
            assert!(ours < bands, "one of two lamps {seed}: {ours} {bands}");
            let [ours, bands] = errors(&sky(0.3, &[(cloud, 1.2, 1.0)]), 4);
            assert!(ours <= bands * (1.0 + 1e-9) && bands < 0.02, "overcast {seed}: {ours} {bands}");
        }
    }

    #[test]
    fn light_and_rest_are_the_total() {
        let samples = sky(0.2, &[(Vec3::new(0.6, 0.0, 0.8), 0.05, 100.0)]);
        let total = project_sh(&samples, 4);
        let split = split_of(&total, &compact_lights(&samples, 4));
        let light = split.direct.unwrap();
        assert!(Vec3::from(light.to_light_world).angle_between(Vec3::new(0.6, 0.0, 0.8)) < 0.02);
        let mut back = RadianceSh { rgb: split.global.rgb, ..total };
        let minus = DirectionalLight { irradiance_rgb: light.irradiance_rgb.map(|e| -e), ..light };
        back = without(&back, &[minus]);
        for (a, b) in back.rows().iter().flatten().zip(total.rows().iter().flatten()) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        assert!(compact_lights(&sky(1.0, &[]), 4).is_empty(), "even light has no lamp");
    }
}
