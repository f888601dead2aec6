//! The mirror ball in pictures that hardly show it, on every engine: light that is finite and not more than there is, or
//! a refusal in words.

use crate::engines;
use glam::{DVec2, DVec3};
use halflight::{
    engine::{Engine, EngineError, LightJob, MeasuredLight},
    light::unwrap_ball::BallShot,
    math::{lens::Lens, pose::Pose},
    model::{image::HdrImage, quality::Quality, rig::MirrorBall},
};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;

fn picture(radiance: impl Fn(usize) -> f32) -> HdrImage {
    let mut picture = HdrImage::default();
    picture.radiance.reshape(WIDTH as usize, HEIGHT as usize, [0.0; 3]);
    picture.flags.reshape(WIDTH as usize, HEIGHT as usize, 0);
    for (k, pixel) in picture.radiance.pixels_mut().iter_mut().enumerate() {
        *pixel = [radiance(k); 3];
    }
    picture
}

fn ball(radius_m: f64) -> MirrorBall {
    MirrorBall {
        centre_world: DVec3::new(0.0, 0.0, 0.05),
        radius_m,
        reflectance_rgb: [0.5; 3],
        surface_radius_m: None,
    }
}

fn measure(
    engine: &mut dyn Engine,
    picture: &HdrImage,
    ball: &MirrorBall,
    eye: DVec3,
    aim: DVec3,
    on_surface: bool,
) -> Result<MeasuredLight, EngineError> {
    let lens = Lens::pinhole(WIDTH, HEIGHT, 300.0, 300.0, 48.0, 36.0);
    let job = LightJob::Ball(BallShot {
        picture,
        lens: &lens,
        world_from_camera: &Pose::look_at(eye, aim, DVec3::Z),
        ball,
        on_surface,
        without_ball: None,
    });
    engine.estimate_light(&job, &Quality { sh_order: 4, ..Quality::default() })
}

/// Light of a ball that reflects a half: finite; its mean within what its brightest pixel allows.
fn assert_sound(found: &MeasuredLight, brightest: f64, what: &str) {
    assert!(found.total.rows().iter().flatten().all(|c| c.is_finite()), "{what}: {:?}", found.total);
    for c in found.total.rgb[0] {
        let mean = f64::from(c) / (4.0 * std::f64::consts::PI).sqrt();
        assert!((0.0..=2.0 * brightest * 1.0001 + 1e-30).contains(&mean), "{what}: a mean of {mean}");
    }
    assert!((0.0..=1.0).contains(&found.flags.filled_share), "{what}: {:?}", found.flags);
}

/// Radiance of the k-th pixel.
type Radiance = fn(usize) -> f32;

pub fn all(engine: &mut dyn Engine) {
    let even = picture(|_| 1.0);
    let middle = DVec3::new(0.0, 0.0, 0.05);
    let look = |distance: f64| DVec3::new(0.6, -0.64, 0.48) * distance + middle;
    // From a hundredth of a millimetre before the ball to where it is a thousandth of a pixel.
    let mut found_at = 0;
    for step in 0..40 {
        let distance = 0.05 + 1e-5 * 1.6f64.powi(step);
        for on_surface in [false, true] {
            let what = format!("{distance} m away, on the surface: {on_surface}");
            match measure(engine, &even, &ball(0.05), look(distance), middle, on_surface) {
                Ok(found) => {
                    assert_sound(&found, 1.0, &what);
                    found_at += 1;
                }
                Err(error) => assert!(matches!(error, EngineError::Input(_)), "{what}: {error}"),
            }
        }
    }
    assert!(found_at > 20, "found at {found_at} of 80 places");
    // Leaving the picture on one side.
    for step in 0..=40 {
        let aside = DVec2::new(0.01 * f64::from(step), 0.0);
        let aim = middle + DVec3::new(aside.x * 0.64, aside.x * 0.6, 0.0) * 2.0;
        match measure(engine, &even, &ball(0.05), look(0.5), aim, false) {
            Ok(found) => assert_sound(&found, 1.0, &format!("{aside} m aside")),
            Err(error) => assert!(matches!(error, EngineError::Input(_)), "{aside}: {error}"),
        }
    }
    // Pixels of every kind.
    let kinds: [(&str, Radiance, f64); 6] = [
        ("black", |_| 0.0, 0.0),
        ("NaN", |_| f32::NAN, 64_000.0),
        ("every third NaN", |k| if k % 3 == 0 { f32::NAN } else { 1.0 }, 1.0),
        ("some infinite", |k| if k % 97 == 0 { f32::INFINITY } else { 1.0 }, 64_000.0),
        ("negative", |_| -1.0, 0.0),
        ("from 1e-20 to 1e5", |k| 10f32.powi((k % 26) as i32 - 20), 1e5),
    ];
    for (name, radiance, brightest) in kinds {
        for on_surface in [false, true] {
            let found = measure(engine, &picture(radiance), &ball(0.05), look(0.4), middle, on_surface);
            assert_sound(&found.expect("a visible ball"), brightest, name);
        }
    }
    // The unit of light does not matter.
    let lit = |factor: f32| picture(move |k| factor * (1.0 + (k % 7) as f32));
    let one = measure(engine, &lit(1.0), &ball(0.05), look(0.4), middle, true).expect("a visible ball").total;
    for factor in [1e-6f32, 2f32.powi(-20), 2f32.powi(20), 1e6] {
        let other =
            measure(engine, &lit(factor), &ball(0.05), look(0.4), middle, true).expect("visible").total;
        for (a, b) in other.rgb.as_flattened().iter().zip(one.rgb.as_flattened()) {
            assert!(
                (a - b * factor).abs() <= 1e-5 * one.rgb[0][0] * factor,
                "times {factor}: {a} for {}",
                b * factor
            );
        }
    }
    // What is no ball, and a camera within it.
    for radius_m in [0.0, -0.05, f64::NAN, f64::INFINITY] {
        let error = measure(engine, &even, &ball(radius_m), look(0.4), middle, false).expect_err("no ball");
        assert!(error.to_string().contains("radius"), "{error}");
    }
    let error = measure(engine, &even, &ball(0.5), look(0.4), middle, false).expect_err("inside").to_string();
    assert!(error.contains("0.4") && error.contains("0.5"), "{error}");
}

engines::on_each!("ball::gl");
