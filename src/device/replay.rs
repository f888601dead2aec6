//! `replay:FILE[,skip=N][,frames=N]`: a recording as a camera, frame after frame without waiting.

use super::parameters::Parameters;
use super::recording::{
    Damage, RecordingReader, Topic,
    messages::{self, ExposureNote},
    pictures,
    reader::Message,
};
use super::{DeviceError, ErrorKind, FrameSource, ImuSource, ImuTruth, Truth};
use crate::model::{
    estimate::PoseEstimate,
    frame::{Exposure, RawFrame},
    imu::ImuSample,
    light::RadianceSh,
    path_text,
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::PathBuf;
use std::sync::Arc;

/// The parameters.
pub const KEYS: [&str; 2] = ["skip", "frames"];

/// What a replay's name says.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayOptions {
    /// The file.
    pub path: PathBuf,
    /// Frames left out at the start (key `skip`).
    pub skip: u64,
    /// Frames at most (key `frames`).
    pub frames: u64,
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
        Ok(Self {
            path: path_text::to_path(path),
            skip: p.number("skip", 0, 0, u64::MAX, " frames")?,
            frames: p.number("frames", u64::MAX, 1, u64::MAX, " frames")?,
        })
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

/// Opens a recording: its camera, and its IMU where it holds one.
pub fn open(
    options: &ReplayOptions,
) -> Result<(ReplaySource<RecordingFile>, Option<ReplayImu<RecordingFile>>), DeviceError> {
    let device = format!("replay:{}", options.path.display());
    let file = || -> Result<RecordingFile, DeviceError> {
        let file = File::open(&options.path)
            .map_err(|e| DeviceError::new(&device, "open the file", ErrorKind::Refused).because(e))?;
        Ok(BufReader::new(file))
    };
    let mut source = ReplaySource::new(&device, file()?)?;
    source.skip(options.skip)?;
    source.most = options.frames;
    let imu = source.reader.has(Topic::Imu).then(|| ReplayImu::new(&device, file()?)).transpose()?;
    Ok((source, imu))
}

/// A recording as `open` opens it.
pub type RecordingFile = BufReader<File>;

/// The camera of a recording.
pub struct ReplaySource<R> {
    device: String,
    reader: RecordingReader<R>,
    rig: Rig,
    response: Option<Response>,
    note: Option<(u64, ExposureNote)>,
    pose: Option<(u64, PoseEstimate)>,
    light: Option<(u64, (RadianceSh, [f32; 3]))>,
    truth: Option<Truth>,
    held: Option<RawFrame>,
    exposures: Vec<Exposure>,
    last: Option<Timestamp>,
    given: u64,
    skipped: u64,
    most: u64,
    told: bool,
}

impl<R: Read + Seek> ReplaySource<R> {
    /// Reads the calibration and the rig. `Refused` where there is no calibration.
    pub fn new(device: &str, source: R) -> Result<Self, DeviceError> {
        let mut reader = RecordingReader::open(device, source)?;
        let (mut lens, mut parts) = (None, None);
        let mut exposures: Vec<Exposure> = Vec::new();
        let mut images = 0;
        // All of a chunk's setup stands before its first picture; a few more frames tell the exposures.
        while let Some(message) = reader.next_message()? {
            let refuse = |why: String| {
                let action = format!("{}: {why}", message.topic.name());
                DeviceError::new(device, action, ErrorKind::Refused)
            };
            let content = &message.content;
            match message.topic {
                Topic::Calibration => {
                    lens = Some(messages::read_calibration(content).map_err(refuse)?);
                }
                Topic::Rig => parts = Some(messages::read_rig(content).map_err(refuse)?),
                Topic::Exposure => {
                    let exposure = messages::read_exposure(content).map_err(refuse)?.exposure;
                    if !exposures.contains(&exposure) {
                        exposures.push(exposure);
                    }
                }
                Topic::Image => images += 1,
                _ => {}
            }
            if images >= 9 && lens.is_some() {
                break;
            }
        }
        let lens = lens.ok_or_else(|| {
            let action = format!(
                "open: the recording has no camera calibration (topic {}, schema foxglove.CameraCalibration)",
                Topic::Calibration.name()
            );
            DeviceError::new(device, action, ErrorKind::Refused)
        })?;
        let (tags, ball, response) = parts.unwrap_or_default();
        reader.rewind();
        Ok(Self {
            device: device.to_owned(),
            reader,
            rig: Rig { lens, tags, ball },
            response,
            note: None,
            pose: None,
            light: None,
            truth: None,
            held: None,
            exposures,
            last: None,
            given: 0,
            skipped: 0,
            most: u64::MAX,
            told: false,
        })
    }

    /// What was wrong with the file so far.
    pub fn damage(&self) -> Damage {
        self.reader.damage()
    }

    /// Leaves out frames without decoding them.
    fn skip(&mut self, frames: u64) -> Result<(), DeviceError> {
        self.skipped = frames;
        let mut left = frames;
        while left > 0 {
            match self.reader.next_message()? {
                None => {
                    let action = format!("skip {frames} frames: the recording has only {}", frames - left);
                    return Err(DeviceError::new(&self.device, action, ErrorKind::Refused));
                }
                Some(message) if message.topic == Topic::Image => left -= 1,
                Some(_) => {}
            }
        }
        Ok(())
    }

    fn ended(&mut self) -> DeviceError {
        let damage = self.reader.damage();
        if damage.warnings() > 0 && !self.told {
            self.told = true;
            tracing::warn!("{}: the recording is damaged: {damage:?}", self.device);
        }
        let action = format!("the recording ends after {} frames", self.given);
        DeviceError::new(&self.device, action, ErrorKind::Ended)
    }

    /// Keeps what a message says for the picture of the same time; a picture becomes a frame.
    fn take(&mut self, message: &Message) -> Result<Option<RawFrame>, String> {
        let (t, content) = (message.log_time, message.content.as_slice());
        match message.topic {
            Topic::Exposure => self.note = Some((t, messages::read_exposure(content)?)),
            Topic::TruthPose => self.pose = Some((t, messages::read_pose(content)?)),
            Topic::TruthLight => self.light = Some((t, messages::read_light(content)?)),
            Topic::Image => return self.frame(t, message).map(Some),
            _ => {}
        }
        Ok(None)
    }

    /// The next whole frame of the file.
    fn read_frame(&mut self) -> Result<RawFrame, DeviceError> {
        if self.given >= self.most {
            return Err(self.ended());
        }
        while let Some(message) = self.reader.next_message()? {
            match self.take(&message) {
                Ok(None) => {}
                Ok(Some(frame)) => {
                    let (w, h) = (frame.pixels.width(), frame.pixels.height());
                    let lens = &self.rig.lens;
                    if (w, h) != (lens.width as usize, lens.height as usize) {
                        let action = format!(
                            "frame {}: the picture is {w} x {h}, must be {} x {} as {} says",
                            frame.sequence,
                            lens.width,
                            lens.height,
                            Topic::Calibration.name()
                        );
                        return Err(DeviceError::new(&self.device, action, ErrorKind::Refused));
                    }
                    return Ok(frame);
                }
                Err(why) => {
                    self.reader.count_bad_message();
                    tracing::warn!("{}: {}: {why}", self.device, message.topic.name());
                }
            }
        }
        Err(self.ended())
    }

    fn frame(&mut self, t: u64, message: &Message) -> Result<RawFrame, String> {
        let Some((_, note)) = self.note.filter(|(of, _)| *of == t) else {
            return Err(format!("a picture at {t} ns has no message on {}", Topic::Exposure.name()));
        };
        if self.last.is_some_and(|last| note.t_mid <= last) {
            return Err(format!("the picture at {t} ns does not come after the one before"));
        }
        let pixels = pictures::read_image(&message.schema, &message.content)?;
        let pose = self.pose.filter(|(of, _)| *of == t);
        self.truth = pose.zip(self.light.filter(|(of, _)| *of == t)).map(|((_, pose), (_, light))| Truth {
            pose: PoseEstimate { t: note.t_mid, ..pose },
            light: light.0,
            to_light_world: light.1,
        });
        self.last = Some(note.t_mid);
        Ok(RawFrame {
            sequence: note.sequence,
            t_mid: note.t_mid,
            exposure: note.exposure,
            pixels: Arc::new(pixels),
            row_time_s: 0.0,
        })
    }
}

impl<R: Read + Seek + Send> FrameSource for ReplaySource<R> {
    /// A message that cannot be understood is counted and skipped; `Refused` where a picture's size is not the
    /// calibration's.
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        let frame = match self.held.take() {
            Some(frame) => frame,
            None => self.read_frame()?,
        };
        if frame.t_mid > deadline {
            self.held = Some(frame);
            return Err(DeviceError::again());
        }
        self.given += 1;
        Ok(frame)
    }

    fn set_exposures(&mut self, _exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        Ok(self.exposures.clone())
    }

    fn rig(&self) -> Option<Rig> {
        Some(self.rig.clone())
    }

    fn response(&self) -> Option<Response> {
        self.response.clone()
    }

    fn frames_left(&self) -> Option<u64> {
        let left = self.reader.count(Topic::Image).saturating_sub(self.skipped + self.given);
        Some(left.min(self.most - self.given))
    }

    fn truth(&mut self) -> Option<Truth> {
        self.truth.clone()
    }

    fn delivers_at_once(&self) -> bool {
        true
    }
}

