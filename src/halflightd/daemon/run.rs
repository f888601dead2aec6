//! Runs the pipeline as the settings say.

use super::{
    blocker_spheres, engines,
    governing::governor_of,
    host::Host,
    known_room,
    live_settings::{LiveSettings, Watched},
    picture_folder::PictureFolder,
    vertex_transfer,
};
use crate::assets::scene as scene_file;
use crate::config::settings::{GrayWeights, RunMode, Settings};
use crate::device::{
    Clock, FrameSource,
    clock::{ManualClock, MonotonicClock},
    open,
};
use crate::engine::Timings;
use crate::model::{frame::Exposure, response::Response, rig::Rig, scene::Scene};
use crate::nearfield::prepare::KnownRoom;
use crate::pipeline::{
    Options, Pipeline, PipelineError,
    event::{FrameSink, RunCounts, run as run_events},
    feed::{Lockstep, Realtime},
};
use crate::plan::{FramePlan, PassTiming};
use std::{path::Path, sync::Arc};

/// A pipeline with the source that feeds it.
pub struct Prepared {
    /// Where frames come from.
    pub source: Box<dyn FrameSource>,
    /// What they go through.
    pub pipeline: Pipeline,
    /// The engine in one line.
    pub engine: String,
    /// Exposures that the camera goes through.
    pub cycle: Vec<Exposure>,
}

/// Opens the devices and the engine and loads the scene.
pub fn prepare(settings: &Settings, host: &Host<'_>) -> Result<Prepared, PipelineError> {
    let opened = open::open(&settings.camera)?;
    let mut source = opened.frames;
    let wanted: Vec<Exposure> =
        settings.exposures_s.iter().map(|&time_s| Exposure { time_s, gain: settings.gain }).collect();
    let cycle = source.set_exposures(&wanted)?;
    let response = response_of(settings, source.as_ref())?;
    let (scene, rig, room) = scene_and_rig(settings, source.as_ref(), host)?;
    let mut engine = engines::open(
        settings.engine,
        settings.backend,
        settings.threads,
        &settings.cpu_kernels,
        Timings::Stamps,
    )?;
    engine.load_room(room.clone())?;
    engine.load_scene(&scene)?;
    let description = engine.description();
    let options = options_of(settings, &cycle);
    let mut pipeline =
        Pipeline::new(engine, Box::new(MonotonicClock::default()), rig, response, scene, options)?;
    if let Some(room) = room {
        pipeline = pipeline.in_room(room);
    }
    let pipeline = pipeline.governed(governor_of(settings)?);
    Ok(Prepared { source, pipeline, engine: description, cycle })
}

/// What the settings mean for the pipeline of a camera that goes through these exposures.
pub(super) fn options_of(settings: &Settings, cycle: &[Exposure]) -> Options {
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

fn response_of(settings: &Settings, source: &dyn FrameSource) -> Result<Response, PipelineError> {
    match settings.response.as_str() {
        "device" => Ok(source.response().unwrap_or_else(|| {
            tracing::warn!(
                "{} states no response: sRGB is taken; calibrate with `halflight hdr`",
                settings.camera
            );
            Response::srgb()
        })),
        "srgb" => Ok(Response::srgb()),
        file => {
            crate::assets::response::load(Path::new(file)).map_err(|e| PipelineError::Setup(e.to_string()))
        }
    }
}

/// The scene's objects and surfaces with the rig that the device or the scene file knows.
fn scene_and_rig(
    settings: &Settings,
    source: &dyn FrameSource,
    host: &Host<'_>,
) -> Result<(Scene, Rig, Option<Arc<KnownRoom>>), PipelineError> {
    let rig = source.rig();
    if settings.scene_file.is_empty() {
        let rig = rig.ok_or_else(|| {
            PipelineError::Setup(format!(
                "{}: knows no lens or tags; name a scene.file that does",
                settings.camera
            ))
        })?;
        return Ok((Scene::default(), rig, None));
    }
    let file =
        scene_file::load(Path::new(&settings.scene_file)).map_err(|e| PipelineError::Setup(e.to_string()))?;
    let rig = file.rig_over(rig).map_err(|e| PipelineError::Setup(e.to_string()))?;
    let mut scene = file.scene_with_ball(rig.ball.as_ref());
    blocker_spheres::fit(&mut scene, settings.quality.spheres, host.progress);
    vertex_transfer::bake(&mut scene, &settings.quality, host.progress);
    let room =
        known_room::of_scene(&file, &mut scene, host).map_err(|e| PipelineError::Setup(e.to_string()))?;
    Ok((scene, rig, room))
}

/// What a run left.
#[derive(Clone, Debug)]
pub struct Ran {
    /// What went through.
    pub counts: RunCounts,
    /// Times of every pass of every frame.
    pub passes: Vec<PassTiming>,
    /// The passes of the last picture, and those left out, each with its reason.
    pub last_plan: FramePlan,
}

/// Runs until the source ends, `device.frames` have gone through, or the sink asks to stop. Settings that are `live` are
/// followed.
pub fn run(
    mut prepared: Prepared,
    settings: &Settings,
    live: Option<&mut LiveSettings>,
    sink: &mut dyn FrameSink,
) -> Result<Ran, PipelineError> {
    let cycle = &prepared.cycle;
    let counts = match settings.mode {
        RunMode::Lockstep => {
            let mut clock = ManualClock::default();
            let mut feed = Lockstep::new(prepared.source.as_mut(), &mut clock);
            let mut feed = Watched { feed: &mut feed, live, cycle };
            run_events(&mut feed, &mut prepared.pipeline, sink, settings.frames)
        }
        RunMode::Realtime => {
            // Recordings and the synthetic room deliver at once; a camera has its own pace.
            let pace: Box<dyn Clock> = Box::new(MonotonicClock::default());
            let mut feed = Realtime::start(prepared.source, Some(pace));
            let mut feed = Watched { feed: &mut feed, live, cycle };
            run_events(&mut feed, &mut prepared.pipeline, sink, settings.frames)
        }
    }?;
    Ok(Ran { counts, passes: prepared.pipeline.take_passes(), last_plan: prepared.pipeline.plan().clone() })
}

/// The whole daemon: settings in, run to the end.
pub fn run_daemon(settings: &Settings, live: Option<&mut LiveSettings>) -> Result<RunCounts, PipelineError> {
    let mut prepared = prepare(settings, &Host::default())?;
    prepared.pipeline = prepared.pipeline.for_pictures_alone();
    tracing::info!(camera = settings.camera, engine = prepared.engine, "running");
    let mut sink = PictureFolder::new(&settings.pictures_folder)?;
    run(prepared, settings, live, &mut sink).map(|ran| ran.counts)
}
