//! Spheres that touch, hold, repeat or miss the receiver.

use crate::math::sh::{cap, log_exp, zonal};
use crate::model::{blocker::Rung, quality::Quality};
use crate::plan::Pass;
use crate::stress::{
    CaseBound, HardCase, Where, naive,
    stage::{ORDER, StressStage, spheres, uniform},
};
use glam::Vec3;

const SOFT: Where = Where::Kernel(Pass::SoftShadow);

/// Spheres under the same light from everywhere.
fn stage(list: impl IntoIterator<Item = (Vec3, f32)>, rung: Rung) -> StressStage {
    let stage = StressStage::new(spheres(list), uniform(1.0));
    StressStage { quality: Quality { rung, ..stage.quality }, ..stage }
}

/// V of one cap about the zenith, order 4, with r/d = sin of its half angle.
fn cap_about_z(sine: f32) -> [f32; ORDER * ORDER] {
    let mut bands = [0.0f32; ORDER];
    cap::visible(ORDER, sine * sine, &mut bands);
    let mut v = [0.0f32; ORDER * ORDER];
    zonal::rotate(&bands, [0.0, 0.0, 1.0], &mut v);
    v
}

/// Two hundred spheres at one place.
fn crowd() -> Vec<(Vec3, f32)> {
    vec![(Vec3::new(0.02, 0.0, 0.2), 0.1); 200]
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "a sphere that touches the ground",
        measures: "least of the light that is left",
        formula: "c = sqrt(1 - (r/d)^2), r/d = 1 + 1e-7",
        runs: SOFT,
        textbook: || f64::from(naive::mean_visibility(1.000_000_1, 1.0)),
        ours: |engine| stage([(Vec3::new(0.0, 0.0, 0.1), 0.1)], Rung::Chain).least_share(engine),
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "the ground within a sphere",
        measures: "least of the light that is left",
        formula: "c = sqrt(1 - (r/d)^2), r > d",
        runs: SOFT,
        textbook: || f64::from(naive::mean_visibility(0.1, 0.06)),
        ours: |engine| stage([(Vec3::new(0.0, 0.0, 0.02), 0.15)], Rung::Chain).least_share(engine),
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "200 spheres at one place, multiplied",
        measures: "least of the light that is left",
        formula: "V <- V V_1, 200 times: each product overshoots",
        runs: SOFT,
        textbook: || f64::from(naive::chain(ORDER, &cap_about_z(20f32.to_radians().sin()), 200)),
        ours: |engine| stage(crowd(), Rung::Chain).least_share(engine),
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "200 spheres at one place, by logarithms",
        measures: "least of the light that is left",
        formula: "exp(g_0) a(|g|) of the sum of 200 logarithms",
        runs: SOFT,
        textbook: || {
            let mut g = [0.0f32; ORDER];
            log_exp::log_cap(ORDER, 20f32.to_radians().sin().powi(2), &mut g);
            let g = g.map(|g| 200.0 * g);
            let x = g[1..].iter().map(|g| g * g).sum::<f32>().sqrt();
            let (a, _) = log_exp::linear_response(ORDER, f64::from(x));
            f64::from(naive::exponential(g[0] / (4.0 * std::f32::consts::PI).sqrt(), a.ln() as f32))
        },
        ours: |engine| stage(crowd(), Rung::Linear).least_share(engine),
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "200 wide spheres at one place, by logarithms",
        measures: "least of the light that is left",
        formula: "exp(g_0) a(|g|) = 0 times infinity",
        runs: SOFT,
        textbook: || {
            // 60 degrees each: the mean's exponent and the largest value that the rest can take.
            let mut g = [0.0f32; ORDER];
            log_exp::log_cap(ORDER, 60f32.to_radians().sin().powi(2), &mut g);
            let g = g.map(|g| 200.0 * g);
            let x = g[1..].iter().map(|g| g * g).sum::<f32>().sqrt();
            let (_, log_a) = (g[0], x * ORDER as f32 / (4.0 * std::f32::consts::PI).sqrt());
            f64::from(naive::exponential(g[0] / (4.0 * std::f32::consts::PI).sqrt(), log_a))
        },
        ours: |engine| {
            let wide = vec![(Vec3::new(0.0, 0.0, 0.12), 0.11); 200];
            stage(wide, Rung::Linear).least_share(engine)
        },
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "a sphere under the ground",
        measures: "least of the light that is left",
        formula: "sum V f+ to order 4: the lobe's lower half leaks",
        runs: SOFT,
        textbook: || {
            let (mut blocked, mut lambert) = ([0.0f32; ORDER], [0.0f32; ORDER]);
            zonal::cap(ORDER, 30f32.to_radians().sin().powi(2), &mut blocked);
            zonal::lambert(ORDER, &mut lambert);
            let sign = |l: usize| if l.is_multiple_of(2) { 1.0 } else { -1.0 };
            let taken: f32 = (0..ORDER).map(|l| sign(l) * blocked[l] * lambert[l]).sum();
            f64::from(1.0 - taken / (lambert[0] * (4.0 * std::f32::consts::PI).sqrt()))
        },
        ours: |engine| stage([(Vec3::new(0.0, 0.0, -0.4), 0.2)], Rung::Chain).least_share(engine),
        bound: CaseBound::exactly(1.0),
    },
    HardCase {
        name: "a sphere without a radius, where the receiver is",
        measures: "least of the light that is left",
        formula: "r/d = 0/0",
        runs: SOFT,
        textbook: || f64::from(naive::mean_visibility(0.0, 0.0)),
        ours: |engine| stage([(Vec3::ZERO, 0.0)], Rung::Chain).least_share(engine),
        bound: CaseBound::exactly(1.0),
    },
    HardCase {
        name: "spheres that are not a number",
        measures: "least of the light that is left",
        formula: "r/d = NaN in every sum after it",
        runs: SOFT,
        textbook: || f64::from(naive::mean_visibility(f32::NAN, 1.0)),
        ours: |engine| {
            let list = [(Vec3::NAN, 0.1), (Vec3::new(0.0, 0.0, 0.1), f32::NAN), (Vec3::INFINITY, 0.1)];
            stage(list, Rung::Directions).least_share(engine)
        },
        bound: CaseBound::exactly(1.0),
    },
    HardCase {
        name: "a sphere ten thousand radii away",
        measures: "what it hides over its true share",
        formula: "1 - sqrt(1 - (r/d)^2) = 1 - 1 in f32",
        runs: Where::Processor,
        textbook: || f64::from(1.0 - naive::mean_visibility(1e-4, 1.0)) / 2.5e-9,
        ours: |_| {
            let mut hidden = [0.0f32; 1];
            zonal::cap(1, 1e-8, &mut hidden);
            Ok(f64::from(hidden[0]) / (4.0 * std::f64::consts::PI).sqrt() / 2.5e-9)
        },
        bound: CaseBound::about(1.0, 1e-6),
    },
    HardCase {
        name: "200 spheres at one place, by the exact exponential",
        measures: "least of the light that is left",
        formula: "exp of the product matrix of 200 logarithms",
        runs: SOFT,
        textbook: || {
            let mut bands = [0.0f32; ORDER];
            log_exp::log_cap(ORDER, 20f32.to_radians().sin().powi(2), &mut bands);
            let mut g = [0.0f32; ORDER * ORDER];
            zonal::rotate(&bands.map(|g| 200.0 * g), [0.0, 0.0, 1.0], &mut g);
            let mut v = [0.0f32; ORDER * ORDER];
            log_exp::exact(ORDER, &g, &mut v);
            f64::from(v[0] / (4.0 * std::f32::consts::PI).sqrt())
        },
        ours: |engine| stage(crowd(), Rung::Squared).least_share(engine),
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "200 spheres at one place, by fixed directions",
        measures: "least of the light that is left (one sphere leaves 0.65)",
        formula: "V <- V V_1, 200 times: each product overshoots",
        runs: SOFT,
        textbook: || f64::from(naive::chain(ORDER, &cap_about_z(20f32.to_radians().sin()), 200)),
        ours: |engine| stage(crowd(), Rung::Directions).least_share(engine),
        bound: CaseBound::new(0.5, 0.8),
    },
];
