//! Only the effects that a scene calls for: what is planned is what is dispatched, what is kept is what would be made again,
//! and what is left out changes no more than is said. On the CPU and on every backend that is found.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/gles.rs"]
mod gles;
#[path = "support/lit_room.rs"]
mod lit_room;
mod support;
#[path = "support/twin_scene.rs"]
mod twin_scene;

use glam::{DVec3, Vec3};
use halflight::{
    animate::posed::Posed,
    engine::{
        Engine, LiveMemory, RelightInput,
        cpu::CpuEngine,
        gpu::{Backend, GpuEngine},
    },
    math::{
        lens::{Distortion, Lens},
        pose::Pose,
    },
    model::{
        animation::{Attachment, FigurePart},
        blocker::Rung,
        environment::EnvironmentPicture,
        frame::Exposure,
        image::HdrImage,
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::{Effects, Quality},
        response::Response,
        scene::{Material, Scene},
        time::Timestamp,
    },
    nearfield::prepare::KnownRoom,
    plan::{
        Effect, EffectVerdict, Foresight, FramePlan, LARGEST_ERROR, Pass,
        effects::{self, Occasion},
    },
};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Software devices share the cores.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;

/// One frame, and what it is drawn from.
#[derive(Clone)]
struct Shot {
    name: &'static str,
    scene: Scene,
    room: Option<Arc<KnownRoom>>,
    lens: Lens,
    pose: Pose,
    light: Lights,
    environment: Option<EnvironmentPicture>,
    quality: Quality,
    posed: Posed,
    exposure_s: f64,
}

fn soft(level: f32) -> RadianceSh {
    let mut soft = RadianceSh::zero(4);
    soft.rgb[0] = [1.2 * level, 1.3 * level, 1.6 * level];
    soft.rgb[2] = [0.2 * level; 3];
    soft
}

/// The same from everywhere.
fn flat() -> RadianceSh {
    let mut flat = RadianceSh::zero(4);
    flat.rgb[0] = [1.0; 3];
    flat
}

fn with_sun(soft: RadianceSh, e: f32) -> Lights {
    let mut light = Lights::soft(soft);
    let to_light_world = Vec3::new(0.48, 0.3, 0.82).normalize().to_array();
    light.hard.push(HardLight { to_light_world, irradiance_rgb: [e, 0.9 * e, 0.8 * e], extent_rad: 0.01 });
    light
}

fn looking(at: DVec3) -> Pose {
    Pose::look_at(DVec3::new(0.3, -0.8, 0.6), at, DVec3::Z)
}

fn base() -> Shot {
    let scene = twin_scene::scene();
    Shot {
        name: "all",
        posed: Posed::new(&scene),
        scene,
        room: None,
        lens: Lens::pinhole(WIDTH, HEIGHT, 100.0, 100.0, 48.0, 36.0),
        pose: looking(DVec3::new(0.0, 0.0, 0.05)),
        light: with_sun(soft(1.0), 3.0),
        environment: Some(environment().clone()),
        quality: Quality { shadow_map_texels: 256, ..Quality::default() },
        exposure_s: 0.4,
    }
}

fn environment() -> &'static EnvironmentPicture {
    static ONCE: OnceLock<EnvironmentPicture> = OnceLock::new();
    ONCE.get_or_init(twin_scene::environment)
}

fn known_room() -> &'static Arc<KnownRoom> {
    static ONCE: OnceLock<Arc<KnownRoom>> = OnceLock::new();
    ONCE.get_or_init(|| Arc::new(lit_room::known_room(false)))
}

impl Shot {
    fn scene(mut self, change: impl FnOnce(&mut Scene)) -> Self {
        change(&mut self.scene);
        self.posed = Posed::new(&self.scene);
        self
    }

