//! Inertial sensors on serial ports. Thin: opens the port, waits for bytes, hands them to [`Wire`].

use super::assemble::Assembler;
use super::description::{BAUD, ImuDescription};
use super::names::{ImuName, Which};
use super::wire::{Protocol, Wire};
use super::wire_log::WireLogWriter;
use crate::clock::Clock;
use crate::model::imu::{ImuOrientation, ImuSample};
use crate::model::time::Timestamp;
use crate::{DeviceError, ErrorKind, ImuSource};
use serialport::{SerialPort, TTYPort};
use std::io::{ErrorKind as IoKind, Read};
use std::sync::Arc;
use std::time::Duration;

/// Bytes of one read.
const READ_BYTES: usize = 4096;
/// The longest single wait for bytes, seconds.
const LONGEST_WAIT_S: f64 = 1.0;
/// A port that gives no sample for so long is told, seconds.
pub const SILENT_S: f64 = 3.0;

/// A sensor on a serial port.
pub struct SerialImu {
    name: String,
    port: TTYPort,
    baud: u32,
    protocol: &'static str,
    clock: Arc<dyn Clock>,
    wire: Wire,
    assembler: Assembler,
    bytes: Box<[u8; READ_BYTES]>,
    log: Option<WireLogWriter>,
    last_sample: Timestamp,
    bytes_then: u64,
}

impl SerialImu {
    /// Opens the port of a name. `Refused` where the name or the rig is wrong or the path is no serial port; `Reopen` where it
    /// is not there, busy or may not be opened (yet).
    pub fn open(
        text: &str,
        name: &ImuName,
        description: &ImuDescription,
        clock: Arc<dyn Clock>,
        log: Option<WireLogWriter>,
    ) -> Result<Self, DeviceError> {
        let refuse = |e| DeviceError::new(text, "read what is said of it", ErrorKind::Refused).because(e);
        let protocol = description.serial_protocol(name.protocol.as_deref()).map_err(refuse)?;
        let Which::Path(path) = &name.which else {
            return Err(DeviceError::new(text, "must name a path", ErrorKind::Refused));
        };
        let (usual_baud, usual_hz) = protocol.usual_baud_and_rate();
        let baud = name.baud.or(description.baud).unwrap_or(usual_baud);
        debug_assert!(BAUD.contains(&baud));
        let port =
            serialport::new(path, baud).open_native().map_err(|error| cannot_open(text, baud, error))?;
        let rate_hz = name.rate(description, usual_hz);
        tracing::info!("{text}: opened, {baud} baud, protocol {}, {rate_hz} Hz", protocol.name());
        let assembler = Assembler::new(rate_hz, description.imu_from_sensor);
        Ok(Self::over(text, port, &protocol, (baud, rate_hz), clock, assembler).with_log(log))
    }

    /// Takes a port that is open.
    fn over(
        name: &str,
        port: TTYPort,
        protocol: &Protocol,
        (baud, rate_hz): (u32, f64),
        clock: Arc<dyn Clock>,
        assembler: Assembler,
    ) -> Self {
        Self {
            name: name.to_owned(),
            port,
            baud,
            protocol: protocol.name(),
            last_sample: clock.now(),
            clock,
            wire: Wire::new(protocol, rate_hz),
            assembler,
            bytes: Box::new([0; READ_BYTES]),
            log: None,
            bytes_then: 0,
        }
    }

    fn with_log(mut self, log: Option<WireLogWriter>) -> Self {
        self.log = log;
        self
    }

    /// What came so far, and what became of it.
    pub fn counts(&self) -> super::sample::WireCounts {
        self.wire.counts()
    }

    /// Samples that were dropped after they were read.
    pub fn dropped(&self) -> u64 {
        self.assembler.dropped()
    }

    /// The next sample that waits.
    fn given(&mut self) -> Option<ImuSample> {
        let sample = self.assembler.take()?;
        self.last_sample = self.clock.now();
        self.bytes_then = self.wire.counts().bytes;
        Some(sample)
    }

    /// Waits for bytes, at most for so long; returns whether some came.
    fn read(&mut self, wait_s: f64) -> Result<bool, DeviceError> {
        let lost = |name: &str| DeviceError::new(name, "read: the port is gone", ErrorKind::Reopen);
        self.port.set_timeout(Duration::from_secs_f64(wait_s)).map_err(|e| lost(&self.name).because(e))?;
        let count = match self.port.read(&mut self.bytes[..]) {
            Ok(0) => return Err(lost(&self.name)),
            Ok(count) => count,
            Err(e) if matches!(e.kind(), IoKind::TimedOut | IoKind::Interrupted | IoKind::WouldBlock) => {
                return Ok(false);
            }
            Err(e) => return Err(lost(&self.name).because(e)),
        };
        let arrival = self.clock.now();
        let bytes = &self.bytes[..count];
        if let Some(log) = &mut self.log {
            log.write(arrival, bytes);
        }
        let assembler = &mut self.assembler;
        self.wire.feed(bytes, arrival, |sample| assembler.put(sample));
        Ok(true)
    }

    /// The loss of a port that answers nothing, or nothing that is read.
    fn silence(&mut self, now: Timestamp) -> Result<(), DeviceError> {
        let silent_s = now.seconds_since(self.last_sample);
        if silent_s < SILENT_S {
            return Ok(());
        }
        let bytes = self.wire.counts().bytes - self.bytes_then;
        let (baud, protocol) = (self.baud, self.protocol);
        let why = if bytes == 0 {
            format!(
                "no byte came for {silent_s:.1} s at {baud} baud: is this the sensor's port (a modem says nothing \
                 either), and has it power?"
            )
        } else {
            format!(
                "{bytes} bytes came in {silent_s:.1} s at {baud} baud and no sample of protocol {protocol} among them: \
                 another baud rate, or another protocol?"
            )
        };
        Err(DeviceError::new(&self.name, why, ErrorKind::Reopen))
    }
}

impl Drop for SerialImu {
    fn drop(&mut self) {
        let counts = self.wire.counts();
        tracing::info!("{}: closed: {counts:?}, {} left out after that", self.name, self.assembler.dropped());
    }
}

fn cannot_open(text: &str, baud: u32, error: serialport::Error) -> DeviceError {
    use serialport::ErrorKind as Kind;
    let (kind, action) = match error.kind() {
        Kind::NoDevice | Kind::Io(IoKind::NotFound) => {
            (ErrorKind::Reopen, "open: not there, or held by another program".to_owned())
        }
        Kind::Io(IoKind::PermissionDenied) => {
            (ErrorKind::Reopen, "open: not allowed (is the user in the group dialout?)".to_owned())
        }
        Kind::InvalidInput => (ErrorKind::Refused, format!("open at {baud} baud")),
        _ => (ErrorKind::Reopen, format!("open at {baud} baud")),
    };
    DeviceError::new(text, action, kind).because(error)
}

impl ImuSource for SerialImu {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        loop {
            if let Some(sample) = self.given() {
                return Ok(sample);
            }
            let left_s = deadline.seconds_since(self.clock.now()).max(0.0);
            let came = self.read(left_s.min(LONGEST_WAIT_S))?;
            if let Some(sample) = self.given() {
                return Ok(sample);
            }
            let now = self.clock.now();
            self.silence(now)?;
            // A wait that ran out ends the call also where the clock is a test's and stands still.
            if now >= deadline || (!came && left_s <= LONGEST_WAIT_S) {
                return Err(DeviceError::again());
            }
        }
    }

    fn orientation(&self) -> Option<ImuOrientation> {
        self.assembler.orientation()
    }
}

#[cfg(test)]
pub(crate) mod tests;
