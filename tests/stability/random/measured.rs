//! Exposures, light, sources, poses, and the mathematics below them.

use super::{CASES, hold, light, number, unit};
use glam::{DVec3, Quat, Vec3};
use halflight::{
    assets::shapes,
    hdr::merge_bracket::merge_pixels,
    light::{
        project_sh::project_sh,
        split::{SplitOptions, split},
    },
    math::{
        color, lens::Lens, octahedral, pose::Pose, projection::Projection, rigid::Quaternion, sh::basis,
        vector::Vector,
    },
    model::{
        frame::Exposure,
        image::{LOWER_BOUND, UPPER_BOUND},
        light::{RadianceSamples, RadianceSh},
        response::Response,
    },
    sources::{
        cut::{Cutter, Leaf},
        expand::{Expander, Marked, Priority, WantedNodes},
        tree::SourceTree,
    },
    track::{
        align::{MapView, place},
        minima,
    },
};
use proptest::prelude::*;
use std::cell::{Cell, RefCell};

fn sum(row: [f32; 3]) -> f64 {
    row.iter().map(|c| f64::from(c.abs())).sum()
}

/// Merging: every bracket of sound times is finite and above 0, and flagged where no value has a weight; in either order.
#[test]
fn exposures() {
    let value = prop_oneof![2 => any::<u8>(), 1 => prop::sample::select(vec![0u8, 1, 127, 128, 254, 255])];
    let pixel = prop::array::uniform3(value);
    let picture = (prop::array::uniform8(pixel), -12.0f64..12.0);
    let response = Response::srgb();
    hold("hdr", prop::collection::vec(picture, 1..6), |bracket| {
        let merged = |bracket: &[([[u8; 3]; 8], f64)]| {
            let exposures: Vec<_> =
                bracket.iter().map(|(_, log)| Exposure { time_s: 10f64.powf(*log), gain: 1.0 }).collect();
            let pictures: Vec<&[[u8; 3]]> = bracket.iter().map(|(pixels, _)| &pixels[..]).collect();
            let (mut radiance, mut flags) = ([[0.0f32; 3]; 8], [0u8; 8]);
            merge_pixels(&pictures, &exposures, response.log_exposure(), &mut radiance, &mut flags);
            (radiance, flags)
        };
        let (radiance, flags) = merged(&bracket);
        for (k, (rgb, flags)) in radiance.iter().zip(flags).enumerate() {
            prop_assert!(rgb.iter().all(|c| c.is_finite() && *c > 0.0), "{rgb:?}");
            let ends = |c: usize| bracket.iter().all(|(pixels, _)| [0, 255].contains(&pixels[k][c]));
            prop_assert_eq!(flags & (LOWER_BOUND | UPPER_BOUND) != 0, (0..3).any(ends));
        }
        let back: Vec<_> = bracket.iter().rev().copied().collect();
        for (a, b) in radiance.as_flattened().iter().zip(merged(&back).0.as_flattened()) {
            // Logarithms of up to 35 are rounded to 2e-6, and summed in the other order.
            prop_assert!((a / b - 1.0).abs() < 2e-5, "{a} {b}");
        }
        Ok(())
    });
}

/// Light: both halves are the whole; no irradiance is negative or beyond the light; its unit does not matter. Sums of
/// samples are as good as in 64 bits.
#[test]
fn light_and_its_halves() {
    let rows = prop::collection::vec(prop::array::uniform3(number()), 36);
    let samples = prop::collection::vec((unit(), prop::array::uniform3(0.0f32..1.0), 0i32..7), 1..24);
    hold("light", (2usize..=6, rows, samples, any::<bool>()), |(order, rows, samples, bounded)| {
        let total = light(order, &rows);
        let options = SplitOptions { bounded, ..SplitOptions::default() };
        let halves = split(&total, &options);
        let sound = total.rows().iter().flatten().all(|c| c.is_finite());
        if let (Some(direct), true) = (halves.direct, sound) {
            let w = Vec3::from(direct.to_light_world);
            prop_assert!((w.length() - 1.0).abs() < 1e-5, "{w}");
            let mut y = [0.0f32; 36];
            basis::evaluate(order, w.to_array(), &mut y);
            for c in 0..3 {
                let e = direct.irradiance_rgb[c];
                prop_assert!(e >= 0.0, "{e}");
                for i in 0..order * order {
                    let (all, left) = (f64::from(total.rgb[i][c]), f64::from(halves.global.rgb[i][c]));
                    let size = all.abs() + f64::from(e);
                    let off = (left + f64::from(e) * f64::from(y[i]) - all).abs();
                    prop_assert!(!(off > 4e-7 * size * order as f64), "row {i}: {off:e} of {size:e}");
                }
            }
        }
        // Samples that can be: radiance from 0 to 1e6.
        let mut seen = RadianceSamples::default();
        for (w, rgb, power) in &samples {
            seen.directions.push([w.x, w.y, w.z, 0.01]);
            let [r, g, b] = rgb.map(|c| c * 10f32.powi(*power));
            seen.radiance.push([r, g, b, 0.0]);
        }
        let found = project_sh(&seen, order);
        let mut want = [[0.0f64; 3]; 36];
        let mut size = [0.0f64; 3];
        for (d, l) in seen.directions.iter().zip(&seen.radiance) {
            let mut y = [0.0f64; 36];
            basis::evaluate(order, [0, 1, 2].map(|k| f64::from(d[k])), &mut y);
            for c in 0..3 {
                size[c] += f64::from(d[3]) * f64::from(l[c]);
                want.iter_mut().zip(y).for_each(|(want, y)| want[c] += f64::from(d[3]) * f64::from(l[c]) * y);
            }
        }
        for (found, want) in found.rows().iter().zip(want) {
            for c in 0..3 {
                prop_assert!((f64::from(found[c]) - want[c]).abs() <= 2e-6 * size[c], "{found:?} {want:?}");
            }
        }
        let halves = split(&found, &options);
        let scaled = RadianceSh { order, rgb: found.rgb.map(|row| row.map(|c| c * 1024.0)) };
        let other = split(&scaled, &options);
        prop_assert_eq!(halves.direct.is_some(), other.direct.is_some());
        if let (Some(a), Some(b)) = (halves.direct, other.direct) {
            // To the bit but for what underflows.
            prop_assert!(Vec3::from(a.to_light_world).distance(Vec3::from(b.to_light_world)) < 1e-30);
            for (a, b) in a.irradiance_rgb.iter().zip(b.irradiance_rgb) {
                prop_assert!((a * 1024.0 - b).abs() <= 1e-30, "{a} {b}");
            }
            // |d| is at most the flux.
            let flux = f64::from(0.01f32) * samples.len() as f64 * 1e6;
            prop_assert!(sum(a.irradiance_rgb) <= 3.0 * flux);
        }
        Ok(())
    });
}

