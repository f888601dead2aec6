//! A camera whose first frame has come: what it finds out at its start is known.

use crate::model::{
    frame::{Exposure, RawFrame},
    response::Response,
    rig::Rig,
    time::Timestamp,
};
use crate::{DeviceError, FrameSource, Truth};

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

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        self.source.set_exposures(exposures)
    }

    fn rig(&self) -> Option<Rig> {
        self.source.rig()
    }

    fn response(&self) -> Option<Response> {
        self.source.response()
    }

    fn frames_left(&self) -> Option<u64> {
        self.source.frames_left()
    }

    fn truth(&mut self) -> Option<Truth> {
        self.source.truth()
    }

    fn scene(&self) -> Option<String> {
        self.source.scene()
    }

    fn delivers_at_once(&self) -> bool {
        self.source.delivers_at_once()
    }
}
