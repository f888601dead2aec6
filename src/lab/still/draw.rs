//! Drawing a still by the engine and the views of the product.

use super::{PictureQuantity, Still};
use crate::digest::PixelDigest;
use crate::engine::{Engine, EngineError, RelightInput};
use crate::model::{
    frame::Exposure,
    image::{RadianceImage, Rgb8Image},
    picture::Picture,
    quality::Quality,
    time::Timestamp,
};
use crate::plan::{FramePlan, PassTiming};
use crate::present::views::{Subject, Views};

/// A still that was drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Linear radiance (or ratio, or difference).
    pub radiance: RadianceImage,
    /// The same through the response, exposed as asked.
    pub display: Rgb8Image,
    /// The list of passes that was run.
    pub plan: FramePlan,
    /// How long they took.
    pub timings: Vec<PassTiming>,
}

impl Drawn {
    /// SHA-256 over the linear and then the 8-bit pixels.
    pub fn digest(&self) -> String {
        let mut digest = PixelDigest::default();
        digest.add_floats(self.radiance.pixels());
        digest.add_bytes(self.display.pixels());
        digest.hex()
    }
}

impl Still {
    /// Draws it. Exposure in seconds for the 8-bit picture; `None` takes the still's own, else puts nine tenths
    /// of the place below 0.8. Drawn `repeat` times more, each pass is reported with its median time.
    ///
    /// # Errors
    /// What the engine refuses, or fails at.
    pub fn draw(
        &self,
        engine: &mut dyn Engine,
        quality: &Quality,
        exposure_s: Option<f64>,
        repeat: usize,
    ) -> Result<Drawn, EngineError> {
        engine.ask_for_linear(true);
        engine.load_room(self.room.clone())?;
        engine.load_scene(&self.scene)?;
        let mut plan = FramePlan::default();
        let time_s = exposure_s.unwrap_or_else(|| self.shown_exposure_s());
        let posed = self.posed();
        let input = RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera: &self.world_from_camera,
            light: &self.light,
            environment: self.environment.as_ref(),
            posed: Some(&posed),
            response: &self.response,
            shown_exposure: Exposure { time_s, gain: 1.0 },
            t: Timestamp(0),
        };
        let subject =
            Subject { scene: &self.scene, input: &input, quality, samples: Some(&self.samples), frame: None };
        let (mut views, mut picture) = (Views::default(), Picture::default());
        views.draw(self.view, engine, &subject, &mut plan, &mut picture)?;
        let mut timings = Vec::new();
        engine.take_timings(&mut timings);
        let mut runs = vec![Vec::with_capacity(repeat); timings.len()];
        for _ in 0..repeat {
            views.draw(self.view, engine, &subject, &mut plan, &mut picture)?;
            engine.take_timings(&mut timings);
            runs.iter_mut().zip(&timings).for_each(|(run, t)| run.push(t.ms));
        }
        for (timing, run) in timings.iter_mut().zip(&mut runs) {
            run.sort_by(f32::total_cmp);
            timing.ms = run.get(run.len() / 2).copied().unwrap_or(timing.ms);
        }
        let mut radiance = picture.radiance;
        self.convert(&mut radiance);
        Ok(Drawn { radiance, display: picture.display, plan, timings })
    }

    /// Makes a picture the quantity that is wanted of it.
    fn convert(&self, picture: &mut RadianceImage) {
        for (out, without) in picture.pixels_mut().iter_mut().zip(self.background.radiance.pixels()) {
            for (o, &w) in out.iter_mut().zip(without) {
                match self.quantity {
                    PictureQuantity::Radiance => {}
                    PictureQuantity::Ratio => *o = if w > 0.0 { *o / w } else { 1.0 },
                    PictureQuantity::Difference => *o = w - *o,
                }
            }
        }
    }
}
