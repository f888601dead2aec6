//! A frame in a known room at 640 x 480 against [Gib03]'s figures for 10, 20 and 50 shadow maps, and all maps in one pass
//! against a pass for each.

use super::nearfield::{radiance, room};
use glam::{Affine3A, DVec3, Vec3};
use halflight::{
    animate::posed::Posed,
    assets::shapes,
    engine::{
        Engine, RelightInput, Timings,
        cpu::CpuEngine,
        gpu::{Backend, GpuEngine, MapSpread},
    },
    math::{lens::Lens, pose::Pose},
    model::{
        frame::Exposure,
        image::HdrImage,
        light::{Lights, RadianceSh},
        picture::Picture,
        quality::{NearForm, Quality},
        response::Response,
        scene::{Material, Scene, VirtualObject},
        time::Timestamp,
    },
    nearfield::{
        field::{NearField, Preparation},
        irradiance::{IrradianceVolume, VolumeSettings},
        patches::{Subdivision, subdivide},
        prepare::{KnownRoom, RoomReport},
    },
    plan::{
        FramePlan, Pass, PassTiming,
        effects::{self, Occasion},
    },
};
use std::{sync::Arc, time::Instant};

const FRAMES: usize = 15;
/// Section 9 of [Gib03]: shadow maps and pictures a second at 640 x 480 on a graphics card of 2002.
const GIB03: [(usize, f64); 3] = [(10, 35.0), (20, 25.0), (50, 14.0)];
/// Passes of the frame, and what lies between them: transfers, waits, finding the lights.
const PARTS: [&str; 6] = ["maps", "subtract", "objects", "composite", "tonemap", "between"];

/// 512 triangles over a table.
fn scene(known: &KnownRoom) -> Scene {
    Scene {
        objects: vec![VirtualObject {
            name: "ball".into(),
            mesh: shapes::uv_sphere(0.1, 17, 16),
            material: Material::Lambert { albedo_rgb: [0.7, 0.5, 0.3] },
            world_from_object: Affine3A::from_translation(Vec3::new(0.05, 0.0, 0.16)),
            openness: Vec::new(),
        }],
        room: Some(Arc::new(known.room.clone())),
        ..Scene::default()
    }
}

/// Median milliseconds of a frame and of its parts, and a digest of its picture.
fn measure(engine: &mut dyn Engine, scene: &Scene, quality: &Quality) -> (f64, [f64; PARTS.len()], u64) {
    let light = Lights::soft(RadianceSh::zero(4));
    let mut plan = FramePlan::default();
    effects::plan(&Occasion::SHOW, scene, &light, quality, &mut plan);
    let mut background = HdrImage::default();
    background.radiance.reshape(640, 480, [0.5, 0.45, 0.4]);
    background.flags.reshape(640, 480, 0);
    let posed = Posed::new(scene);
    let input = RelightInput {
        background: &background,
        lens: &Lens::pinhole(640, 480, 620.0, 620.0, 320.0, 240.0),
        world_from_camera: &Pose::look_at(DVec3::new(0.8, -1.0, 0.9), DVec3::ZERO, DVec3::Z),
        light: &light,
        environment: None,
        posed: Some(&posed),
        response: &Response::srgb(),
        shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
        t: Timestamp(0),
    };
    let mut out = Picture::default();
    let mut timings: Vec<PassTiming> = Vec::new();
    let (mut walls, mut parts) = (Vec::new(), [const { Vec::new() }; PARTS.len()]);
    for frame in 0..FRAMES + 2 {
        let start = Instant::now();
        engine.relight(&plan, &input, &mut out).expect("a sound frame");
        let wall = start.elapsed().as_secs_f64() * 1e3;
        engine.take_timings(&mut timings);
        if frame >= 2 {
            walls.push(wall);
            let mut sums = [0.0; PARTS.len()];
            for timing in &timings {
                let part = match timing.pass {
                    Pass::PointMaps => 0,
                    Pass::Subtract | Pass::SubtractDisplayed => 1,
                    Pass::ShadeObject => 2,
                    Pass::Composite => 3,
                    Pass::Tonemap => 4,
                    _ => 5,
                };
                sums[part] += f64::from(timing.ms);
            }
            sums[5] = wall - sums[..5].iter().sum::<f64>();
            parts.iter_mut().zip(sums).for_each(|(list, sum)| list.push(sum));
        }
    }
    let bits = out.radiance.pixels().as_flattened().iter().map(|x| u64::from(x.to_bits()));
    let digest = bits.fold(0xcbf2_9ce4_8422_2325, |hash, bits| (hash ^ bits).wrapping_mul(0x100_0000_01b3));
    let mut median = |list: &mut Vec<f64>| {
        list.sort_by(f64::total_cmp);
        list[list.len() / 2]
    };
    (median(&mut walls), parts.each_mut().map(&mut median), digest)
}

