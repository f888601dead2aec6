//! One frame of a recording, run through the daemon's pipeline, with all that its picture is drawn from: so that it can be
//! drawn again with other settings.

use super::{
    CliError,
    render::{Quantity, Still, halve_options, middle_of},
};
use crate::cli::progress::host;
use crate::config::settings::{RunMode, Settings};
use crate::daemon::{dress::dressed_anew, prepare::prepare};
use crate::device::clock::ManualClock;
use crate::light::{
    halve::{HalveOptions, halve_still, halve_still_with_rest},
    prefilter::Prefilter,
    project_sh::project_sh,
};
use crate::model::{
    environment::EnvironmentPicture,
    light::{Lights, RadianceSh},
    picture::PictureView,
    quality::Quality,
    time::Timestamp,
};
use crate::nearfield::{faces::Faces, objects};
use crate::pipeline::{
    PipelineError,
    frame::{FrameOutcome, Stage},
    lockstep::Lockstep,
    turns::{FinishedFrame, FrameSink, run as run_turns},
};
use std::sync::Arc;

/// One frame of a recording.
pub struct Moment {
    /// As the pipeline has it.
    pub still: Still,
    /// All light, as it was measured.
    pub total: RadianceSh,
    /// Whether the ball stands on the surface.
    pub above_horizon: bool,
    /// Median wall time of each stage over the frames up to this one, milliseconds, in the order of `Stage::ALL`.
    pub stage_ms: [f32; Stage::ALL.len()],
}

/// Keeps the newest frame, and the times of all.
#[derive(Default)]
struct Newest {
    outcome: Option<FrameOutcome>,
    first: Option<Timestamp>,
    times: Vec<[f32; Stage::ALL.len()]>,
}

impl FrameSink for Newest {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        let outcome = finished.outcome;
        self.times.push(outcome.stage_ms);
        if !outcome.shown.is_passed_through() {
            // Time in the scene begins with the first picture that has it.
            self.first.get_or_insert(outcome.t);
        }
        self.outcome = Some(outcome.clone());
        Ok(true)
    }
}

impl Moment {
    /// The frame of that number, counted from 1, of `settings.camera`, in lockstep. Errors: no pose or light there.
    pub fn of(settings: &Settings, frame: u64) -> Result<Self, CliError> {
        let settings = Settings { mode: RunMode::Lockstep, ..settings.clone() };
        let failed = |e: PipelineError| CliError(e.to_string());
        let mut prepared = prepare(&settings, &host()).map_err(failed)?;
        let mut newest = Newest::default();
        let mut events = Lockstep::new(Arc::default(), prepared.source, prepared.imu, ManualClock::default());
        run_turns(&mut events, &mut prepared.pipeline, &mut newest, frame).map_err(failed)?;
        let from = prepared.pipeline.drawn_from();
        let pose = newest.outcome.as_ref().and_then(|o| o.pose);
        let light = newest.outcome.as_ref().and_then(|o| o.light);
        let (Some(pose), true) = (pose, light.is_some() || from.room.is_some()) else {
            return Err(CliError(format!(
                "--frame = {frame}: pose and light of {} are not known there; must be a later frame, or a recording \
                 with a tag and a ball",
                settings.camera
            )));
        };
        let order = settings.quality.sh_order;
        let time_s = match (&newest.outcome, newest.first) {
            (Some(outcome), Some(first)) => outcome.t.seconds_since(first),
            _ => 0.0,
        };
        let still = Still {
            scene: from.scene.clone(),
            lens: *from.lens,
            world_from_camera: pose.world_from_camera,
            light: light.as_ref().map_or_else(|| Lights::soft(RadianceSh::zero(order)), |l| l.lights),
            background: from.background.clone(),
            response: from.response.clone(),
            exposure_s: Some(from.shown_exposure.effective_s()),
            quantity: Quantity::Radiance,
            room: from.room.cloned(),
            view: PictureView::Final,
            samples: from.samples.clone(),
            environment: None,
            time_s,
        };
        let stage_ms = std::array::from_fn(|k| {
            let mut all: Vec<f32> = newest.times.iter().map(|t| t[k]).collect();
            all.sort_by(f32::total_cmp);
            all.get(all.len() / 2).copied().unwrap_or(0.0)
        });
        let total = light.map_or_else(|| RadianceSh::zero(order), |l| l.total);
        Ok(Self { still, total, above_horizon: settings.ball_on_surface, stage_ms })
    }

    /// A still whose light was measured, as a moment; `None` where there is nothing that its light could be halved from anew.
    pub fn of_still(still: &Still, above_horizon: bool, quality: &Quality) -> Option<Self> {
        let measured = still.room.is_none() && !still.samples.directions.is_empty();
        measured.then(|| Self {
            still: still.clone(),
            total: project_sh(&still.samples, quality.sh_order),
            above_horizon,
            stage_ms: Default::default(),
        })
    }

    /// The light of the moment, halved for other settings; in a known room, its light where the objects are.
    pub fn halved(&self, quality: &Quality) -> Lights {
        match &self.still.room {
            Some(room) => {
                objects::lights_at(room, &Faces::of_room(&room.room), middle_of(&self.still.posed()))
            }
            None => halve_still(&self.still.samples, &self.total(quality), self.options(quality)),
        }
    }

    /// What mirrors and sharp gloss see then.
    pub fn environment(&self, quality: &Quality) -> EnvironmentPicture {
        let samples = &self.still.samples;
        let (_, left) = halve_still_with_rest(samples, &self.total(quality), self.options(quality));
        let (mut work, mut picture) = (Prefilter::default(), EnvironmentPicture::default());
        work.see(samples, 1.0, &mut picture);
        work.levels(left.as_ref(), &mut picture);
        picture
    }

    /// The still with other settings of accuracy: its bodies carry what those ask for, its light is halved anew.
    pub fn still(&self, quality: &Quality) -> Still {
        let mut still = self.still.clone();
        still.scene = dressed_anew(&still.scene, quality, host().progress);
        still.light = self.halved(quality);
        still.environment = still.room.is_none().then(|| self.environment(quality));
        still
    }

    /// All light to the order of other settings.
    fn total(&self, quality: &Quality) -> RadianceSh {
        match quality.sh_order == self.total.order {
            true => self.total,
            false => project_sh(&self.still.samples, quality.sh_order),
        }
    }

    fn options(&self, quality: &Quality) -> HalveOptions {
        halve_options(quality, self.above_horizon)
    }
}
