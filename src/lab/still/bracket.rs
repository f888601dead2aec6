//! Pictures of one bracket in memory: put into one view before anything is made of them, then merged.

use crate::engine::{Bracket, Engine, EngineError};
use crate::hdr::align::{Drift, align};
use crate::model::{
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    response::Response,
};

/// Pictures of one view with their exposures, as many of one as of the other.
#[derive(Clone, Debug)]
pub struct LoadedBracket {
    /// 8-bit pictures.
    pub pictures: Vec<Rgb8Image>,
    /// One for each.
    pub exposures: Vec<Exposure>,
}

impl LoadedBracket {
    /// Pictures taken with these times and no gain.
    pub fn new(pictures: Vec<Rgb8Image>, times_s: &[f64]) -> Self {
        let exposures = times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect();
        Self { pictures, exposures }
    }

    /// The pictures as engines and solvers take them.
    pub fn refs(&self) -> Vec<&Rgb8Image> {
        self.pictures.iter().collect()
    }

    /// Brings the pictures into the view of the one of middle exposure; returns a line for people for each that had moved.
    ///
    /// The response is for interpolating in linear light. One solved from pictures that moved is only a little off: good
    /// enough here, and to be solved again afterwards.
    pub fn steady(&mut self, response: &Response) -> Vec<String> {
        let aligned = align(&self.refs(), &self.exposures, response);
        self.pictures = aligned.pictures;
        let moved = aligned.drifts.iter().zip(&self.exposures).enumerate();
        moved
            .filter(|(_, (drift, _))| **drift != Drift::default())
            .map(|(k, (drift, exposure))| {
                let (shift, turn) = (drift.shift_px, drift.turn_rad.to_degrees());
                format!(
                    "picture {} ({} s) had moved by ({:.2}, {:.2}) px and turned by {turn:.3} degrees; put back",
                    k + 1,
                    exposure.time_s,
                    shift.x,
                    shift.y
                )
            })
            .collect()
    }

    /// One linear picture of all.
    ///
    /// # Errors
    /// The engine refuses the pictures or fails.
    pub fn merge(&self, response: &Response, engine: &mut dyn Engine) -> Result<HdrImage, EngineError> {
        let mut out = HdrImage::default();
        let bracket = Bracket { pictures: &self.refs(), exposures: &self.exposures };
        engine.merge_bracket(&bracket, response, &mut out)?;
        Ok(out)
    }
}
