//! The light of the place, frame by frame: slide, merge, read, follow, split. What cannot be measured is held.

use super::Options;
use crate::device::Clock;
use crate::engine::{Bracket, Engine, EngineError, LightJob, SensorBracket};
use crate::hdr::sliding::{SlidingError, SlidingMerge};
use crate::light::follow::Follow;
use crate::light::halve::HalveOptions;
use crate::light::prefilter::WantedEnvironment;
use crate::light::split::{GRAY_PAPER, GRAY_REC709, SplitOptions};
use crate::light::unwrap_ball::BallShot;
use crate::model::{
    environment::EnvironmentPicture,
    estimate::{LightEstimate, PoseEstimate, Provenance},
    frame::RawFrame,
    image::HdrImage,
    response::Response,
    rig::Rig,
    time::Timestamp,
};

/// Why a frame could not be merged.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// The frame is none of this camera's.
    #[error(transparent)]
    Frame(#[from] SlidingError),
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
}

/// What light is measured at.
#[derive(Clone, Copy)]
pub struct LightMoment<'a> {
    /// The lens and the ball.
    pub rig: &'a Rig,
    /// The camera's pose at `t`, where it is known.
    pub pose: Option<&'a PoseEstimate>,
    /// Time of the newest frame.
    pub t: Timestamp,
    /// Whether the light is to be measured at this frame.
    pub due: bool,
}

/// The light stage and the linear picture that it is read from. It keeps what was seen; settings come with each frame.
pub struct Lighting {
    sliding: SlidingMerge,
    follow: Follow,
    picture: HdrImage,
    /// Frames in the last bracket.
    bracket: usize,
    refused: u64,
    /// The last frame's light was read.
    was_read: bool,
}

impl Lighting {
    /// Empty: no frame, no light.
    pub fn new(rig: &Rig, options: &Options) -> Self {
        Self {
            sliding: SlidingMerge::new(options.quality.brackets, &rig.lens, rig.ball),
            follow: Follow::new(options.filter_tau_s, halving(options)),
            picture: HdrImage::default(),
            bracket: 0,
            refused: 0,
            was_read: false,
        }
    }

    /// Takes a frame, warps older frames of other exposures into its view, and merges them. Returns when the
    /// warping was done, on `watch`.
    pub fn gather(
        &mut self,
        frame: &RawFrame,
        pose: Option<&PoseEstimate>,
        engine: &mut dyn Engine,
        response: &Response,
        options: &Options,
        watch: &dyn Clock,
    ) -> Result<Timestamp, GatherError> {
        self.sliding.keep(options.quality.brackets);
        self.sliding.push(frame, pose.map(|p| p.world_from_camera))?;
        // What the sensor gave is finer than the 8 bits made of it.
        if let Some(registered) = self.sliding.registered_sensor() {
            let warped = watch.now();
            let bracket =
                SensorBracket { pictures: registered.pictures(), exposures: registered.exposures() };
            engine.merge_sensor(&bracket, &mut self.picture)?;
            self.bracket = bracket.pictures.len();
            return Ok(warped);
        }
        let registered = self.sliding.registered(response);
        let warped = watch.now();
        let bracket = Bracket { pictures: registered.pictures(), exposures: registered.exposures() };
        engine.merge_bracket(&bracket, response, &mut self.picture)?;
        self.bracket = bracket.pictures.len();
        Ok(warped)
    }

    /// Forgets the frames that wait to be merged: their values mean something else than those to come.
    pub fn forget_frames(&mut self) {
        self.sliding.clear();
    }

    /// What of the picture of the environment the scene's materials need.
    pub fn want(&mut self, wanted: WantedEnvironment) {
        self.follow.want(wanted);
    }

    /// The picture of the environment, where one is wanted and was seen.
    pub fn environment(&self) -> Option<&EnvironmentPicture> {
        self.follow.environment()
    }

    /// The merged picture, as seen from the newest frame.
    pub fn picture(&self) -> &HdrImage {
        &self.picture
    }

    /// Whether the newest frame alone makes the merged picture.
    pub fn is_alone(&self) -> bool {
        self.bracket == 1
    }

    /// Whether the last measurement read the ball.
    pub fn was_read(&self) -> bool {
        self.was_read
    }

    /// The light at a moment: measured where it is due and the pose was measured, else held. `None` before the first.
    pub fn measure(
        &mut self,
        engine: &mut dyn Engine,
        moment: &LightMoment<'_>,
        options: &Options,
    ) -> Option<LightEstimate> {
        let LightMoment { rig, pose, t, due } = *moment;
        self.follow.retune(options.filter_tau_s, halving(options));
        self.was_read = false;
        let full_bracket = options.quality.brackets.min(options.exposures_in_cycle.max(1));
        let measured_pose = pose.filter(|p| p.provenance == Provenance::Measured);
        if let (true, Some(pose), Some(ball)) =
            (due && self.bracket >= full_bracket, measured_pose, &rig.ball)
        {
            let job = LightJob::Ball(BallShot {
                picture: &self.picture,
                lens: &rig.lens,
                world_from_camera: &pose.world_from_camera,
                ball,
                on_surface: options.ball_on_surface,
                without_ball: None,
            });
            match engine.estimate_light(&job, &options.quality) {
                Ok(light) => {
                    self.was_read = true;
                    self.follow.update(t, &light.total, &light.flags, engine.measured_samples());
                }
                Err(error) => {
                    // The world misbehaved (the ball is out of the picture, say): hold, and say so now and then.
                    if self.refused.is_multiple_of(100) {
                        tracing::warn!("light held: {error}");
                    }
                    self.refused += 1;
                }
            }
        }
        self.follow.estimate(t)
    }
}

fn halving(options: &Options) -> HalveOptions {
    HalveOptions {
        kind: options.quality.split,
        lights: options.quality.lights,
        shadow_maps: options.quality.shadow_maps,
        net_flux: SplitOptions {
            least_anisotropy: options.light_threshold,
            gray_weights: if options.rec709 { GRAY_REC709 } else { GRAY_PAPER },
            ..SplitOptions::default()
        },
        above_horizon: options.ball_on_surface,
        dering: options.quality.dering,
    }
}
