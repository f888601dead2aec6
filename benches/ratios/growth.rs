//! How the time of drawing grows with lights, spheres and pixels: the walking figure on a table, CPU engine.

use glam::{DVec3, Vec3};
use halflight::{
    animate::posed::Posed,
    assets::{scene, spheres},
    engine::{Engine, RelightInput, cpu::CpuEngine},
    math::{lens::Lens, pose::Pose},
    model::{
        blocker::Rung,
        frame::Exposure,
        image::HdrImage,
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::Quality,
        response::Response,
        scene::Scene,
        time::Timestamp,
    },
    plan::{
        FramePlan, Pass,
        effects::{self, Occasion},
    },
};
use std::path::Path;

const FRAMES: usize = 9;
const PASSES: [Pass; 4] = [Pass::ShadowMaps, Pass::SoftShadow, Pass::ShadeObject, Pass::ShadeSurface];

struct Case {
    lights: usize,
    spheres: usize,
    width: u32,
    quality: Quality,
}

/// Median milliseconds of the passes of interest, and of all.
fn measure(engine: &mut CpuEngine, scene: &Scene, case: &Case) -> ([f64; 4], f64) {
    let mut scene = scene.clone();
    scene.figures[0].spheres.truncate(case.spheres);
    let k = f64::from(case.width) / 640.0;
    let lens = Lens::pinhole(case.width, case.width * 3 / 4, 620.0 * k, 620.0 * k, 320.0 * k, 240.0 * k);
    let pose = Pose::look_at(DVec3::new(0.1, -0.6, 0.45), DVec3::new(0.17, 0.0, 0.05), DVec3::Z);
    let mut global = RadianceSh::zero(4);
    global.rgb[0] = [1.2, 1.3, 1.6];
    global.rgb[2] = [0.3, 0.3, 0.5];
    let mut light = Lights::soft(global);
    for i in 0..case.lights {
        // Around the zenith, on a spiral.
        let (radius, phi) = (0.2 + 0.4 * i as f32 / case.lights as f32, 2.4 * i as f32);
        let to_light = Vec3::new(radius * phi.cos(), radius * phi.sin(), 0.8).normalize();
        let irradiance_rgb = [3.0 / case.lights as f32; 3];
        light.hard.push(HardLight { to_light_world: to_light.to_array(), irradiance_rgb, extent_rad: 0.02 });
    }
    let mut background = HdrImage::default();
    background.radiance.reshape(lens.width as usize, lens.height as usize, [0.5, 0.45, 0.4]);
    background.flags.reshape(lens.width as usize, lens.height as usize, 0);
    let posed = Posed::new(&scene);
    let mut plan = FramePlan::default();
    effects::plan(&Occasion::SHOW, &scene, &light, &case.quality, &mut plan);
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
    engine.load_scene(&scene).expect("a sound scene");
    let (mut out, mut timings) = (Picture::default(), Vec::new());
    let (mut passes, mut all) = ([const { Vec::new() }; 4], Vec::new());
    for frame in 0..FRAMES + 2 {
        engine.relight(&plan, &input, &mut out).expect("a sound frame");
        engine.take_timings(&mut timings);
        if frame < 2 {
            continue;
        }
        for (times, pass) in passes.iter_mut().zip(PASSES) {
            times.push(timings.iter().filter(|t| t.pass == pass).map(|t| f64::from(t.ms)).sum::<f64>());
        }
        all.push(timings.iter().map(|t| f64::from(t.ms)).sum::<f64>());
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    (passes.each_mut().map(median), median(&mut all))
}

/// Prints the figures.
pub fn run() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenes/walker.toml");
    let mut scene = scene::load(&file).expect("the project's own scene").scene;
    spheres::fit_scene(&mut scene, None, &mut |_| ());
    let mut engine = CpuEngine::new(None).expect("threads");
    let quality = Quality { shadow_map_texels: 512, ..Quality::default() };
    let usual = |lights, spheres, width| Case { lights, spheres, width, quality };
    println!(
        "walking figure, CPU engine, ms: maps / soft shadow / objects / surfaces, all (over the first of its group)"
    );
    let mut group = |title: &str, cases: Vec<(String, Case)>| {
        println!("  {title}");
        let mut first = None;
        for (name, case) in cases {
            let ([maps, soft, objects, surfaces], all) = measure(&mut engine, &scene, &case);
            let base = *first.get_or_insert(all);
            println!(
                "    {name:<34}{maps:7.2} {soft:7.2} {objects:7.2} {surfaces:7.2}, {all:7.2} ({:.2})",
                all / base
            );
        }
    };
    let lights = [1, 2, 4, 8, 16].map(|n| (format!("{n} hard lights"), usual(n, 20, 640)));
    group("lights (20 spheres, 640 x 480)", lights.into());
    let spheres = [1, 5, 10, 20].map(|n| (format!("{n} spheres"), usual(4, n, 640)));
    group("spheres (4 lights, 640 x 480)", spheres.into());
    let widths = [320, 640, 1280].map(|w| (format!("{w} x {}", w * 3 / 4), usual(4, 20, w)));
    group("pixels (4 lights, 20 spheres)", widths.into());
    let rungs = Rung::ALL.map(|rung| {
        let quality = Quality { rung, ..quality };
        (rung.name().to_owned(), Case { lights: 1, spheres: 20, width: 640, quality })
    });
    group("rungs (order 4, 1 light, 20 spheres, every 4th pixel)", rungs.into());
    let paper = [1u32, 2, 4].map(|soft_step_px| {
        let quality = Quality { rung: Rung::Linear, soft_step_px, ..quality };
        (
            format!("[Now11]'s own, every {soft_step_px} px"),
            Case { lights: 1, spheres: 20, width: 640, quality },
        )
    });
    group("order 4, 20 spheres, linear, 1 light, 4x4 taps", paper.into());
}
