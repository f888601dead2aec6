//! Lobes of exponents from 0 on.

use crate::assets::shapes;
use crate::model::{
    light::Lights,
    scene::{Material, Scene, VirtualObject},
};
use crate::plan::Pass;
use crate::stress::{
    CaseBound, HardCase, Where, naive,
    stage::{StressStage, object, sun, uniform},
};
use glam::{DVec3, Vec3};
use std::f32::consts::TAU;

const SHADE: Where = Where::Kernel(Pass::ShadeObject);

/// A ball of gloss alone, nearly filling the picture, before black.
fn ball(exponent: f32, light: Lights) -> StressStage {
    let material = Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0; 3], exponent };
    alone(object("ball", shapes::uv_sphere(0.2, 48, 24), material, Vec3::ZERO), light)
}

fn alone(one: VirtualObject, light: Lights) -> StressStage {
    let scene = Scene { objects: vec![one], ..Scene::default() };
    StressStage {
        eye_world: DVec3::new(0.0, -0.6, 0.0),
        target_world: DVec3::ZERO,
        background: 0.0,
        ..StressStage::new(scene, light)
    }
}

/// A plate that faces the camera, all of gloss: at its middle the mirrored ray meets a light behind the camera.
fn plate(exponent: f32, light: Lights) -> StressStage {
    let material = Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0; 3], exponent };
    let corner = |x: f64, z: f64| DVec3::new(x, 0.0, z);
    let mesh = shapes::quad([corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)]);
    let stage = alone(object("plate", mesh, material, Vec3::ZERO), light);
    // An odd number of pixels: one has the axis.
    StressStage { size_px: [49, 37], ..stage }
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "a lobe of exponent 0 in a white furnace",
        measures: "largest radiance, 1 from everywhere",
        formula: "(s + 2)/(2 pi) cos^s: its integral is (s + 2)/(s + 1)",
        runs: SHADE,
        textbook: || f64::from(naive::furnace(0.0)),
        ours: |engine| ball(0.0, uniform(1.0)).brightest(engine),
        // 11 bits in the layer of objects.
        bound: CaseBound::new(0.0, 1.0005),
    },
    HardCase {
        name: "a lobe of exponent 1 in a white furnace",
        measures: "largest radiance, 1 from everywhere",
        formula: "(s + 2)/(2 pi) cos^s: its integral is (s + 2)/(s + 1)",
        runs: SHADE,
        textbook: || f64::from(naive::furnace(1.0)),
        ours: |engine| ball(1.0, uniform(1.0)).brightest(engine),
        bound: CaseBound::new(0.0, 1.0005),
    },
    HardCase {
        name: "a lobe of exponent 0, the light behind",
        measures: "largest radiance on the dark side",
        formula: "max(0, cos)^0 = 0^0 = 1",
        runs: SHADE,
        textbook: || f64::from(naive::lobe(-0.5, 0.0) / TAU),
        ours: |engine| ball(0.0, sun(Vec3::Y, 1.0)).brightest(engine),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "a lobe of exponent 1e5 at its peak",
        measures: "radiance over that of the peak",
        formula: "(r.w)^s, r.w = 1 + 1.2e-7 by rounding",
        runs: SHADE,
        textbook: || f64::from(naive::lobe(1.0 + f32::EPSILON, 1e5)),
        ours: |engine| {
            let peak = f64::from(1e5f32 + 1.0) / std::f64::consts::TAU;
            Ok(plate(1e5, sun(Vec3::NEG_Y, 1e-4)).brightest(engine)? / (1e-4 * peak))
        },
        bound: CaseBound::new(0.9, 1.0005),
    },
    HardCase {
        name: "a lobe of exponent 1e30 at its peak",
        measures: "largest radiance, finite",
        formula: "(s + 1) E: infinity",
        runs: SHADE,
        textbook: || f64::from((1e30f32 + 1.0) * 1e10 / TAU),
        ours: |engine| plate(1e30, sun(Vec3::NEG_Y, 1e10)).brightest(engine),
        bound: CaseBound::new(0.0, f32::MAX as f64),
    },
    HardCase {
        name: "a lamp of 1e6 on a white ball",
        measures: "largest radiance (3.2e5; white is 1)",
        formula: "in half floats: infinity",
        runs: SHADE,
        textbook: || f64::from(naive::half(1e6 * 2.0 / TAU)),
        ours: |engine| {
            let material = Material::Lambert { albedo_rgb: [1.0; 3] };
            let white = object("ball", shapes::uv_sphere(0.2, 48, 24), material, Vec3::ZERO);
            alone(white, sun(Vec3::NEG_Y, 1e6)).brightest(engine)
        },
        // The layer of objects ends at 6e4 times white; shown it is white.
        bound: CaseBound::new(5.9e4, 3.19e5),
    },
    HardCase {
        name: "a lamp of 1e-7 on a white ball, exposed for it",
        measures: "largest radiance over its truth",
        formula: "in half floats: three digits less",
        runs: SHADE,
        textbook: || {
            let truth = 1e-7 * 2.0 / TAU;
            f64::from(naive::half(truth) / truth)
        },
        ours: |engine| {
            let material = Material::Lambert { albedo_rgb: [1.0; 3] };
            let white = object("ball", shapes::uv_sphere(0.2, 48, 24), material, Vec3::ZERO);
            let stage = alone(white, sun(Vec3::NEG_Y, 1e-7));
            Ok(StressStage { exposure_s: 1e7, ..stage }.brightest(engine)? / (1e-7 / std::f64::consts::PI))
        },
        // No pixel looks quite along the light; 11 bits.
        bound: CaseBound::new(0.995, 1.0005),
    },
];
