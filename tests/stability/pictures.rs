//! Soft shadows, hard shadows and gloss as they are drawn, on every engine.

use crate::{engines, odd, support::wanted};
use glam::{Affine3A, DVec3, Quat, Vec3};
use halflight::{
    assets::shapes,
    engine::Engine,
    model::{
        blocker::Rung,
        image::RadianceImage,
        light::{Lights, RadianceSh},
        quality::Quality,
        scene::{Material, Scene},
    },
    stress::stage::{ORDER, StressStage, ground, object, object_over_ground, spheres, sun, uniform},
};

const WHITE: Material = Material::Lambert { albedo_rgb: [1.0; 3] };

fn draw(engine: &mut dyn Engine, stage: &StressStage) -> RadianceImage {
    stage.draw(engine).expect("a sound frame").radiance
}

/// Every number a share.
fn assert_shares(picture: &RadianceImage, what: &str) {
    for c in picture.pixels().as_flattened() {
        assert!((0.0..=1.0).contains(c), "{what}: {c}");
    }
}

/// Every number finite and not negative.
fn assert_sound(picture: &RadianceImage, what: &str) {
    for c in picture.pixels().as_flattened() {
        assert!(c.is_finite() && *c >= 0.0, "{what}: {c}");
    }
}

fn largest_difference(a: &RadianceImage, b: &RadianceImage) -> f32 {
    let pairs = a.pixels().as_flattened().iter().zip(b.pixels().as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn mean_difference(a: &RadianceImage, b: &RadianceImage) -> f32 {
    let (a, b) = (a.pixels().as_flattened(), b.pixels().as_flattened());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32
}

fn soft(list: impl IntoIterator<Item = (Vec3, f32)>, rung: Rung, order: usize) -> StressStage {
    let mut global = RadianceSh::zero(order);
    for (i, row) in global.rgb.iter_mut().enumerate().take(order * order) {
        let x = 0.15 * ((i * 7 % 5) as f32 - 2.0);
        *row = if i == 0 { [4.0, 3.5, 3.0] } else { [x, 0.5 * x, -x] };
    }
    let stage = StressStage::new(spheres(list), Lights::soft(global));
    StressStage { quality: Quality { rung, sh_order: order, ..stage.quality }, size_px: [32, 24], ..stage }
}

/// Piles, spheres that touch and hold receivers, under the horizon, of no size: shares, with every rung and order.
fn spheres_leave_shares(engine: &mut dyn Engine) {
    let at = |z: f32| Vec3::new(0.02, 0.01, z);
    let piles: [(&str, Vec<(Vec3, f32)>); 8] = [
        ("touching", vec![(at(0.1), 0.1)]),
        ("holding", vec![(at(0.02), 0.4)]),
        ("its middle in the ground", vec![(at(0.0), 0.1)]),
        ("200 at one place", vec![(at(0.2), 0.12); 200]),
        ("200 within a millimetre", (0..200).map(|k| (at(0.2 + 5e-6 * k as f32), 0.12)).collect()),
        ("under the ground", vec![(at(-0.3), 0.2), (at(-0.1), 0.1)]),
        ("no size", vec![(at(0.1), 0.0), (at(0.0), 1e-30), (at(0.2), 1e-6)]),
        ("as large as the world", vec![(at(1e6), 1e6), (at(-1e6), 1e6), (at(0.0), 1e12)]),
    ];
    for (name, pile) in &piles {
        for rung in Rung::ALL {
            for order in [2, 4, 6] {
                let picture = draw(engine, &soft(pile.iter().copied(), rung, order));
                assert_shares(&picture, &format!("{name}, {}, order {order}", rung.name()));
            }
        }
    }
}

/// A sphere that sinks through the ground, and one that grows from nothing: small steps, small changes. Where its tip goes
/// under the horizon a sphere no longer counts; before that it hides the lower hemisphere from receivers there, which only
/// exact products know to be nothing: the mean's own rung takes half of the light for it, the logarithm's a third.
fn spheres_move_smoothly(engine: &mut dyn Engine) {
    for rung in Rung::ALL {
        // Down: held on the way by a receiver inside, and skipped under the horizon.
        let mut before: Option<RadianceImage> = None;
        let mut worst = 0.0f32;
        for step in 0..=120 {
            let z = 0.2977 - 0.005 * step as f32;
            let picture = draw(engine, &soft([(Vec3::new(0.0, 0.0, z), 0.1)], rung, 4));
            assert_shares(&picture, rung.name());
            if let Some(before) = &before {
                worst = worst.max(largest_difference(before, &picture));
            }
            before = Some(picture);
        }
        println!("{}: sinking by 5 mm changes at most {worst:.3}", rung.name());
        wanted::hold(&format!("stability.sinking.{}", rung.name()), f64::from(worst));
        // Growing.
        let open = draw(engine, &soft([], rung, 4));
        let tiny = draw(engine, &soft([(Vec3::new(0.0, 0.0, 0.1), 1e-5)], rung, 4));
        assert!(largest_difference(&open, &tiny) < 1e-4, "{}", rung.name());
        // A thousandth of the distance: its true share is 1e-6 of the sky, 4e-6 of the light if it stands above.
        let small = draw(engine, &soft([(Vec3::new(0.0, 0.0, 0.1), 1e-4)], rung, 4));
        let taken = largest_difference(&open, &small);
        println!("{}: a thousandth of its distance wide it takes {taken:.1e}", rung.name());
        assert!(taken < 1e-4, "{}: {taken}", rung.name());
        let (mut before, mut worst) = (open, 0.0f32);
        for step in 1..=30 {
            let radius = 0.15 * (step as f32 / 30.0).powi(2);
            let picture = draw(engine, &soft([(Vec3::new(0.0, 0.0, 0.1), radius)], rung, 4));
            worst = worst.max(largest_difference(&before, &picture));
            before = picture;
        }
        println!("{}: growing by up to 1 cm changes at most {worst:.3}", rung.name());
        assert!(worst < 0.3, "{}: {worst}", rung.name());
    }
}

/// Light in another unit, and the whole scene turned or in another unit of length: the same shares.
fn shares_do_not_depend_on_units(engine: &mut dyn Engine) {
    let list = [
        (Vec3::new(0.0, 0.0, 0.1), 0.1),
        (Vec3::new(0.2, 0.1, 0.2), 0.08),
        (Vec3::new(-0.1, 0.2, 0.02), 0.05),
    ];
    for rung in Rung::ALL {
        let plain = soft(list, rung, 4);
        let one = draw(engine, &plain);
        assert!(one.pixels().iter().any(|p| p[0] < 0.8), "hardly any shadow");
        for factor in [1e-6f32, 2f32.powi(-20), 2f32.powi(20), 1e6] {
            let mut other = plain.clone();
            other.light.global.rgb.iter_mut().for_each(|row| *row = row.map(|c| c * factor));
            let off = largest_difference(&one, &draw(engine, &other));
            assert!(off < 2e-6, "{}, light times {factor}: {off:e}", rung.name());
        }
        for factor in [0.1, 4.0] {
            let mut other = soft(list.map(|(at, r)| (at * factor as f32, r * factor as f32)), rung, 4);
            other.eye_world *= factor;
            other.target_world *= factor;
            let off = largest_difference(&one, &draw(engine, &other));
            // cos(half angle) = sqrt(1 - r^2/d^2) makes 3e-4 of a rounding of 1e-7 where a sphere touches.
            assert!(off < 2e-3, "{}, lengths times {factor}: {off:e}", rung.name());
        }
        // A light that is the same about the vertical, and scene and camera turned by an odd angle.
        let upright = |list: Vec<(Vec3, f32)>| {
            let mut stage = soft(list, rung, 4);
            for (i, row) in stage.light.global.rgb.iter_mut().enumerate() {
                let l = i.isqrt();
                if i != l * l + l {
                    *row = [0.0; 3];
                }
            }
            stage
        };
        let one = draw(engine, &upright(list.to_vec()));
        let turn = Quat::from_rotation_z(0.7);
        let mut other = upright(list.iter().map(|(at, r)| (turn * *at, *r)).collect());
        other.eye_world = turn.as_dquat() * other.eye_world;
        other.target_world = turn.as_dquat() * other.target_world;
        let off = largest_difference(&one, &draw(engine, &other));
        // The rung of fixed directions has them where they are: half of its own error.
        let most = if rung == Rung::Directions { 0.06 } else { 2e-3 };
        assert!(off < most, "{}, turned: {off:e}", rung.name());
    }
}

fn from_zenith(degrees: f32) -> Vec3 {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    Vec3::new(0.8 * sine, 0.6 * sine, cosine)
}

fn boxed(light: Lights) -> StressStage {
    let one = object("box", shapes::cuboid(DVec3::splat(0.05)), WHITE, Vec3::new(0.0, 0.0, 0.05));
    let mut stage = StressStage::new(object_over_ground(one), light);
    stage.size_px = [32, 24];
    stage.quality.shadow_map_texels = 128;
    stage
}

/// The ground alone: the box is there, but only its shadow is drawn.
fn shadow_of_box(light: Lights) -> StressStage {
    let stage = boxed(light);
    // Black objects hide the ground without light of their own.
    let mut scene = stage.scene.clone();
    scene.objects[0].material = Material::Lambert { albedo_rgb: [0.0; 3] };
    StressStage { scene, ..stage }
}

/// From the zenith through the horizon, and through each pole: shares, and small steps.
fn hard_light_goes_round(engine: &mut dyn Engine) {
    let (mut before, mut worst) = (None::<RadianceImage>, 0.0f32);
    for step in -60..=60 {
        // 0.1 degrees each, through 90.
        let light = sun(from_zenith(90.0 + 0.1 * step as f32), 1.0);
        let picture = draw(engine, &shadow_of_box(Lights { global: uniform(0.1).global, ..light }));
        assert_shares(&picture, "through the horizon");
        if let Some(before) = &before {
            worst = worst.max(largest_difference(before, &picture));
        }
        before = Some(picture);
    }
    println!("through the horizon: at most {worst:.3} for a tenth of a degree");
    // Measured 0.11, at a shadow's edge.
    assert!(worst < 0.2, "{worst}");
    for pole in [Vec3::Z, Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y] {
        let lift = if pole == Vec3::Z { Vec3::ZERO } else { Vec3::new(0.0, 0.0, 0.6) };
        let across = pole.any_orthonormal_vector();
        let (mut before, mut worst) = (None::<RadianceImage>, 0.0f32);
        for step in -20..=20 {
            let w = (pole + lift + 5e-4 * step as f32 * across).normalize();
            let picture = draw(engine, &shadow_of_box(sun(w, 1.0)));
            assert_shares(&picture, "through a pole");
            assert!(picture.pixels().iter().any(|p| p[0] == 0.0), "no shadow at {w}");
            if let Some(before) = &before {
                worst = worst.max(mean_difference(before, &picture));
            }
            before = Some(picture);
        }
        println!("through {pole}: {worst:.1e} in the mean for half a thousandth");
        // Measured 4.5e-4: an edge that passes pixels' middles.
        assert!(worst < 1e-3, "{pole}: {worst:e}");
    }
}

/// Casters without area, without end, and through the camera; lights without direction or power.
fn odd_casters_and_lights(engine: &mut dyn Engine) {
    let lights = [
        ("up", sun(Vec3::Z, 1.0)),
        ("grazing", sun(from_zenith(89.9), 1.0)),
        ("below", sun(Vec3::NEG_Z, 1.0)),
        ("none", sun(Vec3::ZERO, 1.0)),
        ("NaN", sun(Vec3::NAN, 1.0)),
        ("of infinite power", sun(Vec3::Z, f32::INFINITY)),
        ("of no power", sun(Vec3::Z, 0.0)),
        ("of negative power", sun(Vec3::Z, -3.0)),
        ("of NaN", sun(Vec3::Z, f32::NAN)),
        ("beyond 1e30", sun(Vec3::Z, 1e30)),
        ("of 1e-38", sun(Vec3::Z, 1e-38)),
    ];
    for (name, mesh) in odd::meshes() {
        for (light_name, light) in &lights {
            let what = format!("{name}, a light {light_name}");
            let scene = object_over_ground(object("odd", mesh.clone(), WHITE, Vec3::ZERO));
            let stage = StressStage { size_px: [24, 18], ..StressStage::new(scene, *light) };
            assert_sound(&draw(engine, &stage), &what);
        }
    }
}

/// Gloss of every exponent: no light is made, nothing is not finite, small steps of the exponent are small changes.
fn gloss_of_every_exponent(engine: &mut dyn Engine) {
    let ball = |exponent: f32, light: Lights| {
        let material = Material::Phong { albedo_rgb: [0.0; 3], specular_rgb: [1.0; 3], exponent };
        let one = object("ball", shapes::uv_sphere(0.1, 32, 16), material, Vec3::new(0.0, 0.0, 0.1));
        let scene = Scene { objects: vec![one], ..Scene::default() };
        StressStage { background: 0.0, size_px: [24, 18], ..StressStage::new(scene, light) }
    };
    let exponents = [0.0, 1e-30, 1e-3, 0.5, 1.0, 2.0, 3.0, 10.0, 30.0, 100.0, 1e3, 1e4, 1e5];
    for exponent in exponents {
        let furnace = draw(engine, &ball(exponent, uniform(1.0)));
        for c in furnace.pixels().as_flattened() {
            // 11 bits in the layer of objects.
            assert!((0.0..=1.0005).contains(c), "s = {exponent}: {c}");
        }
        let lit = draw(engine, &ball(exponent, sun(from_zenith(40.0), 1.0)));
        assert_sound(&lit, "gloss in the sun");
        let peak = f64::from((exponent + 1.0) / std::f32::consts::TAU);
        let most = lit.pixels().as_flattened().iter().fold(0.0f32, |a, b| a.max(*b));
        assert!(f64::from(most) <= peak * 1.001, "s = {exponent}: {most} above the lobe's own peak {peak}");
        // A hundredth more of the exponent.
        let next = draw(engine, &ball(exponent * 1.01, sun(from_zenith(40.0), 1.0)));
        let off = f64::from(largest_difference(&lit, &next)) / peak;
        // d/ds of (s + 1) cos^s, over s + 1, is at most 1/(s + 1) + 1/(e s): below 1.4 times the step; 11 bits.
        assert!(off < 0.02, "s = {exponent}: {off}");
    }
}

/// Objects in light of any unit, with the exposure that fits: the same but for the unit.
fn objects_in_light_of_any_unit(engine: &mut dyn Engine) {
    let light = |factor: f32| {
        let sun = sun(from_zenith(40.0), factor);
        Lights { global: uniform(0.3 * factor).global, ..sun }
    };
    let stage = |factor: f32| StressStage {
        background: factor,
        exposure_s: f64::from(1.0 / factor),
        scene: boxed(sun(Vec3::Z, 1.0)).scene,
        ..boxed(light(factor))
    };
    let one = draw(engine, &stage(1.0));
    for factor in [1e-6f32, 1e-3, 1e3, 1e6] {
        let mut other = draw(engine, &stage(factor));
        other.pixels_mut().iter_mut().for_each(|p| *p = p.map(|c| c / factor));
        let off = largest_difference(&one, &other);
        // The layer of objects is in units of white: its 11 bits stay where they are.
        assert!(off < 1e-3, "times {factor}: {off:e}");
    }
    // Channels exchanged.
    let colours = |order: [usize; 3]| {
        let mut stage = boxed(light(1.0));
        let of = |rgb: [f32; 3]| order.map(|c| rgb[c]);
        let mut lights = Lights::soft(RadianceSh::zero(ORDER));
        lights.global.rgb[0] = of([0.5, 1.0, 2.0]);
        for hard in stage.light.hard.as_slice() {
            let mut hard = *hard;
            hard.irradiance_rgb = of([3.0, 1.0, 0.2]);
            lights.hard.push(hard);
        }
        stage.light = lights;
        stage.scene.objects[0].material = Material::Lambert { albedo_rgb: of([0.9, 0.5, 0.1]) };
        stage
    };
    let one = draw(engine, &colours([0, 1, 2]));
    let other = draw(engine, &colours([2, 0, 1]));
    for (a, b) in one.pixels().iter().zip(other.pixels()) {
        assert_eq!([a[2], a[0], a[1]], *b);
    }
}

/// Scene, light and camera turned together by a quarter, which is exact, and by an odd angle.
fn turned_together(engine: &mut dyn Engine) {
    let w = from_zenith(40.0);
    let one = draw(engine, &boxed(sun(w, 1.0)));
    for angle in [std::f32::consts::FRAC_PI_2, std::f32::consts::PI, 0.7] {
        let turn = Quat::from_rotation_z(angle);
        let mut other = boxed(sun(turn * w, 1.0));
        other.scene.objects[0].world_from_object =
            Affine3A::from_quat(turn) * other.scene.objects[0].world_from_object;
        other.eye_world = turn.as_dquat() * other.eye_world;
        other.target_world = turn.as_dquat() * other.target_world;
        let picture = draw(engine, &other);
        let off = mean_difference(&one, &picture);
        println!("turned by {angle}: {off:.1e} in the mean");
        // A shadow map's grid does not turn with the scene: edges of the shadow move by part of a texel (measured 1.9e-4
        // by the odd angle, 1e-6 by quarters).
        let most = if angle == 0.7 { 5e-4 } else { 1e-5 };
        assert!(off < most, "{angle}: {off:e}");
    }
}

/// Pictures of one pixel, one row, one column.
fn smallest_pictures(engine: &mut dyn Engine) {
    for size_px in [[1, 1], [1, 7], [7, 1], [2, 2], [5, 3]] {
        for coverage_samples in [1, 4] {
            for soft_step_px in [1, 2, 4] {
                let mut stage = boxed(Lights { global: uniform(0.5).global, ..sun(from_zenith(30.0), 1.0) });
                stage.scene.figures = spheres([(Vec3::new(0.0, 0.0, 0.05), 0.05)]).figures;
                stage.size_px = size_px;
                stage.display = true;
                stage.quality = Quality { coverage_samples, soft_step_px, ..stage.quality };
                let picture = stage.draw(engine).expect("a sound frame");
                assert_sound(&picture.radiance, &format!("{size_px:?}"));
                assert_eq!(picture.display.pixels().len(), (size_px[0] * size_px[1]) as usize);
            }
        }
    }
}

/// A picture larger than many devices take in one piece.
fn largest_pictures(engine: &mut dyn Engine) {
    let scene = Scene { surfaces: vec![ground()], ..Scene::default() };
    let stage = StressStage {
        size_px: [4096, 2560],
        display: true,
        background: 0.25,
        ..StressStage::new(scene, uniform(1.0))
    };
    let picture = stage.draw(engine).expect("any size");
    assert!(picture.radiance.pixels().iter().all(|p| *p == [0.25; 3]));
    let value = picture.display.pixels()[0];
    assert!(value[0] > 100 && picture.display.pixels().iter().all(|p| *p == value), "{value:?}");
}

pub fn all(engine: &mut dyn Engine) {
    spheres_leave_shares(engine);
    spheres_move_smoothly(engine);
    shares_do_not_depend_on_units(engine);
    hard_light_goes_round(engine);
    odd_casters_and_lights(engine);
    gloss_of_every_exponent(engine);
    objects_in_light_of_any_unit(engine);
    turned_together(engine);
    smallest_pictures(engine);
    largest_pictures(engine);
}

engines::on_each!("pictures::gl");

/// 8192 x 8192 pixels, on the CPU alone: 2 GB.
#[test]
fn a_picture_of_67_million_pixels() {
    let _turn = engines::turn();
    let mut engine = engines::cpu();
    let stage = StressStage {
        size_px: [8192, 8192],
        background: 0.25,
        ..StressStage::new(Scene::default(), uniform(1.0))
    };
    let picture = stage.draw(&mut engine).expect("any size");
    assert_eq!(picture.radiance.pixels().len(), 1 << 26);
    assert!(picture.radiance.pixels().iter().step_by(4097).all(|p| *p == [0.25; 3]));
}
