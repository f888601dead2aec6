//! Writes a recording.

use super::{
    frames::{self, CAMERA},
    messages,
    notes::{self, RecordingOrigin},
    pictures::{self, PictureCoding},
    schema::{Topic, schema},
};
use crate::model::{frame::RawFrame, imu::ImuSample, response::Response, rig::Rig, time::Timestamp};
use crate::{DeviceError, ErrorKind, ImuTruth, Truth};
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

/// A chunk is closed before the next frame once it holds so many bytes...
const CHUNK_BYTES: u64 = 1 << 20;
/// ...or spans so many seconds.
const CHUNK_S: f64 = 1.0;

/// What holds for the whole recording; repeated at the start of each chunk.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// Lens, tags and ball. Without it the recording has no calibration and cannot be replayed.
    pub rig: Option<Rig>,
    /// The camera's response.
    pub response: Option<Response>,
    /// The IMU's true faults.
    pub imu_truth: Option<ImuTruth>,
    /// Who records what.
    pub origin: RecordingOrigin,
}

/// What has been written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// How many were written.
    pub frames: u64,
    /// Inertial samples.
    pub imu_samples: u64,
    /// Pieces that a reader can take by themselves.
    pub chunks: u64,
}

/// Writes frames, samples and truth as they come.
pub struct RecordingWriter<W: Write + Seek> {
    device: String,
    mcap: mcap::Writer<W>,
    coding: PictureCoding,
    setup: Setup,
    channels: BTreeMap<Topic, u16>,
    chunk_start: Option<Timestamp>,
    chunk_bytes: u64,
    written: Written,
}

impl RecordingWriter<BufWriter<File>> {
    /// Makes (or empties) a file.
    pub fn create(path: &Path, coding: PictureCoding, setup: Setup) -> Result<Self, DeviceError> {
        let device = format!("record:{}", path.display());
        let file = File::create(path)
            .map_err(|e| DeviceError::new(&device, "create the file", ErrorKind::Refused).because(e))?;
        Self::new(device, BufWriter::new(file), coding, setup)
    }
}

