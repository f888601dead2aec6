//! Measured light and its two halves: what must hold for any environment picture, and through the points where a
//! direction comes and goes.

use crate::engines;
use halflight::{
    engine::{Engine, LightJob, MeasuredLight},
    light::{
        halve::{HalveOptions, halve_still},
        split::{SplitOptions, split},
    },
    math::sh::{MAX_COEFFICIENTS, basis, rotate::Rotation},
    model::{
        image::Image,
        light::{EnvironmentMap, HardLights, MapLayout, RadianceSh},
        quality::{Quality, SplitKind},
    },
};

const WIDTH: usize = 64;
const HEIGHT: usize = 32;
const SPLITS: [SplitKind; 4] = [SplitKind::Compact, SplitKind::Paper, SplitKind::Bounded, SplitKind::Sh];

fn even(radiance: f32) -> EnvironmentMap {
    EnvironmentMap { layout: MapLayout::Equirect, radiance: Image::filled(WIDTH, HEIGHT, [radiance; 3]) }
}

fn with(mut map: EnvironmentMap, texels: &[(usize, usize, [f32; 3])]) -> EnvironmentMap {
    for (column, row, rgb) in texels {
        *map.radiance.at_mut(*column, *row) = *rgb;
    }
    map
}

/// A sky, a floor and a window, different in each channel.
fn room() -> EnvironmentMap {
    let mut map = even(0.0);
    for row in 0..HEIGHT {
        for column in 0..WIDTH {
            let (u, v) = (column as f32 / WIDTH as f32, row as f32 / HEIGHT as f32);
            let window = if (0.2..0.3).contains(&u) && (0.3..0.45).contains(&v) { 8.0 } else { 0.0 };
            *map.radiance.at_mut(column, row) = [0.4 + u + window, 0.8 - 0.5 * v + window, 0.2 + 0.1 * u * v];
        }
    }
    map
}

fn opposite() -> EnvironmentMap {
    with(even(0.0), &[(5, 9, [1e4; 3]), (5 + WIDTH / 2, HEIGHT - 10, [1e4; 3])])
}

/// Hard environments, with names.
fn maps() -> Vec<(&'static str, EnvironmentMap)> {
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    vec![
        ("zero", even(0.0)),
        ("uniform", even(1.0)),
        ("a room", room()),
        ("two opposite suns", opposite()),
        ("one texel of 1e6", with(even(1.0), &[(20, 7, [1e6; 3])])),
        ("one texel of 1e6 in the dark", with(even(0.0), &[(20, 7, [1e6; 3])])),
        ("the texels at the zenith", with(even(0.1), &[(0, 0, [1e4; 3]), (WIDTH / 2, 0, [1e4; 3])])),
        ("the texels at the nadir", with(even(0.1), &[(3, HEIGHT - 1, [1e4; 3])])),
        ("the seam", with(even(0.1), &[(0, 16, [900.0; 3]), (WIDTH - 1, 16, [900.0; 3])])),
        ("a black channel", with(even(0.0), &[(9, 9, [50.0, 20.0, 0.0])])),
        ("opposed channels", with(even(0.2), &[(10, 8, [400.0, 500.0, 0.0]), (42, 23, [0.0, 0.0, 400.0])])),
        (
            "damaged",
            with(room(), &[(1, 1, [nan; 3]), (30, 9, [inf, 1.0, nan]), (31, 20, [-inf, -3.0, 1e30])]),
        ),
        ("all NaN", even(nan)),
        ("all infinite", even(inf)),
        ("half floats' largest", even(65_504.0)),
        ("hardly any", even(1e-30)),
    ]
}

fn measure(engine: &mut dyn Engine, map: &EnvironmentMap, order: usize) -> MeasuredLight {
    let quality = Quality { sh_order: order, ..Quality::default() };
    engine.estimate_light(&LightJob::Map(map), &quality).expect("a sound picture")
}

fn options(kind: SplitKind) -> HalveOptions {
    HalveOptions {
        kind,
        lights: 4,
        shadow_maps: 16,
        net_flux: SplitOptions::default(),
        above_horizon: false,
        dering: false,
    }
}

/// Flux of hard lights, each channel.
fn flux(hard: &HardLights) -> [f64; 3] {
    hard.as_slice()
        .iter()
        .fold([0.0; 3], |sum, light| std::array::from_fn(|c| sum[c] + f64::from(light.irradiance_rgb[c])))
}

