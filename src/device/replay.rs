//! `replay:FILE[,skip=N][,frames=N][,image_topic=NAME]..`: a recording as a camera, frame after frame without waiting.

use super::recording::{
    Damage, Message, RecordingReader, Topic,
    clock::{GAP_NS, LARGEST_DISORDER_NS},
    messages::{self, ExposureNote},
    pictures::{PictureError, PictureReader},
};
use super::{DeviceError, ErrorKind, FrameSource, Truth};
use crate::model::{
    estimate::PoseEstimate,
    frame::{Exposure, RawFrame},
    light::RadianceSh,
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::sync::Arc;

mod imu;
mod options;
mod prelude;
mod waiting;

pub use imu::ReplayImu;
pub use options::{KEYS, ReplayOptions};
use prelude::Prelude;
use waiting::{Recent, WaitingPictures};

/// The exposure of pictures of which nothing is known: all have it, so that radiance is right but for one factor.
const UNKNOWN_EXPOSURE: Exposure = Exposure { time_s: 0.01, gain: 1.0 };

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
    let mut source = ReplaySource::with_options(&device, file()?, options)?;
    source.skip(options.skip)?;
    source.most = options.frames;
    let imu = source
        .reader
        .has(Topic::Imu)
        .then(|| ReplayImu::with_topics(&device, file()?, options.topics.clone()))
        .transpose()?;
    Ok((source, imu))
}

/// A recording as `open` opens it.
pub type RecordingFile = BufReader<File>;

/// Warnings of one kind that are told one by one; the rest only counts.
const MOST_TOLD: u64 = 10;

/// The camera of a recording.
pub struct ReplaySource<R> {
    device: String,
    reader: RecordingReader<R>,
    pictures: PictureReader,
    rig: Rig,
    response: Option<Response>,
    waiting: WaitingPictures,
    notes: Recent<ExposureNote>,
    poses: Recent<PoseEstimate>,
    lights: Recent<(RadianceSh, [f32; 3])>,
    truth: Option<Truth>,
    held: Option<RawFrame>,
    exposures: Vec<Exposure>,
    /// Of pictures without a message on it, as the device's name states it.
    stated: Option<Exposure>,
    last: Option<Timestamp>,
    /// What is added to the camera's own times, which stepped back though the file's did not; nanoseconds.
    own_shift_ns: i64,
    own_steps: u64,
    given: u64,
    skipped: u64,
    most: u64,
    told: Told,
}

/// What has been said already.
#[derive(Default)]
struct Told {
    end: bool,
    unknown_exposure: bool,
    steps: u64,
}

impl<R: Read + Seek> ReplaySource<R> {
    /// Reads the calibration and the rig. `Refused` where there is no calibration.
    pub fn new(device: &str, source: R) -> Result<Self, DeviceError> {
        Self::with_options(device, source, &ReplayOptions::of_file(""))
    }

    /// The same with what a name says of topics, exposures and pictures.
    pub fn with_options(device: &str, source: R, options: &ReplayOptions) -> Result<Self, DeviceError> {
        let mut reader = RecordingReader::open_topics(device, source, options.topics.clone())?;
        let mut prelude = Prelude::read(device, &mut reader, options.exposure)?;
        let refuse = |action: String| DeviceError::new(device, action, ErrorKind::Refused);
        let lens = prelude.lens.ok_or_else(|| {
            refuse(format!(
                "open: the recording has no camera calibration (topic {}, or schema foxglove.CameraCalibration or sensor_msgs/msg/CameraInfo)",
                options.topics.0.get(&Topic::Calibration).map_or(Topic::Calibration.name(), String::as_str)
            ))
        })?;
        let (tags, ball, response) = prelude.parts.unwrap_or_default();
        let values = response.clone().unwrap_or_else(Response::srgb);
        let pictures = PictureReader::new(&values, options.yuv_range).map_err(refuse)?;
        if prelude.exposures.is_empty() {
            prelude.exposures.push(UNKNOWN_EXPOSURE);
        }
        reader.rewind();
        Ok(Self {
            device: device.to_owned(),
            reader,
            pictures,
            rig: Rig { lens, tags, ball },
            response,
            waiting: WaitingPictures::default(),
            notes: Recent::default(),
            poses: Recent::default(),
            lights: Recent::default(),
            truth: None,
            held: None,
            exposures: prelude.exposures,
            stated: options.exposure,
            last: None,
            own_shift_ns: 0,
            own_steps: 0,
            given: 0,
            skipped: 0,
            most: u64::MAX,
            told: Told::default(),
        })
    }

    /// What was wrong with the file so far.
    pub fn damage(&self) -> Damage {
        self.reader.damage()
    }

    /// How often the clock stepped back by more than a second so far.
    pub fn clock_steps(&self) -> u64 {
        self.reader.clock_steps() + self.own_steps
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
        if !std::mem::replace(&mut self.told.end, true) {
            if let Some(what) = damage.of_file() {
                tracing::warn!("{}: the recording is damaged: {what}", self.device);
            }
            if damage.messages > 0 {
                tracing::warn!("{}: {} messages could not be used", self.device, damage.messages);
            }
        }
        let action = format!("the recording ends after {} frames", self.given);
        DeviceError::new(&self.device, action, ErrorKind::Ended)
    }

    /// Keeps what a message says for the picture of the same time; a picture waits until all of that is there.
    fn take(&mut self, message: Message) -> Result<(), String> {
        let t = message.log_time;
        let at = |why: String| format!("{}: {why}", message.place());
        match message.topic {
            Topic::Exposure => self.notes.put(t, messages::read_exposure(&message).map_err(at)?),
            Topic::TruthPose => self.poses.put(t, messages::read_pose(&message).map_err(at)?),
            Topic::TruthLight => self.lights.put(t, messages::read_light(&message).map_err(at)?),
            Topic::Image => self.waiting.put(message),
            _ => {}
        }
        Ok(())
    }

