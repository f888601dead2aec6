//! Near light: sources that touch the receiver, lie in its plane, or are seen as slivers.

use crate::nearfield::{
    form_factor::form_factor,
    sets::budget_threshold,
    shaft::{Aabb, shaft_interval},
};
use crate::stress::{CaseBound, HardCase, Where, naive};
use crate::visibility::point_maps::PointCamera;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// A unit square in the plane x = 0, from `low` up, seen by a receiver at (`away`, 0, 0) that looks up.
fn wall(away: f64, low: f64) -> f64 {
    let corner = |y: f64, z: f64| DVec3::new(0.0, y, z);
    let corners = [corner(-0.5, low), corner(0.5, low), corner(0.5, low + 1.0), corner(-0.5, low + 1.0)];
    form_factor(DVec3::new(away, 0.0, 0.0), DVec3::Z, &corners)
}

/// The same in closed form for `low` = 0: two rectangles of width 1/2 with a corner at the receiver's foot.
fn wall_in_closed_form(away: f64) -> f64 {
    let a = 1.0 / (1.0 + away * away).sqrt();
    (0.5f64.atan2(away) - away * a * (0.5 * a).atan()) / PI
}

/// A square of side 1 at a height over a receiver that faces it.
fn lid(height: f64) -> [DVec3; 4] {
    let corner = |x: f64, y: f64| DVec3::new(x, y, height);
    [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)]
}

/// Fifty-one lamps of the same strength.
const EQUAL: [f32; 51] = [1.0; 51];

/// Casters all around the origin.
fn around() -> Vec<Vec3> {
    (0..8)
        .map(|k| Vec3::new((k & 1) as f32 - 0.5, (k >> 1 & 1) as f32 - 0.5, (k >> 2) as f32 - 0.5))
        .collect()
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "a source in the receiver's plane",
        measures: "form factor",
        formula: "A cos cos / (pi r^2), r = 0",
        runs: Where::Processor,
        textbook: || f64::from(naive::form_factor_of_middles(1.0, [0.0, 0.0], 0.0)),
        ours: |_| Ok(form_factor(DVec3::ZERO, DVec3::Z, &lid(0.0))),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "a patch 1 cm above",
        measures: "form factor",
        formula: "A cos cos / (pi r^2) = 3183",
        runs: Where::Processor,
        textbook: || f64::from(naive::form_factor_of_middles(1.0, [1.0, 1.0], 0.01)),
        ours: |_| Ok(form_factor(DVec3::ZERO, DVec3::Z, &lid(0.01))),
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "a wall that touches, 1 mm away",
        measures: "form factor over its closed form",
        formula: "A cos cos / (pi r^2) to the wall's middle",
        runs: Where::Processor,
        textbook: || {
            let r = 0.5f32.hypot(0.001);
            f64::from(naive::form_factor_of_middles(1.0, [0.5 / r, 0.001 / r], r))
                / wall_in_closed_form(0.001)
        },
        ours: |_| Ok(wall(0.001, 0.0) / wall_in_closed_form(0.001)),
        bound: CaseBound::about(1.0, 1e-9),
    },
    HardCase {
        name: "a patch a thousand sides away",
        measures: "form factor over A / (pi r^2)",
        formula: "contour with acos: acos(1) = 0 in f32",
        runs: Where::Processor,
        textbook: || {
            let corners = lid(1000.0).map(|c| c.as_vec3().to_array());
            f64::from(naive::form_factor_by_contour([0.0, 0.0, 1.0], &corners)) * PI * 1e6
        },
        ours: |_| Ok(form_factor(DVec3::ZERO, DVec3::Z, &lid(1000.0)) * PI * 1e6),
        bound: CaseBound::about(1.0, 1e-5),
    },
    HardCase {
        name: "a sliver",
        measures: "form factor",
        formula: "n.(a x b) / |a x b|, a = b: 0/0",
        runs: Where::Processor,
        textbook: || {
            let corners = [[0.5, 0.0, 1.0], [0.5, 0.0, 1.0], [0.5, 0.3, 1.0]];
            f64::from(naive::form_factor_by_contour([0.0, 0.0, 1.0], &corners))
        },
        ours: |_| {
            let corner = |y: f64, thin: f64| DVec3::new(0.5 + thin, y, 1.0);
            let needle = [corner(0.0, 0.0), corner(0.0, 1e-13), corner(0.3, 0.0)];
            Ok(form_factor(DVec3::ZERO, DVec3::Z, &needle))
        },
        bound: CaseBound::new(0.0, 1e-7),
    },
    HardCase {
        name: "corners that are not a number",
        measures: "form factor",
        formula: "NaN in the sum",
        runs: Where::Processor,
        textbook: || {
            let corners = [[f32::NAN, 0.0, 1.0], [0.5, 0.0, 1.0], [0.5, 0.3, 1.0]];
            f64::from(naive::form_factor_by_contour([0.0, 0.0, 1.0], &corners))
        },
        ours: |_| {
            let corners = [DVec3::NAN, DVec3::new(0.5, 0.0, 1.0), DVec3::new(0.5, 0.3, 1.0)];
            Ok(form_factor(DVec3::ZERO, DVec3::Z, &corners))
        },
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "51 equal sources under the rule of 2 %",
        measures: "share of the light that is kept",
        formula: "sources below 2 % of all are left out: all of them",
        runs: Where::Processor,
        textbook: || f64::from(naive::kept_above_share(&EQUAL, 0.02)),
        ours: |_| {
            let mut sorted = EQUAL;
            let threshold = budget_threshold(&mut sorted, 0.02);
            let kept: f32 = EQUAL.iter().filter(|c| **c >= threshold).sum();
            Ok(f64::from(kept) / EQUAL.len() as f64)
        },
        bound: CaseBound::new(0.98, 1.0),
    },
    HardCase {
        name: "an object around its lamp",
        measures: "near plane of the lamp's map, metres",
        formula: "near = distance to the middle - radius",
        runs: Where::Processor,
        textbook: || f64::from(0.0 - 0.75f32.sqrt()),
        ours: |_| {
            let camera = PointCamera::fit(Vec3::ZERO, Vec3::NEG_Z, &around(), 256);
            Ok(camera.map_or(f64::NAN, |camera| f64::from(camera.near_m)))
        },
        bound: CaseBound::new(1e-3, 0.5),
    },
    HardCase {
        name: "a shaft between two touching walls",
        measures: "length of the shaft's part that an object at the corner may meet",
        formula: "by the line of the two middles: it passes the object by",
        runs: Where::Processor,
        textbook: || {
            // Middles (0, 0, 1/2) and (1/2, 0, 0): the object at the origin is not on the line.
            let (a, b) = (Vec3::new(0.0, 0.0, 0.5), Vec3::new(0.5, 0.0, 0.0));
            let t = -a.dot(b - a) / (b - a).length_squared();
            f64::from(u8::from(a.lerp(b, t).length() < 0.05))
        },
        ours: |_| {
            let flat = |low: Vec3, high: Vec3| Aabb { low, high };
            let wall = flat(Vec3::new(0.0, -0.5, 0.0), Vec3::new(0.0, 0.5, 1.0));
            let floor = flat(Vec3::new(0.0, -0.5, 0.0), Vec3::new(1.0, 0.5, 0.0));
            let object = flat(Vec3::splat(-0.02), Vec3::splat(0.02));
            let met = shaft_interval(&wall, &floor, &object);
            Ok(met.map_or(0.0, |[first, last]| f64::from(last - first)))
        },
        bound: CaseBound::exactly(1.0),
    },
];
