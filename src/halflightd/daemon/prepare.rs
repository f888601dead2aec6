//! From settings to a pipeline that is ready: one function for each thing that is opened.

use super::{cache_folder, dress, engines, governing::governor_of, host::Host, known_room};
use crate::assets::calibration;
use crate::assets::scene::{self as scene_file, SceneFile};
use crate::config::file;
use crate::config::settings::{GrayWeights, Settings};
use crate::device::bracketed::{CameraResponse, FoundResponse, Replan};
use crate::device::imu::{description::ImuDescription, wire_log::WireLogWriter};
use crate::device::open::{CameraOptions, ImuOptions};
use crate::device::{Clock, DeviceError, ErrorKind, FrameSource, ImuSource, clock::MonotonicClock, open};
use crate::engine::{Engine, EngineError, Timings, cpu::CpuEngine};
use crate::model::{frame::Exposure, path_text, response::Response, rig::Rig, scene::Scene};
use crate::nearfield::prepare::KnownRoom;
use crate::pipeline::{Options, Pipeline, PipelineError, engine_in_use::StandIn};
use std::sync::Arc;

/// A pipeline with the sources that feed it.
pub struct Prepared {
    /// Where frames come from.
    pub source: Box<dyn FrameSource>,
    /// Where inertial samples come from.
    pub imu: Option<Box<dyn ImuSource>>,
    /// What they go through.
    pub pipeline: Pipeline,
    /// The engine in one line.
    pub engine: String,
    /// Exposures that the camera goes through.
    pub cycle: Vec<Exposure>,
    /// What was found out of the camera's response, for when it is opened again.
    pub found: FoundResponse,
}

/// An opened camera that goes through the exposures of the settings.
pub struct OpenedCamera {
    /// The camera.
    pub frames: Box<dyn FrameSource>,
    /// Its inertial sensor, where it has one.
    pub imu: Option<Box<dyn ImuSource>>,
    /// The exposures that it really goes through.
    pub cycle: Vec<Exposure>,
    /// What was found out of its response.
    pub found: FoundResponse,
}

/// A scene with all that stands in it.
struct OpenedScene {
    scene: Scene,
    rig: Rig,
    room: Option<Arc<KnownRoom>>,
}

/// Opens the devices and the engine and loads the scene.
pub fn prepare(settings: &Settings, host: &Host<'_>) -> Result<Prepared, PipelineError> {
    // What costs nothing is looked at first.
    governor_of(settings)?;
    prepare_with(open_camera(settings, &FoundResponse::default())?, settings, host)
}

/// As [`prepare`], with a camera that is open already.
pub fn prepare_with(
    camera: OpenedCamera,
    settings: &Settings,
    host: &Host<'_>,
) -> Result<Prepared, PipelineError> {
    let governor = governor_of(settings)?;
    cache_folder::bound_to(settings.cache_max_mib);
    let response = response_of(settings, camera.frames.as_ref())?;
    let rig = with_lens_of(settings, camera.frames.rig())?;
    let OpenedScene { scene, rig, room } = open_scene(settings, rig, host)?;
    let engine = open_engine(settings, &scene, room.as_ref())?;
    let description = engine.description();
    let options = options_of(settings, &camera.cycle);
    let watch = Box::new(MonotonicClock::default());
    let mut pipeline = Pipeline::new(engine, watch, rig, response, scene, options)?;
    if let Some(room) = room {
        pipeline = pipeline.in_room(room);
    }
    let pipeline = pipeline.governed(governor).with_stand_in(stand_in(settings.threads));
    let OpenedCamera { frames, imu, cycle, found } = camera;
    Ok(Prepared { source: frames, imu, pipeline, engine: description, cycle, found })
}

/// Opens the camera of the settings and asks for their exposures. `found` is what is known of its response from before.
pub fn open_camera(settings: &Settings, found: &FoundResponse) -> Result<OpenedCamera, DeviceError> {
    let options = camera_options(settings, found)?;
    let open::OpenedDevices { mut frames, imu } = open::open_with(&settings.camera, options)?;
    let wanted: Vec<Exposure> =
        settings.exposures_s.iter().map(|&time_s| Exposure { time_s, gain: settings.gain }).collect();
    let cycle = frames.set_exposures(&wanted)?;
    Ok(OpenedCamera { frames, imu, cycle, found: found.clone() })
}

/// What the settings say of a camera. One that states no response finds its own where they leave it to the device.
pub fn camera_options(settings: &Settings, found: &FoundResponse) -> Result<CameraOptions, DeviceError> {
    let refused = |why: String| DeviceError::new(&settings.camera, why, ErrorKind::Refused);
    let stated = stated_response(settings).map_err(|e| refused(e.to_string()))?;
    Ok(CameraOptions {
        response: stated.map_or_else(
            || CameraResponse::ToFind(found.clone()),
            |response| CameraResponse::Stated(Box::new(response)),
        ),
        replan: settings.replan.then_some(Replan { mains: settings.mains }),
    })
}

