//! The engine: each pass on the device, or on its twin where the caller asked for that.

use super::{
    context::{Backend, GpuContext},
    passes::{merge_bracket::MergeBracket, project_sh::ProjectSh, unwrap_ball::UnwrapBall},
    point_pages::MapSpread,
    recorder::{Gpu, Timer},
    relight::{Relighter, ready},
};
use crate::{
    Bracket, Engine, EngineError, LightJob, LiveMemory, MeasuredLight, NearChoice, RelightInput,
    SensorBracket, Timings,
    frame::{check_frame, check_light},
    hdr::merge_bracket,
    light::{
        maps::samples_of_map,
        project_sh,
        unwrap_ball::{BallShot, BallUnwrapper, BallView, UnwrapError},
    },
    model::{
        estimate::LightFlags,
        image::HdrImage,
        light::{RadianceSamples, RadianceSh},
        picture::Picture,
        quality::Quality,
        response::Response,
        scene::Scene,
    },
    nearfield::prepare::KnownRoom,
    plan::{Foresight, FramePlan, Pass, PassSet, PassTiming},
};
use std::sync::Arc;

/// The engine on wgpu. Kernels are compiled when they are first called for. What is too large for the device (many bind
/// 128 MiB at once: 8 million pixels) is done by the twins, with the same result.
pub struct GpuEngine {
    gpu: Gpu,
    /// Passes that run on their twins.
    on_cpu: PassSet,
    merge: Option<MergeBracket>,
    unwrap: Option<UnwrapBall>,
    project: Option<ProjectSh>,
    relighter: Relighter,
    unwrapper: BallUnwrapper,
    ball_view: BallView,
    cells: Vec<[f32; 4]>,
    samples: RadianceSamples,
}

impl GpuEngine {
    /// Opens a backend, or the first that works (Vulkan, then GL). Errors: `NoAdapter`.
    pub fn new(backend: Option<Backend>) -> Result<Self, EngineError> {
        let context = GpuContext::new(backend)?;
        Ok(Self {
            gpu: Gpu::new(context, Timings::default()),
            on_cpu: PassSet::default(),
            merge: None,
            unwrap: None,
            project: None,
            relighter: Relighter::new(),
            unwrapper: BallUnwrapper::new(),
            ball_view: BallView::default(),
            cells: Vec::new(),
            samples: RadianceSamples::default(),
        })
    }

    /// Runs exactly these kernels on their CPU twins. Errors: an unknown name, with the known ones.
    pub fn with_cpu_kernels(mut self, names: &[String]) -> Result<Self, EngineError> {
        self.on_cpu = PassSet::default();
        for name in names {
            let known = Pass::ALL.into_iter().find(|pass| pass.name() == name).ok_or_else(|| {
                let all = Pass::NAMES.join(", ");
                EngineError::Input(format!("kernel {name:?} on the CPU: known are {all}"))
            })?;
            self.on_cpu.insert(known);
        }
        Ok(self)
    }

    /// Times passes like this.
    pub fn with_timings(mut self, timings: Timings) -> Self {
        self.gpu.timer = Timer::new(&self.gpu.context, timings);
        self
    }

    /// Draws the near lights of a known room all together, or each in passes of its own.
    pub fn with_near_lights(mut self, spread: MapSpread) -> Self {
        self.relighter.spread = spread;
        self
    }

    /// Where the work runs.
    pub fn context(&self) -> &GpuContext {
        &self.gpu.context
    }

    /// The passes that run on their twins in a frame: those that the caller asked for, and for a picture that the device
    /// cannot hold all that are done for each pixel.
    fn on_host(&self, input: &RelightInput<'_>) -> PassSet {
        let background = &input.background.radiance;
        let draws = self.gpu.context.draws(background.width(), background.height());
        PassSet::where_true(|pass| self.on_cpu.has(pass) || !draws && pass.facts().per_pixel)
    }

    /// Whether the device takes a bracket in one piece: its pictures, or radiance and flags of the result.
    fn binds_bracket(&self, bracket: &Bracket<'_>) -> bool {
        let pixels = bracket.pictures.first().map_or(0, |p| p.pixels().len());
        self.gpu.context.binds(pixels * (3 * bracket.pictures.len()).max(13) + 64)
    }

    /// Projects samples to SH (kernel `light/project_sh`); the order is taken into 1..=6.
    pub fn project_sh(&mut self, samples: &RadianceSamples, order: usize) -> Result<RadianceSh, EngineError> {
        if self.on_cpu.has(Pass::ProjectSh) || !self.gpu.context.binds(16 * samples.directions.len()) {
            return Ok(self.gpu.timer.host(Pass::ProjectSh, || project_sh::project_sh(samples, order)));
        }
        self.gpu.context.live.serve(Pass::ProjectSh);
        let project = ready(&mut self.project, &self.gpu.context, ProjectSh::new)?;
        project.run(&mut self.gpu, samples, order)
    }