/// Finite; hard lights are not negative and no more than there is; both halves together are the light.
fn bounds(engine: &mut dyn Engine) {
    for (name, map) in maps() {
        for order in [2, 4, 6] {
            let total = measure(engine, &map, order).total;
            assert!(total.rows().iter().flatten().all(|c| c.is_finite()), "{name}, order {order}: {total:?}");
            let all: [f64; 3] =
                std::array::from_fn(|c| f64::from(total.rgb[0][c]) * (4.0 * std::f64::consts::PI).sqrt());
            assert!(all.iter().all(|flux| *flux >= 0.0), "{name}: {all:?}");
            for kind in SPLITS {
                let what = format!("{name}, order {order}, {}", kind.name());
                let lights = halve_still(engine.measured_samples(), &total, options(kind));
                let mut sum = lights.global.rgb.map(|row| row.map(f64::from));
                for hard in lights.hard.as_slice() {
                    let w = hard.to_light_world.map(f64::from);
                    let length = w.iter().map(|c| c * c).sum::<f64>().sqrt();
                    assert!((length - 1.0).abs() < 1e-5, "{what}: {w:?}");
                    let irradiance = hard.irradiance_rgb;
                    assert!(irradiance.iter().all(|e| e.is_finite() && *e >= 0.0), "{what}: {irradiance:?}");
                    let mut y = [0.0f64; MAX_COEFFICIENTS];
                    basis::evaluate(order, w, &mut y);
                    for (row, y) in sum.iter_mut().zip(y).take(order * order) {
                        row.iter_mut().zip(irradiance).for_each(|(c, e)| *c += f64::from(e) * y);
                    }
                }
                let taken = flux(&lights.hard);
                for c in 0..3 {
                    // Rounding of sums of up to 16 lights.
                    assert!(taken[c] <= all[c] * (1.0 + 1e-5), "{what}: {taken:?} of {all:?}");
                    let both = sum[0][c] * (4.0 * std::f64::consts::PI).sqrt() / all[c];
                    // A compact light's hard lights have the irradiance of a plane that faces their middle: less than
                    // the flux of what they stand for, the wider they are.
                    let least = if kind == SplitKind::Compact { 0.9 } else { 1.0 - 2e-5 };
                    assert!(all[c] == 0.0 || (least..=1.0 + 2e-5).contains(&both), "{what}: {both}");
                }
                if kind != SplitKind::Compact {
                    // The compact split takes each light with its extent: only flux is the representatives' own.
                    for (sum, row) in sum.iter().zip(total.rows()) {
                        for c in 0..3 {
                            let off = (sum[c] - f64::from(row[c])).abs();
                            assert!(off <= 2e-6 * all[c] * order as f64, "{what}: {off:e} of {}", all[c]);
                        }
                    }
                }
            }
        }
    }
}

/// Powers of two scale every bit; other factors to rounding. From 1e-6 to 1e6.
fn scaled(engine: &mut dyn Engine) {
    for (name, map) in maps()
        .into_iter()
        .filter(|(name, _)| !name.contains("NaN") && !name.contains("inf") && !name.contains("damaged"))
    {
        let one = measure(engine, &map, 4).total;
        let halves = split(&one, &SplitOptions::default());
        for power in [-20i32, 20] {
            let factor = 2f32.powi(power);
            let mut other = map.clone();
            other.radiance.pixels_mut().iter_mut().for_each(|rgb| *rgb = rgb.map(|c| c * factor));
            let light = measure(engine, &other, 4).total;
            if name != "hardly any" {
                let want = one.rgb.map(|row| row.map(|c| c * factor));
                assert_eq!(light.rgb, want, "{name} times 2^{power}");
            }
            let direct = split(&light, &SplitOptions::default()).direct;
            assert_eq!(
                direct.map(|d| d.to_light_world),
                halves.direct.map(|d| d.to_light_world),
                "{name} 2^{power}"
            );
        }
        for factor in [1e-6f32, 1e6] {
            let mut other = map.clone();
            other.radiance.pixels_mut().iter_mut().for_each(|rgb| *rgb = rgb.map(|c| c * factor));
            let light = measure(engine, &other, 4).total;
            for (a, b) in light.rgb.as_flattened().iter().zip(one.rgb.as_flattened()) {
                let size = (one.rgb[0][0] + one.rgb[0][1] + one.rgb[0][2]) * factor;
                assert!(
                    (a - b * factor).abs() <= 2e-6 * size,
                    "{name} times {factor}: {a} for {}",
                    b * factor
                );
            }
        }
    }
}