fn table(
    engine: &mut dyn Engine,
    what: &str,
    known: &Arc<KnownRoom>,
    near_form: NearForm,
    places: &[u32],
) -> Vec<f64> {
    let scene = scene(known);
    engine.load_room(Some(Arc::clone(known))).expect("a sound room");
    engine.load_scene(&scene).expect("a sound scene");
    let mut walls = Vec::new();
    for &places in places {
        for (maps, fps) in GIB03 {
            let quality = Quality { shadow_maps: maps, pcf_taps: places, near_form, ..Quality::default() };
            let (wall, parts, digest) = measure(engine, &scene, &quality);
            let parts: String =
                PARTS.iter().zip(parts).map(|(part, ms)| format!(" {part} {ms:6.2}")).collect();
            println!(
                "  {what}, {places} places a side, {maps:2} maps: {:5.1} pictures a second ([Gib03] {fps}, ratio {:.2}); ms{parts}; {digest:016x}",
                1e3 / wall,
                1e3 / wall / fps
            );
            walls.push(wall);
        }
    }
    walls
}

/// Prints the figures; a second argument (`cpu`, `vulkan`, `gl`) picks one engine, and `hard` after it hard maps alone.
pub fn run() {
    let arguments: Vec<_> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let asked = |name: &str| arguments.get(1).is_none_or(|only| only.eq_ignore_ascii_case(name));
    let hard = arguments.get(2).is_some_and(|only| only == "hard");
    let places: &[u32] = if hard { &[1] } else { &[1, 4] };
    println!("a known room of 1500 patches at 640 x 480, 512 triangles, maps of 256 x 256");
    let room = room();
    let patches = subdivide(&room, &Subdivision { patches: 1500, ..Subdivision::default() }, &radiance);
    let field = NearField::build(&room, patches.expect("a sound room"), &Preparation::default(), &|_| ());
    let field = field.expect("a lit room");
    let volume = IrradianceVolume::build(&room, &field, &VolumeSettings::default(), &|_| ());
    let known = Arc::new(KnownRoom {
        sun_rgb: vec![[0.0; 3]; field.patches.vertices.len()],
        reflectance_measured: vec![false; field.patches.patches.len()],
        room,
        field,
        volume,
        suns: Vec::new(),
        report: RoomReport::default(),
    });
    match asked("cpu").then(|| CpuEngine::new(None)) {
        None => {}
        Some(Ok(mut engine)) => {
            let ratio = table(&mut engine, "CPU", &known, NearForm::Ratio, places);
            compare(
                &table(&mut engine, "CPU, 8-bit", &known, NearForm::Ldr, places),
                &ratio,
                "8-bit / ratio form",
            );
        }
        Some(Err(error)) => println!("  {error}"),
    }
    for backend in Backend::ALL.into_iter().filter(|backend| asked(backend.name())) {
        let engine = match GpuEngine::new(Some(backend)).map(|engine| engine.with_timings(Timings::Fenced)) {
            Ok(engine) => engine,
            Err(error) => {
                println!("  {error}");
                continue;
            }
        };
        println!("  {}", engine.description());
        let mut engine = engine.with_near_lights(MapSpread::Together);
        let together = table(&mut engine, "one pass of maps", &known, NearForm::Ratio, places);
        if hard {
            continue;
        }
        let displayed = table(&mut engine, "one pass of maps, 8-bit", &known, NearForm::Ldr, places);
        compare(&displayed, &together, "8-bit (a pass a light) / ratio form");
        let mut engine = engine.with_near_lights(MapSpread::Each);
        let each = table(&mut engine, "a pass a map", &known, NearForm::Ratio, places);
        compare(&each, &together, "a pass a map / one pass of maps");
    }
}

fn compare(these: &[f64], those: &[f64], what: &str) {
    let ratios: String = these.iter().zip(those).map(|(a, b)| format!(" {:.2}", a / b)).collect();
    println!("    {what}, times of a frame:{ratios}");
}
