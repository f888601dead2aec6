//! Random cases around the hard ones: numbers from the ends of what f32 holds, values that coincide, and nothing that is
//! not a number. Each stage has its count and its seed here; a failure prints the seed and the smallest case found.

use glam::Vec3;
use halflight::model::light::RadianceSh;
use proptest::{
    prelude::*,
    test_runner::{RngAlgorithm, TestError, TestRng, TestRunner},
};

mod drawn;
mod measured;

/// Cases of each stage.
pub const CASES: u32 = 20_000;
/// The seed, unless `HALFLIGHT_SEED` names another.
const SEED: u64 = 20_111_026;

/// Runs a stage's property.
pub fn hold<S: Strategy>(stage: &str, strategy: S, property: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let seed = std::env::var("HALFLIGHT_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(SEED);
    println!("{stage}: {CASES} cases, seed {seed} (HALFLIGHT_SEED)");
    let mut bytes = [0u8; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
    let config = ProptestConfig {
        cases: CASES,
        failure_persistence: None,
        max_global_rejects: 10 * CASES,
        ..ProptestConfig::default()
    };
    match TestRunner::new_with_rng(config, rng).run(&strategy, property) {
        Ok(()) => {}
        Err(TestError::Fail(why, case)) => panic!("{stage}, seed {seed}: {why}\nsmallest case: {case:?}"),
        Err(TestError::Abort(why)) => panic!("{stage}, seed {seed}: given up, {why}"),
    }
}

/// Any size from 1e-30 to 1e30, either sign.
pub fn any_size() -> impl Strategy<Value = f32> {
    (-30.0f32..30.0, any::<bool>())
        .prop_map(|(log, minus)| if minus { -10f32.powf(log) } else { 10f32.powf(log) })
}

/// Finite: ordinary ones, zeros, the smallest, nearly 1, and any size up to 1e30.
pub fn finite() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -2.0f32..2.0,
        1 => prop::sample::select(vec![
            0.0, -0.0, 1.0, -1.0, f32::MIN_POSITIVE, 1e-45, 1.0 + f32::EPSILON, 1.0 - f32::EPSILON, 0.5,
        ]),
        1 => any_size(),
    ]
}

/// Also what is no number.
pub fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        12 => finite(),
        1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN]),
    ]
}

pub fn vector() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(finite()).prop_map(Vec3::from)
}

/// Unit vectors: anywhere, at the axes, and a hair beside them.
pub fn unit() -> impl Strategy<Value = Vec3> {
    let anywhere = (-1.0f32..1.0, -3.2f32..3.2).prop_map(|(z, phi)| {
        let (sin, cos) = phi.sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z)
    });
    let axis = prop::sample::select(vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z]);
    let beside = (axis.clone(), vector(), -20f32..-1.0)
        .prop_map(|(axis, off, log)| (axis + off.clamp_length_max(1.0) * 10f32.powf(log)).normalize_or(axis));
    prop_oneof![3 => anywhere, 1 => axis, 2 => beside]
}

/// Light of these rows.
pub fn light(order: usize, rows: &[[f32; 3]]) -> RadianceSh {
    let mut light = RadianceSh::zero(order);
    light.rgb.iter_mut().zip(rows).take(order * order).for_each(|(row, given)| *row = *given);
    light
}