/// Channels exchanged in the picture are exchanged in the light, to the bit.
fn exchanged(engine: &mut dyn Engine) {
    for (name, map) in maps() {
        let one = measure(engine, &map, 4).total;
        let mut other = map.clone();
        other.radiance.pixels_mut().iter_mut().for_each(|rgb| *rgb = [rgb[2], rgb[0], rgb[1]]);
        let light = measure(engine, &other, 4).total;
        assert_eq!(light.rgb, one.rgb.map(|rgb| [rgb[2], rgb[0], rgb[1]]), "{name}");
    }
}

/// A picture turned about the vertical gives the light turned.
fn turned(engine: &mut dyn Engine) {
    for (name, map) in maps().into_iter().filter(|(name, _)| !name.contains("damaged")) {
        let one = measure(engine, &map, 4).total;
        for quarters in 1..4usize {
            let mut other = map.clone();
            let shift = quarters * WIDTH / 4;
            for row in 0..HEIGHT {
                for column in 0..WIDTH {
                    *other.radiance.at_mut((column + shift) % WIDTH, row) = *map.radiance.at(column, row);
                }
            }
            let light = measure(engine, &other, 4).total;
            let (sin, cos) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters];
            let rotation = Rotation::<f32>::new(4, [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]);
            let mut want = RadianceSh::zero(4);
            rotation.apply_rows(one.rows(), &mut want.rgb[..16]);
            let size = one.rgb[0].iter().sum::<f32>();
            for (a, b) in light.rgb.as_flattened().iter().zip(want.rgb.as_flattened()) {
                // Texel centres, rounded to f32, are not turned to the bit.
                assert!((a - b).abs() <= 1e-6 * size, "{name}, {quarters} quarters: {a} for {b}");
            }
        }
    }
}

/// E_d w_d of the split by net flux.
fn vector(light: &RadianceSh, options: &SplitOptions) -> [f64; 3] {
    split(light, options).direct.map_or([0.0; 3], |d| {
        let e: f64 = d.irradiance_rgb.iter().map(|e| f64::from(*e)).sum();
        d.to_light_world.map(|c| e * f64::from(c))
    })
}

/// A small change of the light is a small change of its hard half, through the point where there is no direction.
fn continuous(engine: &mut dyn Engine) {
    const STEPS: i32 = 200;
    for bounded in [false, true] {
        let options = SplitOptions { bounded, ..SplitOptions::default() };
        let (mut before, mut worst, mut largest) = (None::<[f64; 3]>, 0.0f64, 0.0f64);
        for step in -STEPS..=STEPS {
            let x = step as f32 / STEPS as f32 * 0.05;
            let map = with(opposite(), &[(5, 9, [1e4 * (1.0 + x); 3])]);
            let light = measure(engine, &map, 4).total;
            let all: f64 =
                light.rgb[0].iter().map(|c| f64::from(*c)).sum::<f64>() * (4.0 * std::f64::consts::PI).sqrt();
            let now = vector(&light, &options).map(|c| c / all);
            largest = largest.max(now.iter().map(|c| c * c).sum::<f64>().sqrt());
            if let Some(before) = before {
                let moved = before.iter().zip(now).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                worst = worst.max(moved);
            }
            before = Some(now);
        }
        println!("bounded {bounded}: at most {largest:.2e} of the light, steps of {worst:.2e}");
        // A step moves half of 2.5e-4 of the light from one side to the other; the fade adds its slope (measured 2.6e-4).
        assert!(worst < 4e-4, "{worst:e}");
        assert!(bounded || largest > 0.02, "{largest:e}");
    }
}

/// More texels than many devices take in one piece (128 MiB).
fn large(engine: &mut dyn Engine) {
    let map =
        EnvironmentMap { layout: MapLayout::Equirect, radiance: Image::filled(4096, 2112, [1.0, 1e6, 0.0]) };
    let light = measure(engine, &map, 2).total;
    for (c, want) in light.rgb[0].iter().zip([1.0, 1e6, 0.0]) {
        let mean = f64::from(*c) / (4.0 * std::f64::consts::PI).sqrt();
        // Solid angles of 8.6 million texels, rounded to f32, and their sum as a tree.
        assert!((mean - want).abs() <= 1e-6 * want, "{mean} for {want}");
    }
}

pub fn all(engine: &mut dyn Engine) {
    bounds(engine);
    scaled(engine);
    exchanged(engine);
    turned(engine);
    continuous(engine);
    large(engine);
}

engines::on_each!("light::gl");
