//! Layer 5: the order of the stages for each frame, the one inbox before them, and the threads. What takes the pictures
//! stands outside.
//!
//! ```text
//! devices, each on a thread ─┐                    ┌─ policy: what is missing, what is shown then
//! settings that are ready ───┼─► inbox ─► turns ──┼─ schedule: when to take a frame, for which moment
//! commands ──────────────────┘  (lockstep: filled  └─ Pipeline: track, merge, light, present ─► FrameSink
//!                                from a recording)
//! ```

pub mod engine_in_use;
pub mod event;
pub mod frame;
pub mod inbox;
pub mod lighting;
pub mod live;
pub mod lockstep;
pub mod options;
pub mod policy;
pub mod presenting;
pub mod schedule;
pub mod screen;
pub mod tracking;
pub mod turns;

use crate::device::{Clock, DeviceError};
use crate::engine::{Engine, EngineError};
use crate::light::prefilter::WantedEnvironment;
use crate::math::lens::Lens;
use crate::model::{
    estimate::{LightEstimate, PoseEstimate},
    frame::{Exposure, RawFrame},
    image::HdrImage,
    imu::ImuSample,
    light::RadianceSamples,
    picture::{Picture, PictureView},
    quality::Effects,
    response::Response,
    rig::Rig,
    scene::Scene,
    time::Timestamp,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{
    FramePlan, PassTiming,
    governor::{Choice, Governor},
};
use engine_in_use::{EngineInUse, StandIn};
use frame::{FrameOutcome, Shown, Stage};
use lighting::{GatherError, LightMoment, Lighting};
pub use options::{Change, GovernorChange, Options};
use policy::Shows;
use presenting::{PictureParts, Presenting};
use std::sync::Arc;
use tracking::{EarlySearch, Tracker, TrackingError};

/// Why the pipeline could not start or go on.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A device failed for good.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// Tracking failed for good.
    #[error(transparent)]
    Tracking(#[from] TrackingError),
    /// Settings do not fit together; names the key.
    #[error("{0}")]
    Setup(String),
    /// A result could not be written; names the file.
    #[error("{0}")]
    Output(String),
}

/// What the last picture was drawn from, besides its pose and its light.
#[derive(Clone, Copy)]
pub struct DrawnFrom<'a> {
    /// Objects and surfaces.
    pub scene: &'a Scene,
    /// The camera's picture, linear.
    pub background: &'a HdrImage,
    /// Intrinsics and distortion, pixels.
    pub lens: &'a Lens,
    /// The way back to 8 bits.
    pub response: &'a Response,
    /// Exposure of the shown picture.
    pub shown_exposure: Exposure,
    /// The light as it was measured last, world frame.
    pub samples: &'a RadianceSamples,
    /// The known room that the scene stands in.
    pub room: Option<&'a Arc<KnownRoom>>,
}

/// One camera's way from frame to picture.
pub struct Pipeline {
    engine: EngineInUse,
    watch: Box<dyn Clock>,
    rig: Rig,
    response: Response,
    /// The one that frames came with last.
    response_of_frames: Option<Arc<Response>>,
    /// The settings of every stage; stages keep none of them.
    options: Options,
    tracker: Tracker,
    lighting: Lighting,
    presenting: Presenting,
    passes: Vec<PassTiming>,
    frames_done: u64,
    governor: Option<Governor>,
    /// Nobody asks for pose and light themselves.
    only_pictures: bool,
}

/// When the stages of a frame were done, on the pipeline's watch.
#[derive(Clone, Copy)]
struct StageTimes {
    start: Timestamp,
    tracked: Timestamp,
    registered: Timestamp,
    merged: Timestamp,
    lit: Timestamp,
    drawn: Timestamp,
}

impl StageTimes {
    fn all_at(start: Timestamp) -> Self {
        Self { start, tracked: start, registered: start, merged: start, lit: start, drawn: start }
    }

    fn located_at(&mut self, t: Timestamp) {
        (self.tracked, self.registered, self.merged, self.lit) = (t, t, t, t);
    }

    /// Milliseconds of each stage, in the order of `Stage::ALL`.
    fn ms(&self) -> [f32; Stage::ALL.len()] {
        [
            (self.tracked, self.start),
            (self.registered, self.tracked),
            (self.merged, self.registered),
            (self.lit, self.merged),
            (self.drawn, self.lit),
            (self.drawn, self.start),
        ]
        .map(|(to, from)| (to.seconds_since(from) * 1e3) as f32)
    }
}

