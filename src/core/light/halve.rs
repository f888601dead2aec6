//! Measured light to the light that is shaded with: by any of the splits, over time.

use super::compact::CompactSplit;
use super::dering::dering;
use super::split::{SplitOptions, split};
use crate::model::{
    light::{Lights, MAX_HARD_LIGHTS, RadianceSamples, RadianceSh},
    quality::SplitKind,
};

/// How light is halved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalveOptions {
    /// By which split.
    pub kind: SplitKind,
    /// Compact lights at most, 1 to 4.
    pub lights: usize,
    /// Hard lights at most, 1 to 64.
    pub shadow_maps: usize,
    /// Of the splits by net flux.
    pub net_flux: SplitOptions,
    /// Whether compact lights are looked for at z > 0 only: where everything stands on a surface.
    pub above_horizon: bool,
    /// Whether the soft half is damped where it would shine negatively on a surface.
    pub dering: bool,
}

/// Halves light, and follows compact lights over time.
#[derive(Clone, Debug)]
pub struct Halver {
    options: HalveOptions,
    compact: CompactSplit,
    has_picture: bool,
}

impl Halver {
    /// Nothing seen yet.
    pub fn new(options: HalveOptions) -> Self {
        let mut compact = CompactSplit::new();
        compact.keep_at_most(options.lights);
        Self { options, compact, has_picture: false }
    }

    /// Goes on with other options: lights that were found stay followed.
    pub fn retune(&mut self, options: HalveOptions) {
        self.compact.keep_at_most(options.lights);
        self.options = options;
    }

    /// Takes in the picture of the environment, if the split needs it: weighted directions (world frame), with weight
    /// `alpha` against those before, `dt_s` after them.
    pub fn see(&mut self, samples: &RadianceSamples, alpha: f64, dt_s: f64) {
        if self.options.kind == SplitKind::Compact && !samples.directions.is_empty() {
            self.compact.update(samples, alpha, dt_s, self.options.above_horizon);
            self.has_picture = true;
        }
    }

    /// Halves `total`, the light in SH, filtered as the pictures were. Both halves together are `total`, but for what
    /// de-ringing takes of the soft half's contrast (never of its flux, band 0). The compact split of light of which no
    /// picture was seen is the bounded one.
    pub fn halve(&mut self, total: &RadianceSh) -> Lights {
        let by_net_flux = |bounded| split(total, &SplitOptions { bounded, ..self.options.net_flux }).into();
        // Near lights alone may have more.
        let maps = self.options.shadow_maps.min(MAX_HARD_LIGHTS);
        let mut lights: Lights = match self.options.kind {
            SplitKind::Compact if self.has_picture => self.compact.lights(total, maps),
            SplitKind::Compact | SplitKind::Bounded => by_net_flux(true),
            SplitKind::Paper => by_net_flux(false),
            SplitKind::Sh => Lights::soft(*total),
        };
        if self.options.dering {
            dering(&mut lights.global);
        }
        lights
    }
}

impl Halver {
    /// The picture of the environment without what the hard lights of the last call of `halve` stand for, as weighted
    /// directions; `false` (and nothing is written) where these do not stand for parts of a picture.
    pub fn left_over(&self, out: &mut RadianceSamples) -> bool {
        let by_picture = self.options.kind == SplitKind::Compact && self.has_picture;
        if by_picture {
            self.compact.left_over(out);
        }
        by_picture
    }
}

/// Halves the light of one picture.
pub fn halve_still(samples: &RadianceSamples, total: &RadianceSh, options: HalveOptions) -> Lights {
    halve_still_with_rest(samples, total, options).0
}

