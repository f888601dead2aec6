//! One frame of a recording, run through the daemon's pipeline, with all that its picture is drawn from: so that it can be
//! drawn again with other settings.

use super::far_light::{FarLight, KnownLight};
use super::{Composition, PictureQuantity};
use crate::config::settings::{RunMode, Settings};
use crate::daemon::{host::Host, prepare::prepare};
use crate::device::clock::ManualClock;
use crate::error::LabError;
use crate::light::below::BelowHorizon;
use crate::model::{scene::Scene, time::Timestamp};
use crate::pipeline::{
    PipelineError,
    frame::{FrameOutcome, Stage},
    lockstep::Lockstep,
    turns::{FinishedFrame, FrameSink, run as run_turns},
};
use std::sync::Arc;

/// One frame of a recording.
pub struct RecordedMoment {
    /// What its picture is composed of.
    pub composition: Composition,
    /// Median wall time of each stage over the frames up to this one, milliseconds, in the order of `Stage::ALL`.
    pub stage_ms: [f32; Stage::ALL.len()],
}

/// Keeps the newest frame, and the times of all.
#[derive(Default)]
struct NewestFrame {
    outcome: Option<FrameOutcome>,
    first: Option<Timestamp>,
    times: Vec<[f32; Stage::ALL.len()]>,
}

impl FrameSink for NewestFrame {
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

impl RecordedMoment {
    /// The frame of that number, counted from 0, of `settings.camera`, in lockstep.
    ///
    /// # Errors
    /// The recording or the scene cannot be opened; no pose or light is known there.
    pub fn of(settings: &Settings, frame: u64, host: &Host<'_>) -> Result<Self, LabError> {
        let settings = Settings { mode: RunMode::Lockstep, ..settings.clone() };
        let mut prepared = prepare(&settings, host)?;
        let mut newest = NewestFrame::default();
        let mut events = Lockstep::new(Arc::default(), prepared.source, prepared.imu, ManualClock::default());
        run_turns(&mut events, &mut prepared.pipeline, &mut newest, frame.saturating_add(1))?;
        let from = prepared.pipeline.drawn_from();
        let pose = newest.outcome.as_ref().and_then(|o| o.pose);
        let light = newest.outcome.as_ref().and_then(|o| o.light);
        let (Some(pose), true) = (pose, light.is_some() || from.room.is_some()) else {
            return Err(LabError::Asked(format!(
                "--frame = {frame}: pose and light of {} are not known there; must be a later frame, or a recording \
                 with a tag and a ball",
                settings.camera
            )));
        };
        let time_s = match (&newest.outcome, newest.first) {
            (Some(outcome), Some(first)) => outcome.t.seconds_since(first),
            _ => 0.0,
        };
        let known = match &light {
            Some(light) => {
                KnownLight::Picture { samples: from.samples.clone(), total: Some(light.total), map: None }
            }
            None => KnownLight::Uniform([0.0; 3]),
        };
        let composition = Composition {
            scene: without_fits(from.scene.clone()),
            lens: *from.lens,
            world_from_camera: pose.world_from_camera,
            far: FarLight {
                known,
                direct: Vec::new(),
                below: BelowHorizon::AsGiven,
                above_horizon: settings.ball_on_surface,
            },
            room: from.room.cloned(),
            background: from.background.clone(),
            response: from.response.clone(),
            exposure_s: Some(from.shown_exposure.effective_s()),
            quantity: PictureQuantity::Radiance,
            time_s,
        };
        Ok(Self { composition, stage_ms: newest.medians() })
    }
}

impl NewestFrame {
    /// Median of each stage's times, milliseconds.
    fn medians(&self) -> [f32; Stage::ALL.len()] {
        std::array::from_fn(|k| {
            let mut all: Vec<f32> = self.times.iter().map(|t| t[k]).collect();
            all.sort_by(f32::total_cmp);
            all.get(all.len() / 2).copied().unwrap_or(0.0)
        })
    }
}

/// The scene without the spheres and transfers that one setting of accuracy fitted to it.
fn without_fits(mut scene: Scene) -> Scene {
    scene.figures.iter_mut().for_each(|figure| figure.spheres.clear());
    scene.transfer = None;
    scene
}