    fn input<'a>(&'a self, background: &'a HdrImage, response: &'a Response) -> RelightInput<'a> {
        RelightInput {
            background,
            lens: &self.lens,
            world_from_camera: &self.pose,
            light: &self.light,
            environment: self.environment.as_ref(),
            posed: Some(&self.posed),
            response,
            shown_exposure: Exposure { time_s: self.exposure_s, gain: 1.0 },
            t: Timestamp(0),
        }
    }

    fn load(&self, engine: &mut dyn Engine) {
        engine.ask_for_linear(true);
        engine.load_room(self.room.clone()).unwrap();
        engine.load_scene(&self.scene).unwrap();
    }

    /// Plans and draws; `keeps`: with what the engine holds.
    fn draw(&self, engine: &mut dyn Engine, keeps: bool, effects: Effects) -> (FramePlan, Picture) {
        let (background, response) = (background(), Response::srgb());
        let input = self.input(&background, &response);
        let quality = Quality { effects, ..self.quality };
        let mut foresight = Foresight::NONE;
        engine.foresee(&input, &quality, &mut foresight).unwrap();
        if !keeps {
            foresight = Foresight { maps_seen: foresight.maps_seen, ..Foresight::NONE };
        }
        let occasion = Occasion {
            camera: Some((&self.lens, &self.pose)),
            spheres: Some(self.posed.spheres()),
            foresight: Some(&foresight),
            ..Occasion::SHOW
        };
        let (mut plan, mut out) = (FramePlan::default(), Picture::default());
        effects::plan(&occasion, &self.scene, &self.light, &quality, &mut plan);
        engine.relight(&plan, &input, &mut out).unwrap();
        let planned: Vec<Pass> = plan.passes.iter().map(|p| p.pass).collect();
        assert_eq!(engine.dispatched(), planned, "{}: what is planned is dispatched", self.name);
        let effects: Vec<Effect> = plan.decisions.iter().map(|d| d.effect).collect();
        assert_eq!(effects, Effect::ALL, "each effect is decided on");
        (plan, out)
    }
}

/// Gray with a slope, so that no pixel is like the next.
fn background() -> HdrImage {
    let mut image = HdrImage::default();
    image.radiance.reshape(WIDTH as usize, HEIGHT as usize, [0.0; 3]);
    for (i, pixel) in image.radiance.pixels_mut().iter_mut().enumerate() {
        *pixel = [0.4 + 1e-5 * i as f32, 0.45, 0.5 - 1e-5 * i as f32];
    }
    image.flags.reshape(WIDTH as usize, HEIGHT as usize, 0);
    image
}

