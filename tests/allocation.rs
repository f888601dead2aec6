//! The pipeline's own code, the kernels of the CPU engine and what near light asks for allocate nothing per frame in steady
//! state. One test alone, for the count is that of the whole program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/sys.rs"]
mod sys;

use glam::Vec3;
use halflight::config::Settings;
use halflight::daemon::{host::Host, run::prepare};
use halflight::model::{
    room::{Face, Room, RoomSun, RoomSurface},
    time::Timestamp,
};
use halflight::nearfield::{
    field::{NearField, Preparation},
    marks::Marks,
    patches::{Subdivision, subdivide},
    representatives::Representatives,
    shaft::Aabb,
    sun_shadows::SunShadows,
    sun_sources::SunMarks,
};
use halflight::sources::expand::Priority;

const WARM_UP: usize = 24;
const MEASURED: usize = 24;

/// Allocations a frame that are not ours: the AprilTag crate makes a list for each call and wrappers for its pictures,
/// and rayon's queue grows by blocks now and then; 2 were measured.
const OF_LIBRARIES: usize = 3;

#[test]
fn frames_in_steady_state_allocate_only_in_libraries() {
    let hud = Settings { hud: true, ..desk() };
    for settings in [desk(), hud, room()] {
        frames_of_the_pipeline(&settings);
    }
    frames_of_near_light();
}

/// The bundled recording of a known room.
fn room() -> Settings {
    Settings {
        camera: concat!("replay:", env!("CARGO_MANIFEST_DIR"), "/tests/recordings/room.mcap").into(),
        scene_file: concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/room.toml").into(),
        decimate: 1,
        threads: 1,
        ..Settings::default()
    }
}

fn desk() -> Settings {
    Settings {
        camera: "synthetic:frames=48,size=320x240,texel_mm=8".into(),
        scene_file: concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/desk.toml").into(),
        exposures_s: vec![1.0 / 4500.0, 1.0 / 500.0, 1.0 / 60.0],
        threads: 1,
        ..Settings::default()
    }
}

fn frames_of_the_pipeline(settings: &Settings) {
    let mut prepared = prepare(settings, &Host::default()).unwrap();
    let frames: Vec<_> =
        (0..WARM_UP + MEASURED).map(|_| prepared.source.next(Timestamp(i64::MAX)).unwrap()).collect();
    let mut relit = 0;
    for frame in &frames[..WARM_UP] {
        prepared.pipeline.frame(frame).unwrap();
    }
    let mut worst = 0;
    for frame in &frames[WARM_UP..] {
        let before = sys::allocations();
        let outcome = prepared.pipeline.frame(frame).unwrap();
        worst = worst.max(sys::allocations() - before);
        relit += usize::from(!outcome.shown.is_passed_through());
    }
    println!(
        "{}: at most {worst} allocations a frame, {relit} of {MEASURED} frames relit",
        settings.scene_file
    );
    assert!(relit > MEASURED / 2, "{relit}");
    assert!(worst <= OF_LIBRARIES, "{worst}");
}

/// A box of 2 m whose floor and walls shine and let two suns in, and an object on its way through it, there and back.
fn frames_of_near_light() {
    const SIDES: [[u32; 4]; 6] =
        [[2, 6, 4, 0], [5, 7, 3, 1], [4, 5, 1, 0], [3, 7, 6, 2], [1, 3, 2, 0], [6, 7, 5, 4]];
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0;
    let room = Room {
        surfaces: vec![RoomSurface {
            name: "walls".to_owned(),
            corners_world: (0..8).map(corner).collect(),
            faces: SIDES.map(Face::Quad).to_vec(),
            reflectance_rgb: [0.5; 3],
            emitted_rgb: [1.0; 3],
        }],
    };
    let how = Subdivision { patches: 300, ..Subdivision::default() };
    let divided = subdivide(&room, &how, &|_| None).unwrap();
    let field = NearField::build(&room, divided, &Preparation::default(), &|_| ()).unwrap();
    let sun = |towards: Vec3| RoomSun {
        to_light_world: towards.normalize().to_array(),
        irradiance_rgb: [2.0; 3],
        extent_rad: 0.005,
        apertures: vec![0],
    };
    let mut suns = SunShadows::default();
    suns.load(&room, &[sun(Vec3::new(0.3, 0.2, 1.0)), sun(Vec3::new(-0.6, 0.1, 1.0))], &field, 128);
    let (mut marks, mut lights, mut rows) = (Marks::default(), Representatives::default(), Vec::new());
    let mut of_suns = SunMarks::default();
    let mut frame = |step: usize| {
        let centre = Vec3::new(0.5 + 0.04 * (step % 24) as f32, 1.0, 0.6);
        let objects = [Aabb { low: centre - 0.15, high: centre + 0.15 }];
        let before = sys::allocations();
        marks.mark(&field, &objects, None);
        of_suns.mark(&field, &suns, &marks, &objects, None);
        lights.choose(&field, &marks, &objects, of_suns.marked(&suns), 10, Priority::ErrorRemoved);
        of_suns.share(&suns, lights.far());
        lights.light_rows(&field, &marks, &mut rows);
        assert!(!lights.far().is_empty() && of_suns.maps().iter().all(Option::is_some));
        assert!(lights.near().len() + lights.far().len() == 10 && rows.iter().any(|r| r[1] > 0.0));
        sys::allocations() - before
    };
    let first: usize = (0..WARM_UP).map(&mut frame).sum();
    let then: usize = (0..MEASURED).map(&mut frame).sum();
    assert!(first > 0, "the first frames make room");
    assert_eq!(then, 0, "near light");
}
