//! Light that has no direction, one at a pole, or numbers in it that are none.

use crate::engine::{Engine, EngineError, LightJob};
use crate::light::{
    halve::{HalveOptions, halve_still},
    maps::samples_of_map,
    project_sh::project_sh,
    split::{Estimator, GRAY_PAPER, SplitOptions, first_moment, irradiance as estimate, split},
    unwrap_ball::BallShot,
};
use crate::math::{
    lens::Lens,
    pose::Pose,
    sh::{MAX_COEFFICIENTS, basis},
};
use crate::model::{
    image::HdrImage,
    light::{EnvironmentMap, RadianceSamples, RadianceSh, SplitLight},
    quality::{Quality, SplitKind},
    rig::MirrorBall,
};
use crate::plan::Pass;
use crate::stress::{
    CaseBound, HardCase, Where, naive,
    stage::{ORDER, even_map, mean_radiance, measure},
};
use glam::DVec3;
use std::f32::consts::PI;

const PROJECT: Where = Where::Kernel(Pass::ProjectSh);
const UNWRAP: Where = Where::Kernel(Pass::UnwrapBall);

/// 2 asin(sin psi / q) - psi for tan psi = r tan(asin q), q = 0.1, r = 1/2.
const HALF_WAY_DEG: f64 = 57.373;

/// Size of the environment pictures, texels.
const WIDTH: usize = 64;
const HEIGHT: usize = 32;

/// The light in a picture by the twin, for the textbook's formulas to work on.
fn twin(map: &EnvironmentMap) -> RadianceSh {
    let mut samples = RadianceSamples::default();
    samples_of_map(map, &mut samples);
    project_sh(&samples, ORDER)
}

fn moment(light: &RadianceSh, channel: usize) -> [f32; 3] {
    first_moment(light.rgb[1][channel], light.rgb[2][channel], light.rgb[3][channel])
}

/// By net flux, as the paper has it, corrected.
fn halves(light: &RadianceSh) -> SplitLight {
    split(light, &SplitOptions::default())
}

/// E_d of a channel; 0 without a hard half.
fn irradiance(light: &RadianceSh, channel: usize) -> f64 {
    halves(light).direct.map_or(0.0, |d| f64::from(d.irradiance_rgb[channel]))
}

/// Some texels of a black picture lit: column, row and radiance.
fn texels(lit: &[(usize, usize, [f32; 3])]) -> EnvironmentMap {
    let mut map = even_map(WIDTH, HEIGHT, 0.0);
    for (column, row, radiance_rgb) in lit {
        *map.radiance.at_mut(*column, *row) = *radiance_rgb;
    }
    map
}

/// Two opposite suns; the first has `share` of the second.
fn opposite(share: f32) -> EnvironmentMap {
    texels(&[(5, 9, [1e4 * share; 3]), (5 + WIDTH / 2, HEIGHT - 10, [1e4; 3])])
}

/// How far E_d w_d moves where one of two opposite suns fades by a millionth, over the light of both.
fn moved(engine: &mut dyn Engine) -> Result<f64, EngineError> {
    let mut vectors = [[0.0f64; 3]; 2];
    let mut all = 0.0;
    for (vector, share) in vectors.iter_mut().zip([1.0 - 1e-6, 1.0 + 1e-6]) {
        let light = measure(engine, &opposite(share))?.total;
        all = mean_radiance(&light) * 4.0 * std::f64::consts::PI;
        if let Some(direct) = halves(&light).direct {
            let e = f64::from(direct.irradiance_rgb[1]);
            *vector = direct.to_light_world.map(|c| e * f64::from(c));
        }
    }
    let square: f64 = vectors[0].iter().zip(vectors[1]).map(|(a, b)| (a - b) * (a - b)).sum();
    Ok(square.sqrt() / all)
}

/// Sun from one side in red and green, from the other in blue, which is weak.
fn opposed() -> EnvironmentMap {
    let mut map = even_map(WIDTH, HEIGHT, 0.2);
    *map.radiance.at_mut(10, 8) = [400.0, 500.0, 0.0];
    *map.radiance.at_mut(10 + WIDTH / 2, HEIGHT - 9) = [0.0, 0.0, 400.0];
    map
}

/// E_d of a sun and some sky, all times `scale`, over `scale`.
fn scaled(engine: &mut dyn Engine, scale: f32) -> Result<f64, EngineError> {
    let mut map = even_map(WIDTH, HEIGHT, scale);
    *map.radiance.at_mut(10, 8) = [500.0 * scale; 3];
    Ok(irradiance(&measure(engine, &map)?.total, 1) / f64::from(scale))
}