/// As [`halve_still`], with what [`Halver::left_over`] gives, where it gives anything.
pub fn halve_still_with_rest(
    samples: &RadianceSamples,
    total: &RadianceSh,
    options: HalveOptions,
) -> (Lights, Option<RadianceSamples>) {
    let mut halver = Halver::new(options);
    halver.see(samples, 1.0, 0.0);
    let lights = halver.halve(total);
    let mut left = RadianceSamples::default();
    let has_rest = halver.left_over(&mut left);
    (lights, has_rest.then_some(left))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::project_sh::project_sh;
    use glam::Vec3;
    use std::f32::consts::PI;

    /// A lamp of 3 degrees in a dim place.
    fn lamp(to_light: Vec3) -> RadianceSamples {
        let mut samples = RadianceSamples::default();
        for k in 0..20_000 {
            let z = 1.0 - (k as f32 + 0.5) / 10_000.0;
            let d = ((1.0 - z * z).sqrt() * crate::math::spiral::turn_f32(k)).extend(z);
            let bright = if d.angle_between(to_light) < 3f32.to_radians() { 300.0 } else { 0.1 };
            samples.directions.push([d.x, d.y, d.z, 4.0 * PI / 20_000.0]);
            samples.radiance.push([bright; 4]);
        }
        samples
    }

    fn options(kind: SplitKind) -> HalveOptions {
        HalveOptions {
            kind,
            lights: 4,
            shadow_maps: 4,
            net_flux: SplitOptions::default(),
            above_horizon: false,
            dering: false,
        }
    }

    #[test]
    fn every_split_keeps_the_flux_and_finds_the_lamp() {
        let to_light = Vec3::new(0.3, -0.5, 0.8).normalize();
        let samples = lamp(to_light);
        let total = project_sh(&samples, 4);
        for kind in [SplitKind::Compact, SplitKind::Paper, SplitKind::Bounded, SplitKind::Sh] {
            let lights = halve_still(&samples, &total, options(kind));
            if kind == SplitKind::Sh {
                assert!(lights.hard.as_slice().is_empty() && lights.global == total);
                continue;
            }
            let hard: f32 = lights.hard.as_slice().iter().map(|h| h.irradiance_rgb[0]).sum();
            let whole = total.rgb[0][0] * (4.0 * PI).sqrt();
            let soft = lights.global.rgb[0][0] * (4.0 * PI).sqrt();
            // What a light of 3 degrees sheds is its flux but for the cosine: a thousandth.
            assert!(((hard + soft) / whole - 1.0).abs() < 1e-3, "{kind:?}: {hard} + {soft} of {whole}");
            assert!(hard > 0.4 * whole, "{kind:?}");
            for h in lights.hard.as_slice() {
                let off = Vec3::from(h.to_light_world).angle_between(to_light).to_degrees();
                assert!(off < 3.0, "{kind:?}: {off} degrees: {h:?}");
            }
        }
    }

    #[test]
    fn only_the_contrast_of_the_soft_half_is_damped() {
        let samples = lamp(Vec3::new(0.3, -0.5, 0.8).normalize());
        let total = project_sh(&samples, 4);
        // What a compact split leaves is smooth: nothing rings, nothing changes.
        let compact = options(SplitKind::Compact);
        let damped = halve_still(&samples, &total, HalveOptions { dering: true, ..compact });
        assert_eq!(damped, halve_still(&samples, &total, compact));
        // The lamp alone, all of it in SH, rings.
        let mut alone = samples;
        alone.radiance.iter_mut().filter(|r| r[0] < 1.0).for_each(|r| *r = [0.0; 4]);
        let total = project_sh(&alone, 4);
        let damped = halve_still(&alone, &total, HalveOptions { dering: true, ..options(SplitKind::Sh) });
        assert_eq!(damped.global.rgb[0], total.rgb[0]);
        for i in 1..4 {
            let kept = damped.global.rgb[i][0] / total.rgb[i][0];
            // 0.863 for a point.
            assert!((0.86..0.87).contains(&kept), "{kept}");
        }
    }

    #[test]
    fn without_a_picture_the_compact_split_is_bounded() {
        let total = project_sh(&lamp(Vec3::Z), 4);
        let mut halver = Halver::new(options(SplitKind::Compact));
        let bounded = halve_still(&RadianceSamples::default(), &total, options(SplitKind::Bounded));
        assert_eq!(halver.halve(&total), bounded);
        halver.see(&RadianceSamples::default(), 1.0, 0.0);
        assert_eq!(halver.halve(&total), bounded);
    }
}
