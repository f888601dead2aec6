//! Soft shadows by every rung of the ladder on the device against the CPU twin, piles of spheres, and objects that move.

#[path = "support/gles.rs"]
mod gles;
mod support;

use glam::{Affine3A, DVec3, Quat, Vec3, Vec4};
use halflight::{
    animate::posed::Posed,
    assets::shapes,
    engine::{
        Engine, RelightInput,
        cpu::CpuEngine,
        gpu::{Backend, GpuEngine},
    },
    math::{
        lens::{Distortion, Lens},
        pose::Pose,
    },
    model::{
        animation::{AnimationChannel, BoundBox, Clip, Figure, Interpolation, Moves, Playing},
        blocker::Rung,
        frame::Exposure,
        image::HdrImage,
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::{Quality, SoftAt},
        response::Response,
        scene::{Material, Mesh, RealSurface, Scene, VirtualObject},
        time::Timestamp,
    },
    plan::{
        FramePlan, Pass,
        effects::{self, Occasion},
    },
    visibility::blockers::Blockers,
};
use std::sync::{Mutex, PoisonError};
use support::wanted;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;

/// Pixels where the device may land on the other side of an edge.
const MOST_AT_EDGES: usize = 8;

/// Software devices share the cores.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn surface(name: &str, mesh: Mesh) -> RealSurface {
    RealSurface { name: name.into(), mesh, receives_shadow: true, albedo_rgb: None }
}

/// Spheres without objects, over the ground and a round real thing, whose normals are everywhere.
fn spheres_alone(spheres: &[(Vec3, f32)]) -> Scene {
    let mound = shapes::transformed(
        &shapes::uv_sphere(0.15, 48, 24),
        &Affine3A::from_translation(Vec3::new(-0.25, -0.1, -0.02)),
    );
    Scene {
        objects: Vec::new(),
        surfaces: vec![surface("ground", shapes::plane_z0(50.0)), surface("mound", mound)],
        figures: vec![Figure::still("pile".into(), 0, Affine3A::IDENTITY, spheres.iter().copied())],
        transfer: None,
        room: None,
    }
}

fn soft_light(order: usize) -> Lights {
    let mut global = RadianceSh::zero(order);
    for (i, row) in global.rgb.iter_mut().enumerate().take(order * order) {
        let x = 0.15 * ((i * 7 % 5) as f32 - 2.0);
        *row = if i == 0 { [4.0, 3.5, 3.0] } else { [x, 0.5 * x, -x] };
    }
    Lights::soft(global)
}

/// All that a frame is drawn from.
struct Shot {
    scene: Scene,
    lens: Lens,
    pose: Pose,
    light: Lights,
    background: HdrImage,
    response: Response,
    posed: Posed,
    plan: FramePlan,
}

impl Shot {
    fn new(scene: Scene, light: Lights, quality: &Quality) -> Self {
        let lens = Lens::pinhole(WIDTH, HEIGHT, 90.0, 90.0, 48.3, 35.6);
        let mut background = HdrImage::default();
        background.radiance.reshape(WIDTH as usize, HEIGHT as usize, [1.0; 3]);
        background.flags.reshape(WIDTH as usize, HEIGHT as usize, 0);
        let mut plan = FramePlan::default();
        let occasion = Occasion { display: false, ..Occasion::SHOW };
        effects::plan(&occasion, &scene, &light, quality, &mut plan);
        assert!(plan.has(Pass::SoftShadow));
        let pose = Pose::look_at(DVec3::new(0.3, -0.7, 0.5), DVec3::new(0.0, 0.0, 0.03), DVec3::Z);
        let posed = Posed::new(&scene);
        Self { scene, lens, pose, light, background, response: Response::srgb(), posed, plan }
    }

    fn draw(&self, engine: &mut dyn Engine) -> Picture {
        engine.load_scene(&self.scene).expect("a sound scene");
        self.draw_again(engine)
    }

    fn draw_again(&self, engine: &mut dyn Engine) -> Picture {
        let input = RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera: &self.pose,
            light: &self.light,
            environment: None,
            posed: Some(&self.posed),
            response: &self.response,
            shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
            t: Timestamp(7),
        };
        let mut out = Picture::default();
        engine.ask_for_linear(true);
        engine.relight(&self.plan, &input, &mut out).expect("a sound frame");
        out
    }
}

