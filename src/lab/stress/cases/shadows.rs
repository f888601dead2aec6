//! Shadow maps of lights that graze, stand in the zenith, or look past the casters.

use crate::assets::shapes;
use crate::engine::{Engine, EngineError};
use crate::model::{
    light::Lights,
    scene::{Material, Scene},
};
use crate::plan::Pass;
use crate::stress::{
    CaseBound, HardCase, Where, naive,
    stage::{StressStage, object, object_over_ground, sun, uniform},
};
use crate::visibility::shadow_maps::{MAX_BIAS_TEXELS, bias_m};
use glam::{DVec3, Vec3};

const MAPS: Where = Where::Kernel(Pass::ShadowMaps);
const SURFACE: Where = Where::Kernel(Pass::ShadeSurface);
const WHITE: Material = Material::Lambert { albedo_rgb: [1.0; 3] };

/// A box of 10 cm over the ground under a light; black where nothing but the object itself is to be seen.
fn boxed(middle_world: Vec3, light: Lights) -> StressStage {
    let one = object("box", shapes::cuboid(DVec3::splat(0.05)), WHITE, middle_world);
    StressStage::new(object_over_ground(one), light)
}

/// Least of the light that is left on the ground around a point that the box does not cover.
fn ground(stage: &StressStage, engine: &mut dyn Engine) -> Result<f64, EngineError> {
    stage.least_share(engine)
}

/// At an angle from the zenith.
fn from_zenith(degrees: f32) -> Vec3 {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    Vec3::new(sine, 0.0, cosine)
}