impl Pipeline {
    /// Takes the engine (scene loaded), a clock for timings, and what is known of the rig.
    pub fn new(
        engine: Box<dyn Engine>,
        watch: Box<dyn Clock>,
        rig: Rig,
        response: Response,
        scene: impl Into<Arc<Scene>>,
        options: Options,
    ) -> Result<Self, PipelineError> {
        let mut tracker = Tracker::start(&rig, options.decimate, options.quad_sigma_px)?;
        tracker.set_response(&response);
        let scene = scene.into();
        let mut lighting = Lighting::new(&rig, &options);
        lighting.want(WantedEnvironment::by(&scene, options.quality.sh_order));
        let presenting = Presenting::new(scene, &options);
        Ok(Self {
            engine: EngineInUse::new(engine),
            watch,
            rig,
            response,
            response_of_frames: None,
            options,
            tracker,
            lighting,
            presenting,
            passes: Vec::new(),
            frames_done: 0,
            governor: None,
            only_pictures: false,
        })
    }

    /// Lets a governor choose the settings of accuracy from the first frame on.
    pub fn governed(mut self, governor: Option<Governor>) -> Self {
        self.governor = governor;
        self.obey();
        self
    }

    /// Takes the settings that the governor has chosen. They change nothing that the scene's bodies carry with them.
    fn obey(&mut self) {
        if let Some(governor) = &self.governor {
            self.options.quality = governor.step().quality;
        }
    }

    /// The known room that the scene stands in (`Scene::room`); the engine has been given it. Objects are lit by it then,
    /// whether or not the camera's picture shows what the light can be measured from.
    pub fn in_room(mut self, room: Arc<KnownRoom>) -> Self {
        self.presenting.take_room(room);
        self
    }

    /// Nobody asks for pose and light themselves: frames whose picture needs neither are shown without them.
    pub fn for_pictures_alone(mut self) -> Self {
        self.only_pictures = true;
        self
    }

    /// Another engine is opened by `open` where the first one keeps failing.
    pub fn with_stand_in(mut self, open: StandIn) -> Self {
        self.engine.replace_by(open, false);
        self
    }

    /// Time passes meanwhile: an engine that stands in is opened beside the frames.
    pub fn go_live(&mut self) {
        self.engine.open_beside();
    }

    /// Whether a frame's picture is the frame itself: there is nothing virtual to draw, and no other exposure to merge.
    fn is_picture_itself(&self, frame: &RawFrame) -> bool {
        self.only_pictures
            && self.options.exposures_in_cycle <= 1
            && self.options.quality.effects == Effects::CalledFor
            && self.options.view == PictureView::Final
            && self.presenting.shows_nothing_virtual(frame)
    }

    /// Goes on with other settings from the next frame on. The light that was measured, the pose and the time within the
    /// scene stay; light of another order is measured anew. An engine that does not take the scene fails as one that does
    /// not draw.
    pub fn change(&mut self, change: Change) {
        let Change { options, scene, governor } = change;
        self.presenting.choose_exposure(&options);
        self.options = options;
        if let Some(scene) = scene {
            self.presenting.change_scene(scene);
            self.engine.has_another_scene();
        }
        self.lighting.want(WantedEnvironment::by(self.presenting.scene(), options.quality.sh_order));
        match governor {
            GovernorChange::Keep => {}
            GovernorChange::Replace(governor) => self.governor = Some(*governor),
            GovernorChange::Remove => self.governor = None,
        }
        self.obey();
    }

    /// Takes an inertial sample: poses between tags come from it.
    pub fn sense(&mut self, sample: &ImuSample) {
        self.tracker.sense(sample);
    }

    /// Has frames searched for tags before their turn.
    pub fn early_search(&self) -> EarlySearch {
        self.tracker.early()
    }

    /// One frame, all stages, seen at its own time.
    pub fn frame(&mut self, frame: &RawFrame) -> Result<FrameOutcome, PipelineError> {
        self.frame_for(frame, None, None)
    }

