//! Layer 3, the door to the world: cameras, IMUs, displays, command links, recordings, clocks. Implementers owe what the
//! traits say.
//!
//! Every device is asked with a deadline and answers with an item or with one of five [`ErrorKind`]s:
//! `Again` = nothing came by the deadline, nothing is wrong; `Working` = the same, but the device is not silent; `Reopen` = the device went away or lost its state: drop it and
//! open it anew; `Ended` = there is no more, ever; `Refused` = the request itself cannot be met, asking again is useless.
//!
//! What every implementer owes:
//! * **Deadline.** `next` returns at most [`DEADLINE_SLACK_S`] after its deadline. A deadline that has passed means: give
//!   what is there, do not wait. A device that cannot keep this is abandoned ([`supervise`]).
//! * **A time line of its own.** A recording or a synthetic source does not wait. It reads the deadline on its own time
//!   line: `Again` where the next item is later than that. [`Timestamp::NEVER`] asks for the next item whatever its time.
//!   Such a source says `delivers_at_once`; [`pace`] makes a live one of it.
//! * **Order of time.** Items of one source come in strictly increasing time. An item that does not is dropped and counted
//!   by the source.
//! * **No allocation for each item** in steady state: buffers belong to the source and come back to it.
//! * **After an error** other than `Again` the source may be dropped and nothing else; dropping closes the device, is quick,
//!   and does not panic.

use halflight_core::{hdr, model};
use halflight_math as math;

mod asked_source;
pub mod at_hand;
pub mod bracket;
pub mod bracketed;
pub mod clock;
pub mod developed;
pub mod error;
pub mod fake;
#[cfg(feature = "v4l2")]
mod frame_count;
pub mod imu;
#[cfg(feature = "libcamera")]
pub mod libcamera;
pub mod measured;
pub mod null_display;
pub mod open;
pub mod pace;
pub mod parameters;
pub mod primed;
pub mod record;
pub mod recording;
pub mod replay;
pub mod stdio_link;
pub mod supervise;
pub mod synthetic;
pub mod truth;
#[cfg(feature = "v4l2")]
pub mod v4l2;

use crate::model::{
    frame::{Exposure, RawFrame},
    image::Rgb8Image,
    imu::{ImuOrientation, ImuSample},
    pixels::PixelFormat,
    response::Response,
    rig::Rig,
    time::Timestamp,
};
pub use clock::{Clock, Signal};
pub use error::{DeviceError, ErrorKind};
pub use truth::{ImuTruth, Truth};

/// How much later than its deadline a call to a device may return, seconds.
pub const DEADLINE_SLACK_S: f64 = 0.02;

/// A camera. Frames come in order of time; exposure and gain as the sensor truly applied them; `t_mid` on the monotonic
/// clock. May block in `next` until the deadline, and in `set_exposures` for the time of a control transfer (some 10 ms).
pub trait FrameSource: Send {
    /// The next frame. `Again` if none came by the deadline; `Ended` after the last one; `Reopen` where the camera was
    /// pulled out; `Refused` where a frame cannot be what the source promised (a picture of another size than its lens).
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError>;

    /// Asks for a cycle of exposures, used in turn; returns what will really be used. A source that cannot
    /// choose (a recording) returns what it has. `Refused` where a value is out of range.
    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError>;

    /// What the source knows of its rig: lens, tags, ball. `None` where the configuration must say.
    fn rig(&self) -> Option<Rig>;

    /// The response the source states for its camera, if any.
    fn response(&self) -> Option<Response> {
        None
    }

    /// Frames to come, where known (for progress bars).
    fn frames_left(&self) -> Option<u64> {
        None
    }

    /// The truth for the frame last returned, where the source knows it (synthetic, or recorded from synthetic).
    fn truth(&mut self) -> Option<Truth> {
        None
    }

    /// What is before the camera, by name, where the source knows it (synthetic, or a recording that says so).
    fn scene(&self) -> Option<String> {
        None
    }

    /// Returns whether the source has a time line of its own and never waits (a recording, a synthetic room).
    fn delivers_at_once(&self) -> bool {
        false
    }

    /// How the driver's pictures lie in memory; `None` where frames come as 8-bit RGB.
    fn pixel_format(&self) -> Option<PixelFormat> {
        None
    }

    /// What was found of the camera's exposure control; `None` where exposures cannot be written.
    fn bracket_report(&self) -> Option<bracket::Report> {
        None
    }
}

