//! Layer 4: the order of the stages for each frame, and the threads. What feeds it (lockstep or as time passes) and
//! what takes its pictures stand outside.

pub mod event;
pub mod feed;
pub mod frame;
pub mod gray_place;
pub mod hud;
pub mod letters;
pub mod lighting;
pub mod policy;
pub mod presenting;
pub mod room_light;
pub mod tracking;
pub mod views;

use crate::device::{Clock, DeviceError};
use crate::engine::{Engine, EngineError};
use crate::light::prefilter::Wanted;
use crate::math::lens::Lens;
use crate::model::{
    frame::{Exposure, RawFrame},
    image::HdrImage,
    light::RadianceSamples,
    picture::{Picture, PictureView},
    quality::{Effects, Quality},
    response::Response,
    rig::Rig,
    scene::Scene,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{FramePlan, PassTiming, governor::Governor};
use frame::{FrameOutcome, Shown, Stage};
use lighting::Lighting;
use presenting::Presenting;
use std::sync::Arc;
use tracking::{Tracker, TrackingError};

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

/// What the settings mean for the pipeline.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Accuracy settings of every frame.
    pub quality: Quality,
    /// Anisotropy below which no direction dominates.
    pub light_threshold: f32,
    /// Gray by Rec. 709 weights in place of 0.3, 0.59, 0.11.
    pub rec709: bool,
    /// Time constant of the light's filter, seconds; 0 = none.
    pub filter_tau_s: f64,
    /// Whether the ball stands on the surface z = 0.
    pub ball_on_surface: bool,
    /// The longest exposure that the camera goes through.
    pub longest_exposure: Exposure,
    /// Different exposures that the camera goes through.
    pub exposures_in_cycle: usize,
    /// Exposure of the shown picture; `None`: the one of the cycle that exposes the place best.
    pub shown_exposure: Option<Exposure>,
    /// What is shown of a frame.
    pub view: PictureView,
    /// Whether text is laid over the picture.
    pub hud: bool,
    /// Tags are searched in a picture reduced by this.
    pub decimate: f32,
    /// Blur before tags are searched, pixels.
    pub quad_sigma_px: f32,
}

/// Settings that have changed while the pipeline runs.
#[derive(Clone, Debug)]
pub struct Change {
    /// All of them; those of the tracker and of the exposures are not looked at.
    pub options: Options,
    /// Gives the scene's bodies what they carry with them (spheres, transfer) anew, where that depends on what has
    /// changed.
    pub dress: Option<fn(&mut Scene, &Quality)>,
    /// The governor from now on: `None` leaves it as it is, `Some(None)` sends it away.
    pub govern: Option<Option<Governor>>,
}

/// What the last picture was drawn from, besides its pose and its light.
#[derive(Clone, Copy)]
pub struct DrawnFrom<'a> {
    /// Objects and surfaces.
    pub scene: &'a Scene,
    /// The camera's picture, linear.
    pub background: &'a HdrImage,
    /// Its lens.
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
    engine: Box<dyn Engine>,
    watch: Box<dyn Clock>,
    rig: Rig,
    response: Response,
    options: Options,
    tracker: Tracker,
    lighting: Lighting,
    presenting: Presenting,
    newest_passes: Vec<PassTiming>,
    passes: Vec<PassTiming>,
    frames_done: u64,
    governor: Option<Governor>,
    /// Nobody asks for pose and light themselves.
    only_pictures: bool,
}