    /// Whether all that the file may say of a picture of this time has come.
    fn is_complete(&self, t: i64) -> bool {
        let has = |topic: Topic, is_there: bool| is_there || !self.reader.has(topic);
        has(Topic::Exposure, self.notes.get(t).is_some())
            && has(Topic::TruthPose, self.poses.get(t).is_some())
            && has(Topic::TruthLight, self.lights.get(t).is_some())
    }

    /// The next whole frame of the file.
    fn read_frame(&mut self) -> Result<RawFrame, DeviceError> {
        if self.given >= self.most {
            return Err(self.ended());
        }
        let mut is_over = false;
        loop {
            let first = self.waiting.first_time();
            if is_over && first.is_none() {
                return Err(self.ended());
            }
            let is_ready = first.is_some_and(|t| is_over || self.waiting.is_full() || self.is_complete(t));
            if is_ready && let Some(message) = self.waiting.pop() {
                match self.frame(&message) {
                    Ok(frame) => return Ok(frame),
                    Err(PictureError::Size((w, h))) => return Err(self.wrong_size(&message, w, h)),
                    Err(PictureError::Unread(why)) => self.refuse(&format!("{}: {why}", message.place())),
                }
                continue;
            }
            match self.reader.next_message()? {
                Some(message) => {
                    if let Err(why) = self.take(message) {
                        self.refuse(&why);
                    }
                }
                None => is_over = true,
            }
        }
    }

    /// Counts a message that is of no use, and says why.
    fn refuse(&mut self, why: &str) {
        self.reader.count_bad_message();
        if self.reader.damage().messages <= MOST_TOLD {
            tracing::warn!("{}: {why}", self.device);
        }
    }

    fn wrong_size(&self, message: &Message, w: usize, h: usize) -> DeviceError {
        let lens = &self.rig.lens;
        let action = format!(
            "{}: the picture is {w} x {h}, must be {} x {} as {} says",
            message.place(),
            lens.width,
            lens.height,
            Topic::Calibration.name()
        );
        DeviceError::new(&self.device, action, ErrorKind::Refused)
    }

    /// The exposure of a picture without a message on it.
    fn exposure_without_note(&mut self, of_file: Option<Exposure>) -> Exposure {
        self.stated.or(of_file).unwrap_or_else(|| {
            if !std::mem::replace(&mut self.told.unknown_exposure, true) {
                tracing::warn!(
                    "{}: no exposures are known (topic {}, Exif, or exposure_s=..,gain=..): all pictures count as {} s",
                    self.device,
                    Topic::Exposure.name(),
                    UNKNOWN_EXPOSURE.time_s
                );
            }
            UNKNOWN_EXPOSURE
        })
    }

    fn frame(&mut self, message: &Message) -> Result<RawFrame, PictureError> {
        let t = message.log_time;
        let note = self.notes.get(t).copied();
        if note.is_none() && self.reader.has(Topic::Exposure) && self.stated.is_none() {
            return Err(format!("no message on {} has its time", Topic::Exposure.name()).into());
        }
        let size = (self.rig.lens.width as usize, self.rig.lens.height as usize);
        let read = self.pictures.read(message, size)?;
        let own = match note {
            Some(note) => note.t_mid.0.saturating_add(message.shift_ns),
            None if read.t.0 > 0 => read.t.0.saturating_add(message.shift_ns),
            None => t,
        };
        let t_mid = self.in_order(own)?;
        let exposure = match note {
            Some(note) => note.exposure,
            None => self.exposure_without_note(read.exposure),
        };
        let pose = self.poses.get(t).copied();
        self.truth = pose.zip(self.lights.get(t).copied()).map(|(pose, light)| Truth {
            pose: PoseEstimate { t: t_mid, ..pose },
            light: light.0,
            to_light_world: light.1,
        });
        self.last = Some(t_mid);
        let sequence = note.map_or(message.number - 1, |note| note.sequence);
        Ok(RawFrame {
            sequence,
            t_mid,
            exposure,
            sensor: None,
            row_time_s: 0.0,
            pixels: Arc::new(read.image),
            response: None,
        })
    }

    /// A picture's time on the line of all frames. A step back by more than a second begins afresh after a gap.
    fn in_order(&mut self, t_ns: i64) -> Result<Timestamp, String> {
        let mut t = Timestamp(t_ns.saturating_add(self.own_shift_ns));
        if let Some(last) = self.last.filter(|last| t <= *last) {
            let back_ns = last.0.saturating_sub(t.0);
            if back_ns <= LARGEST_DISORDER_NS {
                return Err(format!(
                    "it does not come after the picture before, which is {:.6} s later",
                    back_ns as f64 * 1e-9
                ));
            }
            self.own_steps += 1;
            self.own_shift_ns = self.own_shift_ns.saturating_add(back_ns).saturating_add(GAP_NS);
            t = Timestamp(t_ns.saturating_add(self.own_shift_ns));
        }
        if self.clock_steps() > self.told.steps {
            self.told.steps = self.clock_steps();
            tracing::warn!(
                "{}: the clock steps back (step {}): what follows counts as later, after a gap",
                self.device,
                self.told.steps
            );
        }
        Ok(t)
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

    fn scene(&self) -> Option<String> {
        self.reader.notes().get("scene").cloned()
    }

    fn delivers_at_once(&self) -> bool {
        true
    }
}
