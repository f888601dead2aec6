//! The CPU twins in order: the readable description of one frame.

mod finish;
mod fragments;
mod objects;
mod room;
mod soft;
mod surfaces;
mod twins;

pub(crate) use twins::Twins;

use super::{
    Bracket, Engine, EngineError, LightJob, LiveMemory, MeasuredLight, NearChoice, RelightInput,
    SensorBracket,
};
use crate::frame::{FrameJob, FrameState, TwinPasses, check_frame, check_light};
use crate::light::{maps, project_sh::project_sh, unwrap_ball::BallUnwrapper};
use crate::model::{
    image::HdrImage, light::RadianceSamples, picture::Picture, quality::Quality, response::Response,
    scene::Scene,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{Foresight, FramePlan, Pass, PassTiming};
use std::sync::Arc;

/// Timings kept until somebody takes them.
const TIMINGS_KEPT: usize = 256;

/// The engine that needs nothing but the processor. Its results do not depend on the number of threads.
pub struct CpuEngine {
    pool: rayon::ThreadPool,
    state: FrameState,
    twins: Twins,
    unwrapper: BallUnwrapper,
    samples: RadianceSamples,
    timings: Vec<PassTiming>,
}

impl CpuEngine {
    /// An engine with its own pool of so many threads; `None`: one for each core.
    pub fn new(threads: Option<usize>) -> Result<Self, EngineError> {
        if threads == Some(0) {
            return Err(EngineError::Input("threads = 0: must be 1 or more".into()));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .thread_name(|i| format!("engine-{i}"))
            .build()
            .map_err(|e| EngineError::Input(format!("the engine's threads could not be started: {e}")))?;
        Ok(Self {
            pool,
            state: FrameState::default(),
            twins: Twins::default(),
            unwrapper: BallUnwrapper::new(),
            samples: RadianceSamples::default(),
            timings: Vec::with_capacity(TIMINGS_KEPT),
        })
    }
}

impl Engine for CpuEngine {
    fn description(&self) -> String {
        format!("cpu, {} threads", self.pool.current_num_threads())
    }

    fn load_room(&mut self, room: Option<Arc<KnownRoom>>) -> Result<(), EngineError> {
        self.state.room.take(room);
        Ok(())
    }

    fn load_scene(&mut self, scene: &Scene) -> Result<(), EngineError> {
        self.state.load(scene)
    }

    fn merge_bracket(
        &mut self,
        bracket: &Bracket<'_>,
        response: &Response,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        timed(&mut self.timings, Pass::MergeBracket, || {
            let merge = || {
                crate::hdr::merge_bracket::merge_bracket(bracket.pictures, bracket.exposures, response, out)
            };
            self.pool.install(merge).map_err(|e| EngineError::Input(e.to_string()))
        })
    }

    fn merge_sensor(&mut self, bracket: &SensorBracket<'_>, out: &mut HdrImage) -> Result<(), EngineError> {
        timed(&mut self.timings, Pass::MergeBracket, || {
            let merge = || crate::hdr::merge_bracket::merge_sensor(bracket.pictures, bracket.exposures, out);
            self.pool.install(merge).map_err(|e| EngineError::Input(e.to_string()))
        })
    }

    fn estimate_light(
        &mut self,
        job: &LightJob<'_>,
        quality: &Quality,
    ) -> Result<MeasuredLight, EngineError> {
        check_light(job, quality)?;
        let (samples, unwrapper, timings) = (&mut self.samples, &mut self.unwrapper, &mut self.timings);
        self.pool.install(|| {
            let flags = match job {
                LightJob::Ball(shot) => timed(timings, Pass::UnwrapBall, || unwrapper.unwrap(shot, samples))
                    .map_err(|e| EngineError::Input(e.to_string()))?,
                LightJob::Map(map) => maps::samples_of_map(map, samples),
            };
            let total = timed(timings, Pass::ProjectSh, || project_sh(samples, quality.sh_order));
            Ok(MeasuredLight { total, flags })
        })
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
        check_frame(&plan.quality, input)?;
        let (state, twins, timings) = (&mut self.state, &mut self.twins, &mut self.timings);
        self.pool.install(|| draw(plan, input, state, twins, timings, out));
        Ok(())
    }

    fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
    ) -> Result<(), EngineError> {
        check_frame(quality, input)?;
        let (state, timings) = (&mut self.state, &mut self.timings);
        self.pool.install(|| {
            let job = FrameJob::looked_at(quality, input);
            state.foresee(&job, out, &mut |pass, part| timed(timings, pass, part));
        });
        Ok(())
    }

    fn live(&self, out: &mut Vec<LiveMemory>) {
        self.state.live(out);
    }

    fn near_choice(&self) -> Option<NearChoice> {
        self.state.near_choice()
    }

    fn dispatched(&self) -> &[Pass] {
        self.state.held.dispatched()
    }

    fn take_timings(&mut self, out: &mut Vec<PassTiming>) {
        out.clear();
        out.append(&mut self.timings);
    }
}

/// Runs one pass and notes how long it took.
#[allow(clippy::disallowed_methods, reason = "an engine times its passes; nothing else depends on it")]
fn timed<T>(timings: &mut Vec<PassTiming>, pass: Pass, work: impl FnOnce() -> T) -> T {
    let start = std::time::Instant::now();
    let result = work();
    let ms = start.elapsed().as_secs_f32() * 1e3;
    match timings.last_mut() {
        // Parts of one pass.
        Some(last) if last.pass == pass => last.ms += ms,
        _ => {
            if timings.len() >= TIMINGS_KEPT {
                timings.remove(0);
            }
            timings.push(PassTiming { pass, ms });
        }
    }
    result
}

/// Exactly the plan's passes, in the order of a frame. What a later pass would read of one that the plan leaves out
/// counts as absent: no object layer, no ratio, no shadow. Merging and reading the light have their own calls.
fn draw(
    plan: &FramePlan,
    input: &RelightInput<'_>,
    state: &mut FrameState,
    twins: &mut Twins,
    timings: &mut Vec<PassTiming>,
    out: &mut Picture,
) {
    let job = FrameJob::planned(plan, input);
    state.begin(plan, &job);
    twins.begin(job.uses);
    let kept = state.kept(plan, job.uses);
    out.t = input.t;
    for pass in job.uses.iter().filter(|pass| !pass.is_measuring() && !kept.has(*pass)) {
        timed(timings, pass, || twins.run(pass, &job, state, out));
        state.held.mark_made(pass, job.uses);
    }
}
