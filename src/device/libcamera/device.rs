//! What a camera of libcamera can be asked, so that a test can stand in for it.

use super::exposure::{ExposureMetadata, RequestControls};
use super::format::{GrantedStream, RoleChoice, RoleOffer};
use crate::model::pixels::{PixelLayout, PixelMemory};
use crate::v4l2::node::Ready;
use std::io;
use std::time::Duration;

/// A request that has come back with its picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CompletedRequest {
    /// Number of the request and of its buffer.
    pub index: usize,
    /// Bytes of the picture.
    pub used: usize,
    /// Counts the camera's frames, with those that were lost.
    pub sequence: u32,
    /// Whether the request was cancelled or the picture is damaged.
    pub has_error: bool,
    /// How long ago the frame's exposure began, nanoseconds; `None` where its time is missing or on a clock that is not known.
    pub age_ns: Option<i64>,
    /// What it says of the exposure.
    pub metadata: ExposureMetadata,
}

/// A camera that takes requests; dropping it stops it. A request is a buffer with what its frame shall be exposed with. No call waits, but for `wait`
/// and for what starts and stops the camera.
pub trait RequestDevice: Send {
    /// A buffer of the camera.
    type Memory: PixelMemory + 'static;

    /// What it lists, for all roles.
    fn offers(&self) -> io::Result<Vec<RoleOffer>>;
    /// Asks for a stream; the camera gives the nearest that it has.
    fn configure(&mut self, choice: &RoleChoice) -> io::Result<GrantedStream>;
    /// Makes as many requests as the stream has buffers, and starts. `controls` are those of the first frames.
    fn start(&mut self, layout: &PixelLayout, controls: &RequestControls) -> io::Result<Vec<Self::Memory>>;
    /// Returns whether requests may ask for an exposure. Known once the camera has started.
    fn takes_exposures(&self) -> bool;
    /// Hands over a request.
    fn queue(&mut self, index: usize, controls: &RequestControls) -> io::Result<()>;
    /// The next request that has come back, if any.
    fn completed(&mut self) -> Option<CompletedRequest>;
    /// Waits until a request comes back or the camera is gone, so long at most.
    fn wait(&mut self, longest: Duration) -> io::Result<Ready>;
}