/// Sources: whatever their places and powers, what is cut or expanded has all of the light that can be.
#[test]
fn sources() {
    let source = (prop::array::uniform3(number()).prop_map(Vec3::from), number(), 0u32..3);
    let state = RefCell::new((Cutter::default(), Expander::default()));
    let cut = Cell::new(0);
    hold("sources", (prop::collection::vec(source, 0..20), 1usize..12), |(sources, count)| {
        let (cutter, expander) = &mut *state.borrow_mut();
        let leaves: Vec<_> = sources
            .iter()
            .map(|(at, power, root)| Leaf { at: *at, flux_rgb: [*power; 3], root: *root })
            .collect();
        let sound = |at: &Vec3, power: f32| at.is_finite() && power > 0.0 && power.is_finite();
        let flux = |l: &Leaf| f64::from(color::luminance(l.flux_rgb));
        let all: f64 = leaves
            .iter()
            .filter(|l| sound(&l.at, l.flux_rgb[0]) && flux(l).is_finite())
            .map(|l| f64::from(l.flux_rgb[0]))
            .sum();
        let made = cutter.cut(&leaves, count);
        prop_assert!(made.len() <= count);
        // Sums stay in f32.
        prop_assume!(all < 3e38);
        let kept: f64 = made.iter().map(|r| f64::from(r.flux_rgb[0])).sum();
        prop_assert!(made.iter().all(|r| r.at.is_finite() && r.mean.is_finite()), "{made:?}");
        prop_assert!(!(kept > all * (1.0 + 1e-5)), "{kept} of {all}");
        prop_assert!(count < 3 || (kept - all).abs() <= 1e-5 * all, "{kept} of {all}");

        let places: Vec<_> = sources.iter().map(|s| s.0).collect();
        let powers: Vec<_> = sources.iter().map(|s| s.1).collect();
        let tree = SourceTree::build(&places, &powers);
        let light: Vec<f32> = tree.order().iter().map(|&k| powers[k as usize]).collect();
        let towards = vec![Vec3::Z; light.len()];
        let marked = Marked { tree: &tree, light: &light, towards: &towards, lasting: false };
        let all: f64 = light.iter().filter(|l| l.is_finite() && **l > 0.0).map(|l| f64::from(*l)).sum();
        let chosen = expander.expand(&[marked], WantedNodes::exactly(count), Priority::ErrorRemoved);
        let kept: f64 = chosen.iter().map(|c| f64::from(c.light)).sum();
        prop_assert!(chosen.len() <= count);
        prop_assert!(all > 3e38 || (kept - all).abs() <= 1e-5 * all, "{kept} of {all}");
        cut.set(cut.get() + u32::from(chosen.len() > 1));
        Ok(())
    });
    assert!(cut.get() > CASES / 3, "{} were cut", cut.get());
}