/// Two pictures of ratios: the largest difference of a channel but for a few pixels, the largest of all, and the smallest
/// ratio.
fn compare(device: &Picture, twin: &Picture) -> (f32, f32, f32) {
    let (device, twin) = (device.radiance.pixels(), twin.radiance.pixels());
    assert_eq!(device.len(), twin.len());
    let mut apart: Vec<f32> = Vec::new();
    let mut smallest = 1.0f32;
    for (d, t) in device.iter().zip(twin) {
        assert!(d.iter().all(|x| x.is_finite() && (0.0..=1.0).contains(x)), "{d:?}, the twin has {t:?}");
        apart.push((0..3).map(|c| (d[c] - t[c]).abs()).fold(0.0, f32::max));
        smallest = t.iter().copied().fold(smallest, f32::min);
    }
    apart.sort_by(|a, b| b.total_cmp(a));
    (apart[MOST_AT_EDGES], apart[0], smallest)
}

/// An engine of this backend with `compose/soft_shadow` on the device and the rest of a frame on its twins.
fn only_soft_shadow(test: &str, backend: Backend) -> Option<GpuEngine> {
    let engine = match GpuEngine::new(Some(backend)) {
        Ok(engine) => engine,
        Err(error) => {
            support::skip_gpu(test, &error.to_string());
            return None;
        }
    };
    println!("{}", engine.description());
    let others: Vec<_> = Pass::ALL.into_iter().filter(|p| *p != Pass::SoftShadow).collect();
    let names: Vec<_> = others.into_iter().map(|pass| pass.name().to_owned()).collect();
    Some(engine.with_cpu_kernels(&names).expect("known kernels"))
}

/// A body of spheres that overlap and hide each other, one half under the ground, one that receivers stand in.
fn body() -> Vec<(Vec3, f32)> {
    let mut spheres: Vec<_> = (0..12)
        .map(|i| {
            let (sin, cos) = (i as f32 * 2.4).sin_cos();
            (Vec3::new(0.12 * cos, 0.12 * sin, 0.05 + 0.03 * i as f32), 0.05 + 0.006 * (i % 4) as f32)
        })
        .collect();
    spheres.push((Vec3::new(0.3, 0.0, 0.0), 0.06));
    spheres
}

fn every_rung(backend: Backend) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(mut engine) = only_soft_shadow(&format!("rungs on {}", backend.name()), backend) else { return };
    let mut cpu = CpuEngine::new(None).expect("threads");
    for (rung, order) in (2..=6).flat_map(|order| Rung::ALL.map(|rung| (rung, order))) {
        let quality =
            Quality { rung, sh_order: order, soft_step_px: 1, coverage_samples: 1, ..Quality::default() };
        let mut shot = Shot::new(spheres_alone(&body()), soft_light(order), &quality);
        assert!(fits(rung, order, shot.posed.spheres()), "else the twin runs in the device's stead");
        assert!(!shot.plan.passes.iter().any(|p| p.reason.contains("CPU")));
        let (twin, device) = (shot.draw(&mut cpu), shot.draw(&mut engine));
        let (apart, worst, smallest) = compare(&device, &twin);
        println!("{} order {order}: {apart:.1e}, at most {worst:.1e}, darkest {smallest:.2}", rung.name());
        at_vertices(&mut cpu, &mut engine, &mut shot, &quality);
        assert!(smallest < 0.6, "{} order {order}: hardly any shadow", rung.name());
        // Measured 9e-5 to 1.9e-4, at most 6.5e-4, all beside the spheres that touch the ground: there cos(half angle) =
        // sqrt(1 - r^2/d^2) makes 3e-4 of a rounding of 1e-7. With all spheres 0.1 m higher it is 2e-6 to 2e-5.
        assert!(apart < 4e-4 && worst < 2e-3, "{} order {order}: {apart:e}, {worst:e}", rung.name());
    }
}

