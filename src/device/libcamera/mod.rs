//! Cameras behind libcamera: raw sensors on media controllers, which V4L2 alone does not run. `libcamera:ID`, `libcamera:` = the
//! first, with `size=640x480`, `fps=30`, `format=YUYV`.
//!
//! A request asks for its own exposure, and its metadata states what the frame had: brackets need nobody who tells it from the
//! pictures. Formats, scores and layouts are V4L2's (`v4l2::format`); `device` = what a camera can be asked, so that tests can stand
//! in for it; `sys` = the library itself, by the `libcamera` crate.

pub mod camera;
pub mod device;
pub mod exposure;
pub mod format;
pub mod list;
pub mod sys;

use crate::parameters::Parameters;
use crate::v4l2::{self, format::FormatWish, node::EBUSY};
use crate::{Clock, DeviceError, ErrorKind};
use camera::RequestCamera;
use list::LibcameraSensor;
use std::path::Path;
use std::sync::Arc;

/// How long the first frame of a camera is waited for, seconds. It says whether metadata states exposures.
const FIRST_FRAME_S: f64 = 2.0;
/// Media controllers that are looked at for who holds a camera.
const MOST_CONTROLLERS: usize = 32;

/// What stands behind `libcamera:`.
#[derive(Clone, Debug, PartialEq)]
pub struct LibcameraOptions {
    /// libcamera's name of the camera, or a part of it or of its model; empty: the first.
    pub id: String,
    /// Which pictures.
    pub wish: FormatWish,
}

impl LibcameraOptions {
    /// Reads `ID,size=640x480,fps=30,format=YUYV`; all parts may be missing.
    pub fn parse(text: &str) -> Result<Self, DeviceError> {
        let (first, rest) = text.split_once(',').unwrap_or((text, ""));
        let (id, rest) = if first.contains('=') { ("", text) } else { (first, rest) };
        let parameters = Parameters::parse(&format!("libcamera:{text}"), rest, &v4l2::PICTURES)?;
        Ok(Self { id: id.trim().to_owned(), wish: FormatWish::of(&parameters)? })
    }
}

/// Opens the camera that a name means (see [`LibcameraOptions::parse`]) and starts it.
pub fn open(text: &str, clock: Arc<dyn Clock>) -> Result<RequestCamera<sys::LibrarySensor>, DeviceError> {
    let options = LibcameraOptions::parse(text)?;
    let name = format!("libcamera:{text}");
    // It need not be started twice; why it cannot be, the list says.
    let _started = sys::ManagerUse::begin();
    let sensors = list::sensors()?;
    let Some(found) = list::named(&sensors, &options.id) else {
        return Err(DeviceError::new(name, nothing_there(&sensors, &options.id), ErrorKind::Reopen));
    };
    let device = format!("libcamera:{}", found.id);
    let door = sys::LibrarySensor::open(&found.id).map_err(|error| {
        let holder = (error.raw_os_error() == Some(EBUSY)).then(controller_holder).flatten();
        let action = match holder {
            Some(holder) => format!("take {}: {holder} has it", found.model),
            None => format!("take {}", found.model),
        };
        DeviceError::new(&device, action, ErrorKind::Reopen).because(error)
    })?;
    // The same camera in another socket is the same camera.
    let who = format!("{} (libcamera)", found.model);
    let deadline = clock.now().plus_seconds(FIRST_FRAME_S);
    let mut camera = RequestCamera::start(&device, &found.id, door, &options.wish, clock)?.known_as(&who);
    camera.look_at_metadata(deadline)?;
    Ok(camera)
}

/// Returns whether `auto` means a camera of libcamera: there is one that is not on USB, and V4L2 has none that is. The nodes that a
/// media controller has in V4L2 give no pictures by themselves. `None`: libcamera has not been asked, and may have one.
pub fn is_best(video_nodes: &[v4l2::find::FoundNode], sensors: Option<&[LibcameraSensor]>) -> bool {
    let has_usb = video_nodes.iter().any(|node| node.facts.bus.starts_with("usb-"));
    let is_there = |sensors: &[LibcameraSensor]| sensors.iter().any(|sensor| !format::is_usb(&sensor.id));
    !has_usb && sensors.is_none_or(is_there)
}

/// The name behind `libcamera:` of what `auto` takes; `None` where V4L2 has the better camera, or the library cannot be asked.
pub fn best() -> Option<String> {
    let nodes = v4l2::find::nodes().cameras;
    // To start the library takes a tenth of a second, and is for nothing where V4L2 has the camera.
    if !is_best(&nodes, None) {
        return None;
    }
    let sensors = list::sensors().ok()?;
    let is_best = is_best(&nodes, Some(&sensors));
    let sensor = sensors.into_iter().find(|sensor| !format::is_usb(&sensor.id))?;
    is_best.then_some(sensor.id)
}

fn nothing_there(sensors: &[LibcameraSensor], id: &str) -> String {
    let there: Vec<String> = sensors.iter().map(|s| format!("{} ({})", s.id, s.model)).collect();
    let there = match there.is_empty() {
        true => "libcamera lists none; it lists what a running udevd has seen and this user may open \
                 (group video: usermod -aG video USER)"
            .to_owned(),
        false => format!("libcamera lists {}", there.join(", ")),
    };
    if id.is_empty() { format!("no camera; {there}") } else { format!("no camera \"{id}\"; {there}") }
}

/// Who holds a media controller.
fn controller_holder() -> Option<String> {
    (0..MOST_CONTROLLERS).find_map(|k| v4l2::find::holder(Path::new(&format!("/dev/media{k}"))))
}

#[cfg(test)]
mod tests;
