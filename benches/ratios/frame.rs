//! Time of each stage of a 640 x 480 frame on the device and on the CPU, against the papers' figures.
//!
//! OpenGL ES 3.1 on Mesa: run with `MESA_GL_VERSION_OVERRIDE=3.0 MESA_GLES_VERSION_OVERRIDE=3.1`.

use crate::timing::median;
use glam::{Affine3A, DVec3, Vec3};
use halflight::light::unwrap_ball::BallShot;
use halflight::{
    assets::shapes,
    engine::{
        Bracket, Engine, LightJob, RelightInput, Timings,
        cpu::CpuEngine,
        gpu::{Backend, GpuEngine},
    },
    math::{lens::Lens, pose::Pose},
    model::{
        frame::Exposure,
        image::{HdrImage, Rgb8Image},
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::Quality,
        response::Response,
        rig::MirrorBall,
        scene::{Material, Mesh, RealSurface, Scene, VirtualObject},
        time::Timestamp,
    },
    plan::{
        FramePlan, Pass, PassTiming,
        effects::{self, Occasion},
    },
};
use std::time::Instant;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;
const FRAMES: usize = 25;
/// Section 7 of [Now11]: more than 70 pictures a second on a laptop of 2008.
const NOW11_FRAME_MS: f64 = 1000.0 / 70.0;
/// Section 8 of [Gib03]: 35 pictures a second with 10 shadow passes on a graphics card of 2002.
const GIB03_FRAME_MS: f64 = 1000.0 / 35.0;

/// An object that stands at a place, its axes along the world's.
pub fn object(name: &str, mesh: Mesh, material: Material, at: Vec3) -> VirtualObject {
    VirtualObject {
        name: name.into(),
        mesh,
        material,
        world_from_object: Affine3A::from_translation(at),
        openness: Vec::new(),
    }
}

/// A knot and two balls on a table; `segments` sets the number of triangles.
pub fn scene(segments: u32) -> Scene {
    let matt = Material::Lambert { albedo_rgb: [0.7, 0.5, 0.3] };
    let glossy = Material::Phong { albedo_rgb: [0.2, 0.3, 0.6], specular_rgb: [0.3; 3], exponent: 40.0 };
    let ball = |bands| shapes::uv_sphere(0.05, 2 * bands, bands);
    Scene {
        objects: vec![
            object(
                "knot",
                shapes::torus_knot(0.07, 0.02, segments, segments / 8),
                matt,
                Vec3::new(0.0, 0.0, 0.1),
            ),
            object("glossy", ball(segments / 6), glossy, Vec3::new(0.15, -0.05, 0.05)),
            object("matt", ball(segments / 6), matt, Vec3::new(-0.15, -0.05, 0.05)),
        ],
        surfaces: vec![RealSurface {
            name: "table".into(),
            mesh: shapes::plane_z0(1.0),
            receives_shadow: true,
            albedo_rgb: None,
        }],
        ..Scene::default()
    }
}

/// All that a frame is drawn from.
pub struct Frame {
    lens: Lens,
    pose: Pose,
    light: Lights,
    background: HdrImage,
    pictures: Vec<Rgb8Image>,
    exposures: [Exposure; 3],
    response: Response,
    ball: MirrorBall,
    /// The passes of a picture.
    pub plan: FramePlan,
    /// What is in it.
    pub scene: Scene,
}

impl Frame {
    /// A frame that shows a scene from the usual place.
    pub fn new(scene: Scene) -> Self {
        let (width, height) = (WIDTH as usize, HEIGHT as usize);
        let mut background = HdrImage::default();
        background.radiance.reshape(width, height, [0.5, 0.45, 0.4]);
        background.flags.reshape(width, height, 0);
        let pictures = (0..3u8)
            .map(|k| {
                let pixels =
                    (0..width * height).map(|i| [(); 3].map(|()| (i / 7 + 40 * usize::from(k)) as u8));
                Rgb8Image::from_pixels(width, height, pixels.collect()).expect("as many pixels as were made")
            })
            .collect();
        let mut global = RadianceSh::zero(4);
        global.rgb[0] = [1.2, 1.3, 1.6];
        global.rgb[2] = [0.3, 0.3, 0.5];
        let mut light = Lights::soft(global);
        light.hard.push(HardLight {
            to_light_world: Vec3::new(0.4, 0.3, 0.7).normalize().to_array(),
            irradiance_rgb: [3.0, 2.8, 2.4],
            extent_rad: 0.0,
        });
        let mut plan = FramePlan::default();
        effects::plan(&Occasion::SHOW, &scene, &light, &Quality::default(), &mut plan);
        Self {
            lens: Lens::pinhole(WIDTH, HEIGHT, 620.0, 620.0, 320.0, 240.0),
            pose: Pose::look_at(DVec3::new(0.1, -0.5, 0.4), DVec3::new(0.0, 0.0, 0.05), DVec3::Z),
            light,
            background,
            pictures,
            exposures: [0.004, 0.016, 0.064].map(|time_s| Exposure { time_s, gain: 1.0 }),
            response: Response::srgb(),
            ball: MirrorBall {
                centre_world: DVec3::new(0.0, 0.0, 0.06),
                radius_m: 0.06,
                reflectance_rgb: [0.6; 3],
                surface_radius_m: None,
            },
            plan,
            scene,
        }
    }