/// The same evaluated at the vertices of a grid.
fn at_vertices(cpu: &mut CpuEngine, engine: &mut GpuEngine, shot: &mut Shot, quality: &Quality) {
    shot.plan.quality.soft_at = SoftAt::Vertex;
    let (twin, device) = (shot.draw(cpu), shot.draw(engine));
    let (apart, worst, smallest) = compare(&device, &twin);
    let what = format!("{} order {} at vertices", quality.rung.name(), quality.sh_order);
    println!("{what}: {apart:.1e}, at most {worst:.1e}, darkest {smallest:.2}");
    assert!(smallest < 0.6, "{what}: hardly any shadow");
    // Measured 2.4e-6, at most 1.9e-5: no vertex lies beside the point where a sphere touches the ground.
    assert!(apart < 1e-5 && worst < 1e-4, "{what}: {apart:e}, {worst:e}");
}

fn fits(rung: Rung, order: usize, spheres: &[halflight::model::blocker::BlockerSphere]) -> bool {
    let mut blockers = Blockers::new();
    blockers.prepare(spheres, rung, order, 64);
    blockers.fit_shader()
}

#[test]
fn every_rung_on_vulkan() {
    every_rung(Backend::Vulkan);
}

#[test]
fn every_rung_on_gl() {
    every_rung(Backend::Gl);
}

/// Thin and thick boxes, some beside spheres of the same body, one that receivers stand in.
fn boxes_and_spheres(spheres: &[(Vec3, f32)]) -> Scene {
    let of = |at: [f32; 3], half: [f32; 3], tilt: f32| {
        let turn = Quat::from_rotation_x(tilt) * Quat::from_rotation_z(0.5 + tilt);
        BoundBox {
            node: 0,
            centre_node: at.into(),
            axes_node: [turn * Vec3::X, turn * Vec3::Y, turn * Vec3::Z],
            half_node: half.into(),
        }
    };
    let mut scene = spheres_alone(spheres);
    scene.figures[0].boxes = vec![
        of([0.0, 0.15, 0.15], [0.15, 0.1, 0.002], 0.2),
        of([0.1, -0.1, 0.08], [0.002, 0.1, 0.07], 0.0),
        of([-0.1, -0.2, 0.03], [0.05, 0.05, 0.04], 0.0),
        of([0.0, 0.0, 0.3], [0.1, 0.1, 0.0], 1.0),
    ];
    scene
}

fn every_rung_with_boxes(backend: Backend) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(mut engine) = only_soft_shadow(&format!("boxes on {}", backend.name()), backend) else { return };
    let mut cpu = CpuEngine::new(None).expect("threads");
    for (rung, order) in [2, 4, 6].into_iter().flat_map(|order| Rung::ALL.map(|rung| (rung, order))) {
        let quality =
            Quality { rung, sh_order: order, soft_step_px: 2, coverage_samples: 1, ..Quality::default() };
        for spheres in [&[][..], &[(Vec3::new(0.3, 0.2, 0.1), 0.08)]] {
            let mut shot = Shot::new(boxes_and_spheres(spheres), soft_light(order), &quality);
            let what = format!("boxes and {} spheres, {} order {order}", spheres.len(), rung.name());
            for soft_at in [SoftAt::Pixel, SoftAt::Vertex] {
                shot.plan.quality.soft_at = soft_at;
                let (twin, device) = (shot.draw(&mut cpu), shot.draw(&mut engine));
                let (apart, worst, smallest) = compare(&device, &twin);
                println!("{what}, {soft_at:?}: {apart:.1e}, at most {worst:.1e}, darkest {smallest:.2}");
                assert!(smallest < 0.7, "{what}: hardly any shadow");
                assert!(apart < 4e-4 && worst < 2e-3, "{what}: {apart:e}, {worst:e}");
            }
        }
    }
}

#[test]
fn boxes_on_vulkan() {
    every_rung_with_boxes(Backend::Vulkan);
}

#[test]
fn boxes_on_gl() {
    every_rung_with_boxes(Backend::Gl);
}

