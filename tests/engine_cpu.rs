//! The CPU engine as a whole: it runs exactly the plan, gives the same picture for any number of threads,
//! and allocates nothing per frame. Also the golden numbers of the shadow bias.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]
#[path = "support/golden.rs"]
mod golden;
mod support;
#[path = "support/sys.rs"]
mod sys;

use glam::{Affine3A, DVec3, Vec3};
use halflight::engine::{Bracket, Engine, EngineError, RelightInput, cpu::CpuEngine};
use halflight::math::{lens::Distortion, lens::Lens, pose::Pose};
use halflight::model::{
    frame::Exposure,
    image::{HdrImage, Image, Rgb8Image},
    light::{HardLight, HardLights, Lights, RadianceSh},
    picture::Picture,
    quality::Quality,
    response::Response,
    scene::{Material, Mesh, RealSurface, Scene, VirtualObject},
    time::Timestamp,
};
use halflight::plan::{
    FramePlan, Pass, PassTiming,
    effects::{self, Occasion},
};
use halflight::visibility::shadow_maps;

/// The allocator counts the whole process: tests of this file take turns.
static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());

fn turn() -> std::sync::MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn sphere(name: &str, rows: u32, centre: Vec3, radius: f32, material: Material) -> VirtualObject {
    let columns = 2 * rows;
    let mut mesh = Mesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            let theta = std::f32::consts::PI * j as f32 / rows as f32;
            let phi = std::f32::consts::TAU * i as f32 / columns as f32;
            let n = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            mesh.positions.push(n);
            mesh.normals.push(n);
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let a = j * (columns + 1) + i;
            let b = a + columns + 1;
            mesh.triangles.push([a, b, b + 1]);
            mesh.triangles.push([a, b + 1, a + 1]);
        }
    }
    let world_from_object = Affine3A::from_translation(centre) * Affine3A::from_scale(Vec3::splat(radius));
    VirtualObject { name: name.into(), mesh, material, world_from_object, openness: Vec::new() }
}

