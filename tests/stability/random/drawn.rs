//! Visibility, composing and near light.

use super::{CASES, finite, hold, light, number, unit, vector};
use glam::Vec3;
use halflight::{
    compose::{
        composite,
        geometry::MaterialTerms,
        reflected::Reflected,
        shade_object::{self, LightTerms, ObjectPoint, Surroundings},
        shade_surface,
        tonemap::ToneTable,
    },
    math::sh::zonal::PhongNorm,
    model::{
        blocker::{BlockerSphere, Rung},
        light::{HardLight, Lights},
        response::Response,
        scene::Material,
    },
    nearfield::{
        form_factor::form_factor,
        packed::{pack, unpack},
        shaft::{Aabb, shaft_interval},
    },
    visibility::{
        blockers::Blockers,
        lobes::share_left,
        point_maps::PointCamera,
        shadow_maps::{bias_m, lit},
    },
};
use proptest::prelude::*;
use std::cell::{Cell, RefCell};

/// Spheres before soft light: V is a possible one with every rung, whatever the spheres; shares stay shares.
#[test]
fn visibility() {
    let sphere = (prop::array::uniform3(number()).prop_map(Vec3::from), number(), 0u32..4, any::<bool>());
    let rung = prop::sample::select(Rung::ALL.to_vec());
    let state = RefCell::new(Blockers::new());
    let hidden = Cell::new(0);
    let texels: Vec<f32> = (0..16 * 16).map(|k| if k % 3 == 0 { 1.0 } else { 0.5 }).collect();
    let strategy = (
        (prop::collection::vec(sphere, 0..10), rung, 2usize..=6),
        (vector(), unit(), unit()),
        (number(), number(), number(), 0u32..9, number()),
    );
    hold(
        "visibility",
        strategy,
        |((spheres, rung, order), (point, normal, axis), (x, y, depth, taps, cosine))| {
            let mut list = Vec::new();
            for (at, radius, body, again) in spheres {
                let one = BlockerSphere { centre_world: at, radius_m: radius, body };
                list.push(one);
                if again {
                    list.push(BlockerSphere { body: body + 10, ..one });
                }
            }
            let blockers = &mut *state.borrow_mut();
            blockers.prepare(&list, rung, order, 32);
            let mut v = [0.0; 36];
            blockers.visibility(point, normal, None, &mut v);
            let whole = (4.0 * std::f32::consts::PI).sqrt();
            prop_assert!((0.0..=whole * 1.000_001).contains(&v[0]), "{}: V_0 = {}", rung.name(), v[0]);
            hidden.set(hidden.get() + u32::from(v[0] < 0.99 * whole));
            let rest: f32 = v[1..].iter().map(|v| v * v).sum();
            // 32 directions are few for 36 coefficients: their sums are not quite orthogonal.
            let most = match rung {
                Rung::Directions => 1.5 * v[0] * (whole - v[0]) + 0.2,
                _ => v[0] * (whole - v[0]) * 1.0001 + 1e-4,
            };
            prop_assert!(rest <= most, "{}: {rest} with V_0 = {}", rung.name(), v[0]);

            for one in list
                .iter()
                .filter(|s| s.centre_world.is_finite() && s.radius_m.is_finite() && s.radius_m > 0.0)
            {
                let left = share_left(40.0, axis, point, normal, one);
                prop_assert!((0.0..=1.0).contains(&left), "{one:?}: {left}");
            }
            let share = lit(&texels, 16, taps, x * 16.0, y * 16.0, depth);
            prop_assert!((0.0..=1.0).contains(&share), "{share}");
            let bias = bias_m(0.01f32, 2.0, cosine, 0.64);
            prop_assert!((0.0..=0.64).contains(&bias), "{cosine}: {bias}");
            Ok(())
        },
    );
    println!("in {} something was hidden", hidden.get());
    assert!(hidden.get() > CASES / 3, "{}", hidden.get());
}

fn material() -> impl Strategy<Value = Material> {
    let rgb = || prop::array::uniform3(0.0f32..1.0);
    let exponent =
        prop_oneof![2 => 0.0f32..100.0, 1 => prop::sample::select(vec![0.0, 1e-30, 1.0, 1e5, 1e30])];
    prop_oneof![
        rgb().prop_map(|albedo_rgb| Material::Lambert { albedo_rgb }),
        (rgb(), rgb(), exponent).prop_map(|(albedo_rgb, specular_rgb, exponent)| Material::Phong {
            albedo_rgb,
            specular_rgb,
            exponent
        }),
        rgb().prop_map(|reflectance_rgb| Material::Mirror { reflectance_rgb }),
    ]
}

