//! What a video node can be asked, so that a test can stand in for the kernel.

use crate::model::pixels::PixelMemory;
use std::io;
use std::time::Duration;

/// The kernel's number for "no such format, control or index".
pub const EINVAL: i32 = 22;
/// The kernel's number for "the device is gone".
pub const ENODEV: i32 = 19;
/// The kernel's number for "this is no such device".
pub const ENOTTY: i32 = 25;
/// The kernel's number for "somebody else has it".
pub const EBUSY: i32 = 16;

/// Who a node is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NodeFacts {
    /// The kernel's driver.
    pub driver: String,
    /// The camera's own name.
    pub card: String,
    /// Where it is plugged in.
    pub bus: String,
    /// Whether it gives pictures. A USB camera has a second node for metadata, which gives none.
    pub captures: bool,
    /// Whether it takes the multi-planar calls only.
    pub multi_planar: bool,
}

/// Frame rates that a driver lists for a format and size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameRates(Vec<f64>);

impl FrameRates {
    /// Adds a rate, frames a second; nonsense is left out.
    pub fn add(&mut self, frames_per_s: f64) {
        if frames_per_s.is_finite() && frames_per_s > 0.0 {
            self.0.push(frames_per_s);
        }
    }

    /// All, as listed.
    pub fn as_slice(&self) -> &[f64] {
        &self.0
    }

    /// The highest; `None` where the driver lists none.
    pub fn highest(&self) -> Option<f64> {
        self.0.iter().copied().reduce(f64::max)
    }
}

/// One format and size that a driver lists.
#[derive(Clone, Debug, PartialEq)]
pub struct Offer {
    /// The kernel's four letters.
    pub fourcc: [u8; 4],
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Rates at this size.
    pub rates: FrameRates,
}

/// What the driver made of a wish for a format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Granted {
    /// The kernel's four letters.
    pub fourcc: [u8; 4],
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from one row to the next; 0 where the driver states none.
    pub stride: u32,
    /// Separate pieces of memory for a picture.
    pub planes: u32,
    /// The kernel's `v4l2_colorspace`.
    pub colour_space: u32,
    /// The kernel's `v4l2_ycbcr_encoding`, 0: by the colour space.
    pub encoding: u32,
    /// The kernel's `v4l2_quantization`, 0: by the colour space.
    pub quantization: u32,
}

/// A buffer that the driver has filled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filled {
    /// Number of the buffer.
    pub index: usize,
    /// Bytes that were filled.
    pub used: usize,
    /// Bytes of them before the picture, which drivers of several planes may write.
    pub skipped: usize,
    /// Counts the camera's frames, with those that were lost.
    pub sequence: u32,
    /// The driver's time, nanoseconds.
    pub time_ns: i64,
    /// Whether the driver says that the picture is damaged.
    pub has_error: bool,
    /// Whether the time is on the monotonic clock.
    pub is_monotonic: bool,
    /// Whether the time is the start of the exposure; else it is the end of the frame.
    pub at_start: bool,
}

/// What waiting came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ready {
    /// A buffer is filled.
    Filled,
    /// Nothing yet.
    Nothing,
    /// The device is gone.
    Gone,
}

/// What a control's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlKind {
    /// A number in a range.
    Number,
    /// One of several, by number.
    Menu,
    /// 0 or 1.
    Switch,
}

/// A control and its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ControlFacts {
    /// The kernel's number.
    pub id: u32,
    /// For people.
    pub name: String,
    /// What its numbers are.
    pub kind: ControlKind,
    /// Least value.
    pub least: i32,
    /// Largest value.
    pub most: i32,
    /// Step, at least 1.
    pub step: i32,
    /// The driver's own choice.
    pub default: i32,
    /// Whether it can be written at all.
    pub can_be_set: bool,
}

/// Whose controls can be asked and written: a video node, or the sensor behind one. A call is a transfer to the device (some
/// 10 ms).
pub trait ControlNode: Send {
    /// The range of a control; `None` where there is none.
    fn control_facts(&self, id: u32) -> Option<ControlFacts>;
    /// The value of a control.
    fn control(&self, id: u32) -> io::Result<i32>;
    /// The value of a control of 64 bits.
    fn wide_control(&self, id: u32) -> io::Result<i64>;
    /// Sets a control; returns what was taken, which may be clamped.
    fn set_control(&self, id: u32, value: i32) -> io::Result<i32>;
}

/// A sensor behind a video node.
pub struct BehindNode {
    /// Its own name.
    pub name: String,
    /// Columns and rows that it gives.
    pub size: [u32; 2],
    /// What can be asked of it and written.
    pub controls: Box<dyn ControlNode>,
}

/// A video node. No call waits, but for `wait` and for controls, which are a transfer to the camera (some 10 ms).
pub trait VideoNode: ControlNode {
    /// A buffer of the driver.
    type Memory: PixelMemory + 'static;

    /// Who it is.
    fn facts(&self) -> io::Result<NodeFacts>;
    /// What it lists.
    fn offers(&self) -> io::Result<Vec<Offer>>;
    /// Asks for a format; the driver gives the nearest that it has.
    fn set_format(&mut self, fourcc: [u8; 4], width: u32, height: u32) -> io::Result<Granted>;
    /// Asks for a rate, frames a second; returns what it will be.
    fn set_rate(&mut self, frames_per_s: f64) -> io::Result<f64>;
    /// Makes buffers; the driver may give fewer or more.
    fn buffers(&mut self, count: u32) -> io::Result<Vec<Self::Memory>>;
    /// Hands a buffer to the driver.
    fn queue(&mut self, index: usize) -> io::Result<()>;
    /// Takes a filled buffer, if there is one.
    fn dequeue(&mut self) -> io::Result<Option<Filled>>;
    /// Starts the stream.
    fn start(&mut self) -> io::Result<()>;
    /// Ends the stream; all buffers are free again.
    fn stop(&mut self) -> io::Result<()>;
    /// Waits until a buffer is filled, or the device is gone, or so long.
    fn wait(&mut self, longest: Duration) -> io::Result<Ready>;
    /// The sensor that a media controller has behind it; `None` where there is no controller.
    fn sensor(&self) -> Option<BehindNode> {
        None
    }
}
