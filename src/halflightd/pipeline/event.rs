//! Everything that can happen to the pipeline: one closed enum. One loop takes it (`turns`), live and in lockstep.

use super::Change;
use crate::device::{DeviceError, Truth};
use crate::model::{frame::RawFrame, imu::ImuSample, time::Timestamp};

/// A frame as it reaches the pipeline.
#[derive(Debug)]
pub struct ArrivedFrame {
    /// As the source gave it.
    pub frame: RawFrame,
    /// Frames that were passed over since the last one, because newer ones came.
    pub passed_over: u64,
    /// What the source knows of this frame, where it does.
    pub truth: Option<Box<Truth>>,
}

/// Devices that can go away and come back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DeviceRole {
    /// What gives frames.
    Camera,
    /// The inertial sensor.
    Imu,
    /// What shows pictures.
    Display,
    /// The line that commands come on.
    Link,
}

impl DeviceRole {
    /// All, in order.
    pub const ALL: [Self; 4] = [Self::Camera, Self::Imu, Self::Display, Self::Link];

    /// For messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Camera => "the camera",
            Self::Imu => "the IMU",
            Self::Display => "the display",
            Self::Link => "the command line",
        }
    }
}

/// What somebody asks of the running pipeline.
#[derive(Debug)]
pub enum Command {
    /// Go on with other settings, which are ready: what they cost has been done on another thread.
    Change(Box<Change>),
    /// End after this turn.
    Stop,
}

/// What can happen.
#[derive(Debug)]
pub enum Event {
    /// With the moment at which it arrived.
    Frame(ArrivedFrame),
    /// An inertial sample; in lockstep each comes before the first frame that is later.
    Imu(ImuSample),
    /// A command, or settings that are ready.
    Command(Command),
    /// The moment that was waited for has come, and nothing else has.
    Due,
    /// A device is lost, and is being opened again.
    Lost(DeviceRole, DeviceError),
    /// A lost device is there again.
    Back(DeviceRole),
    /// There are no more frames: the camera's source has ended, or failed for good.
    Ended(Result<(), DeviceError>),
}

/// What the loop waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Awaited {
    /// Whether a frame is wanted yet. Frames stay where they are until one is.
    pub frame: bool,
    /// When to say [`Event::Due`] if nothing else has happened.
    pub deadline: Timestamp,
}

/// Gives events, one after the other, on its own clock.
pub trait EventSource {
    /// The next event. Returns no later than the deadline (a source that follows a recording does not wait at all).
    fn next_event(&mut self, awaited: Awaited) -> Event;

    /// Now, on the clock of [`Awaited::deadline`].
    fn now(&self) -> Timestamp;

    /// The frame after the last one, where it is known already and nothing can take its place: the pipeline may begin
    /// to work on it.
    fn frame_ahead(&mut self) -> Option<&RawFrame> {
        None
    }
}
