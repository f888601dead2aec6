//! Standard sensors (HID usage page 0x20, and chips on I2C or SPI) as the kernel gives them: IIO devices with a buffer, a trigger
//! and a clock that is named. `dev_rotation` fuses by itself; `gyro_3d` is read together with `accel_3d` beside it.
//!
//! Never tried on the hardware or the kernel: the tests have a folder like sysfs, and pipes.

pub mod layout;
mod sysfs;

use super::assemble::Assembler;
use super::description::ImuDescription;
use super::names::{ImuName, Which};
use super::sample::{SampleStamp, WireSample};
use crate::clock::Clock;
use crate::model::imu::{ImuOrientation, ImuSample};
use crate::model::time::Timestamp;
use crate::{DeviceError, ErrorKind, ImuSource};
use glam::DQuat;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs::File;
use std::io::{ErrorKind as IoKind, Read};
use std::path::PathBuf;
use std::sync::Arc;
use sysfs::Opened;

/// Records of one read at most.
const READ_RECORDS: usize = 32;
/// The longest single wait, seconds.
const LONGEST_WAIT_S: f64 = 1.0;

/// Where the kernel's files are.
#[derive(Clone, Debug)]
pub struct Places {
    /// Folders of devices and triggers.
    pub sys: PathBuf,
    /// Nodes.
    pub dev: PathBuf,
}

impl Default for Places {
    fn default() -> Self {
        Self { sys: "/sys/bus/iio/devices".into(), dev: "/dev".into() }
    }
}

/// One device of the one or two that are read.
struct DevicePart {
    file: File,
    opened: Opened,
    bytes: Vec<u8>,
    /// Bytes of a record that has not come whole yet.
    held: usize,
}

/// A standard sensor.
pub struct IioImu {
    name: String,
    parts: Vec<DevicePart>,
    clock: Arc<dyn Clock>,
    assembler: Assembler,
    accel: Option<[f64; 3]>,
    /// Records taken so far.
    records: u64,
}

impl IioImu {
    /// Finds a sensor, enables its channels and its buffer. `Reopen` where it is not there or may not be set up (yet); `Refused`
    /// where it has neither an orientation nor rates.
    pub fn open(
        text: &str,
        name: &ImuName,
        description: &ImuDescription,
        clock: Arc<dyn Clock>,
        places: &Places,
    ) -> Result<Self, DeviceError> {
        let fail = |(kind, why): (ErrorKind, String)| DeviceError::new(text, why, kind);
        let folder = match &name.which {
            Which::Name(wanted) => sysfs::find(places, wanted).map_err(fail)?,
            Which::Path(path) => {
                let node = path.rsplit('/').next().unwrap_or_default();
                places.sys.join(node)
            }
            Which::Ids(..) => return Err(fail((ErrorKind::Refused, "must be a path or name=TEXT".into()))),
        };
        let first = sysfs::open(places, &folder).map_err(fail)?;
        let mut all = vec![first];
        if !all[0].1.has_orientation() {
            if !all[0].1.has_gyro() {
                let why = "gives neither an orientation nor rates: name dev_rotation or gyro_3d".to_owned();
                return Err(fail((ErrorKind::Refused, why)));
            }
            if !all[0].1.has_accel() {
                let beside = sysfs::find(places, "accel_3d").map_err(fail)?;
                all.push(sysfs::open(places, &beside).map_err(fail)?);
            }
        }
        for (_, opened) in &all {
            tracing::info!("{text}: {} opened, its times are on the clock \"{}\"", opened.name, opened.clock);
        }
        let rate_hz = name.rate(description, all[0].1.rate_hz.unwrap_or(100.0));
        let parts = all.into_iter().map(|(file, opened)| {
            let bytes = vec![0; READ_RECORDS * opened.layout.bytes];
            DevicePart { file, opened, bytes, held: 0 }
        });
        Ok(Self {
            name: text.to_owned(),
            parts: parts.collect(),
            clock,
            assembler: Assembler::new(rate_hz, description.imu_from_sensor),
            accel: None,
            records: 0,
        })
    }

    /// The clock of each device's times, as the kernel names it.
    pub fn clocks(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().map(|part| part.opened.clock.as_str())
    }

