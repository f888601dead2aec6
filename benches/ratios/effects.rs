//! What scenes cost that call for less than everything, and an empty one against copying the camera's picture.

use crate::{frame::object, timing::median};
use glam::{Affine3A, DVec3, Vec3};
use halflight::{
    animate::posed::Posed,
    assets::shapes,
    config::Settings,
    daemon::{host::Host, prepare::prepare},
    engine::{
        Engine, RelightInput, Timings,
        cpu::CpuEngine,
        gpu::{Backend, GpuEngine},
    },
    math::{lens::Lens, pose::Pose},
    model::{
        animation::Figure,
        frame::Exposure,
        image::{HdrImage, Rgb8Image},
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::{Effects, Quality},
        response::Response,
        scene::{Material, RealSurface, Scene},
        time::Timestamp,
    },
    plan::{
        Foresight, FramePlan,
        effects::{self, Occasion},
    },
};
use std::time::Instant;

const FRAMES: usize = 15;

/// A ball, a mirror and a glossy box on a table, each with a sphere.
fn scene() -> Scene {
    let matt = Material::Lambert { albedo_rgb: [0.7, 0.5, 0.3] };
    let mirror = Material::Mirror { reflectance_rgb: [0.9; 3] };
    let glossy = Material::Phong { albedo_rgb: [0.2, 0.3, 0.6], specular_rgb: [0.3; 3], exponent: 20.0 };
    let places = [Vec3::new(0.0, 0.0, 0.06), Vec3::new(0.16, 0.0, 0.05), Vec3::new(-0.15, 0.0, 0.05)];
    let body = |name: &str, k: usize, radius| {
        let at = Affine3A::from_translation(places[k]);
        Figure::still(name.into(), k, at, [(Vec3::ZERO, radius)].into_iter())
    };
    Scene {
        objects: vec![
            object("matt", shapes::uv_sphere(0.06, 96, 48), matt, places[0]),
            object("mirror", shapes::uv_sphere(0.05, 64, 32), mirror, places[1]),
            object("glossy", shapes::cuboid(DVec3::splat(0.05)), glossy, places[2]),
        ],
        surfaces: vec![RealSurface {
            name: "table".into(),
            mesh: shapes::plane_z0(1.0),
            receives_shadow: true,
            albedo_rgb: None,
        }],
        figures: vec![body("matt", 0, 0.06), body("mirror", 1, 0.05), body("glossy", 2, 0.06)],
        ..Scene::default()
    }
}

struct Case {
    name: &'static str,
    scene: Scene,
    light: Lights,
    target: DVec3,
    /// With what the engine holds of the frame before.
    keeps: bool,
}

fn cases() -> Vec<Case> {
    let mut global = RadianceSh::zero(4);
    global.rgb[0] = [1.2, 1.3, 1.6];
    global.rgb[2] = [0.3, 0.3, 0.5];
    let soft = Lights::soft(global);
    let mut light = soft;
    light.hard.push(HardLight {
        to_light_world: Vec3::new(0.4, 0.3, 0.7).normalize().to_array(),
        irradiance_rgb: [3.0, 2.8, 2.4],
        extent_rad: 0.01,
    });
    let (at, aside) = (DVec3::new(0.0, 0.0, 0.05), DVec3::new(0.9, -0.4, 0.0));
    let all = |name| Case { name, scene: scene(), light, target: at, keeps: false };
    let mut no_objects = all("no objects");
    no_objects.scene.objects.clear();
    no_objects.scene.figures.clear();
    let mut no_spheres = all("no spheres");
    no_spheres.scene.figures.clear();
    let mut gone = all("out of view, no spheres");
    gone.scene.figures.clear();
    gone.target = aside;
    vec![
        all("all of it"),
        Case { keeps: true, ..all("nothing moved") },
        Case { light: soft, ..all("no hard light") },
        no_spheres,
        Case { target: aside, ..all("out of view") },
        gone,
        Case { light: Lights::soft(RadianceSh::zero(4)), ..all("night") },
        no_objects,
    ]
}