/// Poses: what is found is finite and a rotation; a tag that was seen properly is found where it was.
#[test]
fn track() {
    let eye = (-3.1f64..3.1, 0.0f64..1.6, 0.1f64..20.0);
    let noise = prop::collection::vec(-1.0f64..1.0, 8);
    let views =
        prop::collection::vec((prop::array::uniform3(number()), prop::array::uniform3(number())), 0..5);
    let strategy =
        (eye, noise, -9.0f64..1.5, views, prop::array::uniform4(number()), prop::array::uniform4(number()));
    let lens = Lens::pinhole(640, 480, 800.0, 800.0, 320.0, 240.0).without_distortion();
    let solved = Cell::new(0);
    hold("track", strategy, |((around, up, away), noise, log_noise, views, p, q)| {
        let h = 0.05;
        let corners_m = [[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]].map(Vector);
        let eye = away * DVec3::new(up.cos() * around.cos(), up.cos() * around.sin(), -up.sin());
        let pose = Pose::look_at(eye, DVec3::ZERO, if up > 1.5 { DVec3::X } else { DVec3::NEG_Z });
        let off = 10f64.powf(log_noise);
        let corners_px: Vec<_> = corners_m
            .iter()
            .enumerate()
            .filter_map(|(k, c)| {
                let seen = lens.project(pose.inverse().transform(DVec3::from(*c)).into())?;
                Some(seen + Vector([off * noise[2 * k], off * noise[2 * k + 1]]))
            })
            .collect();
        if let Ok(corners_px) = <[Vector<f64, 2>; 4]>::try_from(corners_px)
            && let Some(found) = minima::solve_rectangle(&corners_m, &corners_px, 0.1, &lens)
        {
            solved.set(solved.get() + 1);
            for one in std::iter::once(&found.best).chain(&found.other) {
                let t = one.camera_from_object.translation;
                prop_assert!(t.is_finite() && one.rms_px.is_finite() && one.rms_px >= 0.0, "{one:?}");
                let rotation = one.camera_from_object.rotation;
                prop_assert!((rotation.dot(rotation) - 1.0).abs() < 1e-9, "{one:?}");
            }
            prop_assert!(found.ambiguity >= 1.0 && found.ambiguity <= 1e6);
            if off < 1e-6 && up > 0.3 && away < 1.0 {
                let back = found.best.camera_from_object.inverse().translation;
                prop_assert!(DVec3::from(back).distance(eye) < 1e-4, "{back:?} for {eye}");
            }
        }
        let views: Vec<MapView<f32>> =
            views.iter().map(|(known, map)| MapView { known_m: Vector(*known), map: Vector(*map) }).collect();
        let turn = Quaternion(p).renormalised();
        if let Some(found) = place(turn, &views) {
            prop_assert!(
                found.scale > 0.0 && found.scale.is_finite() && found.origin.is_finite(),
                "{found:?}"
            );
        }
        let to = Quaternion(q).renormalised();
        for one in [turn, to, turn.slerp(to, 0.5), turn.slerp(to, 0.0), turn.times(to).renormalised()] {
            prop_assert!((one.dot(one) - 1.0).abs() < 1e-5, "{one:?}");
        }
        prop_assert!(turn.slerp(to, 0.5).dot(turn).abs() > 0.7, "the short way");
        Ok(())
    });
    println!("{} tags were found", solved.get());
    assert!(solved.get() > CASES / 3, "{}", solved.get());
}

/// Mathematics: harmonics keep their norm at every direction, directions come back from the square, turned vectors keep
/// their length, meshes their soundness, colours their range.
#[test]
fn math() {
    let mesh = shapes::uv_sphere(1.0, 8, 4);
    hold(
        "math",
        (unit(), unit(), number(), prop::array::uniform3(number()), 1usize..=6),
        |(w, v, x, odd, order)| {
            let mut y = [0.0f32; 36];
            basis::evaluate(order, w.to_array(), &mut y);
            let square: f64 = y.iter().map(|y| f64::from(*y).powi(2)).sum();
            let want = (order * order) as f64 / (4.0 * std::f64::consts::PI);
            // The addition theorem; |w| is rounded, and counts 2 l times.
            prop_assert!((square / want - 1.0).abs() < 5e-6, "{w}: {square} for {want}");
            let back = octahedral::direction(octahedral::place(w));
            prop_assert!(back.distance(w) < 1e-6, "{w}: {back}");
            let at = octahedral::place(Vec3::from(odd));
            prop_assert!(at.abs().max_element() <= 1.0, "{odd:?}: {at}");
            prop_assert!(octahedral::direction(at).is_normalized());
            let turn = Quat::from_rotation_arc(w, v);
            let arc = Quaternion::arc(Vector(w.to_array()), Vector(v.to_array()));
            let turned = arc.rotate(Vector(w.to_array()));
            prop_assert!(
                Vec3::from(turned.0).distance(v) < 2e-3,
                "{w} to {v}: {turned:?}, glam has {}",
                turn * w
            );
            prop_assert!((arc.dot(arc) - 1.0).abs() < 1e-5);
            let encoded = color::srgb_encode(x);
            prop_assert!(x.is_nan() || x < 0.0 || encoded >= 0.0, "{x}: {encoded}");
            if (0.0..=1.0).contains(&x) {
                prop_assert!(
                    (0.0..=1.000_001).contains(&encoded) && (color::srgb_decode(encoded) - x).abs() < 1e-6,
                    "{x}"
                );
            }
            let bounds =
                shapes::bounds(&shapes::transformed(&mesh, &glam::Affine3A::from_scale(Vec3::splat(x))));
            prop_assert!(bounds.is_none_or(|(low, high)| !(low.x > high.x)));
            Ok(())
        },
    );
}