/// Every scene of the matrix with the passes that it calls for.
fn matrix() -> Vec<(Shot, Vec<Pass>)> {
    use Pass::{Composite, PointMaps, ShadeObject, ShadeSurface, ShadowMaps, SoftShadow, Subtract, Tonemap};
    let matt = Material::Lambert { albedo_rgb: [0.6; 3] };
    let all = vec![ShadowMaps, SoftShadow, ShadeObject, ShadeSurface, Composite, Tonemap];
    let named = |name, shot: Shot| Shot { name, ..shot };
    let room = known_room();
    let (lens, room_pose) = lit_room::camera(WIDTH, HEIGHT, Distortion::None);
    let in_room = Shot {
        name: "known room",
        room: Some(Arc::clone(room)),
        lens,
        pose: room_pose,
        light: Lights::soft(soft(0.3)),
        environment: None,
        ..base().scene(|scene| *scene = lit_room::scene(room))
    };
    let matt_alone = |scene: &mut Scene| {
        scene.objects.truncate(1);
        scene.objects[0].material = matt;
        scene.objects[0].openness.clear();
        scene.figures.clear();
        scene.transfer = None;
    };
    vec![
        (base(), all.clone()),
        (
            named(
                "no objects",
                base().scene(|scene| {
                    scene.objects.clear();
                    scene.figures.clear();
                }),
            ),
            vec![Composite, Tonemap],
        ),
        (
            named(
                "no mirror",
                base().scene(|scene| scene.objects.iter_mut().for_each(|o| o.material = matt)),
            ),
            all.clone(),
        ),
        (
            named("uniform light", Shot { light: Lights::soft(flat()), ..base() }),
            vec![SoftShadow, ShadeObject, ShadeSurface, Composite, Tonemap],
        ),
        (
            named("night", Shot { light: Lights::soft(RadianceSh::zero(4)), ..base() }),
            vec![ShadeObject, Composite, Tonemap],
        ),
        (
            // The camera looks away: no shadow reaches what it sees, but what bodies hide of the sky has no end.
            named("out of view", Shot { pose: looking(DVec3::new(0.6, -1.6, 0.0)), ..base() }),
            vec![SoftShadow, ShadeSurface, Composite, Tonemap],
        ),
        (
            named(
                "out of view, no spheres",
                Shot {
                    pose: looking(DVec3::new(0.6, -1.6, 0.0)),
                    ..base().scene(|scene| scene.figures.clear())
                },
            ),
            vec![Composite, Tonemap],
        ),
        (
            named("faint sun", Shot { light: with_sun(soft(1.0), 1e-3), ..base().scene(matt_alone) }),
            vec![ShadeObject, Composite, Tonemap],
        ),
        (
            // A small body high above the ground, whose soft shadow is nearly none.
            named(
                "small and high",
                Shot {
                    quality: Quality { rung: Rung::Linear, ..base().quality },
                    light: Lights::soft(flat()),
                    pose: looking(DVec3::new(0.0, 0.0, 0.6)),
                    ..base().scene(|scene| {
                        scene.objects.truncate(1);
                        scene.objects[0].material = matt;
                        scene.objects[0].world_from_object.translation.z = 0.7;
                        scene.surfaces.truncate(1);
                        scene.transfer = None;
                        scene.figures.truncate(1);
                        let figure = &mut scene.figures[0];
                        figure.world_from_figure.translation.z = 0.7;
                        figure.spheres.truncate(1);
                        figure.spheres[0].radius_node = 0.01;
                        figure.parts =
                            vec![FigurePart { object: 0, attachment: Attachment::Rigid { joint: 0 } }];
                    })
                },
            ),
            vec![ShadeObject, Composite, Tonemap],
        ),
        (in_room, vec![PointMaps, Subtract, ShadeObject, Composite, Tonemap]),
    ]
}

/// The engine of a test, in its words; none where there is no adapter.
fn engine(backend: Option<Backend>, test: &str) -> Option<Box<dyn Engine>> {
    let Some(backend) = backend else { return Some(Box::new(CpuEngine::new(None).unwrap())) };
    match GpuEngine::new(Some(backend)) {
        Ok(engine) => Some(Box::new(engine)),
        Err(error) => {
            support::skip_gpu(test, &error.to_string());
            None
        }
    }
}

fn same(a: &Picture, b: &Picture) -> bool {
    a.radiance == b.radiance && a.display == b.display
}

/// Largest difference of two pictures, as a share of the first.
fn apart(plan: &Picture, all: &Picture) -> f32 {
    let pairs = plan.radiance.pixels().as_flattened().iter().zip(all.radiance.pixels().as_flattened());
    pairs.map(|(p, a)| if p == a { 0.0 } else { (p - a).abs() / p.abs().max(1e-9) }).fold(0.0, f32::max)
}

/// What every frame needs that draws the scene on a device: what casts, what receives, camera, light, shadow maps' cameras.
#[rustfmt::skip]
const SCENE: [&str; 8] =
    ["indices", "indices", "light", "materials", "shadow cameras", "vertices", "vertices", "view"];
#[rustfmt::skip]
const NEAR_MAPS: [&str; 7] =
    ["indices", "near cameras", "near depth", "near lights", "near maps", "pages of near maps", "vertices"];
const ROOM_LIGHTS: [&str; 10] = [
    "indices",
    "listed lights",
    "ranges of lights",
    "ratios",
    "room depth",
    "suns",
    "suns' cameras of the room",
    "triangles with lights",
    "turns",
    "vertices",
];