/// So many spheres, all the same or each a little elsewhere (all different bodies' worth of overlap).
fn pile(count: usize, spread_m: f32) -> Vec<(Vec3, f32)> {
    (0..count)
        .map(|i| {
            let (sin, cos) = (i as f32 * 2.4).sin_cos();
            let share = (i as f32 + 0.5) / count as f32;
            let at = Vec3::new(share.sqrt() * cos, share.sqrt() * sin, share - 0.5);
            (Vec3::new(0.05, 0.0, 0.2) + spread_m * at, 0.12 + 0.2 * spread_m * sin)
        })
        .collect()
}

fn piles(backend: Backend) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(mut engine) = only_soft_shadow(&format!("piles on {}", backend.name()), backend) else { return };
    let mut cpu = CpuEngine::new(None).expect("threads");
    let orders = |count| if count == 200 { 2..=6 } else { 4..=4 };
    for (count, spread_m) in [(64, 0.0), (64, 0.1), (200, 0.0), (200, 0.1), (270, 0.1)] {
        for (rung, order) in orders(count).flat_map(|order| Rung::ALL.map(|rung| (rung, order))) {
            // Each of 200 is tested against 64 others: much for software.
            let soft_step_px = if count == 64 { 2 } else { 4 };
            let quality =
                Quality { rung, sh_order: order, soft_step_px, coverage_samples: 1, ..Quality::default() };
            let shot = Shot::new(spheres_alone(&pile(count, spread_m)), soft_light(order), &quality);
            let (twin, device) = (shot.draw(&mut cpu), shot.draw(&mut engine));
            let (apart, worst, smallest) = compare(&device, &twin);
            let pile = format!("{count} spheres within {spread_m} m, {} order {order}", rung.name());
            println!("{pile}: {apart:.1e}, at most {worst:.1e}, darkest {smallest:.2}");
            assert!(smallest < 0.95, "{pile}: hardly any shadow");
            let on_device = fits(rung, order, shot.posed.spheres());
            assert_eq!(on_device, count <= 256, "{pile}");
            // Measured 1.2e-5 for one sphere many times (the others lie in it), 5.2e-4 where each direction is tested
            // against all. Among different ones the last digit decides for some receivers whether one lies in another,
            // and each that counts is a factor: up to 1.01 where 64 count (`dc` 0.7 % of the light, the others 0.1 %),
            // of more where 200 stand near the limits of `linear` (2 %) and `hybrid` (0.5 %).
            let most = match rung {
                _ if !on_device => 0.0,
                Rung::Directions => 8e-4,
                Rung::Linear if count == 200 && spread_m > 0.0 => 4e-2,
                Rung::Dc | Rung::Hybrid if spread_m > 0.0 => 1.5e-2,
                // 2.9e-3 of 200 in the chain of order 6.
                _ if spread_m > 0.0 => {
                    wanted::hold("twins_soft.piles", f64::from(worst));
                    continue;
                }
                _ => 5e-5,
            };
            assert!(worst <= most, "{pile}: {worst:e}");
        }
    }
}

#[test]
fn piles_stay_in_bounds_on_vulkan() {
    piles(Backend::Vulkan);
}

#[test]
fn piles_stay_in_bounds_on_gl() {
    piles(Backend::Gl);
}

/// Two balls of which one goes round the other by a clip, with its spheres, and a box that stands still.
fn moving() -> Scene {
    let matt = Material::Lambert { albedo_rgb: [0.8, 0.5, 0.3] };
    let ball = |name: &str, radius: f64| {
        let mesh = shapes::uv_sphere(radius, 32, 16);
        VirtualObject {
            name: name.into(),
            mesh,
            material: matt,
            world_from_object: Affine3A::IDENTITY,
            openness: Vec::new(),
        }
    };
    let mut goes = Figure::still("goes".into(), 1, Affine3A::IDENTITY, [(Vec3::ZERO, 0.06)].into_iter());
    let at = |x: f32, y: f32| Vec4::new(x, y, 0.06, 0.0);
    let channel = |moves, values| AnimationChannel {
        node: 0,
        moves,
        interpolation: Interpolation::Linear,
        times_s: vec![0.0, 1.0, 2.0],
        values,
    };
    let turned = |angle: f32| Vec4::from(Quat::from_rotation_z(angle));
    goes.clips.push(Clip {
        name: "round".into(),
        start_s: 0.0,
        duration_s: 2.0,
        channels: vec![
            channel(Moves::Translation, vec![at(0.2, -0.1), at(-0.1, -0.2), at(-0.2, 0.1)]),
            channel(Moves::Rotation, vec![turned(0.0), turned(1.0), turned(2.0)]),
        ],
    });
    goes.playing = Some(Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: false });
    let mut stands = ball("stands", 0.1);
    stands.world_from_object = Affine3A::from_translation(Vec3::new(0.0, 0.0, 0.1));
    let mut cube = ball("cube", 0.1);
    cube.mesh = shapes::cuboid(DVec3::splat(0.05));
    cube.world_from_object = Affine3A::from_translation(Vec3::new(0.25, 0.15, 0.05));
    Scene {
        objects: vec![stands, ball("goes", 0.06), cube],
        surfaces: vec![surface("ground", shapes::plane_z0(50.0))],
        figures: vec![goes],
        transfer: None,
        room: None,
    }
}