/// An inertial sensor. May block in `next` until the deadline.
pub trait ImuSource: Send {
    /// The next sample: stated on the camera's time line as far as the device knows it, later than the sample before.
    /// `Again` if none came by the deadline; a source with a time line of its own gives nothing later than the deadline.
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError>;

    /// Appends all samples that `next` gives up to the deadline, in order of time. The end of a recording is no error.
    fn samples_until(&mut self, deadline: Timestamp, out: &mut Vec<ImuSample>) -> Result<(), DeviceError> {
        loop {
            match self.next(deadline) {
                Ok(sample) => out.push(sample),
                Err(error)
                    if matches!(error.kind, ErrorKind::Again | ErrorKind::Working | ErrorKind::Ended) =>
                {
                    return Ok(());
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// The orientation at the sample last returned, where the sensor or the source makes one. It stands beside the sample,
    /// so that recordings and all that takes rates stay as they are.
    fn orientation(&self) -> Option<ImuOrientation> {
        None
    }

    /// What is wrong with the sensor, where the source knows it (synthetic, or recorded from synthetic).
    fn imu_truth(&self) -> Option<ImuTruth> {
        None
    }

    /// Returns whether the source has a time line of its own and never waits.
    fn delivers_at_once(&self) -> bool {
        false
    }
}

/// The mode of a display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayMode {
    /// Columns of the picture that `show` takes.
    pub width: usize,
    /// Rows of the picture that `show` takes.
    pub height: usize,
    /// Seconds between two refreshes; `None` where the display is not paced.
    pub period_s: Option<f64>,
}

/// What a display tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DisplayEvent {
    /// The picture last handed to `show` is on the screen.
    Shown {
        /// Time of the refresh that showed it, monotonic clock.
        at: Timestamp,
    },
    /// The screen has another mode; pictures of the old size are refused from now on.
    ModeChanged(DisplayMode),
}

/// A screen or a window. May block in `next` until the deadline; `show` may block for a copy, never for a refresh.
pub trait Display: Send {
    /// The next event. `Again` if none came by the deadline; `Reopen` where the screen was pulled out.
    fn next(&mut self, deadline: Timestamp) -> Result<DisplayEvent, DeviceError>;

    /// Hands over a picture for the next refresh, copied or converted before this returns; [`DisplayEvent::Shown`] says when
    /// it was seen. `Again` while the picture before has not been shown yet; `Refused` where the size is not the mode's;
    /// `Reopen` where the screen is gone.
    fn show(&mut self, picture: &Rgb8Image) -> Result<(), DeviceError>;

    /// The mode as of the last event.
    fn mode(&self) -> DisplayMode;
}

/// One request over a command link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Counts the requests of one link; the reply names it.
    pub id: u64,
    /// One line of text without its end; at most [`Request::LONGEST`] bytes.
    pub text: String,
}

impl Request {
    /// The most bytes in one request; a link drops longer lines and replies that it did.
    pub const LONGEST: usize = 1024;
}

/// A line of requests and replies (serial, socket). May block in `next` until the deadline, in `reply` never: what does not
/// fit into the link's buffer is dropped and counted by the link.
pub trait CommandLink: Send {
    /// The next request, whole. `Again` if none came by the deadline; half a line waits for its end.
    fn next(&mut self, deadline: Timestamp) -> Result<Request, DeviceError>;

    /// Answers the request with this number by one line of text.
    fn reply(&mut self, id: u64, text: &str) -> Result<(), DeviceError>;
}

impl<S: FrameSource + ?Sized> FrameSource for Box<S> {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        (**self).next(deadline)
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        (**self).set_exposures(exposures)
    }

    fn rig(&self) -> Option<Rig> {
        (**self).rig()
    }

    fn response(&self) -> Option<Response> {
        (**self).response()
    }

    fn frames_left(&self) -> Option<u64> {
        (**self).frames_left()
    }

    fn truth(&mut self) -> Option<Truth> {
        (**self).truth()
    }

    fn scene(&self) -> Option<String> {
        (**self).scene()
    }

    fn delivers_at_once(&self) -> bool {
        (**self).delivers_at_once()
    }

    fn bracket_report(&self) -> Option<bracket::Report> {
        (**self).bracket_report()
    }
}

impl<I: ImuSource + ?Sized> ImuSource for Box<I> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        (**self).next(deadline)
    }

    fn orientation(&self) -> Option<ImuOrientation> {
        (**self).orientation()
    }

    fn imu_truth(&self) -> Option<ImuTruth> {
        (**self).imu_truth()
    }

    fn delivers_at_once(&self) -> bool {
        (**self).delivers_at_once()
    }
}