/// What a pass needs on a device, written down here once more; `has_picture`: of the place, for mirrors.
fn memory_of(pass: Pass, has_picture: bool) -> Vec<&'static str> {
    let list: &[&str] = match pass {
        Pass::ShadowMaps => &["cameras of shadow maps", "shadow depth", "shadow maps"],
        Pass::SoftShadow => &[
            "blocker tables",
            "blockers",
            "coarse depth",
            "coarse view",
            "planes",
            "soft shadows",
            "soft terms",
        ],
        Pass::PointMaps => &NEAR_MAPS,
        Pass::Subtract => &ROOM_LIGHTS,
        Pass::ShadeObject => &["object depth", "object layer", "object samples", "surroundings"],
        Pass::ShadeSurface => &["ratios", "soft picture", "surface depth"],
        Pass::Composite => &["background", "composed radiance", "composed radiance", "composite params"],
        Pass::Tonemap => &["display", "display", "starts of values", "thresholds", "tonemap params"],
        // None of these is among the passes of this file's scenes.
        _ => &[],
    };
    let picture = (pass == Pass::ShadeObject && has_picture).then_some("environment");
    list.iter().copied().chain(picture).collect()
}

/// What lives is exactly what the passes need.
fn lives_for(engine: &dyn Engine, shot: &Shot, passes: &[Pass], on_device: bool) {
    let mut live: Vec<LiveMemory> = Vec::new();
    engine.live(&mut live);
    assert!(live.iter().all(|l| l.bytes > 0));
    // Stand-ins of one texel where a binding has to be filled, and the times of passes where devices tell them.
    let names: Vec<&str> =
        live.iter().map(|l| l.name).filter(|n| !["one texel", "pass times"].contains(n)).collect();
    let mut expected = Vec::new();
    for pass in passes {
        if on_device {
            expected.extend(memory_of(*pass, shot.environment.is_some()));
        } else {
            expected.extend(match pass {
                Pass::ShadowMaps => Some("shadow maps"),
                Pass::SoftShadow => Some("soft shadows"),
                Pass::PointMaps => Some("near maps"),
                Pass::Subtract | Pass::ShadeSurface => Some("ratios"),
                Pass::ShadeObject => Some("object layer"),
                _ => None,
            });
        }
    }
    if on_device && passes.iter().any(|pass| pass.draws_scene()) {
        expected.extend(SCENE);
    }
    expected.sort_unstable();
    assert_eq!(names, expected, "{}", shot.name);
}

fn called_for_and_no_more(backend: Option<Backend>) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(mut engine) = engine(backend, "called_for_and_no_more") else { return };
    println!("{}", engine.description());
    for (shot, expected) in matrix() {
        shot.load(engine.as_mut());
        let (everything, all) = shot.draw(engine.as_mut(), true, Effects::All);
        assert!(everything.kept.is_empty(), "{}", shot.name);
        let (plan, picture) = shot.draw(engine.as_mut(), false, Effects::CalledFor);
        assert_eq!(engine.dispatched(), expected, "{}", shot.name);
        lives_for(engine.as_ref(), &shot, &expected, backend.is_some());
        let off = || plan.decisions.iter().filter(|d| d.verdict == EffectVerdict::Off);
        assert!(off().all(|d| d.error_bound <= LARGEST_ERROR), "{}: {:?}", shot.name, plan.decisions);
        let bound: f32 = off().map(|d| d.error_bound).sum();
        let apart = apart(&picture, &all);
        println!("  {}: {apart:.1e} of {bound:.1e}", shot.name);
        // Where the bound is 0 the bits have to agree; else a device keeps objects in 16-bit floats, whose steps are 2^-10.
        let step = if bound > 0.0 && backend.is_some() { 1e-3 } else { 0.0 };
        assert!(apart <= bound * 1.001 + step, "{}: {apart} of {bound}", shot.name);
        // The faint effects change something: their bounds are put to the test.
        if shot.name.contains("faint") || shot.name.contains("small") {
            assert!(apart > 0.0 && bound > 0.0, "{}: {apart} of {bound}", shot.name);
        }
        // Nothing has moved: all but the last steps is kept.
        let (plan, again) = shot.draw(engine.as_mut(), true, Effects::CalledFor);
        assert_eq!(engine.dispatched(), [Pass::Composite, Pass::Tonemap], "{}: {:?}", shot.name, plan.kept);
        assert_eq!(plan.kept.len() + 2, expected.len(), "{}", shot.name);
        lives_for(engine.as_ref(), &shot, &expected, backend.is_some());
        assert!(same(&picture, &again), "{}: what is kept is what would be made", shot.name);
    }
}