impl<W: Write + Seek> RecordingWriter<W> {
    /// Writes to anything; `device` names it in errors. The file depends only on what is written to it.
    pub fn new(
        device: impl Into<String>,
        target: W,
        coding: PictureCoding,
        setup: Setup,
    ) -> Result<Self, DeviceError> {
        let device = device.into();
        let mut mcap = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Zstd))
            .compression_threads(0)
            .chunk_size(None)
            .library(concat!("halflight ", env!("CARGO_PKG_VERSION")))
            .create(target)
            .map_err(|e| DeviceError::new(&device, "begin the file", ErrorKind::Refused).because(e))?;
        let texts = setup.origin.texts(setup.rig.as_ref(), coding);
        mcap.write_metadata(&mcap::records::Metadata { name: notes::NAME.to_owned(), metadata: texts })
            .map_err(|e| DeviceError::new(&device, "begin the file", ErrorKind::Refused).because(e))?;
        Ok(Self {
            device,
            mcap,
            coding,
            setup,
            channels: BTreeMap::new(),
            chunk_start: None,
            chunk_bytes: 0,
            written: Written::default(),
        })
    }

    /// What has been written so far.
    pub fn written(&self) -> Written {
        self.written
    }

    /// Writes a frame with its exposure, and its truth where it is known.
    pub fn write_frame(&mut self, frame: &RawFrame, truth: Option<&Truth>) -> Result<(), DeviceError> {
        let t = frame.t_mid;
        self.begin(t)?;
        let sequence = frame.sequence as u32;
        self.put(Topic::Exposure, t, sequence, &messages::write_exposure(frame))?;
        if let Some(truth) = truth {
            let pose = messages::write_pose(t, &truth.pose.world_from_camera);
            self.put(Topic::TruthPose, t, sequence, &pose)?;
            let transform = messages::write_transform(t, CAMERA, &truth.pose.world_from_camera);
            self.put(Topic::Transforms, t, sequence, &transform)?;
            self.put(Topic::TruthLight, t, sequence, &messages::write_light(t, truth))?;
        }
        let image = pictures::write_image(t, &frame.pixels, self.coding).map_err(|e| {
            let (w, h) = (frame.pixels.width(), frame.pixels.height());
            let action = format!("code frame {} ({w} x {h}) as {:?}", frame.sequence, self.coding);
            DeviceError::new(&self.device, action, ErrorKind::Refused).because(e)
        })?;
        self.put(Topic::Image, t, sequence, &image)?;
        self.written.frames += 1;
        Ok(())
    }

    /// Writes inertial samples. Those that are not finite numbers are left out: JSON has no word for them, and no reader takes them.
    pub fn write_imu(&mut self, samples: &[ImuSample]) -> Result<(), DeviceError> {
        let is_finite = |s: &&ImuSample| s.gyro_rad_s.iter().chain(&s.accel_m_s2).all(|x| x.is_finite());
        for sample in samples.iter().filter(is_finite) {
            if self.chunk_start.is_none() {
                self.begin(sample.t)?;
            }
            let sequence = self.written.imu_samples as u32;
            self.put(Topic::Imu, sample.t, sequence, &messages::write_imu(sample))?;
            self.written.imu_samples += 1;
        }
        Ok(())
    }

    /// Closes the last chunk and writes the summary.
    pub fn finish(mut self) -> Result<(Written, W), DeviceError> {
        let failed = |e| DeviceError::new(&self.device, "finish the file", ErrorKind::Reopen).because(e);
        self.mcap.finish().map_err(failed)?;
        Ok((self.written, self.mcap.into_inner()))
    }

    /// Closes a chunk that is full and opens the next with what holds for the whole recording.
    fn begin(&mut self, t: Timestamp) -> Result<(), DeviceError> {
        if let Some(start) = self.chunk_start {
            if self.chunk_bytes < CHUNK_BYTES && t.seconds_since(start).abs() < CHUNK_S {
                return Ok(());
            }
            self.mcap
                .flush()
                .map_err(|e| DeviceError::new(&self.device, "write a chunk", ErrorKind::Reopen).because(e))?;
        }
        self.chunk_start = Some(t);
        self.chunk_bytes = 0;
        self.written.chunks += 1;
        let setup = self.setup.clone();
        if let Some(rig) = &setup.rig {
            self.put(Topic::Calibration, t, 0, &messages::write_calibration(t, &rig.lens))?;
            self.put(Topic::Rig, t, 0, &messages::write_rig(t, rig, setup.response.as_ref()))?;
            for (name, place) in frames::standing(rig) {
                self.put(Topic::Transforms, t, 0, &messages::write_transform(t, &name, &place))?;
            }
        }
        if let Some(truth) = &setup.imu_truth {
            self.put(Topic::TruthImu, t, 0, &messages::write_imu_truth(t, truth))?;
        }
        Ok(())
    }

    fn put(&mut self, topic: Topic, t: Timestamp, sequence: u32, message: &[u8]) -> Result<(), DeviceError> {
        let failed = |device: &str, e: mcap::McapError| {
            let action = format!("write {} bytes on {}", message.len(), topic.name());
            DeviceError::new(device, action, ErrorKind::Reopen).because(e)
        };
        let channel_id = match self.channels.get(&topic) {
            Some(id) => *id,
            None => {
                let (name, encoding, bytes) = schema(topic, self.coding == PictureCoding::Raw);
                let message_encoding = if encoding == "jsonschema" { "json" } else { "protobuf" };
                let id = self
                    .mcap
                    .add_schema(name, encoding, &bytes)
                    .and_then(|s| self.mcap.add_channel(s, topic.name(), message_encoding, &BTreeMap::new()))
                    .map_err(|e| failed(&self.device, e))?;
                self.channels.insert(topic, id);
                id
            }
        };
        let time = u64::try_from(t.0).unwrap_or(0);
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.chunk_bytes += message.len() as u64;
        self.mcap.write_to_known_channel(&header, message).map_err(|e| failed(&self.device, e))
    }
}
