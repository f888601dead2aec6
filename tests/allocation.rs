//! The pipeline's own code, the kernels of the CPU engine and what near light asks for allocate nothing per frame in steady
//! state. One test alone, for the count is that of the whole program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/sys.rs"]
mod sys;

use glam::{DVec3, Vec3};
use halflight::config::Settings;
use halflight::daemon::{host::Host, prepare::prepare};
use halflight::device::bracket::{
    FrameSeen, Scheduler,
    simulator::{Faults, SimulatedCamera},
    thumbnail::Thumbnail,
};
use halflight::hdr::{
    develop::{Developer, SensorOptions},
    merge_bracket::merge_sensor,
    sliding::SlidingMerge,
};
use halflight::math::{lens::Lens, pose::Pose};
use halflight::model::{
    frame::{Exposure, RawFrame},
    image::HdrImage,
    pixels::{BayerDepth, BayerOrder, PixelFormat, PixelLayout, PixelPool},
    response::Response,
    room::{Face, Room, RoomSun, RoomSurface},
    time::Timestamp,
};
use halflight::nearfield::{
    field::{NearField, Preparation},
    frame::{NearFrame, NearQuality},
    marks::Marks,
    patches::{Subdivision, subdivide},
    representatives::Representatives,
    shaft::Aabb,
    sun_shadows::SunShadows,
    sun_sources::SunMarks,
};
use halflight::sources::expand::{Priority, WantedNodes};
use halflight::visibility::proxies::Proxies;

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
    choosing_near_light();
    bracketing();
    developing_and_merging();
    for threads in [1, 2, 3, 5] {
        for start in [0, 9, 17] {
            frames_of_near_light(threads, start);
        }
    }
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
    for frame in &frames[..WARM_UP] {
        prepared.pipeline.frame(frame).unwrap();
    }
    let (mut relit, mut worst) = (0, 0);
    for (k, frame) in (WARM_UP..).zip(&frames[WARM_UP..]) {
        let counted = sys::allocated(|| {
            let outcome = prepared.pipeline.frame(frame).unwrap();
            relit += usize::from(!outcome.shown.is_passed_through());
        });
        assert!(counted.count <= OF_LIBRARIES, "{}, frame {k}: {counted}", settings.scene_file);
        worst = worst.max(counted.count);
    }
    println!(
        "{}: at most {worst} allocations a frame, {relit} of {MEASURED} frames relit",
        settings.scene_file
    );
    assert!(relit > MEASURED / 2, "{relit}");
}

/// A box of 2 m whose floor and walls shine.
fn box_room() -> (Room, NearField) {
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
    (room, field)
}

/// Lights chosen in a box with two suns, for an object on its way through it, there and back.
fn choosing_near_light() {
    let (room, field) = box_room();
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
        marks.mark(&field, &objects, None);
        of_suns.mark(&field, &suns, &marks, &objects, None);
        lights.choose(
            &field,
            &marks,
            &objects,
            of_suns.marked(&suns),
            WantedNodes::exactly(10),
            Priority::ErrorRemoved,
        );
        of_suns.share(&suns, lights.far());
        lights.light_rows(&field, &marks, &mut rows);
        assert!(!lights.far().is_empty() && of_suns.maps().iter().all(Option::is_some));
        assert!(lights.near().len() + lights.far().len() == 10 && rows.iter().any(|r| r[1] > 0.0));
    };
    let first = sys::allocated(|| (0..WARM_UP).for_each(&mut frame));
    let then = sys::allocated(|| (0..MEASURED).for_each(&mut frame));
    assert!(first.count > 0, "the first frames make room");
    assert_eq!(then.count, 0, "near light: {then}");
}