/// Frame after frame of a scene in which an object moves: as the twin draws it, and to the bit as if all of it were
/// uploaded each time.
fn moved_objects(backend: Backend) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let test = format!("moving objects on {}", backend.name());
    let mut engine = match GpuEngine::new(Some(backend)) {
        Ok(engine) => engine,
        Err(error) => return support::skip_gpu(&test, &error.to_string()),
    };
    println!("{}", engine.description());
    let mut cpu = CpuEngine::new(None).expect("threads");
    let mut light = soft_light(4);
    let to_light_world = Vec3::new(0.4, 0.3, 0.7).normalize().to_array();
    light.hard.push(HardLight { to_light_world, irradiance_rgb: [6.0, 5.5, 5.0], extent_rad: 0.0 });
    let quality = Quality { soft_step_px: 1, coverage_samples: 1, ..Quality::default() };
    let mut shot = Shot::new(moving(), light, &quality);
    let radial = Distortion::RadialTangential([-0.25, 0.06, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    for distortion in [Distortion::None, radial] {
        shot.lens.distortion = distortion;
        // What stands still is where loading puts it.
        shot.posed = Posed::new(&shot.scene);
        shot.posed.update(&shot.scene, 0.0);
        engine.load_scene(&shot.scene).expect("a sound scene");
        cpu.load_scene(&shot.scene).expect("a sound scene");
        let mut before = shot.draw_again(&mut engine);
        for t_s in [0.7, 1.6, 0.1] {
            shot.posed.update(&shot.scene, t_s);
            let moved: Vec<_> = shot.posed.objects().iter().map(|object| object.moved).collect();
            assert_eq!(moved, [false, true, false]);
            let (device, twin) = (shot.draw_again(&mut engine), shot.draw_again(&mut cpu));
            let changed = device.radiance.pixels().iter().zip(before.radiance.pixels());
            let changed = changed.filter(|(now, then)| (now[0] - then[0]).abs() > 0.05).count();
            assert!(changed > 100, "{changed} pixels changed");
            let apart = device.radiance.pixels().iter().zip(twin.radiance.pixels());
            let apart = apart.filter(|(d, t)| (0..3).any(|c| (d[c] - t[c]).abs() > 2e-2 * t[c].max(0.01)));
            let apart = apart.count();
            println!("{t_s} s: {apart} pixels apart, {changed} changed");
            assert!(apart < 20, "{apart} pixels");
            before = device;
            // The same with all of the scene uploaded anew.
            let anew = shot.draw(&mut engine);
            let same = anew.radiance.pixels().iter().zip(before.radiance.pixels()).filter(|(a, b)| a == b);
            assert_eq!(same.count(), before.radiance.pixels().len(), "{t_s} s");
        }
    }
}

#[test]
fn moved_objects_are_where_they_are_on_vulkan() {
    moved_objects(Backend::Vulkan);
}

#[test]
fn moved_objects_are_where_they_are_on_gl() {
    moved_objects(Backend::Gl);
}

#[test]
fn gles_3_1_does_the_same() {
    for test in [
        "every_rung_on_gl",
        "boxes_on_gl",
        "piles_stay_in_bounds_on_gl",
        "moved_objects_are_where_they_are_on_gl",
    ] {
        let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        gles::assert_gles_3_1(&gles::child(test, "3.1"));
    }
}
