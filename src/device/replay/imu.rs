//! The inertial samples of a recording.

use crate::model::{imu::ImuSample, time::Timestamp};
use crate::recording::{
    Message, RecordingReader, Topic, TopicNames,
    clock::{GAP_NS, LARGEST_DISORDER_NS},
    messages,
};
use crate::{DeviceError, ErrorKind, ImuSource, ImuTruth};
use std::io::{Read, Seek};

/// The IMU of a recording; reads the file by itself.
pub struct ReplayImu<R> {
    device: String,
    reader: RecordingReader<R>,
    truth: Option<ImuTruth>,
    next: Option<ImuSample>,
    last: Option<Timestamp>,
    /// What is added to the sensor's own times, which stepped back though the file's did not; nanoseconds.
    own_shift_ns: i64,
    is_told: bool,
}

impl<R: Read + Seek> ReplayImu<R> {
    /// Finds the first sample and the truth before it.
    pub fn new(device: &str, source: R) -> Result<Self, DeviceError> {
        Self::with_topics(device, source, TopicNames::default())
    }

    /// The same with topics that are asked for.
    pub fn with_topics(device: &str, source: R, topics: TopicNames) -> Result<Self, DeviceError> {
        let reader = RecordingReader::open_topics(device, source, topics)?;
        let mut imu = Self {
            device: device.to_owned(),
            reader,
            truth: None,
            next: None,
            last: None,
            own_shift_ns: 0,
            is_told: false,
        };
        imu.advance()?;
        Ok(imu)
    }

    /// Reads on to the next sample that comes after the last one.
    fn advance(&mut self) -> Result<(), DeviceError> {
        self.next = None;
        while let Some(message) = self.reader.next_message()? {
            match message.topic {
                Topic::TruthImu => self.truth = messages::read_imu_truth(&message).ok(),
                Topic::Imu => match self.sample(&message) {
                    Ok(sample) => {
                        self.last = Some(sample.t);
                        self.next = Some(sample);
                        return Ok(());
                    }
                    Err(why) => {
                        self.reader.count_bad_message();
                        if !std::mem::replace(&mut self.is_told, true) {
                            tracing::warn!("{}: {}: {why}", self.device, message.place());
                        }
                    }
                },
                _ => {}
            }
        }
        Ok(())
    }

    fn sample(&mut self, message: &Message) -> Result<ImuSample, String> {
        let sample = messages::read_imu(message)?;
        // A sensor without a clock of its own.
        let t_ns = match sample.t.0 {
            0 => message.log_time,
            t => t.saturating_add(message.shift_ns),
        };
        let mut t = Timestamp(t_ns.saturating_add(self.own_shift_ns));
        if let Some(last) = self.last.filter(|last| t <= *last) {
            let back_ns = last.0.saturating_sub(t.0);
            if back_ns <= LARGEST_DISORDER_NS {
                return Err("it does not come after the sample before".into());
            }
            self.own_shift_ns = self.own_shift_ns.saturating_add(back_ns).saturating_add(GAP_NS);
            t = Timestamp(t_ns.saturating_add(self.own_shift_ns));
        }
        Ok(ImuSample { t, ..sample })
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
