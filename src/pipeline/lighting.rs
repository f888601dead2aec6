//! The light of the place, frame by frame: slide, merge, read, follow, split. What cannot be measured is held.

use super::Options;
use crate::engine::{Bracket, Engine, EngineError, LightJob};
use crate::hdr::sliding::SlidingMerge;
use crate::light::follow::Follow;
use crate::light::split::{GRAY_PAPER, GRAY_REC709, SplitOptions};
use crate::model::{
    estimate::{LightEstimate, PoseEstimate, Provenance},
    frame::RawFrame,
    image::HdrImage,
    quality::Quality,
    response::Response,
    rig::Rig,
    time::Timestamp,
};

/// The light stage and the linear picture that it is read from.
pub struct Lighting {
    sliding: SlidingMerge,
    follow: Follow,
    picture: HdrImage,
    quality: Quality,
    on_surface: bool,
    refused: u64,
}

impl Lighting {
    /// Empty: no frame, no light.
    pub fn new(rig: &Rig, options: &Options) -> Self {
        let split = SplitOptions {
            least_anisotropy: options.light_threshold,
            gray_weights: if options.rec709 { GRAY_REC709 } else { GRAY_PAPER },
            fade_in: true,
        };
        Self {
            sliding: SlidingMerge::new(options.quality.brackets, rig.lens, rig.ball),
            follow: Follow::new(options.filter_tau_s, split),
            picture: HdrImage::default(),
            quality: options.quality,
            on_surface: options.ball_on_surface,
            refused: 0,
        }
    }

    /// Takes a frame; older frames of other exposures are warped into its view.
    pub fn register(&mut self, frame: &RawFrame, pose: Option<&PoseEstimate>) {
        self.sliding.push(frame, pose.map(|p| p.world_from_camera));
        self.sliding.register();
    }

    /// Merges what `register` left.
    pub fn merge(&mut self, engine: &mut dyn Engine, response: &Response) -> Result<(), EngineError> {
        let (pictures, exposures) = self.sliding.registered();
        engine.merge_bracket(&Bracket { pictures, exposures }, response, &mut self.picture)
    }

    /// The merged picture, as seen from the newest frame.
    pub fn picture(&self) -> &HdrImage {
        &self.picture
    }

    /// The light at `t`: measured where it is due and the pose was measured, else held. `None` before the first.
    pub fn measure(
        &mut self,
        engine: &mut dyn Engine,
        rig: &Rig,
        pose: Option<&PoseEstimate>,
        t: Timestamp,
        due: bool,
    ) -> Option<LightEstimate> {
        let measured_pose = pose.filter(|p| p.provenance == Provenance::Measured);
        if let (true, Some(pose), Some(ball)) = (due && self.sliding.is_full(), measured_pose, &rig.ball) {
            let job = LightJob::Ball {
                picture: &self.picture,
                lens: &rig.lens,
                world_from_camera: &pose.world_from_camera,
                ball,
                on_surface: self.on_surface,
            };
            match engine.estimate_light(&job, &self.quality) {
                Ok(light) => self.follow.update(t, &light.total, &light.flags),
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