    /// Waits for records; returns whether some may have come.
    fn wait(&self, wait_s: f64) -> Result<bool, DeviceError> {
        let lost = |e| DeviceError::new(&self.name, "wait for records", ErrorKind::Reopen).because(e);
        // One or two devices; one stands there twice.
        let fd = |k: usize| PollFd::new(&self.parts[k.min(self.parts.len() - 1)].file, PollFlags::IN);
        let mut fds = [fd(0), fd(1)];
        let wait = Timespec { tv_sec: wait_s as i64, tv_nsec: (wait_s.fract() * 1e9) as _ };
        match poll(&mut fds, Some(&wait)) {
            Ok(count) => Ok(count > 0),
            Err(rustix::io::Errno::INTR) => Ok(false),
            Err(error) => Err(lost(std::io::Error::from(error))),
        }
    }

    /// Takes what all devices have, the forces first.
    fn read(&mut self) -> Result<(), DeviceError> {
        let Self { parts, assembler, accel, clock, name, records } = self;
        for part in parts.iter_mut().rev() {
            let count = match part.file.read(&mut part.bytes[part.held..]) {
                Ok(0) => {
                    return Err(DeviceError::new(
                        name.as_str(),
                        "read: the device is gone",
                        ErrorKind::Reopen,
                    ));
                }
                Ok(count) => count,
                Err(e) if matches!(e.kind(), IoKind::WouldBlock | IoKind::Interrupted) => continue,
                Err(e) => return Err(DeviceError::new(name.as_str(), "read", ErrorKind::Reopen).because(e)),
            };
            let arrival = clock.now();
            let length = part.opened.layout.bytes;
            let whole = (part.held + count) / length * length;
            for record in part.bytes[..whole].chunks_exact(length) {
                let mut sample = part.opened.sample(record, arrival);
                *records += 1;
                *accel = sample.accel_m_s2.or(*accel);
                sample.accel_m_s2 = *accel;
                let is_sample =
                    sample.orientation.is_some() || (sample.gyro_rad_s.is_some() && accel.is_some());
                if is_sample {
                    assembler.put(sample);
                }
            }
            part.bytes.copy_within(whole..part.held + count, 0);
            part.held = part.held + count - whole;
        }
        Ok(())
    }
}

/// The kernel stops sampling.
impl Drop for IioImu {
    fn drop(&mut self) {
        for part in &self.parts {
            part.opened.stop();
        }
        let Self { name, records, assembler, .. } = self;
        tracing::info!("{name}: closed: {records} records, {} left out", assembler.dropped());
    }
}

impl Opened {
    fn sample(&self, record: &[u8], arrival: Timestamp) -> WireSample {
        let mut sample = WireSample::empty(arrival);
        let three = |names: [&str; 3], scale: f64| {
            let mut values = [0.0; 3];
            for (value, name) in values.iter_mut().zip(names) {
                *value = self.layout.channel(name)?.read(record, 0)? as f64 * scale;
            }
            Some(values)
        };
        sample.accel_m_s2 = three(sysfs::ACCEL, self.accel_scale);
        sample.gyro_rad_s = three(sysfs::GYRO, self.gyro_scale);
        if let Some(channel) = self.layout.channel(sysfs::ORIENTATION) {
            let [x, y, z, w] = [0, 1, 2, 3].map(|k| channel.read(record, k).unwrap_or(0) as f64);
            // The scale falls out.
            sample.orientation = Some(DQuat::from_xyzw(x, y, z, w).normalize());
        }
        if let Some(ns) = self.layout.time(sysfs::TIMESTAMP, record) {
            sample.stamp = SampleStamp::Ticks { value: ns.cast_unsigned(), bits: 64, tick_s: 1e-9 };
        }
        sample
    }
}

impl ImuSource for IioImu {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        loop {
            if let Some(sample) = self.assembler.take() {
                return Ok(sample);
            }
            let left_s = deadline.seconds_since(self.clock.now()).max(0.0);
            let came = self.wait(left_s.min(LONGEST_WAIT_S))?;
            if came {
                self.read()?;
            }
            let is_over = self.clock.now() >= deadline || (!came && left_s <= LONGEST_WAIT_S);
            if is_over && !self.assembler.has_waiting() {
                return Err(DeviceError::again());
            }
        }
    }

    fn orientation(&self) -> Option<ImuOrientation> {
        self.assembler.orientation()
    }
}

#[cfg(test)]
mod tests;