/// Frames in which one thing after the other changes, drawn with what is held and without.
fn kept_is_what_would_be_made(backend: Option<Backend>) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let test = "kept_is_what_would_be_made";
    let (Some(mut keeping), Some(mut making)) = (engine(backend, test), engine(backend, test)) else {
        return;
    };
    let mut shot = base();
    shot.load(keeping.as_mut());
    shot.load(making.as_mut());
    let mut maps_kept = 0;
    let mut moved_the_camera = Vec::new();
    for step in 0..14 {
        match step {
            // A camera that moves while all shadows stay in its picture: the maps stay.
            2 => shot.pose = Pose::look_at(DVec3::new(0.31, -0.8, 0.6), DVec3::new(0.0, 0.0, 0.05), DVec3::Z),
            3 => shot.light = with_sun(soft(1.1), 3.0),
            4 => shot.light = with_sun(soft(1.1), 2.0),
            5 => shot.exposure_s = 0.3,
            6 => shot.scene.figures[1].world_from_figure.translation.x += 0.02,
            7 => shot.quality.pcf_taps = 2,
            8 => shot.quality.shadow_map_texels = 128,
            9 => shot.pose = looking(DVec3::new(0.6, -1.6, 0.0)),
            10 => shot.pose = looking(DVec3::new(0.0, 0.0, 0.05)),
            11 => shot.environment = None,
            12 => shot.light = Lights::soft(soft(1.1)),
            _ => {}
        }
        if step == 6 {
            // The object moves by its pose, not by another scene.
            shot.posed = Posed::new(&shot.scene);
        }
        let (plan, kept) = shot.draw(keeping.as_mut(), true, Effects::CalledFor);
        let (_, made) = shot.draw(making.as_mut(), false, Effects::CalledFor);
        assert!(same(&kept, &made), "step {step}");
        maps_kept += usize::from(plan.keeps(Pass::ShadowMaps));
        if step == 2 {
            moved_the_camera = plan.kept.iter().map(|p| p.pass).collect();
        }
        if [0, 3, 6, 7, 8, 11, 12].contains(&step) {
            assert!(!plan.keeps(Pass::ShadeObject), "step {step}");
        }
        if [1, 13].contains(&step) {
            assert_eq!(keeping.dispatched(), [Pass::Composite, Pass::Tonemap], "step {step}");
        }
    }
    assert_eq!(moved_the_camera, [Pass::ShadowMaps], "the view alone has changed");
    assert!(maps_kept >= 5, "{maps_kept}");
}

#[test]
fn cpu_draws_what_is_called_for() {
    called_for_and_no_more(None);
}

#[test]
fn vulkan_draws_what_is_called_for() {
    called_for_and_no_more(Some(Backend::Vulkan));
}

#[test]
fn gl_draws_what_is_called_for() {
    called_for_and_no_more(Some(Backend::Gl));
}

#[test]
fn gles_3_1_draws_what_is_called_for() {
    gles::assert_gles_3_1(&gles::child("gl_draws_what_is_called_for", "3.1"));
}

#[test]
fn cpu_keeps_what_it_would_make() {
    kept_is_what_would_be_made(None);
}

#[test]
fn vulkan_keeps_what_it_would_make() {
    kept_is_what_would_be_made(Some(Backend::Vulkan));
}

#[test]
fn gl_keeps_what_it_would_make() {
    kept_is_what_would_be_made(Some(Backend::Gl));
}
