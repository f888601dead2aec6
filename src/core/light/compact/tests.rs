//! Compact lights: flux kept, directions, extents, and how they come and go.
use super::*;
use crate::model::light::CompactLight;
use glam::Vec3;
use std::f32::consts::PI;

/// A sky of `ambient` with uniform discs: direction, radius in degrees, flux.
fn place(count: usize, ambient: f32, discs: &[(Vec3, f32, f32)]) -> RadianceSamples {
    let mut samples = RadianceSamples::default();
    for k in 0..count {
        let z = 1.0 - 2.0 * (k as f32 + 0.5) / count as f32;
        let (s, c) = (2.399_963_3 * k as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let d = Vec3::new(r * c, r * s, z);
        let mut radiance = ambient;
        for &(w, radius_deg, flux) in discs {
            let cosine = radius_deg.to_radians().cos();
            if d.dot(w.normalize()) >= cosine {
                radiance += flux / (2.0 * PI * (1.0 - cosine));
            }
        }
        samples.directions.push([d.x, d.y, d.z, 4.0 * PI / count as f32]);
        samples.radiance.push([radiance, 0.8 * radiance, 0.5 * radiance, 0.0]);
    }
    samples
}

fn found(samples: &RadianceSamples) -> Vec<CompactLight> {
    let mut split = CompactSplit::new();
    split.update(samples, 1.0, 0.0, false);
    let total = crate::light::project_sh::project_sh(samples, 4);
    split.lights(&total, 16).compact.iter().flatten().copied().collect()
}

#[test]
fn lights_are_found_where_they_are_and_as_wide_as_they_are() {
    let (lamp, window) = (Vec3::new(0.5, -0.4, 0.7), Vec3::new(-1.0, 0.3, 0.2));
    let lights = found(&place(40_000, 0.1, &[(lamp, 3.0, 2.0), (window, 15.0, 3.0)]));
    assert_eq!(lights.len(), 2, "{lights:?}");
    for (want, radius_deg, flux) in [(lamp, 3.0f32, 2.0), (window, 15.0, 3.0)] {
        let light = lights.iter().find(|l| Vec3::from(l.to_light_world).angle_between(want) < 0.1).unwrap();
        let off = Vec3::from(light.to_light_world).angle_between(want.normalize()).to_degrees();
        // The lamp's disc holds 27 samples: its own centroid is off by as much.
        assert!(off < 0.25, "{off} degrees");
        assert!((light.flux_rgb[0] / flux - 1.0).abs() < 0.05, "{light:?}");
        // A uniform disc's rms radius is its radius over sqrt 2.
        let extent = light.extent_rad.to_degrees();
        assert!((extent / (radius_deg / 2f32.sqrt()) - 1.0).abs() < 0.1, "{extent} of {radius_deg}");
    }
}

#[test]
fn the_brightest_are_kept_and_the_others_fade_out() {
    let (lamp, window) = (Vec3::new(0.5, -0.4, 0.7), Vec3::new(-1.0, 0.3, 0.2));
    let samples = place(40_000, 0.1, &[(lamp, 3.0, 2.0), (window, 3.0, 3.0)]);
    let total = crate::light::project_sh::project_sh(&samples, 4);
    let mut split = CompactSplit::new();
    split.keep_at_most(1);
    let look = |split: &mut CompactSplit, dt_s: f64| {
        split.update(&samples, 1.0, dt_s, false);
        let lights = split.lights(&total, 16).compact;
        lights.iter().flatten().map(|l| (Vec3::from(l.to_light_world), l.fade)).collect::<Vec<_>>()
    };
    let one = look(&mut split, 0.0);
    assert_eq!(one.len(), 1);
    assert!(one[0].0.angle_between(window) < 0.01, "the brighter of both: {one:?}");
    split.keep_at_most(4);
    for _ in 0..20 {
        look(&mut split, FADE_S);
    }
    assert_eq!(look(&mut split, FADE_S).len(), 2);
    // Half way out after half of the time, and gone after all of it.
    split.keep_at_most(1);
    let fading = look(&mut split, FADE_S / 2.0);
    assert!(fading.len() == 2 && fading.iter().any(|l| (l.1 - 0.5).abs() < 1e-6), "{fading:?}");
    look(&mut split, FADE_S);
    assert_eq!(look(&mut split, FADE_S).len(), 1);
}

#[test]
fn uniform_light_darkness_and_noise_have_no_lights() {
    assert!(found(&place(20_000, 1.0, &[])).is_empty());
    assert!(found(&place(20_000, 0.0, &[])).is_empty());
    assert!(found(&RadianceSamples::default()).is_empty());
    let mut broken = place(20_000, 1.0, &[]);
    broken.radiance.iter_mut().step_by(3).for_each(|r| *r = [f32::NAN; 4]);
    broken.directions.iter_mut().step_by(5).for_each(|d| *d = [f32::INFINITY; 4]);
    // Holes of one third in a uniform sky leave texels of equal radiance: nothing stands out.
    assert!(found(&broken).is_empty());
}

#[test]
fn flux_is_kept_to_rounding() {
    let discs =
        [(Vec3::new(0.2, 0.1, 0.9), 4.0, 5.0), (Vec3::X, 12.0, 1.0), (Vec3::new(-1.0, -1.0, 0.4), 8.0, 2.0)];
    let samples = place(30_000, 0.2, &discs);
    let total = crate::light::project_sh::project_sh(&samples, 4);
    for maps in [0, 1, 2, 3, 8, 64] {
        let mut split = CompactSplit::new();
        split.update(&samples, 1.0, 0.0, false);
        let lights = split.lights(&total, maps);
        assert!(lights.hard.as_slice().len() <= maps);
        for c in 0..3 {
            let hard: f32 = lights.compact.iter().flatten().map(|l| l.flux_rgb[c]).sum();
            let soft = lights.global.rgb[0][c] * (4.0 * PI).sqrt();
            let whole = total.rgb[0][c] * (4.0 * PI).sqrt();
            assert!(((hard + soft) / whole - 1.0).abs() < 1e-6, "{maps} maps: {hard} + {soft} of {whole}");
            // What the hard lights shed on a plane facing the sky: never more than the flux behind them.
            let shed: f32 = lights.hard.as_slice().iter().map(|h| h.irradiance_rgb[c]).sum();
            assert!(shed <= hard * (1.0 + 1e-6) && shed >= 0.9 * hard, "{shed} of {hard}");
        }
        assert!(lights.global.rgb[0].iter().all(|c| *c > 0.0));
    }
}

#[test]
fn a_still_light_stays_still_and_near_equals_do_not_change_places() {
    // Five lights of nearly the same flux with 5 % of noise on each texel, 30 frames a second for 20 seconds.
    let at = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z];
    let clean = place(6000, 0.1, &at.map(|d| (d + Vec3::new(0.1, 0.2, 0.15), 7.0, 1.0)));
    let total = crate::light::project_sh::project_sh(&clean, 4);
    let mut split = CompactSplit::new();
    let mut dice = crate::math::dice::Dice::new(1);
    let mut random = || dice.unit_f32() - 0.5;
    let (mut changes, mut last) = (0, None);
    let (mut sums, mut squares, mut count) = ([Vec3::ZERO; 4], [0.0f64; 4], 0.0);
    for frame in 0..600 {
        let mut noisy = clean.clone();
        for r in &mut noisy.radiance {
            let gain = 1.0 + 0.17 * random(); // Standard deviation 0.05.
            r.iter_mut().take(3).for_each(|c| *c *= gain);
        }
        split.update(&noisy, if frame == 0 { 1.0 } else { 0.1 }, 1.0 / 30.0, false);
        let lights = split.lights(&total, 8);
        let ids = lights.compact.map(|l| l.map(|l| l.id));
        assert!(ids.iter().all(Option::is_some));
        changes += usize::from(last.is_some_and(|l| l != ids));
        last = Some(ids);
        if frame >= 100 {
            count += 1.0;
            for (k, light) in lights.compact.iter().flatten().enumerate() {
                let d = Vec3::from(light.to_light_world);
                sums[k] += d;
                let mean = sums[k].normalize();
                squares[k] += f64::from(d.angle_between(mean).to_degrees()).powi(2);
            }
        }
    }
    assert!(changes <= 2, "{changes} changes in 20 s");
    for s in squares {
        let rms = (s / count).sqrt();
        assert!(rms < 0.1, "jitter {rms} degrees");
    }
}