    /// One frame, all stages, to be seen at `shown_at` (`None`: at the frame's own time): virtual objects are posed for
    /// that moment. `ahead` is the frame after it, where that is there already: tags are looked for in it while this one is
    /// drawn. Whatever fails degrades the picture, and is logged.
    ///
    /// # Errors
    /// Only a fault in the tracking thread.
    pub fn frame_for(
        &mut self,
        frame: &RawFrame,
        shown_at: Option<Timestamp>,
        ahead: Option<&RawFrame>,
    ) -> Result<FrameOutcome, PipelineError> {
        self.follow_response(frame);
        self.presenting.see(frame);
        self.passes.clear();
        let mut times = StageTimes::all_at(self.watch.now());
        let is_itself = self.is_picture_itself(frame);
        let located = if is_itself { Err("nothing virtual to draw") } else { self.locate(frame)? };
        times.located_at(self.watch.now());
        if let Some(ahead) = ahead.filter(|_| !is_itself) {
            self.tracker.early().offer(ahead);
        }
        let mut estimates = (None, None);
        let shown = match located {
            Err(why) => self.show_as_it_is(frame, why),
            Ok(pose) => match self.measure(frame, pose.as_ref(), &mut times) {
                Err(why) => self.show_as_it_is(frame, why),
                Ok(light) => {
                    estimates = (pose, light);
                    self.present(frame, light.as_ref(), shown_at.unwrap_or(frame.t_mid))
                }
            },
        };
        self.presenting.lay_text_over(self.options.hud);
        times.drawn = self.watch.now();
        self.engine.get().take_timings(&mut self.passes);
        self.frames_done += 1;
        let stage_ms = times.ms();
        let choice = match is_itself {
            false => self.govern(times.drawn, &stage_ms),
            // Nothing was drawn that the governor could learn from.
            true => self.governor.as_ref().map(Governor::choice),
        };
        let (pose, light) = estimates;
        Ok(FrameOutcome { sequence: frame.sequence, t: frame.t_mid, pose, light, shown, stage_ms, choice })
    }

    /// Goes over to the response that a frame comes with, where it is another one.
    fn follow_response(&mut self, frame: &RawFrame) {
        let Some(response) = &frame.response else { return };
        if self.response_of_frames.as_ref().is_some_and(|known| Arc::ptr_eq(known, response)) {
            return;
        }
        self.response_of_frames = Some(Arc::clone(response));
        if self.response != **response {
            self.response.clone_from(response);
            self.tracker.set_response(response);
            self.lighting.forget_frames();
        }
    }