/// Texels of the pictures whose sums are long.
const LONG_WIDTH: usize = 1024;
const LONG_HEIGHT: usize = 512;

/// Radiance 1 all over, and one texel of 1e6.
fn long_map() -> EnvironmentMap {
    let mut map = even_map(LONG_WIDTH, LONG_HEIGHT, 1.0);
    *map.radiance.at_mut(300, 100) = [1e6; 3];
    map
}

/// Mean radiance of [`long_map`]: each texel's share is exact to f64.
fn long_truth() -> f64 {
    let omega = crate::math::sphere::equirect_row_solid_angle(LONG_WIDTH, LONG_HEIGHT, 100);
    1.0 + (1e6 - 1.0) * omega / (4.0 * std::f64::consts::PI)
}

/// Rows of a picture whose first row is 1e-4 from the zenith.
const FINE: usize = 16_384;

fn damaged(radiance_rgb: [f32; 3]) -> EnvironmentMap {
    let mut map = even_map(WIDTH, HEIGHT, 1.0);
    *map.radiance.at_mut(20, 12) = radiance_rgb;
    map
}

/// A white sky over a black floor.
fn overcast() -> EnvironmentMap {
    let mut map = even_map(WIDTH, HEIGHT, 1.0);
    map.radiance.pixels_mut()[WIDTH * HEIGHT / 2..].fill([0.0; 3]);
    map
}

/// A mirror ball of a tenth of the distance, in a picture that is seen from outside of it: radiance by column and row.
fn ball(engine: &mut dyn Engine, radiance: impl Fn(usize, usize) -> f32) -> Result<RadianceSh, EngineError> {
    const SIDE: u32 = 128;
    let lens = Lens::pinhole(SIDE, SIDE, 580.0, 580.0, 64.0, 64.0);
    let ball = MirrorBall {
        centre_world: DVec3::ZERO,
        radius_m: 0.05,
        reflectance_rgb: [1.0; 3],
        surface_radius_m: None,
    };
    let mut picture = HdrImage::default();
    picture.radiance.reshape(SIDE as usize, SIDE as usize, [0.0; 3]);
    picture.flags.reshape(SIDE as usize, SIDE as usize, 0);
    for row in 0..SIDE as usize {
        for column in 0..SIDE as usize {
            *picture.radiance.at_mut(column, row) = [radiance(column, row); 3];
        }
    }
    // From -x: what is behind the camera is reflected in the middle.
    let job = LightJob::Ball(BallShot {
        picture: &picture,
        lens: &lens,
        world_from_camera: &Pose::look_at(DVec3::new(-0.5, 0.0, 0.0), DVec3::ZERO, DVec3::Z),
        ball: &ball,
        on_surface: false,
        without_ball: None,
    });
    let quality = Quality { sh_order: ORDER, ..Quality::default() };
    Ok(engine.estimate_light(&job, &quality)?.total)
}