impl Pipeline {
    /// Takes the engine (scene loaded), a clock for timings, and what is known of the rig.
    pub fn new(
        engine: Box<dyn Engine>,
        watch: Box<dyn Clock>,
        rig: Rig,
        response: Response,
        scene: Scene,
        options: Options,
    ) -> Result<Self, PipelineError> {
        let mut tracker = Tracker::start(&rig, options.decimate, options.quad_sigma_px)?;
        tracker.set_response(&response);
        let mut lighting = Lighting::new(&rig, &options);
        lighting.want(Wanted::by(&scene, options.quality.sh_order));
        let presenting = Presenting::new(scene, &options);
        Ok(Self {
            engine,
            watch,
            rig,
            response,
            options,
            tracker,
            lighting,
            presenting,
            newest_passes: Vec::new(),
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
        let Some(governor) = &self.governor else { return };
        self.options.quality = governor.step().quality;
        self.lighting.retune(&self.options);
        self.presenting.retune(&self.options);
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

    /// Whether a frame's picture is the frame itself: there is nothing virtual to draw, and no other exposure to merge.
    fn is_picture_itself(&self, frame: &RawFrame) -> bool {
        self.only_pictures
            && self.options.exposures_in_cycle <= 1
            && self.options.quality.effects == Effects::CalledFor
            && self.options.view == PictureView::Final
            && self.presenting.shows_nothing_virtual(frame)
    }

    /// Goes on with other settings from the next frame on. The light that was measured, the pose and the time within the
    /// scene stay; light of another order is measured anew. Fails where the engine cannot take the scene.
    pub fn change(&mut self, change: Change) -> Result<(), PipelineError> {
        let Change { options, dress, govern } = change;
        self.options = options;
        self.lighting.retune(&options);
        self.presenting.retune(&options);
        if let Some(dress) = dress {
            self.presenting.change_scene(|scene| dress(scene, &options.quality));
            self.engine.load_scene(self.presenting.scene())?;
        }
        self.lighting.want(Wanted::by(self.presenting.scene(), options.quality.sh_order));
        if let Some(governor) = govern {
            self.governor = governor;
        }
        self.obey();
        Ok(())
    }

    /// One frame, all stages. Errors of the engine in the light or in the drawing degrade the picture and are logged;
    /// only a frame that does not fit the rig is an error.
    pub fn frame(&mut self, frame: &RawFrame) -> Result<FrameOutcome, PipelineError> {
        let lens = &self.rig.lens;
        self.presenting.see(frame);
        let mut stage_ms = [0.0f32; Stage::ALL.len()];
        let start = self.watch.now();
        if self.is_picture_itself(frame) {
            self.presenting.shown_as_it_is(lens, frame);
            self.presenting.lay_text_over();
            self.frames_done += 1;
            let ms = (self.watch.now().seconds_since(start) * 1e3) as f32;
            stage_ms[Stage::Relight as usize] = ms;
            stage_ms[Stage::Frame as usize] = ms;
            let shown = Shown::PassedThrough("nothing virtual to draw");
            let (sequence, t) = (frame.sequence, frame.t_mid);
            // Nothing is drawn that the governor could learn from.
            let choice = self.governor.as_ref().map(Governor::choice);
            return Ok(FrameOutcome { sequence, t, pose: None, light: None, shown, stage_ms, choice });
        }
        let pose = self.tracker.track(frame)?;
        let tracked = self.watch.now();
        let registered = self.lighting.gather(
            frame,
            pose.as_ref(),
            self.engine.as_mut(),
            &self.response,
            self.watch.as_ref(),
        )?;
        let merged = self.watch.now();
        let due = self.frames_done.is_multiple_of(u64::from(self.options.quality.light_every.max(1)));
        let light = self.lighting.measure(self.engine.as_mut(), &self.rig, pose.as_ref(), frame.t_mid, due);
        let lit = self.watch.now();
        let of_frame = self.presenting.frame_of(frame, self.lighting.is_alone(), self.lighting.was_read());
        let obstacle = policy::obstacle(pose.as_ref(), light.is_some() || self.presenting.has_room());
        let shown = match (obstacle, &pose) {
            (None, Some(pose)) => self.presenting.relit(
                self.engine.as_mut(),
                self.lighting.picture(),
                lens,
                &pose.world_from_camera,
                light.as_ref().map(|light| &light.lights),
                self.lighting.environment(),
                &self.response,
                frame.t_mid,
                of_frame,
            ),
            _ => Err(obstacle.unwrap_or("nothing to draw with")),
        };
        let shown = match shown {
            Ok(()) => Shown::Relit,
            Err(why) => {
                self.presenting.passed_through(
                    self.engine.as_mut(),
                    self.lighting.picture(),
                    lens,
                    &self.response,
                    frame,
                    of_frame,
                );
                Shown::PassedThrough(why)
            }
        };
        self.presenting.lay_text_over();
        let done = self.watch.now();
        for (slot, (to, from)) in stage_ms.iter_mut().zip([
            (tracked, start),
            (registered, tracked),
            (merged, registered),
            (lit, merged),
            (done, lit),
            (done, start),
        ]) {
            *slot = (to.seconds_since(from) * 1e3) as f32;
        }
        self.engine.take_timings(&mut self.newest_passes);
        self.passes.append(&mut self.newest_passes);
        self.frames_done += 1;
        let drawing_ms = stage_ms[Stage::Relight as usize];
        let choice = self.governor.as_mut().map(|governor| {
            let changed = governor.frame(done, drawing_ms, stage_ms[Stage::Frame as usize] - drawing_ms);
            (changed, governor.choice())
        });
        if let Some((true, choice)) = &choice {
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
        let choice = choice.map(|(_, choice)| choice);
        if let Some(choice) = choice.filter(|_| self.options.hud) {
            self.note(format_args!(
                "governor: step {} of {}, expected error {:.3}, expected {:.1} ms, measured {:.1} ms",
                choice.step + 1,
                choice.of,
                choice.expected_error,
                choice.expected_ms,
                choice.measured_ms
            ));
        }
        Ok(FrameOutcome { sequence: frame.sequence, t: frame.t_mid, pose, light, shown, stage_ms, choice })
    }

    /// The last picture.
    pub fn picture(&self) -> &Picture {
        self.presenting.picture()
    }

    /// Hands in a line of text for the next picture, shown above the table of its effects where `Options::hud` is set.
    /// Allocates nothing in steady state.
    pub fn note(&mut self, line: std::fmt::Arguments<'_>) {
        self.presenting.note(line);
    }

    /// The passes of the last picture, and those left out, each with its reason.
    pub fn plan(&self) -> &FramePlan {
        self.presenting.plan()
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

    /// Times of all passes so far, taken away.
    pub fn take_passes(&mut self) -> Vec<PassTiming> {
        std::mem::take(&mut self.passes)
    }
}