/// A plate alone, flat at z = 0.1, seen from above.
fn plate(light: Lights) -> StressStage {
    let corner = |x: f64, y: f64| DVec3::new(x, y, 0.1);
    let mesh = shapes::quad([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    let scene = Scene { objects: vec![object("plate", mesh, WHITE, Vec3::ZERO)], ..Scene::default() };
    StressStage { eye_world: DVec3::new(0.05, -0.1, 0.6), background: 0.0, ..StressStage::new(scene, light) }
}

/// Share of a flat plate that a shadow map without bias hides from a light at an angle: depths of the texels' middles
/// against those of points between them.
fn acne(degrees: f32) -> f64 {
    let tangent = degrees.to_radians().tan();
    let hidden = (0..1000).filter(|k| {
        let at = *k as f32 * 0.037;
        at * tangent > (at.floor() + 0.5) * tangent
    });
    hidden.count() as f64 / 1000.0
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "a light in the zenith",
        measures: "least of the light that is left on the ground",
        formula: "right = cross(z, w) / |cross(z, w)| = 0/0",
        runs: MAPS,
        textbook: || f64::from(naive::right_of([0.0, 0.0, 1.0])[0]),
        ours: |engine| ground(&boxed(Vec3::new(0.0, 0.0, 0.3), sun(Vec3::Z, 1.0)), engine),
        bound: CaseBound::new(0.0, 1e-6),
    },
    HardCase {
        name: "a light just beside the zenith",
        measures: "least of the light that is left on the ground",
        formula: "right = cross(z, w) / |cross(z, w)|, the squares underflow",
        runs: MAPS,
        textbook: || f64::from(naive::right_of([1e-23, 0.0, 1.0])[1]),
        ours: |engine| ground(&boxed(Vec3::new(0.0, 0.0, 0.3), sun(Vec3::new(1e-23, 0.0, 1.0), 1.0)), engine),
        bound: CaseBound::new(0.0, 1e-6),
    },
    HardCase {
        name: "a caster before the near plane",
        measures: "least of the light that is left on the ground",
        formula: "near and far of what is seen: the caster 15 m above is cut off",
        runs: MAPS,
        textbook: || naive::clipped_depth(-15.0, 0.0, 2.0).map_or(1.0, |_| 0.0),
        ours: |engine| ground(&boxed(Vec3::new(0.0, 0.0, 15.0), sun(Vec3::Z, 1.0)), engine),
        bound: CaseBound::new(0.0, 1e-6),
    },
    HardCase {
        name: "a plate under a light at 86 degrees",
        measures: "least radiance over that of an open plate",
        formula: "no bias: half of the plate hides the rest of it",
        runs: MAPS,
        textbook: || 1.0 - acne(86.0).ceil(),
        ours: |engine| {
            let to_light = from_zenith(86.0);
            let picture = plate(sun(to_light, 1.0)).draw(engine)?;
            let least =
                picture.radiance.pixels().as_flattened().iter().copied().fold(f32::INFINITY, f32::min);
            Ok(f64::from(least / to_light.z) * std::f64::consts::PI)
        },
        // 11 bits in the layer of objects.
        bound: CaseBound::about(1.0, 1e-3),
    },
    HardCase {
        name: "the bias at 89.9 degrees",
        measures: "bias of a filter of 4 taps, texels",
        formula: "texel (pcf + 1/2) sqrt2 tan(theta): shadows come loose",
        runs: Where::Processor,
        textbook: || f64::from(naive::bias_texels(2.0, 89.9f32.to_radians().cos())),
        ours: |_| Ok(f64::from(bias_m(1.0f32, 2.0, 89.9f32.to_radians().cos(), MAX_BIAS_TEXELS))),
        bound: CaseBound::new(0.0, MAX_BIAS_TEXELS as f64),
    },
    HardCase {
        name: "the bias at 90.1 degrees",
        measures: "bias of a filter of 4 taps, texels",
        formula: "tan(theta) < 0: the bias pulls the wrong way",
        runs: Where::Processor,
        textbook: || f64::from(naive::bias_texels(2.0, 90.1f32.to_radians().cos())),
        ours: |_| Ok(f64::from(bias_m(1.0f32, 2.0, 90.1f32.to_radians().cos(), MAX_BIAS_TEXELS))),
        bound: CaseBound::new(0.0, MAX_BIAS_TEXELS as f64),
    },
    HardCase {
        name: "a light at 89.9 degrees over the ground",
        measures: "least of the light that is left",
        formula: "(soft + E cos V) / (soft + E cos), V from a bias of 2000 texels: no shadow",
        runs: SURFACE,
        textbook: || f64::from(naive::light_ratio(0.0, 1.0, 89.9f32.to_radians().cos(), 1.0)),
        ours: |engine| ground(&boxed(Vec3::new(0.0, 0.0, 0.05), sun(from_zenith(89.9), 1.0)), engine),
        bound: CaseBound::new(0.0, 0.05),
    },
    HardCase {
        name: "a light under the ground as strong as the sky",
        measures: "least of the light that is left",
        formula: "(soft + E cos V) / (soft + E cos), cos < 0: division by zero",
        runs: SURFACE,
        textbook: || f64::from(naive::light_ratio(1.0, 1.0, -1.0, 0.0)),
        ours: |engine| {
            let below = sun(Vec3::NEG_Z, std::f32::consts::PI);
            let stage = boxed(Vec3::new(0.0, 0.0, 0.9), Lights { global: uniform(1.0).global, ..below });
            // Only the ground is looked at: the box is above the camera.
            ground(&stage, engine)
        },
        bound: CaseBound::exactly(1.0),
    },
    HardCase {
        name: "no light to take a share of",
        measures: "least of the light that is left",
        formula: "(soft + E cos V) / (soft + E cos) = 0/0",
        runs: SURFACE,
        textbook: || f64::from(naive::light_ratio(0.0, 0.0, 1.0, 0.0)),
        ours: |engine| ground(&boxed(Vec3::new(0.0, 0.0, 0.9), sun(Vec3::Z, 0.0)), engine),
        bound: CaseBound::exactly(1.0),
    },
    HardCase {
        name: "a light whose direction is none",
        measures: "least of the light that is left",
        formula: "w = 0 / |0|",
        runs: SURFACE,
        textbook: || f64::from(naive::direction([0.0; 3])[2]),
        ours: |engine| ground(&boxed(Vec3::new(0.0, 0.0, 0.9), sun(Vec3::ZERO, 1.0)), engine),
        bound: CaseBound::exactly(1.0),
    },
];
