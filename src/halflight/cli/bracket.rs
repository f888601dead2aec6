//! A bracket from files, put into one view before anything is made of it.

use crate::hdr::align::{Drift, align};
use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};

/// Brings the pictures into the view of the one of middle exposure; a line for people for each that had moved.
///
/// The response is for interpolating in linear light. One solved from pictures that moved is only a little off: good
/// enough here, and to be solved again afterwards.
pub fn steady(pictures: &mut Vec<Rgb8Image>, exposures: &[Exposure], response: &Response) -> Vec<String> {
    let aligned = align(&pictures.iter().collect::<Vec<_>>(), exposures, response);
    *pictures = aligned.pictures;
    let moved = aligned.drifts.iter().zip(exposures).enumerate();
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