fn ground() -> RealSurface {
    let p = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    let mesh = Mesh {
        positions: vec![p(-50.0, -50.0), p(50.0, -50.0), p(50.0, 50.0), p(-50.0, 50.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    RealSurface { name: "ground".into(), mesh, receives_shadow: true, albedo_rgb: None }
}

fn scene() -> Scene {
    let matt = Material::Lambert { albedo_rgb: [0.8, 0.5, 0.3] };
    let glossy = Material::Phong { albedo_rgb: [0.2, 0.3, 0.6], specular_rgb: [0.3; 3], exponent: 40.0 };
    let mirror = Material::Mirror { reflectance_rgb: [0.9; 3] };
    Scene {
        objects: vec![
            sphere("matt", 24, Vec3::new(0.0, 0.0, 0.1), 0.1, matt),
            sphere("glossy", 20, Vec3::new(0.15, -0.12, 0.05), 0.05, glossy),
            sphere("mirror", 20, Vec3::new(-0.15, -0.1, 0.06), 0.06, mirror),
        ],
        surfaces: vec![ground()],
        figures: Vec::new(),
        transfer: None,
        room: None,
    }
}

fn light() -> Lights {
    let mut global = RadianceSh::zero(4);
    global.rgb[0] = [1.2, 1.3, 1.6];
    global.rgb[2] = [0.3, 0.3, 0.5];
    let mut light = Lights::soft(global);
    light.hard.push(sun(Vec3::new(0.4, 0.3, 0.7)));
    light.hard.push(HardLight {
        to_light_world: [0.0, 0.6, 0.8],
        irradiance_rgb: [0.3, 0.2, 0.1],
        extent_rad: 0.0,
    });
    light
}

fn sun(to_light: Vec3) -> HardLight {
    HardLight {
        to_light_world: to_light.normalize().to_array(),
        irradiance_rgb: [3.0, 2.8, 2.4],
        extent_rad: 0.0,
    }
}

struct Frame {
    lens: Lens,
    pose: Pose,
    light: Lights,
    background: HdrImage,
    response: Response,
}

impl Frame {
    fn new(distortion: Distortion) -> Self {
        let lens = Lens { distortion, ..Lens::pinhole(160, 120, 170.0, 170.0, 81.0, 59.0) };
        let mut background = HdrImage::default();
        background.radiance.reshape(160, 120, [0.5, 0.45, 0.4]);
        background.flags.reshape(160, 120, 0);
        let pose = Pose::look_at(DVec3::new(0.3, -0.6, 0.5), DVec3::new(0.0, 0.0, 0.05), DVec3::Z);
        Self { lens, pose, light: light(), background, response: Response::srgb() }
    }

    fn input(&self) -> RelightInput<'_> {
        RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera: &self.pose,
            light: &self.light,
            environment: None,
            posed: None,
            response: &self.response,
            shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
            t: Timestamp(7),
        }
    }

    fn plan(&self, scene: &Scene) -> FramePlan {
        let mut plan = FramePlan::default();
        let occasion = Occasion { camera: Some((&self.lens, &self.pose)), ..Occasion::SHOW };
        effects::plan(&occasion, scene, &self.light, &Quality::default(), &mut plan);
        plan
    }
}

fn draw(threads: usize, frame: &Frame, scene: &Scene, plan: &FramePlan) -> (Picture, Vec<PassTiming>) {
    let mut engine = CpuEngine::new(Some(threads)).unwrap();
    engine.load_scene(scene).unwrap();
    let mut picture = Picture::default();
    engine.relight(plan, &frame.input(), &mut picture).unwrap();
    let mut timings = Vec::new();
    engine.take_timings(&mut timings);
    (picture, timings)
}

#[test]
fn the_picture_does_not_depend_on_the_number_of_threads() {
    let _turn = turn();
    let radial = Distortion::RadialTangential([-0.2, 0.05, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0]);
    for distortion in [Distortion::None, radial] {
        let (frame, scene) = (Frame::new(distortion), scene());
        let plan = frame.plan(&scene);
        let (one, timings) = draw(1, &frame, &scene, &plan);
        let passes: Vec<Pass> = timings.iter().map(|t| t.pass).collect();
        let planned: Vec<Pass> = plan.passes.iter().map(|p| p.pass).collect();
        assert_eq!(passes, planned, "every planned pass is timed, in order");
        assert!(one.radiance.pixels().iter().flatten().all(|c| c.is_finite() && *c >= 0.0));
        assert_eq!(one.t, Timestamp(7));
        for threads in [2, 3] {
            let (other, _) = draw(threads, &frame, &scene, &plan);
            assert!(one.radiance == other.radiance && one.display == other.display, "{threads} threads");
        }
        // Something was drawn, something was shadowed, and most of the picture is untouched.
        let background = frame.background.radiance.pixels();
        let pairs = || one.radiance.pixels().iter().zip(background);
        let changed = pairs().filter(|(a, b)| a != b).count();
        let dark = pairs().filter(|(a, b)| a[0] < 0.45 * b[0] && a[0] > 0.2 * b[0]).count();
        assert!((2_000..9_000).contains(&changed) && dark > 300, "{changed} changed, {dark} dark");
    }
}

#[test]
fn every_list_of_passes_is_executed_as_it_stands() {
    let _turn = turn();
    let (frame, scene) = (Frame::new(Distortion::None), scene());
    let full = frame.plan(&scene);
    let (whole, _) = draw(2, &frame, &scene, &full);
    let mut engine = CpuEngine::new(Some(2)).unwrap();
    engine.load_scene(&scene).unwrap();
    let background = frame.background.radiance.pixels();
    // All subsets that end in the compositing: leaving a pass out must do no more than lose its effect, even
    // right after a frame that had it.
    for subset in 0..8u32 {
        let left = |pass: Pass| match pass {
            Pass::ShadowMaps => subset & 1 != 0,
            Pass::ShadeObject => subset & 2 != 0,
            Pass::ShadeSurface => subset & 4 != 0,
            _ => true,
        };
        let mut plan = full.clone();
        plan.passes.retain(|p| left(p.pass));
        let mut picture = Picture::default();
        engine.relight(&full, &frame.input(), &mut picture).unwrap();
        assert_eq!(picture.radiance, whole.radiance);
        engine.relight(&plan, &frame.input(), &mut picture).unwrap();
        let pixels = picture.radiance.pixels();
        if subset & 2 == 0 {
            // No objects: every pixel is the background or darker.
            assert!(pixels.iter().zip(background).all(|(a, b)| a.iter().zip(b).all(|(a, b)| a <= b)));
        }
        if subset & 2 == 0 && subset & 5 != 5 {
            assert!(pixels == background, "subset {subset}: neither objects nor shadows");
        }
    }
    let mut linear = full.clone();
    linear.passes.retain(|p| p.pass != Pass::Tonemap);
    let mut picture = Picture::default();
    engine.relight(&linear, &frame.input(), &mut picture).unwrap();
    assert_eq!(picture.radiance, whole.radiance);
}

#[test]
fn no_allocation_per_frame() {
    let _turn = turn();
    let (mut frame, scene) = (Frame::new(Distortion::None), scene());
    let mut engine = CpuEngine::new(Some(2)).unwrap();
    engine.load_scene(&scene).unwrap();
    let mut plan = frame.plan(&scene);
    let mut picture = Picture::default();
    let mut merged = HdrImage::default();
    let mut timings = Vec::with_capacity(64);
    let pictures = [Rgb8Image::filled(160, 120, [90; 3]), Rgb8Image::filled(160, 120, [150; 3])];
    let pictures = [&pictures[0], &pictures[1]];
    let exposures = [Exposure { time_s: 0.01, gain: 1.0 }, Exposure { time_s: 0.04, gain: 1.0 }];
    let frames = 100;
    let mut one = |k: i64| {
        // The camera sways and the sun moves, over the same places again and again.
        let phase = (k % 20) as f64 * 0.314;
        let eye = DVec3::new(0.3 + 0.1 * phase.sin(), -0.6, 0.5 + 0.05 * phase.cos());
        frame.pose = Pose::look_at(eye, DVec3::new(0.0, 0.0, 0.05), DVec3::Z);
        let second = frame.light.hard.as_slice()[1];
        frame.light.hard = HardLights::none();
        frame.light.hard.push(sun(Vec3::new(0.4, 0.3 * phase.cos() as f32, 0.7)));
        frame.light.hard.push(second);
        let bracket = Bracket { pictures: &pictures, exposures: &exposures };
        engine.merge_bracket(&bracket, &frame.response, &mut merged).unwrap();
        let occasion = Occasion { camera: Some((&frame.lens, &frame.pose)), ..Occasion::SHOW };
        effects::plan(&occasion, &scene, &frame.light, &Quality::default(), &mut plan);
        let input = RelightInput {
            background: &merged,
            lens: &frame.lens,
            world_from_camera: &frame.pose,
            light: &frame.light,
            environment: None,
            posed: None,
            response: &frame.response,
            shown_exposure: exposures[0],
            t: Timestamp(k),
        };
        engine.relight(&plan, &input, &mut picture).unwrap();
        engine.take_timings(&mut timings);
    };
    (0..frames).for_each(&mut one);
    let counted = sys::allocated(|| (frames..2 * frames).for_each(&mut one));
    println!("{} allocations in {frames} frames", counted.count);
    // The queue of the thread pool takes a new block for every 63 jobs handed in (two a frame): 4 in 100 frames.
    // A kernel that allocated once a frame would make 100.
    assert!(counted.count <= 8, "in {frames} frames: {counted}");
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let _turn = turn();
    let scene = scene();
    let frame = Frame::new(Distortion::None);
    let plan = frame.plan(&scene);
    let mut engine = CpuEngine::new(Some(1)).unwrap();
    engine.load_scene(&scene).unwrap();
    let mut refused = |plan: &FramePlan, frame: &Frame, seconds: f64, word: &str| {
        let shown_exposure = Exposure { time_s: seconds, gain: 1.0 };
        let input = RelightInput { shown_exposure, ..frame.input() };
        match engine.relight(plan, &input, &mut Picture::default()) {
            Err(EngineError::Input(text)) => assert!(text.contains(word), "{text}"),
            other => panic!("{word}: {other:?}"),
        }
    };
    let mut wrong = Frame::new(Distortion::None);
    wrong.background.radiance = Image::filled(80, 60, [0.0; 3]);
    refused(&plan, &wrong, 1.0, "160 x 120");
    let mut wrong = Frame::new(Distortion::None);
    wrong.pose.translation.x = f64::NAN;
    refused(&plan, &wrong, 1.0, "pose");
    refused(&plan, &frame, 0.0, "exposure");
    for (quality, word) in [
        (Quality { shadow_map_texels: 5000, ..Quality::default() }, "64..=4096"),
        (Quality { pcf_taps: 0, ..Quality::default() }, "pcf_taps"),
        (Quality { coverage_samples: 3, ..Quality::default() }, "1 or 4"),
    ] {
        refused(&FramePlan { quality, ..plan.clone() }, &frame, 1.0, word);
    }
    assert!(CpuEngine::new(Some(0)).is_err());
}

#[test]
fn an_empty_scene_and_broken_meshes_leave_the_picture_as_it_is() {
    let _turn = turn();
    let frame = Frame::new(Distortion::None);
    let mut broken = sphere("broken", 4, Vec3::ZERO, 0.1, Material::Mirror { reflectance_rgb: [1.0; 3] });
    broken.mesh.positions.iter_mut().for_each(|p| p.x = f32::NAN);
    broken.mesh.triangles.push([0, 1, 999]);
    for scene in
        [Scene::default(), Scene { objects: vec![broken], surfaces: vec![ground()], ..Scene::default() }]
    {
        // The plan of a full scene on purpose: engines take what they get.
        let plan = frame.plan(&self::scene());
        let (picture, _) = draw(2, &frame, &scene, &plan);
        assert_eq!(picture.radiance, frame.background.radiance);
    }
}

fn bias<T: golden::Precision>(entry: &golden::Entry) {
    let cosine = T::of(entry.number::<f64>("incidence_deg").to_radians().cos());
    let (texel, pcf) = (entry.number::<T>("texel_world"), entry.number::<T>("pcf_half_width_texels"));
    for (key, limit) in [("receiver_plane_bias", T::infinity()), ("clamped", entry.number("max_bias"))] {
        entry.check_key(key, Some(&[shadow_maps::bias_m(texel, pcf, cosine, limit)]));
    }
}

#[test]
fn golden_bias() {
    let Some(shared) = support::shared("golden_bias") else { return };
    golden::run(&shared, &[("bias", bias::<f64>, bias::<f32>)]);
}