/// Whole frames of near light with their maps, from any place of an object's way on: it dips into the shining floor, so that
/// casters are cut off at near planes in some frames and not in others. What any frame may need is there after the first.
fn frames_of_near_light(threads: usize, start: usize) {
    let (_, field) = box_room();
    let triangles: Vec<[u32; 3]> = field.patches.patches.iter().flat_map(|p| p.triangles()).collect();
    let body = |step: usize| -> Vec<Vec3> {
        let height = 0.4 + 0.45 * (step as f32 * 0.26).cos();
        let middle = Vec3::new(0.5 + 0.04 * (step % 24) as f32, 1.0, height);
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) - 0.5;
        (0..8).map(|i| middle + 0.3 * corner(i)).collect()
    };
    const FACES: [[u32; 3]; 12] = [
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
    ];
    let proxies = Proxies::build(&body(0), &FACES, std::iter::once(0..FACES.len()), 500);
    let lens = Lens::pinhole(160, 120, 90.0, 90.0, 80.0, 60.0);
    let pose = Pose::look_at(DVec3::new(0.2, 0.2, 1.7), DVec3::new(1.0, 1.0, 0.3), DVec3::Z);
    let quality = NearQuality { lights: 10, left_rad: f32::INFINITY, texels: 128, places: 4 };
    let mut near = NearFrame::default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut lit = 0;
    let mut frame = |step: usize| {
        near.update(&field, &proxies, &body(step), (&lens, &pose), &quality);
        near.draw(&proxies);
        near.list(&field, &triangles, true);
        lit = lit.max(near.lights().len());
    };
    pool.install(|| {
        frame(start);
        for step in start + 1..start + 1 + MEASURED {
            let counted = sys::allocated(|| frame(step));
            // A worker of the pool signs on with its queue's memory at its first steal, at any moment: 2304 and 1520
            // bytes, once each. That is not ours.
            assert_eq!(counted.ours, 0, "{threads} threads, from {start} on, frame {step}: {counted}");
        }
    });
    assert_eq!(lit, quality.lights);
}

/// The scheduler of exposures, from its first frame on.
fn bracketing() {
    let cycle = [0.001, 0.004, 0.016].map(|time_s| Exposure { time_s, gain: 1.0 });
    let faults =
        Faults { delay: (1, 4), jitter: 0.3, twice: 0.05, lost: 0.05, lamp: 0.01, ..Faults::default() };
    let mut camera = SimulatedCamera::new(3, faults);
    let mut scheduler = Scheduler::new(&cycle).unwrap();
    let mut thumbnail = Thumbnail::default();
    let counted = sys::allocated(|| {
        for _ in 0..500 {
            let frame = camera.next(&mut thumbnail);
            let (sequence, t, stated) = (frame.sequence, frame.t, frame.stated);
            scheduler.frame(FrameSeen { sequence, t, stated, thumbnail: &thumbnail });
            while scheduler.settled().is_some() {}
            if let Some(asked) = scheduler.next_write(sequence) {
                scheduler.written(asked, camera.write(asked), sequence);
            }
        }
    });
    assert_eq!(counted.ours, 0, "{counted}");
    assert!(scheduler.report().sure > 300);
}

/// Frames of a 12-bit sensor: developed, warped into the newest view and merged.
fn developing_and_merging() {
    let (width, height) = (96, 64);
    let layout = PixelLayout::packed(PixelFormat::Bayer(BayerOrder::Rggb, BayerDepth::Bits12), width, height);
    let mut pool = PixelPool::new((0..4).map(|_| vec![3u8; layout.least_bytes()]));
    let mut developer = Developer::new(&Response::srgb(), SensorOptions::default()).unwrap();
    let lens = Lens::pinhole(width as u32, height as u32, 80.0, 80.0, 48.0, 32.0);
    let mut ring = SlidingMerge::new(3, &lens, None);
    let mut merged = HdrImage::default();
    let mut frame = |k: usize| {
        let (slot, _) = pool.free().expect("buffers come back");
        let pixels = pool.lend(slot, layout, layout.least_bytes()).unwrap().unwrap();
        let developed = developer.develop(&pixels).unwrap();
        let eye = DVec3::new(0.01 * k as f64, -0.5, 0.4);
        let pose = Pose::look_at(eye, eye + DVec3::new(0.0, 0.5, -0.4), DVec3::Z);
        let frame = RawFrame {
            sequence: k as u64,
            t_mid: Timestamp(k as i64),
            exposure: Exposure { time_s: [0.01, 0.04, 0.16][k % 3], gain: 1.0 },
            pixels: developed.pixels,
            sensor: developed.sensor,
            row_time_s: 0.0,
            response: None,
        };
        ring.push(&frame, Some(pose)).unwrap();
        let registered = ring.registered_sensor().expect("the sensor's pictures are there");
        merge_sensor(registered.pictures(), registered.exposures(), &mut merged).unwrap();
    };
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    threads.install(|| {
        (0..WARM_UP).for_each(&mut frame);
        for k in WARM_UP..WARM_UP + MEASURED {
            let counted = sys::allocated(|| frame(k));
            assert_eq!(counted.ours, 0, "frame {k} of a sensor: {counted}");
        }
    });
}
