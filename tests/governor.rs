//! The governor in the pipeline: a load that comes and goes, with a clock that is simulated.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::config::presets;
use halflight::device::{Clock, FrameSource, clock::ManualClock, open};
use halflight::engine::{
    Bracket, Engine, EngineError, LightJob, LiveMemory, MeasuredLight, RelightInput, SensorBracket,
    cpu::CpuEngine,
};
use halflight::model::{
    frame::Exposure,
    image::HdrImage,
    light::RadianceSamples,
    picture::{Picture, PictureView},
    quality::Quality,
    response::Response,
    scene::Scene,
    time::Timestamp,
};
use halflight::nearfield::prepare::KnownRoom;
use halflight::pipeline::{Options, Pipeline};
use halflight::plan::{
    Foresight, FramePlan, Pass, PassTiming,
    front::Front,
    governor::{Goal, Governor},
};
use std::sync::{
    Arc,
    atomic::{AtomicU32, Ordering::Relaxed},
};

/// Frames between two steps of the load.
const FRAMES_OF_A_STEP: u64 = 75;
const PERIOD_NS: i64 = 33_333_333;
const BUDGET_MS: f32 = 30.0;
/// What a frame takes besides drawing.
const MERGING_NS: i64 = 5_000_000;

/// Lets simulated time pass.
fn pass(clock: &ManualClock, ns: i64) {
    clock.wait_until(Timestamp(clock.now().0 + ns));
}

/// The CPU engine; its drawing takes simulated time, as the front says and as the load is.
struct Loaded {
    inner: CpuEngine,
    clock: ManualClock,
    front: Front,
    load_permille: Arc<AtomicU32>,
    frames: u32,
}

impl Engine for Loaded {
    fn description(&self) -> String {
        self.inner.description()
    }

    fn load_room(&mut self, room: Option<Arc<KnownRoom>>) -> Result<(), EngineError> {
        self.inner.load_room(room)
    }

    fn load_scene(&mut self, scene: &Scene) -> Result<(), EngineError> {
        self.inner.load_scene(scene)
    }

    fn merge_bracket(
        &mut self,
        bracket: &Bracket<'_>,
        response: &Response,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        pass(&self.clock, MERGING_NS);
        self.inner.merge_bracket(bracket, response, out)
    }

    fn merge_sensor(&mut self, bracket: &SensorBracket<'_>, out: &mut HdrImage) -> Result<(), EngineError> {
        pass(&self.clock, MERGING_NS);
        self.inner.merge_sensor(bracket, out)
    }

    fn estimate_light(
        &mut self,
        job: &LightJob<'_>,
        quality: &Quality,
    ) -> Result<MeasuredLight, EngineError> {
        self.inner.estimate_light(job, quality)
    }

    fn measured_samples(&self) -> &RadianceSamples {
        self.inner.measured_samples()
    }

    fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
    ) -> Result<(), EngineError> {
        self.inner.foresee(input, quality, out)
    }

    fn dispatched(&self) -> &[Pass] {
        self.inner.dispatched()
    }

    fn live(&self, out: &mut Vec<LiveMemory>) {
        self.inner.live(out);
    }

    fn relight(
        &mut self,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        self.frames += 1;
        let step = self.front.steps().iter().find(|s| s.quality == plan.quality);
        // Before the first picture with objects the plan has the settings all the same.
        let ms = f64::from(step.expect("the settings are a step of the front").ms);
        let load = f64::from(self.load_permille.load(Relaxed)) * 1e-3;
        // Up to 8 % more or less from frame to frame.
        let noise = 1.0 + 0.08 * (f64::from(self.frames) * 2.399).sin();
        pass(&self.clock, (ms * load * noise * 1e6) as i64);
        self.inner.relight(plan, input, out)
    }

    fn take_timings(&mut self, out: &mut Vec<PassTiming>) {
        self.inner.take_timings(out);
    }
}

#[test]
fn stepped_load_is_followed_within_ten_frames_and_without_oscillation() {
    let mut source = open::open("synthetic:frames=300,size=192x144,seed=3,texel_mm=10").unwrap().frames;
    let wanted = [0.001, 0.004, 0.016].map(|time_s| Exposure { time_s, gain: 1.0 });
    let cycle = source.set_exposures(&wanted).unwrap();
    let base = Quality::default();
    let front = presets::front(presets::BUNDLED).unwrap().over(&base);
    // The loads are such that other steps of the bundled front are right for each.
    let steps = front.steps();
    assert!(steps.len() >= 4, "{}", steps.len());
    let middle = steps[steps.len() / 2].ms;
    let (clock, load_permille) = (ManualClock::default(), Arc::new(AtomicU32::new(1000)));
    let engine = Loaded {
        inner: CpuEngine::new(Some(1)).unwrap(),
        clock: clock.clone(),
        front: front.clone(),
        load_permille: load_permille.clone(),
        frames: 0,
    };
    let options = Options {
        quality: base,
        light_threshold: 1e-3,
        rec709: false,
        filter_tau_s: 0.2,
        ball_on_surface: true,
        longest_exposure: cycle[2],
        exposures_in_cycle: 3,
        shown_exposure: None,
        view: PictureView::Final,
        hud: true,
        decimate: 1.0,
        quad_sigma_px: 0.8,
    };
    let governor = Governor::new(front, Goal { budget_ms: Some(BUDGET_MS), max_error: None });
    let rig = source.rig().unwrap();
    let pipeline = Pipeline::new(
        Box::new(engine),
        Box::new(clock.clone()),
        rig,
        Response::srgb(),
        Scene::default(),
        options,
    );
    let mut pipeline = pipeline.unwrap().governed(governor);
    // Such that the middle step takes 20 ms, then 60, then 10, then 35.
    let loads = [20.0f32, 60.0, 10.0, 35.0].map(|ms| (1e3 * ms / middle) as u32);
    let (mut within, mut counted) = (0, 0);
    let mut taken = Vec::new();
    for (k, load) in loads.into_iter().enumerate() {
        load_permille.store(load, Relaxed);
        let (mut changes_before, mut late_changes) = (None, 0);
        for frame in 0..FRAMES_OF_A_STEP {
            let raw = source.next(Timestamp(i64::MAX)).unwrap();
            let next = clock.now().0 + PERIOD_NS;
            let outcome = pipeline.frame(&raw).unwrap();
            clock.wait_until(Timestamp(next));
            let choice = outcome.choice.unwrap();
            if frame >= 10 {
                counted += 1;
                within += u32::from(choice.measured_ms <= BUDGET_MS);
            }
            // Steady after a second and a half: then at most one change a second.
            if frame >= 45 {
                let before = changes_before.replace(choice.changes).unwrap_or(choice.changes);
                late_changes += choice.changes - before;
            }
            if frame + 1 == FRAMES_OF_A_STEP {
                taken.push(choice.step);
            }
        }
        assert!(late_changes <= 1, "load {k}: {late_changes} changes within the last second");
    }
    assert!(f64::from(within) >= 0.95 * f64::from(counted), "{within} of {counted} within the budget");
    // The heavier the load, the cheaper the step.
    assert!(taken[1] < taken[0] && taken[2] > taken[1] && taken[3] < taken[2], "{taken:?}");
}
