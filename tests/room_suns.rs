//! Suns of a known room share the frame's n lights with its near light, through the engine and the plan.
#![allow(clippy::unwrap_used, reason = "a test may fail loudly")]

#[path = "support/lit_room.rs"]
mod lit_room;

use glam::Vec3;
use halflight::{
    animate::posed::Posed,
    engine::{Engine, RelightInput, cpu::CpuEngine},
    math::lens::Distortion,
    model::{
        frame::Exposure,
        image::HdrImage,
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::Quality,
        response::Response,
        room::RoomSun,
        time::Timestamp,
    },
    plan::{
        Foresight, FramePlan, Pass,
        effects::{self, Occasion},
    },
};
use std::sync::Arc;

const SIZE: usize = 96;

/// What a frame of the lit room with some suns took.
struct Drawn {
    picture: Picture,
    /// Suns with a map of the objects.
    maps: usize,
    /// Whether any is drawn.
    planned: bool,
}

/// The sun of `lit_room` from other directions and of other strength.
fn sun(towards: [f32; 3], strength: f32) -> RoomSun {
    let known = lit_room::known_room(true);
    let own = known.suns.first().unwrap();
    RoomSun {
        to_light_world: Vec3::from(towards).normalize().to_array(),
        irradiance_rgb: own.irradiance_rgb.map(|e| strength * e),
        ..own.clone()
    }
}

fn low() -> RoomSun {
    sun([-0.9, 0.1, 0.35], 1.0)
}

fn high() -> RoomSun {
    sun([-0.9, -0.25, 0.5], 0.5)
}

/// The room hides it from all that is in it.
fn hidden() -> RoomSun {
    sun([0.9, 0.1, 0.35], 20.0)
}

fn draw(suns: &[RoomSun], shadow_maps: usize) -> Drawn {
    let mut known = lit_room::known_room(false);
    known.suns = suns.to_vec();
    let known = Arc::new(known);
    let scene = lit_room::scene(&known);
    let (lens, pose) = lit_room::camera(SIZE as u32, SIZE as u32, Distortion::None);
    let mut background = HdrImage::default();
    background.radiance.reshape(SIZE, SIZE, [1.0; 3]);
    background.flags.reshape(SIZE, SIZE, 0);
    let mut light = Lights::soft(RadianceSh::zero(4));
    for sun in suns {
        light.hard.push(HardLight {
            to_light_world: sun.to_light_world,
            irradiance_rgb: sun.irradiance_rgb,
            extent_rad: sun.extent_rad,
        });
    }
    let posed = Posed::new(&scene);
    let input = RelightInput {
        background: &background,
        lens: &lens,
        world_from_camera: &pose,
        light: &light,
        environment: None,
        posed: Some(&posed),
        response: &Response::srgb(),
        shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
        t: Timestamp(0),
    };
    let quality = Quality { shadow_maps, near_width_deg: 90.0, coverage_samples: 1, ..Quality::default() };
    let mut engine = CpuEngine::new(None).unwrap();
    engine.load_room(Some(Arc::clone(&known))).unwrap();
    engine.load_scene(&scene).unwrap();
    let (mut foresight, mut plan) = (Foresight::NONE, FramePlan::default());
    engine.foresee(&input, &quality, &mut foresight).unwrap();
    let occasion = Occasion { foresight: Some(&foresight), camera: Some((&lens, &pose)), ..Occasion::SHOW };
    effects::plan(&occasion, &scene, &light, &quality, &mut plan);
    // What is left of the room alone.
    plan.passes.retain(|planned| planned.pass != Pass::ShadeObject);
    let mut picture = Picture::default();
    engine.relight(&plan, &input, &mut picture).unwrap();
    let mut live = Vec::new();
    engine.live(&mut live);
    let bytes: u64 = live.iter().filter(|l| l.name == "shadow maps").map(|l| l.bytes).sum();
    let side = u64::from(quality.shadow_map_texels);
    Drawn { picture, maps: (bytes / (4 * side * side)) as usize, planned: plan.has(Pass::ShadowMaps) }
}

/// What objects take of the picture.
fn taken(drawn: &Drawn) -> f64 {
    drawn.picture.radiance.pixels().iter().map(|p| f64::from(3.0 - p[0] - p[1] - p[2])).sum()
}

#[test]
fn maps_of_suns_are_drawn_where_they_are_among_the_lights() {
    for (suns, shadow_maps, maps) in [
        (vec![], 10, 0),
        (vec![low()], 10, 1),
        (vec![low(), high()], 10, 2),
        // Both by one.
        (vec![low(), high()], 2, 1),
        (vec![hidden()], 10, 0),
        (vec![hidden(), low()], 10, 1),
        (vec![hidden(), low(), high()], 2, 1),
        // A single light goes to what sends more: the window, or a strong sun.
        (vec![sun([-0.9, 0.1, 0.35], 0.01)], 1, 0),
        (vec![sun([-0.9, 0.1, 0.35], 20.0)], 1, 1),
    ] {
        let drawn = draw(&suns, shadow_maps);
        assert_eq!(drawn.maps, maps, "{suns:?}, n = {shadow_maps}");
        assert_eq!(drawn.planned, maps > 0, "{suns:?}, n = {shadow_maps}");
    }
}

#[test]
fn a_sun_takes_a_light_from_the_room_and_one_that_is_hidden_does_not() {
    // With a hidden sun the shadows are those of the room without.
    let (without, hidden) = (draw(&[], 3), draw(&[hidden()], 3));
    let pairs = without.picture.radiance.pixels().iter().zip(hidden.picture.radiance.pixels());
    let apart = pairs.filter(|(a, b)| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-6)).count();
    assert!(taken(&without) > 50.0);
    // Where walls adjoin, the filter of the room's own shadow lets a little of any sun in.
    assert!(apart * 100 < SIZE * SIZE, "{apart} pixels");
    // Merged suns take about what they take with a map each: less and more of each as their shadows lie.
    let (one, two) = (draw(&[low(), high()], 2), draw(&[low(), high()], 10));
    assert_eq!((one.maps, two.maps), (1, 2));
    let ratio = taken(&one) / taken(&two);
    println!("{ratio}");
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
}