/// Composing: no light makes a shade negative or endless, no ratio leaves [0, 1], no exposure leaves 8 bits.
#[test]
fn compose() {
    let hard =
        prop::collection::vec((prop::array::uniform3(number()), prop::array::uniform3(number())), 0..4);
    let rows = prop::collection::vec(prop::array::uniform3(number()), 16);
    let point = (unit(), unit(), 0.0f32..=1.0, 0.0f32..=1.0);
    let table = ToneTable::of(&Response::srgb());
    let nothing = Reflected::default();
    let plain = Surroundings::new(None, &nothing, PhongNorm::EnergySafe, 4);
    hold(
        "compose",
        (hard, rows, material(), point, (number(), number())),
        |(hard, rows, material, point, odd)| {
            let mut lights = Lights::soft(light(4, &rows));
            for (to_light_world, irradiance_rgb) in hard {
                lights.hard.push(HardLight { to_light_world, irradiance_rgb, extent_rad: odd.0 });
            }
            let terms = LightTerms::of(&lights);
            let (normal, to_eye, openness, visible) = point;
            let at = ObjectPoint {
                position_world: Vec3::ZERO,
                normal,
                to_eye,
                tint_openness: [1.0, 1.0, 1.0, openness],
                soft: [0.0; 4],
                gloss: [openness; 3],
            };
            let out =
                shade_object::shade(&terms, &plain, &MaterialTerms::of(&material), &at, |_, _, _| visible);
            prop_assert!(out.iter().all(|c| c.is_finite() && *c >= 0.0), "{out:?}");
            let blocked = [if odd.1.is_finite() { odd.1.max(0.0) } else { 0.0 }, visible, openness];
            let ratio = shade_surface::ratio(&terms, normal, blocked);
            prop_assert!(ratio.iter().all(|c| (0.0..=1.0).contains(c)), "{ratio:?} of {blocked:?}");
            let over = composite::over([visible, 1.0, 1e30], ratio, [openness, 0.0, 0.0, openness]);
            prop_assert!(over.iter().all(|c| c.is_finite() && *c >= 0.0), "{over:?}");
            let (a, b) = (odd.0, odd.1);
            let (low, high) = if a < b { (a, b) } else { (b, a) };
            prop_assert!(!(low <= high) || table.value(0, low) <= table.value(0, high), "{low} {high}");
            Ok(())
        },
    );
}

/// Near light: form factors are shares, and those of two halves add up; shafts are met from both ends; numbers come back
/// from 16 bits; a lamp's map is sound wherever its casters are.
#[test]
fn near_light() {
    let corner = || prop::array::uniform3(finite()).prop_map(|c| Vec3::from(c).as_dvec3());
    let places = prop::collection::vec(prop::array::uniform3(number()).prop_map(Vec3::from), 1..9);
    let boxes = prop::array::uniform3((vector(), prop::array::uniform3(0.0f32..1.0)));
    let strategy = (
        (corner(), unit(), corner(), corner(), corner(), 0.0f64..1.0),
        (boxes, number()),
        (vector(), unit(), places),
    );
    hold("nearfield", strategy, |((at, normal, a, u, v, cut), (boxes, odd), (lamp, front, casters))| {
        // A parallelogram and its two parts.
        let quad = [a, a + u, a + u + v, a + v];
        let normal = normal.as_dvec3().normalize();
        let whole = form_factor(at, normal, &quad);
        prop_assert!((0.0..=1.0).contains(&whole), "{whole}");
        let middle = u * cut;
        let parts = [[a, a + middle, a + middle + v, a + v], [a + middle, a + u, a + u + v, a + middle + v]];
        let sum: f64 = parts.iter().map(|part| form_factor(at, normal, part)).sum();
        let ordinary = [a, u, v, at].iter().all(|p| p.abs().max_element() < 3.0);
        // The point may lie in the plane of one, to rounding, and not of another: then it is a corner's angle.
        if ordinary && u.cross(v).dot(a - at).abs() > 1e-6 && u.cross(v).length() > 1e-6 {
            prop_assert!((sum - whole).abs() < 1e-6, "{whole} in two: {sum}");
        }
        let [a, b, c] = boxes.map(|(low, size)| Aabb { low, high: low + Vec3::from(size) });
        // From the other end it is met, too, if it only just is.
        let size = [a, b, c].iter().map(|x| x.low.abs().max(x.high.abs()).max_element()).fold(0.0, f32::max);
        let grown = Aabb { low: c.low - 1e-5 * size, high: c.high + 1e-5 * size };
        prop_assert!(shaft_interval(&a, &b, &c).is_none() || shaft_interval(&b, &a, &grown).is_some());
        if let Some([first, last]) = shaft_interval(&a, &b, &c) {
            prop_assert!((0.0..=1.0).contains(&first) && first <= last && last <= 1.0, "{first} {last}");
        }
        prop_assert!(shaft_interval(&a, &b, &a).is_some(), "an end of the shaft itself");
        let back = unpack(pack(odd));
        prop_assert!((0.0..2.0).contains(&back), "{odd}: {back}");
        if (1e-9..1.0).contains(&odd) {
            prop_assert!((back / odd - 1.0).abs() < 2.5e-4, "{odd}: {back}");
        }
        if let Some(camera) = PointCamera::fit(lamp, front, &casters, 64) {
            prop_assert!(
                camera.near_m > 0.0 && camera.near_m.is_finite() && camera.texel > 0.0,
                "{camera:?}"
            );
            prop_assert!(camera.rows.as_flattened().iter().all(|r| r.is_finite()), "{camera:?}");
            let slope = camera.slope(0, casters[0], front);
            prop_assert!(slope.iter().all(|s| s.is_finite()), "{slope:?}");
        }
        Ok(())
    });
}
