//! Setting up an IIO device by the kernel's files.

use super::Places;
use super::layout::Layout;
use crate::ErrorKind;
use std::fs::{self, File, OpenOptions};
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Channels of forces, rates, orientation (x, y, z, w) and time.
pub(super) const ACCEL: [&str; 3] = ["in_accel_x", "in_accel_y", "in_accel_z"];
pub(super) const GYRO: [&str; 3] = ["in_anglvel_x", "in_anglvel_y", "in_anglvel_z"];
pub(super) const ORIENTATION: &str = "in_rot_quaternion";
pub(super) const TIMESTAMP: &str = "in_timestamp";
/// The longest file of sysfs that is read, bytes.
const LONGEST: u64 = 4096;
/// Devices that are looked at.
const MOST_DEVICES: usize = 256;
/// Records that the kernel keeps.
const KEPT_RECORDS: &str = "64";

/// What went wrong: what to do about it, and the text.
pub(super) type Failure = (ErrorKind, String);

/// A device that is set up.
pub(super) struct Opened {
    pub(super) name: String,
    pub(super) layout: Layout,
    /// To m/s^2 and rad/s.
    pub(super) accel_scale: f64,
    pub(super) gyro_scale: f64,
    pub(super) clock: String,
    folder: PathBuf,
    pub(super) rate_hz: Option<f64>,
}

impl Opened {
    /// Switches its buffer off; a device that is gone has none.
    pub(super) fn stop(&self) {
        let _ = fs::write(self.folder.join("buffer/enable"), "0");
    }

    pub(super) fn has_orientation(&self) -> bool {
        self.layout.channel(ORIENTATION).is_some_and(|channel| channel.repeat == 4)
    }

    pub(super) fn has_gyro(&self) -> bool {
        GYRO.iter().all(|name| self.layout.channel(name).is_some())
    }

    pub(super) fn has_accel(&self) -> bool {
        ACCEL.iter().all(|name| self.layout.channel(name).is_some())
    }
}

fn read(path: PathBuf) -> Option<String> {
    let mut text = String::new();
    File::open(path).ok()?.take(LONGEST).read_to_string(&mut text).ok()?;
    // The kernel ends the name of a clock by a zero.
    Some(text.trim_matches(|c: char| c.is_whitespace() || c == '\0').to_owned())
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    fs::write(path, text).map_err(|error| {
        let hint = match error.kind() {
            std::io::ErrorKind::PermissionDenied => " (a udev rule must let the user set up IIO devices)",
            _ => "",
        };
        (ErrorKind::Reopen, format!("write \"{text}\" to {}: {error}{hint}", path.display()))
    })
}

/// The folder of the device with this name.
pub(super) fn find(places: &Places, wanted: &str) -> Result<PathBuf, Failure> {
    let missing = |why: String| (ErrorKind::Reopen, why);
    let entries = fs::read_dir(&places.sys)
        .map_err(|e| missing(format!("no IIO device is there: {}: {e}", places.sys.display())))?;
    let mut folders: Vec<PathBuf> = entries.flatten().take(MOST_DEVICES).map(|entry| entry.path()).collect();
    folders.sort();
    let mut names = Vec::new();
    for folder in folders {
        match read(folder.join("name")) {
            Some(name) if name == wanted => return Ok(folder),
            Some(name) if folder.join("scan_elements").is_dir() => names.push(name),
            _ => {}
        }
    }
    Err(missing(format!("no IIO device is called \"{wanted}\"; there are: {}", names.join(", "))))
}

/// Sets a device up and opens its node.
pub(super) fn open(places: &Places, folder: &Path) -> Result<(File, Opened), Failure> {
    let name = read(folder.join("name"))
        .ok_or_else(|| (ErrorKind::Reopen, format!("{}: no such IIO device", folder.display())))?;
    write(&folder.join("buffer/enable"), "0")?;
    let mut channels = Vec::new();
    for channel in ACCEL.iter().chain(&GYRO).chain([&ORIENTATION, &TIMESTAMP]) {
        let file = |end: &str| folder.join("scan_elements").join(format!("{channel}_{end}"));
        let Some(form) = read(file("type")) else { continue };
        let index = read(file("index")).and_then(|index| index.parse().ok());
        let index: u32 =
            index.ok_or_else(|| (ErrorKind::Refused, format!("{}: no number", file("index").display())))?;
        write(&file("en"), "1")?;
        channels.push(((*channel).to_owned(), index, form));
    }
    let layout = Layout::new(channels).map_err(|why| (ErrorKind::Refused, why))?;
    set_trigger(places, folder, &name)?;
    // Times of the records: on the monotonic clock, where the kernel lets us choose.
    let clock_file = folder.join("current_timestamp_clock");
    let _ = fs::write(&clock_file, "monotonic");
    let _ = fs::write(folder.join("buffer/length"), KEPT_RECORDS);
    write(&folder.join("buffer/enable"), "1")?;
    let node = places.dev.join(folder.file_name().unwrap_or_default());
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(rustix::fs::OFlags::NONBLOCK.bits().cast_signed())
        .open(&node)
        .map_err(|e| (ErrorKind::Reopen, format!("open {}: {e}", node.display())))?;
    let number =
        |names: [&str; 2]| names.into_iter().find_map(|name| read(folder.join(name))?.parse::<f64>().ok());
    let scale =
        |names: [&str; 2]| number(names).filter(|scale| scale.is_finite() && *scale != 0.0).unwrap_or(1.0);
    let opened = Opened {
        layout,
        accel_scale: scale(["in_accel_scale", "in_accel_x_scale"]),
        gyro_scale: scale(["in_anglvel_scale", "in_anglvel_x_scale"]),
        clock: read(clock_file).unwrap_or_else(|| "realtime".to_owned()),
        rate_hz: number(["sampling_frequency", "in_anglvel_sampling_frequency"])
            .filter(|rate| super::super::description::RATE_HZ.contains(rate)),
        name,
        folder: folder.to_owned(),
    };
    Ok((file, opened))
}

/// Gives the device a trigger where it has none: one that carries its name.
fn set_trigger(places: &Places, folder: &Path, name: &str) -> Result<(), Failure> {
    let current = folder.join("trigger/current_trigger");
    // A device without the file is its own trigger.
    if read(current.clone()).is_none_or(|trigger| !trigger.is_empty()) {
        return Ok(());
    }
    let entries = fs::read_dir(&places.sys).into_iter().flatten().flatten().take(MOST_DEVICES);
    let trigger = entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("trigger"))
        .find_map(|entry| read(entry.path().join("name")).filter(|trigger| trigger.starts_with(name)));
    match trigger {
        Some(trigger) => write(&current, &trigger),
        None => Err((ErrorKind::Reopen, format!("{name} has no trigger, and none is named after it"))),
    }
}