#[test]
fn a_light_that_comes_or_goes_does_so_gradually() {
    let dark = place(6000, 0.3, &[]);
    let lit = place(6000, 0.3, &[(Vec3::new(0.3, 0.0, 1.0), 6.0, 3.0)]);
    let total = crate::light::project_sh::project_sh(&lit, 4);
    let mut split = CompactSplit::new();
    split.update(&dark, 1.0, 0.0, false);
    let mut shed = Vec::new();
    for frame in 0..60 {
        split.update(if frame < 30 { &lit } else { &dark }, 0.5, 1.0 / 30.0, false);
        shed.push(split.lights(&total, 1).hard.as_slice().iter().map(|h| h.irradiance_rgb[0]).sum::<f32>());
    }
    assert!(shed[0] < 0.7 && shed[29] > 2.7 && shed[59] == 0.0, "{shed:?}");
    assert!(shed[..29].windows(2).all(|w| (w[1] - w[0]).abs() < 0.75), "{shed:?}");
}

#[test]
fn below_the_horizon_nothing_is_looked_for() {
    let samples = place(20_000, 0.1, &[(Vec3::new(0.1, 0.2, -0.9), 5.0, 4.0)]);
    let total = crate::light::project_sh::project_sh(&samples, 4);
    for (above, lights) in [(true, 0), (false, 1)] {
        let mut split = CompactSplit::new();
        split.update(&samples, 1.0, 0.0, above);
        assert_eq!(split.lights(&total, 4).hard.as_slice().len().min(1), lights);
    }
}