/// The IMU of a recording; reads the file by itself.
pub struct ReplayImu<R> {
    device: String,
    reader: RecordingReader<R>,
    truth: Option<ImuTruth>,
    next: Option<ImuSample>,
    last: Option<Timestamp>,
}

impl<R: Read + Seek> ReplayImu<R> {
    /// Finds the first sample and the truth before it.
    pub fn new(device: &str, source: R) -> Result<Self, DeviceError> {
        let reader = RecordingReader::open(device, source)?;
        let mut imu = Self { device: device.to_owned(), reader, truth: None, next: None, last: None };
        imu.advance()?;
        Ok(imu)
    }

    /// Reads on to the next sample that comes after the last one.
    fn advance(&mut self) -> Result<(), DeviceError> {
        self.next = None;
        while let Some(message) = self.reader.next_message()? {
            match message.topic {
                Topic::TruthImu => self.truth = messages::read_imu_truth(&message.content).ok(),
                Topic::Imu => match messages::read_imu(&message.content) {
                    Ok(sample) if self.last.is_none_or(|last| sample.t > last) => {
                        self.last = Some(sample.t);
                        self.next = Some(sample);
                        return Ok(());
                    }
                    _ => self.reader.count_bad_message(),
                },
                _ => {}
            }
        }
        Ok(())
    }
}

impl<R: Read + Seek + Send> ImuSource for ReplayImu<R> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        let Some(sample) = self.next else {
            let action = "the recording holds no more inertial samples";
            return Err(DeviceError::new(&self.device, action, ErrorKind::Ended));
        };
        if sample.t > deadline {
            return Err(DeviceError::again());
        }
        self.advance()?;
        Ok(sample)
    }

    fn imu_truth(&self) -> Option<ImuTruth> {
        self.truth
    }

    fn delivers_at_once(&self) -> bool {
        true
    }
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
    }
}
