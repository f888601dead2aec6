use super::*;
use crate::light::halve::{HalveOptions, Halver};
use crate::light::maps::samples_of_map;
use crate::light::project_sh::project_sh;
use crate::light::split::SplitOptions;
use crate::model::image::Image;
use crate::model::quality::SplitKind;
use std::f32::consts::PI;

/// A smooth place with a bright spot of `radius_deg` at `towards`.
fn place(towards: DVec3, radius_deg: f64, bright: f32) -> EnvironmentMap {
    let mut radiance = Image::filled(256, 128, [0.0f32; 3]);
    for row in 0..128 {
        for column in 0..256 {
            let d = sphere::equirect_direction((column as f64 + 0.5) / 256.0, (row as f64 + 0.5) / 128.0);
            let spot = if d.angle_between(towards).to_degrees() < radius_deg { bright } else { 0.0 };
            *radiance.at_mut(column, row) = [1.0 + 0.5 * d.z as f32 + spot, 0.5, 0.3 + 0.2 * d.x as f32];
        }
    }
    EnvironmentMap { layout: MapLayout::Equirect, radiance }
}

fn flux(map: &OctahedralMap, channel: usize) -> f32 {
    let side = map.side();
    (0..side * side).map(|i| octahedral::texel_sr(i % side, i / side, side) * map.texels()[i][channel]).sum()
}

#[test]
fn samples_and_maps_give_the_same_picture() {
    let map = place(DVec3::new(0.6, -0.48, 0.64), 6.0, 40.0);
    let mut samples = RadianceSamples::default();
    samples_of_map(&map, &mut samples);
    // Every third sample is missing, and one is not a number.
    let mut thin = RadianceSamples::default();
    for (k, (d, r)) in samples.directions.iter().zip(&samples.radiance).enumerate() {
        if k % 3 != 0 {
            thin.directions.push(*d);
            thin.radiance.push(if k == 10_000 { [f32::NAN; 4] } else { *r });
        }
    }
    let (mut a, mut b, mut c) =
        (EnvironmentPicture::default(), EnvironmentPicture::default(), EnvironmentPicture::default());
    let mut work = Prefilter::default();
    work.look_at_map(&map, DMat3::IDENTITY, 128, &mut a);
    work.see(&samples, 1.0, &mut b);
    work.see(&thin, 1.0, &mut c);
    let (mut worst, mut thin_worst) = (0.0f32, 0.0f32);
    for k in 0..3000 {
        let z = 1.0 - 2.0 * (k as f32 + 0.5) / 3000.0;
        let (s, co) = (2.4 * k as f32).sin_cos();
        let d = Vec3::new((1.0 - z * z).sqrt() * co, (1.0 - z * z).sqrt() * s, z);
        let want = [0.5, 0.3 + 0.2 * d.x];
        for (seen, worst) in [(&b, &mut worst), (&c, &mut thin_worst), (&a, &mut 0.0)] {
            let seen = seen.all.look(d);
            assert!(seen.iter().all(|c| c.is_finite() && *c >= 0.0));
            *worst = worst.max((seen[1] - want[0]).abs()).max((seen[2] - want[1]).abs());
        }
    }
    // A texel's sample lies up to half a texel (0.8 degrees) from its centre; holes take a neighbour two texels off.
    assert!(worst < 0.006 && thin_worst < 0.03, "{worst} {thin_worst}");
    for picture in [&a, &b] {
        let truth = 4.0 * PI * 1.0 + 40.0 * 2.0 * PI * (1.0 - 6f32.to_radians().cos());
        assert!((flux(&picture.all, 0) / truth - 1.0).abs() < 0.01, "{} {truth}", flux(&picture.all, 0));
    }
    // What was there before counts with 1 - alpha.
    let before = c.all.look(Vec3::X)[1];
    thin.radiance.iter_mut().for_each(|r| *r = [0.0; 4]);
    work.see(&thin, 0.25, &mut c);
    assert!((c.all.look(Vec3::X)[1] / before - 0.75).abs() < 1e-5);
}