fn draw(engine: &mut dyn Engine, case: &Case, effects: Effects, plan: &mut FramePlan, out: &mut Picture) {
    let lens = Lens::pinhole(640, 480, 620.0, 620.0, 320.0, 240.0);
    let pose = Pose::look_at(DVec3::new(0.1, -0.5, 0.4), case.target, DVec3::Z);
    let mut background = HdrImage::default();
    background.radiance.reshape(640, 480, [0.5, 0.45, 0.4]);
    background.flags.reshape(640, 480, 0);
    let posed = Posed::new(&case.scene);
    let input = RelightInput {
        background: &background,
        lens: &lens,
        world_from_camera: &pose,
        light: &case.light,
        environment: None,
        posed: Some(&posed),
        response: &Response::srgb(),
        shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
        t: Timestamp(0),
    };
    let quality = Quality { effects, ..Quality::default() };
    let mut foresight = Foresight::NONE;
    engine.foresee(&input, &quality, &mut foresight).expect("a sound frame");
    if !case.keeps {
        foresight = Foresight { maps_seen: foresight.maps_seen, ..Foresight::NONE };
    }
    let occasion = Occasion {
        camera: Some((&lens, &pose)),
        spheres: Some(posed.spheres()),
        foresight: Some(&foresight),
        ..Occasion::SHOW
    };
    effects::plan(&occasion, &case.scene, &case.light, &quality, plan);
    engine.relight(plan, &input, out).expect("a sound frame");
}

/// Median milliseconds of the passes of a frame.
fn measure(engine: &mut dyn Engine, case: &Case, effects: Effects) -> f64 {
    let (mut plan, mut out, mut timings) = (FramePlan::default(), Picture::default(), Vec::new());
    engine.load_scene(&case.scene).expect("a sound scene");
    for _ in 0..2 {
        draw(engine, case, effects, &mut plan, &mut out);
    }
    engine.take_timings(&mut timings);
    let mut all: Vec<f64> = (0..FRAMES)
        .map(|_| {
            draw(engine, case, effects, &mut plan, &mut out);
            engine.take_timings(&mut timings);
            timings.iter().map(|t| f64::from(t.ms)).sum()
        })
        .collect();
    median(&mut all)
}

fn compare(engine: &mut dyn Engine) {
    println!("  {}", engine.description());
    for case in cases() {
        let all = measure(engine, &case, Effects::All);
        let called_for = measure(engine, &case, Effects::CalledFor);
        println!(
            "    {:<26}{called_for:8.2} ms, all forced on {all:8.2} ms, ratio {:.3}",
            case.name,
            called_for / all
        );
    }
}

/// A frame of the daemon's pipeline with nothing virtual, against copying the frame's pixels.
fn empty() {
    let settings = Settings {
        camera: "synthetic:frames=40,size=640x480,texel_mm=8".into(),
        exposures_s: vec![1.0 / 500.0],
        ..Settings::default()
    };
    let mut prepared = match prepare(&settings, &Host::default()) {
        Ok(prepared) => prepared,
        Err(error) => return println!("  {error}"),
    };
    prepared.pipeline = prepared.pipeline.for_pictures_alone();
    let frames: Vec<_> = (0..40).filter_map(|_| prepared.source.next(Timestamp(i64::MAX)).ok()).collect();
    let mut target = Rgb8Image::filled(640, 480, [0; 3]);
    let (mut copies, mut whole) = (Vec::new(), Vec::new());
    for frame in &frames {
        let start = Instant::now();
        target.pixels_mut().copy_from_slice(frame.pixels.pixels());
        std::hint::black_box(&mut target);
        copies.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        prepared.pipeline.frame(frame).expect("a sound frame");
        whole.push(start.elapsed().as_secs_f64() * 1e3);
        assert!(prepared.pipeline.picture().display == *frame.pixels, "bit for bit");
    }
    let (copy, whole) = (median(&mut copies[10..]), median(&mut whole[10..]));
    println!(
        "  empty scene, whole frame {whole:.4} ms, plain copy {copy:.4} ms, ratio {:.2} (at most 1.3)",
        whole / copy
    );
}

/// Prints the figures.
pub fn run() {
    println!("only the effects called for, 640 x 480, passes of a frame");
    match CpuEngine::new(None) {
        Ok(mut engine) => compare(&mut engine),
        Err(error) => println!("  {error}"),
    }
    for backend in Backend::ALL {
        match GpuEngine::new(Some(backend)).map(|engine| engine.with_timings(Timings::Fenced)) {
            Ok(mut engine) => compare(&mut engine),
            Err(error) => println!("  {error}"),
        }
    }
    empty();
}
