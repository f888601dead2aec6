//! A known room's light taken from 8-bit values, as [Gib03] did, against the ratio form: what the picture shows.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/lit_room.rs"]
mod lit_room;
mod support;

use halflight::{
    animate::posed::Posed,
    engine::{Engine, RelightInput, cpu::CpuEngine},
    math::lens::Distortion,
    model::{
        frame::Exposure,
        image::HdrImage,
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::{NearForm, Quality},
        response::Response,
        time::Timestamp,
    },
    nearfield::prepare::KnownRoom,
    plan::{FramePlan, Pass, effects},
};
use std::sync::Arc;
use support::wanted;

const SIZE: (usize, usize) = (160, 120);

/// The place alone as shown, and with what objects take of it; the objects themselves are left out.
fn draw(known: &Arc<KnownRoom>, quality: &Quality, background: impl Fn(usize) -> [f32; 3]) -> [Picture; 2] {
    let scene = lit_room::scene(known);
    let (lens, pose) = lit_room::camera(SIZE.0 as u32, SIZE.1 as u32, Distortion::None);
    let mut place = HdrImage::default();
    place.radiance.reshape(SIZE.0, SIZE.1, [0.0; 3]);
    place.radiance.pixels_mut().iter_mut().enumerate().for_each(|(i, pixel)| *pixel = background(i));
    place.flags.reshape(SIZE.0, SIZE.1, 0);
    let mut light = Lights::soft(RadianceSh::zero(4));
    for sun in &known.suns {
        light.hard.push(HardLight {
            to_light_world: sun.to_light_world,
            irradiance_rgb: sun.irradiance_rgb,
            extent_rad: sun.extent_rad,
        });
    }
    let mut plan = FramePlan::default();
    effects::plan(&effects::Occasion::SHOW, &scene, &light, quality, &mut plan);
    plan.passes.retain(|planned| planned.pass != Pass::ShadeObject);
    let mut engine = CpuEngine::new(None).unwrap();
    engine.load_room(Some(Arc::clone(known))).unwrap();
    engine.load_scene(&scene).unwrap();
    let posed = Posed::new(&scene);
    let input = RelightInput {
        background: &place,
        lens: &lens,
        world_from_camera: &pose,
        light: &light,
        environment: None,
        posed: Some(&posed),
        response: &Response::srgb(),
        shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
        t: Timestamp(0),
    };
    let mut out = [Picture::default(), Picture::default()];
    engine.relight(&plan, &input, &mut out[1]).unwrap();
    plan.passes.retain(|planned| matches!(planned.pass, Pass::Composite | Pass::Tonemap));
    engine.relight(&plan, &input, &mut out[0]).unwrap();
    out
}

fn forms(known: &Arc<KnownRoom>, quality: &Quality, background: impl Fn(usize) -> [f32; 3]) -> [Picture; 3] {
    let [place, ratio] = draw(known, &Quality { near_form: NearForm::Ratio, ..*quality }, &background);
    let [_, ldr] = draw(known, &Quality { near_form: NearForm::Ldr, ..*quality }, &background);
    [place, ratio, ldr]
}

/// For each value of each pixel: how dark the ratio form makes it, and how much brighter the other shows it.
fn differences(pictures: &[Picture; 3]) -> Vec<(i32, i32)> {
    let [place, ratio, ldr] = pictures.each_ref().map(|p| p.display.pixels().as_flattened());
    let both = place.iter().zip(ratio).zip(ldr);
    both.map(|((p, r), l)| (i32::from(*p) - i32::from(*r), i32::from(*l) - i32::from(*r))).collect()
}

/// Grey from nearly black to nearly white, in no simple order.
fn greys(i: usize) -> [f32; 3] {
    let at = |k: usize| 0.01 + 1.38 * ((i * 31 + k * 57) % 199) as f32 / 199.0;
    [at(0), at(1), at(2)]
}

#[test]
fn a_single_light_is_taken_alike() {
    let known = Arc::new(lit_room::known_room(false));
    for taps in [1, 4] {
        let quality = Quality { shadow_maps: 1, near_width_deg: 90.0, pcf_taps: taps, ..Quality::default() };
        let found = differences(&forms(&known, &quality, greys));
        let shadow = found.iter().filter(|d| d.0 > 8).count();
        let worst = found.iter().map(|d| d.1.abs()).max().unwrap();
        println!("{taps} taps: {shadow} values in shadow, at most {worst} apart");
        assert!(shadow > 2000, "{shadow}");
        // The picture's value and the transfer are each rounded, and so is what both are held against.
        let brighter = found.iter().map(|d| d.1).max().unwrap();
        assert!(brighter <= 1, "{brighter}");
        if taps == 1 {
            assert!(worst <= 1, "{worst}");
        } else {
            // Half of a transfer is more than what half of a light is worth; measured 66.
            assert!((30..=75).contains(&worst), "{worst}");
        }
    }
}

#[test]
fn nothing_gets_brighter_or_turns_over() {
    let odd = [0.0, -1.0, f32::NAN, f32::INFINITY, 1e30, 1e-30, 1.0, 0.02, 3.0];
    let background = |i: usize| [odd[i % odd.len()], odd[(i / 7) % odd.len()], odd[(i / 5) % odd.len()]];
    for sun in [false, true] {
        let known = Arc::new(lit_room::known_room(sun));
        let quality = Quality {
            shadow_maps: 30,
            near_width_deg: 90.0,
            pcf_taps: 2,
            near_form: NearForm::Ldr,
            ..Quality::default()
        };
        for background in [&background as &dyn Fn(usize) -> [f32; 3], &greys] {
            let [place, ldr] = draw(&known, &quality, background);
            let pairs =
                || place.display.pixels().as_flattened().iter().zip(ldr.display.pixels().as_flattened());
            assert!(pairs().all(|(place, ldr)| ldr <= place));
            assert!(pairs().filter(|(place, ldr)| ldr < place).count() > 3000);
        }
    }
}

#[test]
fn many_lights_show_the_known_errors() {
    let known = Arc::new(lit_room::known_room(false));
    let run = |lights: usize| {
        let quality =
            Quality { shadow_maps: lights, near_width_deg: 90.0, pcf_taps: 1, ..Quality::default() };
        let found = differences(&forms(&known, &quality, |_| [0.7; 3]));
        let shadow: Vec<_> = found.into_iter().filter(|d| d.0 > 2).collect();
        let mean = shadow.iter().map(|d| f64::from(d.1)).sum::<f64>() / shadow.len() as f64;
        let most = shadow.iter().map(|d| d.1.abs()).max().unwrap();
        println!(
            "{lights} lights: {} values in shadow, {mean:+.2} in the mean, {most} at most",
            shadow.len()
        );
        (mean, most)
    };
    let [one, many @ ..] = [1, 4, 10, 50].map(run);
    // One light is exact but for rounding. Of more, measured: 0.7, 1.8 and 1.0 values too bright in the mean, and 82 to 87 where
    // all of them are hidden: 2 T(L/2) - T(L) - T(0) (spec 9), which is 85.5 for the exposure of 0.49, and each light's rounding.
    assert!(one.0.abs() < 0.05 && one.1 <= 1, "{one:?}");
    for (mean, most) in many {
        assert!(mean > 0.5 && mean < 2.0 && most >= 50, "{mean} {most}");
        wanted::hold("near_forms.darkest", f64::from(most));
    }
}
