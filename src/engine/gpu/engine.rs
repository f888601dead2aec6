//! The engine: each pass on the device, or on its twin where the caller asked for that.

use super::{
    context::{Backend, GpuContext},
    kernels::TABLE,
    passes::{merge_bracket::MergeBracket, project_sh::ProjectSh, unwrap_ball::UnwrapBall},
    point_pages::Spread,
    recorder::Timer,
    relight::{Relighter, ready},
};
use crate::{
    Bracket, Engine, EngineError, LightJob, Live, MeasuredLight, RelightInput, cpu,
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
    plan::{Foresight, FramePlan, Pass, PassTiming},
};
use std::sync::Arc;

/// What is done for each pixel of the picture.
const PER_PIXEL: [Pass; 7] = [
    Pass::SoftShadow,
    Pass::Subtract,
    Pass::SubtractDisplayed,
    Pass::ShadeObject,
    Pass::ShadeSurface,
    Pass::Composite,
    Pass::Tonemap,
];

/// The engine on wgpu. Kernels are compiled when they are first called for. What is too large for the device (many bind
/// 128 MiB at once: 8 million pixels) is done by the twins, with the same result.
pub struct GpuEngine {
    context: GpuContext,
    timer: Timer,
    on_cpu: [bool; Pass::ALL.len()],
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
        let timer = Timer::new(&context);
        Ok(Self {
            context,
            timer,
            on_cpu: [false; Pass::ALL.len()],
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
        self.on_cpu = [false; Pass::ALL.len()];
        for name in names {
            let known = TABLE.iter().find(|kernel| kernel.pass.name() == name).ok_or_else(|| {
                let all: Vec<_> = TABLE.iter().map(|kernel| kernel.pass.name()).collect();
                EngineError::Input(format!("kernel {name:?} on the CPU: known are {}", all.join(", ")))
            })?;
            self.on_cpu[known.pass as usize] = true;
        }
        Ok(self)
    }

    /// Draws the near lights of a known room all together, or each in passes of its own.
    pub fn with_near_lights(mut self, spread: Spread) -> Self {
        self.relighter.spread = spread;
        self
    }

    /// Where the work runs.
    pub fn context(&self) -> &GpuContext {
        &self.context
    }

    fn on_cpu(&self, pass: Pass) -> bool {
        self.on_cpu[pass as usize]
    }

    /// Whether the device takes a bracket in one piece: its pictures, or radiance and flags of the result.
    fn binds_bracket(&self, bracket: &Bracket<'_>) -> bool {
        let pixels = bracket.pictures.first().map_or(0, |p| p.pixels().len());
        self.context.binds(pixels * (3 * bracket.pictures.len()).max(13) + 64)
    }

    /// Projects samples to SH (kernel `light/project_sh`); the order is taken into 1..=6.
    pub fn project_sh(&mut self, samples: &RadianceSamples, order: usize) -> Result<RadianceSh, EngineError> {
        if self.on_cpu(Pass::ProjectSh) || !self.context.binds(16 * samples.directions.len()) {
            return Ok(self.timer.host(Pass::ProjectSh, || project_sh::project_sh(samples, order)));
        }
        self.context.live.serve(Pass::ProjectSh);
        let project = ready(&mut self.project, &self.context, ProjectSh::new)?;
        project.run(&self.context, &mut self.timer, samples, order)
    }

    /// Reads a ball's radiance samples (kernel `light/unwrap_ball`); the host makes the rays and fills what the
    /// ball does not show.
    fn unwrap_ball(
        &mut self,
        shot: &BallShot<'_>,
        out: &mut RadianceSamples,
    ) -> Result<LightFlags, EngineError> {
        let (twin, timer) = (&mut self.unwrapper, &mut self.timer);
        let refused = |error: UnwrapError| EngineError::Input(error.to_string());
        if self.on_cpu[Pass::UnwrapBall as usize] {
            let unwrap = || twin.unwrap(shot, out);
            return timer.host(Pass::UnwrapBall, unwrap).map_err(refused);
        }
        self.context.live.serve(Pass::UnwrapBall);
        let kernel = ready(&mut self.unwrap, &self.context, UnwrapBall::new)?;
        let (view, cells) = (&mut self.ball_view, &mut self.cells);
        let prepare = || {
            shot.check()?;
            view.prepare(shot.lens, shot.world_from_camera, shot.ball)
        };
        timer.host(Pass::UnwrapBall, prepare).map_err(refused)?;
        kernel.run(&self.context, timer, view, shot.on_surface, cells)?;
        let finish = || twin.finish(view, cells, shot, out);
        timer.host(Pass::UnwrapBall, finish).map_err(refused)
    }
}

impl Engine for GpuEngine {
    fn description(&self) -> String {
        let twins: Vec<_> = Pass::ALL.into_iter().filter(|&pass| self.on_cpu(pass)).map(Pass::name).collect();
        let on_cpu =
            if twins.is_empty() { String::new() } else { format!(", on the CPU: {}", twins.join(", ")) };
        format!("gpu: {}{on_cpu}", self.context.description())
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
        if self.on_cpu(Pass::MergeBracket) || !self.binds_bracket(bracket) {
            return self
                .timer
                .host(Pass::MergeBracket, || {
                    merge_bracket::merge_bracket(bracket.pictures, bracket.exposures, response, out)
                })
                .map_err(|error| EngineError::Input(error.to_string()));
        }
        merge_bracket::check(bracket.pictures, bracket.exposures)
            .map_err(|error| EngineError::Input(error.to_string()))?;
        self.context.live.serve(Pass::MergeBracket);
        let merge = ready(&mut self.merge, &self.context, MergeBracket::new)?;
        merge.run(&self.context, &mut self.timer, bracket, response, out)
    }

    fn estimate_light(
        &mut self,
        job: &LightJob<'_>,
        quality: &Quality,
    ) -> Result<MeasuredLight, EngineError> {
        cpu::check_light(job, quality)?;
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
        let background = &input.background.radiance;
        let draws = self.context.draws(background.width(), background.height());
        let on_cpu = |pass: Pass| self.on_cpu[pass as usize] || !draws && PER_PIXEL.contains(&pass);
        self.relighter.run(&self.context, &mut self.timer, on_cpu, plan, input, out)
    }

    fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
    ) -> Result<(), EngineError> {
        cpu::check_frame(quality, input)?;
        let timer = &mut self.timer;
        self.relighter.foresee(input, quality, out, &mut |pass, part| timer.host(pass, part));
        Ok(())
    }

    fn live(&self, out: &mut Vec<Live>) {
        self.context.live.list(out);
    }

    fn dispatched(&self) -> &[Pass] {
        self.relighter.dispatched()
    }

    fn take_timings(&mut self, out: &mut Vec<PassTiming>) {
        out.clear();
        self.timer.take(out);
    }
}