/// Opens the inertial sensor that the settings name; `raw` takes all that comes over its wire.
pub fn open_named_imu(
    settings: &Settings,
    clock: Arc<dyn Clock>,
    raw: Option<WireLogWriter>,
) -> Result<Box<dyn ImuSource>, DeviceError> {
    let refused = |why: String| DeviceError::new(&settings.imu, why, ErrorKind::Refused);
    let mut description = ImuDescription::default();
    if !settings.imu_file.is_empty() {
        let text = file::text(&path_text::to_path(&settings.imu_file)).map_err(refused)?;
        let read =
            ImuDescription::from_toml(&text).map_err(|e| refused(format!("{}: {e}", settings.imu_file)))?;
        description = read.ok_or_else(|| refused(format!("{}: has no table [imu]", settings.imu_file)))?;
    }
    open::open_imu(&settings.imu, clock, ImuOptions { description, raw })
}

/// Reads the response of the settings: the camera's own, sRGB, or a file's.
fn response_of(settings: &Settings, source: &dyn FrameSource) -> Result<Response, PipelineError> {
    let stated = stated_response(settings)?;
    Ok(stated.or_else(|| source.response()).unwrap_or_else(|| {
        tracing::warn!(
            "{} states no response: sRGB is taken; calibrate with `halflight hdr`",
            settings.camera
        );
        Response::srgb()
    }))
}

/// The response that the settings state; `None` where they leave it to the device.
fn stated_response(settings: &Settings) -> Result<Option<Response>, PipelineError> {
    match settings.response.as_str() {
        "device" => Ok(None),
        "srgb" => Ok(Some(Response::srgb())),
        file => crate::assets::response::load(&path_text::to_path(file)).map(Some).map_err(setup),
    }
}

/// What a device knows of its rig, with the lens that the settings name.
fn with_lens_of(settings: &Settings, rig: Option<Rig>) -> Result<Option<Rig>, PipelineError> {
    if settings.calibration.is_empty() {
        return Ok(rig);
    }
    let file = path_text::to_path(&settings.calibration);
    let lens = calibration::load(&file).map_err(setup)?;
    Ok(Some(match rig {
        Some(rig) => {
            let (width, height) = (rig.lens.width as usize, rig.lens.height as usize);
            Rig { lens: calibration::for_picture(lens, width, height, &file).map_err(setup)?, ..rig }
        }
        None => Rig { lens, tags: Vec::new(), ball: None },
    }))
}

/// Loads the scene of the settings with the rig that the device or the scene file knows, and makes its bodies and its room
/// ready.
fn open_scene(settings: &Settings, rig: Option<Rig>, host: &Host<'_>) -> Result<OpenedScene, PipelineError> {
    let Some(file) = scene_file_of(settings)? else {
        let rig = rig.ok_or_else(|| {
            PipelineError::Setup(format!(
                "{}: knows no lens or tags; name a scene.file that does",
                settings.camera
            ))
        })?;
        return Ok(OpenedScene { scene: Scene::default(), rig, room: None });
    };
    let rig = file.rig_over(rig).map_err(setup)?;
    let mut scene = file.scene_with_ball(rig.ball.as_ref());
    dress::dress(&mut scene, &settings.quality, host.progress);
    let room = known_room::of_scene(&file, &mut scene, host).map_err(setup)?;
    Ok(OpenedScene { scene, rig, room })
}

fn scene_file_of(settings: &Settings) -> Result<Option<SceneFile>, PipelineError> {
    let name = &settings.scene_file;
    (!name.is_empty()).then(|| scene_file::load(&path_text::to_path(name)).map_err(setup)).transpose()
}

/// Opens the engine of the settings and gives it room and scene.
fn open_engine(
    settings: &Settings,
    scene: &Scene,
    room: Option<&Arc<KnownRoom>>,
) -> Result<Box<dyn Engine>, EngineError> {
    let engine = engines::open(
        settings.engine,
        settings.backend,
        settings.threads,
        &settings.cpu_kernels,
        Timings::Stamps,
    )?;
    with_scene(engine, scene, room)
}

/// The CPU, for when the engine of the settings keeps failing.
fn stand_in(threads: usize) -> StandIn {
    Box::new(move |scene, room| {
        let engine = CpuEngine::new((threads > 0).then_some(threads))?;
        with_scene(Box::new(engine), scene, room)
    })
}

fn with_scene(
    mut engine: Box<dyn Engine>,
    scene: &Scene,
    room: Option<&Arc<KnownRoom>>,
) -> Result<Box<dyn Engine>, EngineError> {
    engine.load_room(room.cloned())?;
    engine.load_scene(scene)?;
    Ok(engine)
}

/// What the settings mean for the pipeline of a camera that goes through these exposures.
pub fn options_of(settings: &Settings, cycle: &[Exposure]) -> Options {
    let shown_exposure = (settings.shown_exposure_s > 0.0)
        .then_some(Exposure { time_s: settings.shown_exposure_s, gain: 1.0 });
    Options {
        quality: settings.quality,
        light_threshold: settings.light_threshold as f32,
        rec709: settings.gray == GrayWeights::Rec709,
        filter_tau_s: settings.filter_tau_s,
        ball_on_surface: settings.ball_on_surface,
        longest_exposure: cycle
            .iter()
            .copied()
            .max_by(|a, b| a.effective_s().total_cmp(&b.effective_s()))
            .unwrap_or(Exposure { time_s: 1.0 / 60.0, gain: 1.0 }),
        exposures_in_cycle: cycle.len(),
        shown_exposure,
        view: settings.view,
        hud: settings.hud,
        decimate: settings.decimate as f32,
        quad_sigma_px: settings.quad_sigma_px as f32,
    }
}

fn setup(error: impl std::fmt::Display) -> PipelineError {
    PipelineError::Setup(error.to_string())
}
