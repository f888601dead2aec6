//! From estimates to the shown picture: plan, then draw.

use super::Options;
use crate::engine::{Engine, RelightInput};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    frame::{Exposure, RawFrame},
    image::HdrImage,
    light::{RadianceSh, SplitLight},
    picture::Picture,
    quality::Quality,
    response::Response,
    scene::Scene,
    time::Timestamp,
};
use crate::plan::{
    FramePlan,
    effects::{self, Occasion},
};

/// Plans and draws.
pub struct Presenting {
    scene: Scene,
    nothing: Scene,
    plan: FramePlan,
    picture: Picture,
    quality: Quality,
    shown_exposure: Exposure,
}

impl Presenting {
    /// Takes the scene that the engine was given, to plan with.
    pub fn new(scene: Scene, options: &Options) -> Self {
        Self {
            scene,
            nothing: Scene::default(),
            plan: FramePlan::default(),
            picture: Picture::default(),
            quality: options.quality,
            shown_exposure: options.shown_exposure,
        }
    }

    /// Draws the virtual objects into the picture; `Err` says why it could not.
    #[allow(clippy::too_many_arguments, reason = "all that one picture is drawn from")]
    pub fn relit(
        &mut self,
        engine: &mut dyn Engine,
        background: &HdrImage,
        lens: &Lens,
        world_from_camera: &Pose,
        light: &SplitLight,
        response: &Response,
        t: Timestamp,
    ) -> Result<(), &'static str> {
        let occasion = Occasion { camera: Some((lens, world_from_camera)), ..Occasion::SHOW };
        effects::plan(&occasion, &self.scene, light, &self.quality, &mut self.plan);
        let input = RelightInput {
            background,
            lens,
            world_from_camera,
            light,
            response,
            shown_exposure: self.shown_exposure,
            t,
        };
        engine.relight(&self.plan, &input, &mut self.picture).map_err(|error| {
            tracing::warn!("shown without virtual objects: {error}");
            "the engine could not draw"
        })
    }

    /// The camera picture alone at the shown exposure; if even that fails, the frame as it came.
    pub fn passed_through(
        &mut self,
        engine: &mut dyn Engine,
        background: &HdrImage,
        lens: &Lens,
        response: &Response,
        frame: &RawFrame,
    ) {
        let dark = SplitLight { direct: None, global: RadianceSh::zero(self.quality.sh_order) };
        effects::plan(&Occasion::SHOW, &self.nothing, &dark, &self.quality, &mut self.plan);
        let input = RelightInput {
            background,
            lens,
            world_from_camera: &Pose::IDENTITY,
            light: &dark,
            response,
            shown_exposure: self.shown_exposure,
            t: frame.t_mid,
        };
        if let Err(error) = engine.relight(&self.plan, &input, &mut self.picture) {
            tracing::warn!("shown as it came: {error}");
            self.picture.t = frame.t_mid;
            self.picture.display.reshape(frame.pixels.width(), frame.pixels.height(), [0; 3]);
            self.picture.display.pixels_mut().copy_from_slice(frame.pixels.pixels());
        }
    }

    /// The last picture.
    pub fn picture(&self) -> &Picture {
        &self.picture
    }
}
