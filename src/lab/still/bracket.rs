//! Pictures of one bracket in memory: put into one view before anything is made of them, then merged.

use crate::engine::{Bracket, Engine, EngineError};
use crate::hdr::align::{Drift, align};
use crate::hdr::faults::{Fault, examine, full_range, is_limited_range};
use crate::hdr::ghosts::{Mended, mend};
use crate::model::{
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    response::Response,
};
use std::path::PathBuf;

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

    /// Spreads pictures at video's range over the whole, leaves out those that cannot be what they are stated to be, and puts
    /// right the exposure of one that is brighter or darker than stated. `names`: one for each picture; those left out are
    /// removed. A line for people for each fault. At least one picture stays.
    pub fn sort_out(&mut self, names: &mut Vec<PathBuf>) -> Vec<String> {
        let mut told = Vec::new();
        if is_limited_range(&self.refs()) {
            self.pictures.iter_mut().for_each(|picture| *picture = full_range(picture));
            told.push(
                "the pictures hold values of 16..235 only (video's range): spread over 0..255".to_owned(),
            );
        }
        let faults = examine(&self.refs(), &self.exposures);
        for (k, fault) in faults.iter().enumerate() {
            if let Some(fault) = fault {
                told.push(format!("{}: {}", names[k].display(), said(fault, names)));
            }
            if let Some(Fault::Brightness { factor }) = fault {
                self.exposures[k].gain *= factor;
            }
        }
        let out = |k: usize| faults[k].is_some_and(|fault| fault.leaves_out());
        if (0..faults.len()).all(out) {
            return told;
        }
        for k in (0..faults.len()).rev().filter(|&k| out(k)) {
            self.pictures.remove(k);
            self.exposures.remove(k);
            names.remove(k);
        }
        told
    }

    /// Where something moved between the pictures (a person, a leaf), keeps what the best exposed one saw. A line for people
    /// for each picture that was mended.
    pub fn lay_ghosts(&mut self, response: &Response, names: &[PathBuf]) -> Vec<String> {
        let (reference, mended) = mend(&self.refs(), &self.exposures, response);
        let mut told = Vec::new();
        for Mended { index, picture, share } in mended {
            let (name, of) = (names[index].display(), names[reference].display());
            told.push(format!(
                "{name}: {:.1} % of it shows something that moved; there {of} counts",
                share * 100.0
            ));
            self.pictures[index] = picture;
        }
        told
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

/// What is wrong with a picture, for people.
fn said(fault: &Fault, names: &[PathBuf]) -> String {
    match fault {
        Fault::Black { against } => {
            format!(
                "black where {} shows light that it would have shown: left out",
                names[*against].display()
            )
        }
        Fault::TooBright { against } => {
            format!("saturated where {} shows little light: left out", names[*against].display())
        }
        Fault::Frozen { against } => {
            format!(
                "the same picture as {}, though their exposures differ: left out",
                names[*against].display()
            )
        }
        Fault::WhiteBalance { factors: [red, _, blue] } => {
            format!("another white balance (red {red:.2} x, blue {blue:.2} x against green): left out")
        }
        Fault::Brightness { factor } => {
            format!("{factor:.2} x as bright as stated: its exposure was put right")
        }
    }
}
