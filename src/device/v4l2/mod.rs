//! Cameras of the kernel's V4L2 interface: `v4l2:/dev/video0`, `v4l2:card=TEXT`, `v4l2:`, with `size=640x480`, `fps=30`,
//! `format=YUYV`.
//!
//! Devices, formats and controls go through the `v4l` crate's types and calls. Its stream is not used: it fails for good after
//! one time-out, knows no multi-planar drivers and no newest picture. Ours is `stream`, over `node` = what the kernel can be
//! asked, so that tests can stand in for it.

pub mod camera;
pub mod control;
pub mod find;
pub mod format;
pub mod node;
pub mod sensor;
pub mod stream;
pub mod sys;

use crate::parameters::Parameters;
use crate::{Clock, DeviceError};
use camera::V4l2Camera;
use find::NodeWish;
use format::FormatWish;
use std::path::PathBuf;
use std::sync::Arc;

/// The parameters that say which pictures.
pub const PICTURES: [&str; 3] = ["size", "fps", "format"];
/// The parameters of a camera's name.
const KNOWN: [&str; 4] = ["card", PICTURES[0], PICTURES[1], PICTURES[2]];

impl FormatWish {
    /// Reads [`PICTURES`]; all may be missing.
    pub fn of(parameters: &Parameters) -> Result<Self, DeviceError> {
        let mut wish = Self::default();
        if let Some(size) = parameters.text("size") {
            let sides = size.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
            let sides = sides.filter(|(w, h)| (16..=16384).contains(w) && (16..=16384).contains(h));
            (wish.width, wish.height) = sides.ok_or_else(|| {
                parameters.refuse(
                    "size",
                    size,
                    "must be WIDTHxHEIGHT, each within 16..=16384 px, e.g. 640x480",
                )
            })?;
        }
        wish.frames_per_s = parameters.number("fps", wish.frames_per_s, 1.0, 1000.0, " frames a second")?;
        if let Some(letters) = parameters.text("format") {
            let fourcc: Option<[u8; 4]> = letters.as_bytes().try_into().ok();
            let known = fourcc.filter(|f| format::pixel_format(*f).is_some());
            wish.fourcc = Some(known.ok_or_else(|| {
                parameters.refuse(
                    "format",
                    letters,
                    "must be four letters of a format that is read, e.g. YUYV, NV12, MJPG, pRAA",
                )
            })?);
        }
        Ok(wish)
    }
}

/// What stands behind `v4l2:`.
#[derive(Clone, Debug, PartialEq)]
pub struct V4l2Options {
    /// Which node.
    pub node: NodeWish,
    /// Which pictures.
    pub wish: FormatWish,
}

impl V4l2Options {
    /// Reads `/dev/video0,size=640x480,fps=30,format=YUYV`; all parts may be missing.
    pub fn parse(text: &str) -> Result<Self, DeviceError> {
        let device = format!("v4l2:{text}");
        let (path, rest) = match text.split_once(',') {
            Some((path, rest)) if path.starts_with('/') => (Some(path), rest),
            None if text.starts_with('/') => (Some(text), ""),
            _ => (None, text),
        };
        let parameters = Parameters::parse(&device, rest, &KNOWN)?;
        let wish = FormatWish::of(&parameters)?;
        let node = match (path, parameters.text("card")) {
            (Some(_), Some(card)) => return Err(parameters.refuse("card", card, "a path was given, too")),
            (Some(path), None) => NodeWish::Path(PathBuf::from(path)),
            (None, Some(card)) => NodeWish::Card(card.to_owned()),
            (None, None) => NodeWish::Any,
        };
        Ok(Self { node, wish })
    }
}

/// Opens the camera that a name means (see [`V4l2Options::parse`]) and starts it.
pub fn open(text: &str, clock: Arc<dyn Clock>) -> Result<V4l2Camera<sys::KernelNode>, DeviceError> {
    let options = V4l2Options::parse(text)?;
    let (node, found) = find::open(text, &options)?;
    let device = format!("v4l2:{}", found.path.display());
    // The same camera in another socket is the same camera.
    let identity = format!("{} ({})", found.facts.card, found.facts.driver);
    Ok(V4l2Camera::start(&device, node, &options.wish, clock)?.known_as(identity))
}

#[cfg(test)]
mod tests;
