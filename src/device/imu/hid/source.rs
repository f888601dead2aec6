//! A sensor that sends reports, over whatever reads them.

use super::ReportProtocol;
use super::descriptor::{Descriptor, SENSOR_PAGE};
use crate::clock::Clock;
use crate::imu::assemble::Assembler;
use crate::imu::wire_log::WireLogWriter;
use crate::model::imu::{ImuOrientation, ImuSample};
use crate::model::time::Timestamp;
use crate::{DeviceError, ErrorKind, ImuSource};
use std::sync::Arc;

/// The longest report, bytes.
pub const LONGEST_REPORT: usize = 4096;
/// The longest single wait, seconds.
const LONGEST_WAIT_S: f64 = 1.0;
/// A device that gives no sample for so long is told, seconds.
const SILENT_S: f64 = 3.0;

/// Where reports come from. Errors are texts of their cause; all of them mean that the device is gone.
pub trait Reports: Send {
    /// Waits for a report, at most for so many milliseconds; the number of its bytes, 0 where none came.
    fn read(&mut self, report: &mut [u8], wait_ms: u16) -> Result<usize, String>;

    /// Sends a feature report, its number first.
    fn send_feature(&mut self, report: &[u8]) -> Result<(), String>;
}

/// Whether a device can send what the protocol needs; else why not.
pub fn check(descriptor: &Descriptor, protocol: &ReportProtocol) -> Result<(), String> {
    let (id, length) = protocol.report();
    if descriptor.inputs.iter().any(|report| report.bytes() == length && (id == 0 || report.id == id)) {
        return Ok(());
    }
    let sends: Vec<String> = descriptor
        .inputs
        .iter()
        .map(|report| format!("report {} of {} bytes", report.id, report.bytes()))
        .collect();
    let hint = if descriptor.collections.iter().any(|(page, _)| *page == SENSOR_PAGE) {
        "; it is a standard sensor: name it as iio:name=.."
    } else {
        ""
    };
    Err(format!("its descriptor has no report {id} of {length} bytes, but {}{hint}", sends.join(", ")))
}

/// A sensor that sends reports.
pub struct HidImu<R> {
    name: String,
    reports: R,
    protocol: ReportProtocol,
    clock: Arc<dyn Clock>,
    assembler: Assembler,
    report: Box<[u8; LONGEST_REPORT]>,
    log: Option<WireLogWriter>,
    last_sample: Timestamp,
    kept_alive: Option<Timestamp>,
    foreign: u64,
}

impl<R: Reports> HidImu<R> {
    /// Takes an open device.
    pub fn new(
        name: &str,
        reports: R,
        protocol: ReportProtocol,
        assembler: Assembler,
        clock: Arc<dyn Clock>,
        log: Option<WireLogWriter>,
    ) -> Self {
        Self {
            name: name.to_owned(),
            reports,
            protocol,
            last_sample: clock.now(),
            clock,
            assembler,
            report: Box::new([0; LONGEST_REPORT]),
            log,
            kept_alive: None,
            foreign: 0,
        }
    }

    /// Reports that were none of the protocol's.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }

    fn lost(&self, cause: String) -> DeviceError {
        DeviceError::new(&self.name, "read: the device is gone", ErrorKind::Reopen).because(cause)
    }

    fn keep_alive(&mut self) -> Result<(), DeviceError> {
        let Some((report, every_s)) = self.protocol.keep_alive() else { return Ok(()) };
        let now = self.clock.now();
        if self.kept_alive.is_some_and(|then| now.seconds_since(then) < every_s) {
            return Ok(());
        }
        self.kept_alive = Some(now);
        self.reports.send_feature(report).map_err(|cause| self.lost(cause))
    }

    /// Waits for one report; returns whether one came.
    fn read(&mut self, wait_s: f64) -> Result<bool, DeviceError> {
        // Rounded up, so that a short wait is one.
        let wait_ms = (wait_s * 1e3).ceil().clamp(0.0, 1000.0) as u16;
        let count = self.reports.read(&mut self.report[..], wait_ms).map_err(|cause| self.lost(cause))?;
        let Some(report) = self.report.get(..count).filter(|report| !report.is_empty()) else {
            return Ok(false);
        };
        let arrival = self.clock.now();
        if let Some(log) = &mut self.log {
            log.write(arrival, report);
        }
        let assembler = &mut self.assembler;
        if !self.protocol.read(report, arrival, &mut |sample| assembler.put(sample)) {
            self.foreign += 1;
        }
        Ok(true)
    }

    fn silence(&self, now: Timestamp) -> Result<(), DeviceError> {
        let silent_s = now.seconds_since(self.last_sample);
        if silent_s < SILENT_S {
            return Ok(());
        }
        let why = format!("no sample came for {silent_s:.1} s ({} other reports)", self.foreign);
        Err(DeviceError::new(&self.name, why, ErrorKind::Reopen))
    }
}

impl<R: Reports> ImuSource for HidImu<R> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        loop {
            if let Some(sample) = self.assembler.take() {
                self.last_sample = self.clock.now();
                return Ok(sample);
            }
            self.keep_alive()?;
            let left_s = deadline.seconds_since(self.clock.now()).max(0.0);
            let came = self.read(left_s.min(LONGEST_WAIT_S))?;
            let now = self.clock.now();
            if !came {
                self.silence(now)?;
            }
            let is_over = now >= deadline || (!came && left_s <= LONGEST_WAIT_S);
            if is_over && !self.assembler.has_waiting() {
                self.silence(now)?;
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