    /// What it is drawn from, seen from a pose.
    pub fn input<'a>(&'a self, world_from_camera: &'a Pose) -> RelightInput<'a> {
        RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera,
            light: &self.light,
            environment: None,
            posed: None,
            response: &self.response,
            shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
            t: Timestamp(0),
        }
    }

    /// Everything that a frame does, once.
    fn run(&self, engine: &mut dyn Engine, out: &mut Picture) {
        let pictures: Vec<_> = self.pictures.iter().collect();
        let bracket = Bracket { pictures: &pictures, exposures: &self.exposures };
        let mut merged = HdrImage::default();
        engine.merge_bracket(&bracket, &self.response, &mut merged).expect("a sound bracket");
        let job = LightJob::Ball(BallShot {
            picture: &self.background,
            lens: &self.lens,
            world_from_camera: &self.pose,
            ball: &self.ball,
            on_surface: true,
            without_ball: None,
        });
        engine.estimate_light(&job, &self.plan.quality).expect("a visible ball");
        let input = self.input(&self.pose);
        engine.relight(&self.plan, &input, out).expect("a sound frame");
    }
}

fn measure(frame: &Frame, engine: &mut dyn Engine) {
    let mut out = Picture::default();
    let mut timings: Vec<PassTiming> = Vec::new();
    engine.load_scene(&frame.scene).expect("a sound scene");
    // Twice to warm up: kernels are compiled in the first frame.
    for _ in 0..2 {
        frame.run(engine, &mut out);
    }
    engine.take_timings(&mut timings);
    let (mut stages, mut walls) = (vec![Vec::new(); Pass::ALL.len()], Vec::new());
    for _ in 0..FRAMES {
        let start = Instant::now();
        frame.run(engine, &mut out);
        walls.push(start.elapsed().as_secs_f64() * 1e3);
        engine.take_timings(&mut timings);
        let mut sums = [0.0; Pass::ALL.len()];
        for timing in &timings {
            sums[timing.pass as usize] += f64::from(timing.ms);
        }
        for (stage, sum) in stages.iter_mut().zip(sums) {
            stage.push(sum);
        }
    }
    println!("  {}", engine.description());
    for (pass, stage) in Pass::ALL.into_iter().zip(&mut stages) {
        println!("    {:<24}{:8.2} ms", pass.name(), median(stage));
    }
    let wall = median(&mut walls);
    println!(
        "    {:<24}{wall:8.2} ms with transfers   [Now11] / ours {:.2}, [Gib03] at 10 passes / ours {:.2}",
        "whole frame",
        NOW11_FRAME_MS / wall,
        GIB03_FRAME_MS / wall
    );
}

/// Prints the figures.
pub fn run() {
    for segments in [48, 192] {
        let frame = Frame::new(scene(segments));
        let triangles: usize = frame.scene.objects.iter().map(|o| o.mesh.triangles.len()).sum();
        println!(
            "frame of {WIDTH} x {HEIGHT}, {triangles} triangles, 3 exposures, a ball of 150 px, a map of 1024 x 1024"
        );
        match CpuEngine::new(None) {
            Ok(mut engine) => measure(&frame, &mut engine),
            Err(error) => println!("  {error}"),
        }
        for backend in Backend::ALL {
            match GpuEngine::new(Some(backend)).map(|engine| engine.with_timings(Timings::Fenced)) {
                Ok(mut engine) => measure(&frame, &mut engine),
                Err(error) => println!("  {error}"),
            }
        }
    }
}
