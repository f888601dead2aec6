//! A camera whose first frame has come: what it finds out at its start is known.

use crate::asked_source::ask_source;
use crate::model::{frame::RawFrame, time::Timestamp};
use crate::{DeviceError, FrameSource};

/// A source with its first frame in hand, which `next` gives first.
pub struct PrimedSource<S> {
    source: S,
    first: Option<RawFrame>,
}

impl<S: FrameSource> PrimedSource<S> {
    /// Takes a source and the frame that it gave.
    pub fn new(source: S, first: Option<RawFrame>) -> Self {
        Self { source, first }
    }
}

impl<S: FrameSource> FrameSource for PrimedSource<S> {
    fn next(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        self.first.take().map_or_else(|| self.source.next(deadline), Ok)
    }

    ask_source!(set_exposures rig response frames_left truth scene delivers_at_once pixel_format bracket_report);
}