    /// Reads a ball's radiance samples (kernel `light/unwrap_ball`); the host makes the rays and fills what the
    /// ball does not show.
    fn unwrap_ball(
        &mut self,
        shot: &BallShot<'_>,
        out: &mut RadianceSamples,
    ) -> Result<LightFlags, EngineError> {
        let twin = &mut self.unwrapper;
        let refused = |error: UnwrapError| EngineError::Input(error.to_string());
        if self.on_cpu.has(Pass::UnwrapBall) {
            let unwrap = || twin.unwrap(shot, out);
            return self.gpu.timer.host(Pass::UnwrapBall, unwrap).map_err(refused);
        }
        self.gpu.context.live.serve(Pass::UnwrapBall);
        let kernel = ready(&mut self.unwrap, &self.gpu.context, UnwrapBall::new)?;
        let (view, cells) = (&mut self.ball_view, &mut self.cells);
        let prepare = || {
            shot.check()?;
            view.prepare(shot.lens, shot.world_from_camera, shot.ball)
        };
        self.gpu.timer.host(Pass::UnwrapBall, prepare).map_err(refused)?;
        kernel.run(&mut self.gpu, view, shot.on_surface, cells)?;
        let finish = || twin.finish(view, cells, shot, out);
        self.gpu.timer.host(Pass::UnwrapBall, finish).map_err(refused)
    }
}

impl Engine for GpuEngine {
    fn description(&self) -> String {
        let twins: Vec<_> = self.on_cpu.iter().map(Pass::name).collect();
        let on_cpu =
            if twins.is_empty() { String::new() } else { format!(", on the CPU: {}", twins.join(", ")) };
        format!("gpu: {}{on_cpu}", self.gpu.context.description())
    }

    fn load_room(&mut self, room: Option<Arc<KnownRoom>>) -> Result<(), EngineError> {
        self.relighter.take_room(room);
        Ok(())
    }

    fn load_scene(&mut self, scene: &Scene) -> Result<(), EngineError> {
        self.relighter.load(scene)
    }

    fn merge_bracket(
        &mut self,
        bracket: &Bracket<'_>,
        response: &Response,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        if self.on_cpu.has(Pass::MergeBracket) || !self.binds_bracket(bracket) {
            return self
                .gpu
                .timer
                .host(Pass::MergeBracket, || {
                    merge_bracket::merge_bracket(bracket.pictures, bracket.exposures, response, out)
                })
                .map_err(|error| EngineError::Input(error.to_string()));
        }
        merge_bracket::check(bracket.pictures, bracket.exposures)
            .map_err(|error| EngineError::Input(error.to_string()))?;
        self.gpu.context.live.serve(Pass::MergeBracket);
        let merge = ready(&mut self.merge, &self.gpu.context, MergeBracket::new)?;
        merge.run(&mut self.gpu, bracket, response, out)
    }

    fn merge_sensor(&mut self, bracket: &SensorBracket<'_>, out: &mut HdrImage) -> Result<(), EngineError> {
        let size = merge_bracket::check_sensor(bracket.pictures, bracket.exposures)
            .map_err(|error| EngineError::Input(error.to_string()))?;
        let bytes_a_pixel = (6 * bracket.pictures.len()).max(13);
        if self.on_cpu.has(Pass::MergeBracket)
            || !self.gpu.context.binds(size.0 * size.1 * bytes_a_pixel + 64)
        {
            return self
                .gpu
                .timer
                .host(Pass::MergeBracket, || {
                    merge_bracket::merge_sensor(bracket.pictures, bracket.exposures, out)
                })
                .map_err(|error| EngineError::Input(error.to_string()));
        }
        self.gpu.context.live.serve(Pass::MergeBracket);
        let merge = ready(&mut self.merge, &self.gpu.context, MergeBracket::new)?;
        merge.run_sensor(&mut self.gpu, bracket, out)
    }

    fn estimate_light(
        &mut self,
        job: &LightJob<'_>,
        quality: &Quality,
    ) -> Result<MeasuredLight, EngineError> {
        check_light(job, quality)?;
        let mut samples = std::mem::take(&mut self.samples);
        let flags = match *job {
            LightJob::Ball(shot) => self.unwrap_ball(&shot, &mut samples),
            LightJob::Map(map) => Ok(samples_of_map(map, &mut samples)),
        };
        let measured = flags.and_then(|flags| {
            let total = self.project_sh(&samples, quality.sh_order)?;
            Ok(MeasuredLight { total, flags })
        });
        self.samples = samples;
        measured
    }

    fn measured_samples(&self) -> &RadianceSamples {
        &self.samples
    }

    fn relight(
        &mut self,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        let on_host = self.on_host(input);
        self.relighter.relight(&mut self.gpu, on_host, plan, input, out)
    }

    fn ask_for_linear(&mut self, wanted: bool) {
        self.relighter.wants_linear = wanted;
    }

    fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
    ) -> Result<(), EngineError> {
        check_frame(quality, input)?;
        let timer = &mut self.gpu.timer;
        self.relighter.foresee(input, quality, out, &mut |pass, part| timer.host(pass, part));
        Ok(())
    }

    fn live(&self, out: &mut Vec<LiveMemory>) {
        self.gpu.context.live.list(out);
    }

    fn near_choice(&self) -> Option<NearChoice> {
        self.relighter.near_choice()
    }

    fn dispatched(&self) -> &[Pass] {
        self.relighter.dispatched()
    }

    fn take_timings(&mut self, out: &mut Vec<PassTiming>) {
        out.clear();
        self.gpu.timer.take(out);
    }
}