    /// The pose at the frame's time; `Err` says why the frame can only be shown as it came.
    fn locate(
        &mut self,
        frame: &RawFrame,
    ) -> Result<Result<Option<PoseEstimate>, &'static str>, PipelineError> {
        match self.tracker.track(frame) {
            Ok(pose) => Ok(Ok(pose)),
            // The camera has come back with pictures of another size, say.
            Err(error @ (TrackingError::Size { .. } | TrackingError::Tags(_))) => {
                tracing::warn!("shown as it came: {error}");
                Ok(Err("the frame does not fit the lens"))
            }
            Err(fault) => Err(fault.into()),
        }
    }

    fn show_as_it_is(&mut self, frame: &RawFrame, why: &'static str) -> Shown {
        self.presenting.show_as_it_is(&self.rig.lens, frame, &self.options);
        Shown::PassedThrough(why)
    }

    /// Merges the frame and reads the light. `Err` says why nothing can be drawn over a merged picture.
    fn measure(
        &mut self,
        frame: &RawFrame,
        pose: Option<&PoseEstimate>,
        times: &mut StageTimes,
    ) -> Result<Option<LightEstimate>, &'static str> {
        self.reload_scene(frame.t_mid)?;
        let engine = self.engine.get();
        let gathered =
            self.lighting.gather(frame, pose, engine, &self.response, &self.options, self.watch.as_ref());
        let warped = match gathered {
            Ok(warped) => warped,
            Err(GatherError::Frame(why)) => {
                tracing::warn!("shown as it came: {why}");
                return Err("the frame does not fit the lens");
            }
            Err(GatherError::Engine(error)) => return Err(self.engine_failed(&error, frame.t_mid)),
        };
        times.registered = warped;
        times.merged = self.watch.now();
        let due = self.frames_done.is_multiple_of(u64::from(self.options.quality.light_every.max(1)));
        let job = LightMoment { rig: &self.rig, pose, t: frame.t_mid, due };
        let light = self.lighting.measure(self.engine.get(), &job, &self.options);
        times.lit = self.watch.now();
        Ok(light)
    }

    /// Draws the virtual objects where the camera will be at `shown_at`, or says in the outcome why not.
    fn present(&mut self, frame: &RawFrame, light: Option<&LightEstimate>, shown_at: Timestamp) -> Shown {
        let pose = self.tracker.pose_at(shown_at);
        let light_is_known = light.is_some() || self.presenting.has_room();
        let row = policy::judge(policy::missing_of_frame(pose.as_ref(), light_is_known));
        let why = row.filter(|row| row.shows < Shows::Everything).map(|row| row.says);
        let of_frame = self.presenting.frame_of(frame, self.lighting.is_alone(), self.lighting.was_read());
        let parts = PictureParts {
            background: self.lighting.picture(),
            lens: &self.rig.lens,
            response: &self.response,
            light: light.map(|light| &light.lights),
            environment: self.lighting.environment(),
            t: frame.t_mid,
            of_frame,
        };
        let why = match (why, pose) {
            (None, Some(pose)) => {
                let drawn =
                    self.presenting.relit(self.engine.get(), &parts, &pose.world_from_camera, &self.options);
                match drawn {
                    Ok(()) => {
                        self.engine.has_drawn();
                        return Shown::Relit;
                    }
                    Err(error) => {
                        let (scene, room) = (self.presenting.scene(), self.presenting.room());
                        self.engine.failed(&error, frame.t_mid, scene, room)
                    }
                }
            }
            (why, _) => why.unwrap_or("no tag found yet"),
        };
        self.presenting.passed_through(self.engine.get(), &parts, frame, &self.options);
        Shown::PassedThrough(why)
    }

    /// Hands the scene to an engine that has not taken it yet.
    fn reload_scene(&mut self, t: Timestamp) -> Result<(), &'static str> {
        match self.engine.load(self.presenting.scene()) {
            Ok(()) => Ok(()),
            Err(error) => Err(self.engine_failed(&error, t)),
        }
    }

    fn engine_failed(&mut self, error: &EngineError, t: Timestamp) -> &'static str {
        self.engine.failed(error, t, self.presenting.scene(), self.presenting.room())
    }

    /// Lets the governor look at a frame, and follows it.
    fn govern(&mut self, done: Timestamp, stage_ms: &[f32; Stage::ALL.len()]) -> Option<Choice> {
        let governor = self.governor.as_mut()?;
        let drawing_ms = stage_ms[Stage::Relight as usize];
        let changed = governor.frame(done, drawing_ms, stage_ms[Stage::Frame as usize] - drawing_ms);
        let choice = governor.choice();
        if changed {
            self.obey();
            tracing::info!(
                step = choice.step,
                of = choice.of,
                expected_error = choice.expected_error,
                expected_ms = choice.expected_ms,
                measured_ms = choice.measured_ms,
                "the governor changes the settings"
            );
        }
        self.note(format_args!(
            "governor: step {} of {}, expected error {:.3}, expected {:.1} ms, measured {:.1} ms",
            choice.step + 1,
            choice.of,
            choice.expected_error,
            choice.expected_ms,
            choice.measured_ms
        ));
        Some(choice)
    }

    /// The last picture.
    pub fn picture(&self) -> &Picture {
        self.presenting.picture()
    }

    /// Times of the passes of the last frame, in order.
    pub fn passes(&self) -> &[PassTiming] {
        &self.passes
    }

    /// The last picture with a text over it that says what is missing, for the time that no frame comes; plain gray before
    /// the first picture.
    pub fn hold(&mut self, says: &str) -> &Picture {
        self.presenting.hold(says, &self.rig.lens)
    }

    /// Hands in a line of text for the next picture, shown above the table of its effects where `Options::hud` is set.
    /// Allocates nothing in steady state.
    pub fn note(&mut self, line: std::fmt::Arguments<'_>) {
        if self.options.hud {
            self.presenting.note(line);
        }
    }

    /// The passes of the last picture, and those left out, each with its reason.
    pub fn plan(&self) -> &FramePlan {
        self.presenting.plan()
    }

    /// The scene as it is drawn: with what the bodies carry with them.
    pub fn scene(&self) -> &Arc<Scene> {
        self.presenting.scene()
    }

    /// What the last picture was drawn from.
    pub fn drawn_from(&self) -> DrawnFrom<'_> {
        DrawnFrom {
            scene: self.presenting.scene(),
            background: self.lighting.picture(),
            lens: &self.rig.lens,
            response: &self.response,
            shown_exposure: self.presenting.shown_exposure(),
            samples: self.engine.measured_samples(),
            room: self.presenting.room(),
        }
    }
}