/// The angle between the camera's axis and the direction that a lit spot half way to the ball's outline reflects.
fn half_way_deg(engine: &mut dyn Engine) -> Result<f64, EngineError> {
    // The outline is 580 tan(asin 0.1) = 58.3 pixels from the middle; the spot is 29.15 to the right.
    let spot = |column: usize, row: usize| {
        let (x, y) = (column as f32 + 0.5 - 64.0 - 29.15, row as f32 + 0.5 - 64.0);
        (1.5 - x.hypot(y)).clamp(0.0, 1.0)
    };
    let light = ball(engine, spot)?;
    let d = moment(&light, 1).map(f64::from);
    let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
    Ok((-d[0] / length).acos().to_degrees())
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "no light at all",
        measures: "irradiance of the hard light",
        formula: "w = d / |d| = 0/0",
        runs: PROJECT,
        textbook: || {
            let d = [0.0; 3];
            f64::from(naive::irradiance(d, naive::direction(d)))
        },
        ours: |engine| Ok(irradiance(&measure(engine, &even_map(WIDTH, HEIGHT, 0.0))?.total, 1)),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "the same light from everywhere",
        measures: "irradiance of the hard light, radiance 1",
        formula: "E = 4 pi L(w) / n^2: a sun that is not there",
        runs: PROJECT,
        textbook: || f64::from(4.0 * PI * 1.0 / (ORDER * ORDER) as f32),
        ours: |engine| Ok(irradiance(&measure(engine, &even_map(WIDTH, HEIGHT, 1.0))?.total, 1)),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "two opposite suns, one fades by a millionth",
        measures: "step of E_d w_d over all light",
        formula: "w = d / |d|, E from all bands: the light changes sides",
        runs: PROJECT,
        textbook: || {
            let of = |share| {
                let light = twin(&opposite(share));
                let w = naive::direction(moment(&light, 1));
                let e = estimate(ORDER, light.rows(), w, Estimator::AllBands)[1];
                (w.map(|c| e * c), mean_radiance(&light) * 4.0 * std::f64::consts::PI)
            };
            let ((a, all), (b, _)) = (of(1.0 - 1e-6), of(1.0 + 1e-6));
            let square: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            square.sqrt() / all
        },
        ours: moved,
        bound: CaseBound::new(0.0, 1e-5),
    },
    HardCase {
        name: "one texel of 1e6 among half a million",
        measures: "relative error of the mean radiance",
        formula: "one running sum in f32",
        runs: PROJECT,
        textbook: || {
            let omega =
                |row| crate::math::sphere::equirect_row_solid_angle(LONG_WIDTH, LONG_HEIGHT, row) as f32;
            let map = long_map();
            let each =
                (0..LONG_HEIGHT).flat_map(|row| map.radiance.row(row).iter().map(move |c| c[1] * omega(row)));
            (f64::from(naive::running_sum(each)) / (4.0 * std::f64::consts::PI) / long_truth() - 1.0).abs()
        },
        ours: |engine| Ok((mean_radiance(&measure(engine, &long_map())?.total) / long_truth() - 1.0).abs()),
        // Sums of 16 or 64 in a row, then a tree.
        bound: CaseBound::new(0.0, 1e-6),
    },
    HardCase {
        name: "a texel that is not a number",
        measures: "mean radiance (1 without it)",
        formula: "sum L y: NaN in every coefficient",
        runs: PROJECT,
        textbook: || {
            let map = damaged([f32::NAN; 3]);
            let count = (WIDTH * HEIGHT) as f32;
            f64::from(naive::running_sum(map.radiance.pixels().iter().map(|c| c[1])) / count)
        },
        ours: |engine| Ok(mean_radiance(&measure(engine, &damaged([f32::NAN; 3]))?.total)),
        // One of 2048, at most pi / 2 times as large as the mean.
        bound: CaseBound::new(0.999, 1.0),
    },
    HardCase {
        name: "a texel of infinity",
        measures: "first moment along x",
        formula: "sum L y: inf - inf and inf * 0",
        runs: PROJECT,
        textbook: || {
            let map = damaged([f32::INFINITY; 3]);
            f64::from(naive::running_sum(map.radiance.pixels().iter().map(|c| c[1] * 0.0)))
        },
        ours: |engine| Ok(f64::from(measure(engine, &damaged([f32::INFINITY; 3]))?.total.rgb[3][1])),
        // 64000 in its place, in one texel of 0.0095 sr.
        bound: CaseBound::new(-700.0, 700.0),
    },
    HardCase {
        name: "a channel that is black",
        measures: "irradiance of the hard light in blue",
        formula: "a direction for each channel, d / |d| = 0/0",
        runs: PROJECT,
        textbook: || {
            let d = [0.0; 3];
            f64::from(naive::irradiance(d, naive::direction(d)))
        },
        ours: |engine| {
            let map = texels(&[(10, 8, [300.0, 200.0, 0.0])]);
            Ok(irradiance(&measure(engine, &map)?.total, 2))
        },
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "blue light from the other side",
        measures: "irradiance of the hard light in blue",
        formula: "E = d . w in each channel, w from gray: below zero",
        runs: PROJECT,
        textbook: || {
            let light = twin(&opposed());
            let gray = std::array::from_fn(|k| {
                GRAY_PAPER.iter().enumerate().map(|(c, weight)| weight * moment(&light, c)[k]).sum()
            });
            f64::from(naive::irradiance(moment(&light, 2), naive::direction(gray)))
        },
        ours: |engine| Ok(irradiance(&measure(engine, &opposed())?.total, 2)),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "a sun 1e-4 from the zenith",
        measures: "angle to the zenith over its true size",
        formula: "theta = acos(z), z = 1 in f32",
        runs: PROJECT,
        textbook: || {
            let truth = 0.5 * PI / FINE as f32;
            f64::from(naive::polar_angle(truth.cos()) / truth)
        },
        ours: |engine| {
            let mut map = even_map(4, FINE, 0.0);
            *map.radiance.at_mut(2, 0) = [1e6; 3];
            let light = measure(engine, &map)?.total;
            let d = moment(&light, 1).map(f64::from);
            let truth = 0.5 * std::f64::consts::PI / FINE as f64;
            Ok(d[0].hypot(d[1]) / d[2] / truth)
        },
        bound: CaseBound::about(1.0, 1e-5),
    },
    HardCase {
        name: "the zenith itself",
        measures: "y_1 towards +z, largest error of the three",
        formula: "phi = atan2(y, x), d theta = cross(z, w) / |cross(z, w)| = 0/0",
        runs: Where::Processor,
        textbook: || f64::from(naive::right_of([0.0, 0.0, 1.0])[0]),
        ours: |_| {
            let mut y = [0.0f32; MAX_COEFFICIENTS];
            basis::evaluate(2, [0.0f32, 0.0, 1.0], &mut y);
            let truth = [0.0, (0.75 / std::f64::consts::PI).sqrt(), 0.0];
            Ok(y[1..4].iter().zip(truth).map(|(y, t)| (f64::from(*y) - t).abs()).fold(0.0, f64::max))
        },
        bound: CaseBound::new(0.0, 1e-7),
    },
    HardCase {
        name: "light of a millionth",
        measures: "E_d times 1e6, over E_d of the same light times 1",
        formula: "w = d / (|d| + 1e-4): the usual epsilon",
        runs: PROJECT,
        textbook: || {
            let d = |scale: f32| [0.0, 0.0, 3.0 * scale];
            let e =
                |scale| naive::irradiance(d(scale), naive::direction_with_epsilon(d(scale), 1e-4)) / scale;
            f64::from(e(1e-6) / e(1.0))
        },
        ours: |engine| Ok(scaled(engine, 1e-6)? / scaled(engine, 1.0)?),
        bound: CaseBound::about(1.0, 1e-6),
    },
    HardCase {
        name: "light times a million",
        measures: "E_d over 1e6, over E_d of the same light times 1",
        formula: "in half floats: infinity",
        runs: PROJECT,
        textbook: || f64::from(naive::half(500.0 * 1e6) / naive::half(500.0) / 1e6),
        ours: |engine| Ok(scaled(engine, 1e6)? / scaled(engine, 1.0)?),
        bound: CaseBound::about(1.0, 1e-6),
    },
    HardCase {
        name: "the outline of the mirror ball",
        measures: "mean radiance of a ball that is 1 all over",
        formula: "solid angles by the place: (1 - r)^(-1/2) at the outline",
        runs: UNWRAP,
        textbook: || f64::from(naive::ball_jacobian(0.1, 1.0)),
        ours: |engine| Ok(mean_radiance(&ball(engine, |_, _| 1.0)?)),
        bound: CaseBound::about(1.0, 1e-5),
    },
    HardCase {
        name: "a picture of a mirror ball, half way out",
        measures: "angle to the camera's axis, degrees (57.4 by reflection)",
        formula: "theta = pi r, as of an angular map",
        runs: UNWRAP,
        textbook: || f64::from(naive::angular_map_angle(0.5).to_degrees()),
        ours: half_way_deg,
        bound: CaseBound::about(HALF_WAY_DEG, 0.3),
    },
    HardCase {
        name: "a mirror ball with pixels that are no numbers",
        measures: "mean radiance of a ball that is 1 elsewhere",
        formula: "sum L y: NaN in every coefficient",
        runs: UNWRAP,
        textbook: || f64::from(naive::running_sum([1.0, f32::NAN, 1.0])),
        ours: |engine| {
            let odd = |column: usize, row: usize| {
                if (column * 7 + row).is_multiple_of(31) { f32::NAN } else { 1.0 }
            };
            Ok(mean_radiance(&ball(engine, odd)?))
        },
        bound: CaseBound::about(1.0, 1e-3),
    },
    HardCase {
        name: "a white sky over a black floor",
        measures: "share of the sky that is called a sun",
        formula: "E = |d|, the net flux: all of it",
        runs: PROJECT,
        textbook: || {
            // d of half a sphere of radiance 1 is pi; its irradiance on the ground is pi.
            let d = [0.0, 0.0, PI];
            f64::from(naive::irradiance(d, naive::direction(d)) / PI)
        },
        ours: |engine| {
            let light = measure(engine, &overcast())?.total;
            let options = HalveOptions {
                kind: SplitKind::Compact,
                lights: 4,
                shadow_maps: 8,
                net_flux: SplitOptions::default(),
                above_horizon: true,
                dering: false,
            };
            let lights = halve_still(engine.measured_samples(), &light, options);
            let hard: f64 = lights.hard.as_slice().iter().map(|h| f64::from(h.irradiance_rgb[1])).sum();
            Ok(hard / std::f64::consts::PI)
        },
        bound: CaseBound::new(0.0, 0.05),
    },
];
