//! A camera through V4L2, as little of it as the steps need. Structures are bytes; numbers are at the kernel's places.

use crate::sys::{self, Mapping, POLL_GONE, POLL_IN, Request};
use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Result};
use std::os::unix::fs::OpenOptionsExt;

pub const EXPOSURE_MODE: u32 = 0x009a_0901;
pub const EXPOSURE: u32 = 0x009a_0902;
pub const BRIGHTNESS: u32 = 0x0098_0900;
pub const GAIN: u32 = 0x0098_0913;
/// Values of the mode of exposure.
pub const MANUAL: i32 = 1;
pub const APERTURE_PRIORITY: i32 = 3;
/// `device_caps` of a node that gives pictures.
pub const CAPTURES: u32 = 1;
const CAPTURE_TYPE: u32 = 1;
const MAPPED: u32 = 1;
const YUYV: u32 = u32::from_le_bytes(*b"YUYV");
const NONBLOCKING: i32 = 0o4000;

const fn ask(direction: u32, number: u32) -> Request {
    Request { direction, letter: b'V', number }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[at + k]))
}

fn put(bytes: &mut [u8], at: usize, value: u32) {
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

/// An opened node.
pub struct Video {
    file: File,
    buffers: Vec<Mapping>,
}

/// Range of a control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    pub least: i32,
    pub most: i32,
    pub step: i32,
    pub default: i32,
}

/// A full buffer.
pub struct Full {
    pub index: u32,
    pub sequence: u32,
    pub used: usize,
}

impl Video {
    pub fn open(path: &str) -> Result<Self> {
        let file = OpenOptions::new().read(true).write(true).custom_flags(NONBLOCKING).open(path)?;
        Ok(Self { file, buffers: Vec::new() })
    }

    /// What this node can do.
    pub fn abilities(&self) -> Result<u32> {
        let mut bytes = [0; 104];
        sys::request(&self.file, ask(2, 0), &mut bytes)?;
        Ok(word(&bytes, 88))
    }

    pub fn range(&self, control: u32) -> Result<Range> {
        let mut bytes = [0; 68];
        put(&mut bytes, 0, control);
        sys::request(&self.file, ask(3, 36), &mut bytes)?;
        let [least, most, step, default] = [40, 44, 48, 52].map(|at| word(&bytes, at) as i32);
        Ok(Range { least, most, step, default })
    }

    /// Writes a control; returns what the driver made of the value.
    pub fn set(&self, control: u32, value: i32) -> Result<i32> {
        let mut bytes = [0; 8];
        put(&mut bytes, 0, control);
        put(&mut bytes, 4, value as u32);
        sys::request(&self.file, ask(3, 28), &mut bytes)?;
        Ok(word(&bytes, 4) as i32)
    }

    /// Asks for YUYV of a size; returns the size that it will be.
    pub fn set_size(&self, width: u32, height: u32) -> Result<(usize, usize)> {
        let mut bytes = [0; 208];
        for (at, value) in [(0, CAPTURE_TYPE), (8, width), (12, height), (16, YUYV)] {
            put(&mut bytes, at, value);
        }
        sys::request(&self.file, ask(3, 5), &mut bytes)?;
        Ok((word(&bytes, 8) as usize, word(&bytes, 12) as usize))
    }

    /// Makes buffers, queues the first `queued` of them, and starts.
    pub fn start(&mut self, count: u32, queued: u32) -> Result<()> {
        let mut bytes = [0; 20];
        for (at, value) in [(0, count), (4, CAPTURE_TYPE), (8, MAPPED)] {
            put(&mut bytes, at, value);
        }
        sys::request(&self.file, ask(3, 8), &mut bytes)?;
        for index in 0..word(&bytes, 0) {
            let mut buffer = Self::buffer(index);
            sys::request(&self.file, ask(3, 9), &mut buffer)?;
            self.buffers.push(Mapping::new(&self.file, word(&buffer, 64), word(&buffer, 72) as usize)?);
        }
        (0..queued).try_for_each(|index| self.queue(index))?;
        sys::request(&self.file, ask(1, 18), &mut CAPTURE_TYPE.to_le_bytes())
    }

    pub fn stop(&self) -> Result<()> {
        sys::request(&self.file, ask(1, 19), &mut CAPTURE_TYPE.to_le_bytes())
    }

    fn buffer(index: u32) -> [u8; 88] {
        let mut bytes = [0; 88];
        for (at, value) in [(0, index), (4, CAPTURE_TYPE), (60, MAPPED)] {
            put(&mut bytes, at, value);
        }
        bytes
    }

    pub fn queue(&self, index: u32) -> Result<()> {
        sys::request(&self.file, ask(3, 15), &mut Self::buffer(index))
    }

    /// The next full buffer; `TimedOut` where none came.
    pub fn take(&self, timeout_ms: i32) -> Result<Full> {
        let found = sys::ready(&self.file, timeout_ms)?;
        if found & (POLL_IN | POLL_GONE) == 0 {
            return Err(Error::from(ErrorKind::TimedOut));
        }
        let mut bytes = Self::buffer(0);
        sys::request(&self.file, ask(3, 17), &mut bytes)?;
        Ok(Full { index: word(&bytes, 0), sequence: word(&bytes, 56), used: word(&bytes, 8) as usize })
    }

    pub fn bytes(&self, full: &Full) -> &[u8] {
        let whole = self.buffers[full.index as usize].bytes();
        &whole[..full.used.min(whole.len())]
    }
}
