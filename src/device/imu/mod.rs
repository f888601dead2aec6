//! Inertial sensors on wires: serial ports, HID, IIO. Protocols are pure (`wire`, `hid`); transports are thin (`serial`,
//! `hid::hidraw`, `iio`).
//!
//! A sample goes from its protocol ([`sample::WireSample`]) through [`gates`] (serial lines only: USB has checksums that hold)
//! and [`arrival`] to [`assemble`], which turns it into the mounting's axes and makes what is missing: rates of sensors that
//! give orientations alone, orientations of sensors that give rates and forces alone ([`fusion`]).

pub mod alone;
pub mod arrival;
pub mod assemble;
pub mod description;
pub mod fusion;
pub mod gates;
pub mod hid;
pub mod iio;
pub mod names;
pub mod sample;
#[cfg(feature = "serial")]
pub mod serial;
pub mod wire;
pub mod wire_log;