#[test]
fn levels_are_phong_means_of_what_is_there() {
    let towards = DVec3::new(-0.48, 0.6, 0.64);
    let map = place(towards, 4.0, 100.0);
    let mut picture = EnvironmentPicture::default();
    let mut work = Prefilter::default();
    work.look_at_map(&map, DMat3::IDENTITY, 128, &mut picture);
    work.levels(None, &mut picture);
    assert!(picture.holds_hard_lights);
    assert_eq!(picture.glossy.len(), 6, "8 .. 256");
    let spot_sr = 2.0 * std::f64::consts::PI * (1.0 - 4f64.to_radians().cos());
    for level in 0..picture.glossy.len() {
        let s = f64::from(EnvironmentPicture::exponent_of(level));
        // Constant light stays what it is.
        assert!(picture.glossy[level].texels().iter().all(|t| (t[1] - 0.5).abs() < 1e-5), "level {level}");
        for off_deg in [0.0f64, 10.0, 25.0, 60.0] {
            let axis = towards.any_orthonormal_vector();
            let about = glam::DQuat::from_axis_angle(axis, off_deg.to_radians()) * towards;
            let got = f64::from(picture.gloss(s as f32, about.as_vec3())[0]);
            // The lobe over the spot, by its mean over a ring of points of equal area.
            let (side, other) = towards.any_orthonormal_pair();
            let mut lobe = 0.0;
            for k in 0..400 {
                let cosine = 1.0 - (1.0 - 4f64.to_radians().cos()) * (f64::from(k) + 0.5) / 400.0;
                let sine = (1.0 - cosine * cosine).sqrt();
                let (sp, cp) = (2.4 * f64::from(k)).sin_cos();
                lobe +=
                    about.dot(towards * cosine + (side * cp + other * sp) * sine).max(0.0).powf(s) / 400.0;
            }
            let want = 100.0 * spot_sr * lobe * (s + 1.0) / (2.0 * std::f64::consts::PI)
                + 1.0
                + 0.5 * about.z * (s + 1.0) / (s + 2.0);
            // Between texels the peak over a spot that is small for its lobe is cut: by 0.125 at s = 16.
            let size = 100.0 * spot_sr * (s + 1.0) / (2.0 * std::f64::consts::PI);
            assert!((got - want).abs() < 0.01 + 0.14 * size.min(100.0), "s = {s}, {off_deg}: {got} {want}");
        }
    }
}

#[test]
fn the_rest_and_the_hard_lights_are_the_whole() {
    let map = place(DVec3::new(0.3, -0.5, 0.8).normalize(), 5.0, 200.0);
    let mut samples = RadianceSamples::default();
    samples_of_map(&map, &mut samples);
    let total = project_sh(&samples, 4);
    let options = HalveOptions {
        dering: false,
        kind: SplitKind::Compact,
        lights: 4,
        shadow_maps: 8,
        net_flux: SplitOptions::default(),
        above_horizon: false,
    };
    let mut halver = Halver::new(options);
    let mut left = RadianceSamples::default();
    assert!(!halver.left_over(&mut left));
    halver.see(&samples, 1.0, 0.0);
    let lights = halver.halve(&total);
    assert!(halver.left_over(&mut left));
    let (mut picture, mut work) = (EnvironmentPicture::default(), Prefilter::default());
    work.look_at_map(&map, DMat3::IDENTITY, 256, &mut picture);
    work.levels(Some(&left), &mut picture);
    assert!(!picture.holds_hard_lights);
    let soft = lights.global.rgb[0][0] * (4.0 * PI).sqrt();
    // The cells of what is left do not fall evenly on the texels, but it is smooth.
    let kept = flux(&work.left, 0);
    assert!((kept / soft - 1.0).abs() < 0.01, "{kept} of {soft}; all {}", flux(&picture.all, 0));
    assert!(flux(&picture.all, 0) > 1.2 * kept, "the spot is a good part");
    let seen = work.left.look(Vec3::new(0.3, -0.5, 0.8).normalize())[0];
    assert!(seen < 3.0, "the spot of 200 is gone: {seen}");
}

#[test]
fn nothing_gives_a_black_picture() {
    let (mut picture, mut work) = (EnvironmentPicture::default(), Prefilter::default());
    work.see(&RadianceSamples::default(), 1.0, &mut picture);
    assert_eq!(picture.all.look(Vec3::X), [0.0; 3]);
    work.levels(None, &mut picture);
    assert_eq!(picture.gloss(30.0, Vec3::X), [0.0; 3]);
    let empty = EnvironmentMap { layout: MapLayout::Cube, radiance: Image::default() };
    work.look_at_map(&empty, DMat3::IDENTITY, 0, &mut picture);
    assert_eq!(picture.all.look(Vec3::X), [0.0; 3]);
}
