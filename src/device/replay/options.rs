//! What a replay's name says.

use super::UNKNOWN_EXPOSURE;
use crate::model::{
    frame::Exposure,
    limits::{MAX_GAIN, MAX_TIME_S},
    path_text,
    pixels::YuvRange,
};
use crate::parameters::Parameters;
use crate::recording::{Topic, TopicNames};
use crate::{DeviceError, ErrorKind};
use std::path::PathBuf;

/// Topics that a name may choose.
const TOPIC_KEYS: [(&str, Topic); 5] = [
    ("image_topic", Topic::Image),
    ("calibration_topic", Topic::Calibration),
    ("exposure_topic", Topic::Exposure),
    ("imu_topic", Topic::Imu),
    ("rig_topic", Topic::Rig),
];

/// The parameters.
pub const KEYS: [&str; 10] = [
    "skip",
    "frames",
    "exposure_s",
    "gain",
    "yuv_range",
    "image_topic",
    "calibration_topic",
    "exposure_topic",
    "imu_topic",
    "rig_topic",
];

/// What a replay's name says.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayOptions {
    /// The file.
    pub path: PathBuf,
    /// Frames left out at the start (key `skip`).
    pub skip: u64,
    /// Frames at most (key `frames`).
    pub frames: u64,
    /// Topics by name (keys `image_topic`, `calibration_topic`, `exposure_topic`, `imu_topic`, `rig_topic`).
    pub topics: TopicNames,
    /// Exposure of pictures without a message on it (keys `exposure_s` and `gain`).
    pub exposure: Option<Exposure>,
    /// Range of raw pictures in Y, Cb, Cr (key `yuv_range`: full or limited).
    pub yuv_range: YuvRange,
}

impl ReplayOptions {
    /// Reads the part of a device name after `replay:`. The parameters begin at the last commas that are
    /// followed by `key=`, so a path may hold commas.
    pub fn parse(text: &str) -> Result<Self, DeviceError> {
        let path = file_of(text);
        let device = format!("replay:{text}");
        let p = Parameters::parse(&device, text.get(path.len()..).unwrap_or(""), &KEYS)?;
        if path.is_empty() {
            let action = "no file is named: must be replay:FILE[,skip=N][,frames=N]";
            return Err(DeviceError::new(device, action, ErrorKind::Refused));
        }
        let topics = TOPIC_KEYS.iter().filter_map(|(key, topic)| Some((*topic, p.text(key)?.to_owned())));
        let yuv_range = match p.text("yuv_range") {
            None | Some("full") => YuvRange::Full,
            Some("limited") => YuvRange::Limited,
            Some(other) => return Err(p.refuse("yuv_range", other, "must be full or limited")),
        };
        let time_s = p.number("exposure_s", UNKNOWN_EXPOSURE.time_s, 1e-9, MAX_TIME_S, " s")?;
        let gain = p.number("gain", UNKNOWN_EXPOSURE.gain, 1e-9, MAX_GAIN, "")?;
        let is_stated = p.text("exposure_s").is_some() || p.text("gain").is_some();
        Ok(Self {
            path: path_text::to_path(path),
            skip: p.number("skip", 0, 0, u64::MAX, " frames")?,
            frames: p.number("frames", u64::MAX, 1, u64::MAX, " frames")?,
            topics: TopicNames(topics.collect()),
            exposure: is_stated.then_some(Exposure { time_s, gain }),
            yuv_range,
        })
    }

    /// All of a file, as it says.
    pub fn of_file(path: impl Into<PathBuf>) -> Self {
        let (topics, yuv_range) = (TopicNames::default(), YuvRange::Full);
        Self { path: path.into(), skip: 0, frames: u64::MAX, topics, exposure: None, yuv_range }
    }
}

/// The part of `FILE[,key=value..]` that names the file. A name may hold commas and `=`: all of it is the file where there
/// is one of that name; else parameters begin after a file that is there, or after `.mcap`, or where a known key stands.
fn file_of(text: &str) -> &str {
    let is_there = |name: &str| path_text::to_path(name).is_file();
    let (mut path, mut found) = (text, text);
    while !is_there(path) {
        let Some((head, last)) = path.rsplit_once(',').filter(|(_, last)| last.contains('=')) else { break };
        let is_known = last.split_once('=').is_some_and(|(key, _)| KEYS.contains(&key.trim()));
        path = head;
        if is_known || head.ends_with(".mcap") || is_there(head) {
            found = head;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_and_without_parameters() {
        let options = |text: &str| ReplayOptions::parse(text).unwrap();
        assert_eq!(options("a,b.mcap").path, PathBuf::from("a,b.mcap"));
        let o = options("a,b.mcap,skip=3,frames=7");
        assert_eq!((o.path, o.skip, o.frames), (PathBuf::from("a,b.mcap"), 3, 7));
        let error = ReplayOptions::parse("a.mcap,skop=3").unwrap_err().to_string();
        assert!(error.contains("did you mean \"skip\""), "{error}");
        assert!(ReplayOptions::parse("").is_err());
        let o = options("a.mcap,image_topic=/left/image_raw,exposure_s=0.02,yuv_range=limited");
        assert_eq!(o.topics.0.get(&Topic::Image).map(String::as_str), Some("/left/image_raw"));
        assert_eq!(o.exposure, Some(Exposure { time_s: 0.02, gain: 1.0 }));
        assert_eq!((o.yuv_range, options("a.mcap").exposure), (YuvRange::Limited, None));
        assert!(ReplayOptions::parse("a.mcap,exposure_s=0").is_err());
    }
}
