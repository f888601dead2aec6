//! Pictures from a node: buffers that go back to the driver when their picture is dropped, the newest picture first, and what
//! was lost counted.

use super::node::{ENODEV, Filled, Ready, VideoNode};
use crate::frame_count::FrameCount;
use crate::model::pixels::{FramePixels, PixelLayout, PixelMemory, PixelPool};
use std::io;
use std::time::Duration;

/// Buffers that a driver is asked for: one being filled, one waiting, one in hand, and one for a slow moment.
const BUFFERS: u32 = 4;

/// What a stream has lost so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounts {
    /// Frames that the driver's count says were made and that never came.
    pub gaps: u64,
    /// Pictures that the driver called damaged, or that were shorter than they must be.
    pub damaged: u64,
    /// Pictures that were passed over for a newer one.
    pub passed_over: u64,
}

/// A picture with what the driver said of it.
pub struct StreamedPicture {
    /// Number of the frame, counting on where the driver's 32 bits wrap.
    pub sequence: u64,
    /// What the driver said.
    pub filled: Filled,
    /// The bytes.
    pub pixels: FramePixels,
}

/// Why no picture came.
#[derive(Debug)]
pub enum StreamError {
    /// None by the deadline.
    Nothing,
    /// The camera is gone.
    Gone,
    /// The driver refuses.
    Driver(&'static str, io::Error),
}

/// A running stream. Dropping it stops the node.
pub struct Stream<N: VideoNode> {
    node: N,
    layout: PixelLayout,
    pool: PixelPool<N::Memory>,
    sequence: FrameCount,
    counts: StreamCounts,
}

impl<N: VideoNode> Stream<N> {
    /// Makes buffers, hands them to the driver and starts. The format is set already.
    pub fn start(mut node: N, layout: PixelLayout) -> Result<Self, StreamError> {
        let buffers = node.buffers(BUFFERS).map_err(|e| StreamError::Driver("make buffers", e))?;
        if buffers.len() < 2 {
            let why = io::Error::other(format!("{} buffers; at least 2 are needed", buffers.len()));
            return Err(StreamError::Driver("make buffers", why));
        }
        for index in 0..buffers.len() {
            node.queue(index).map_err(|e| StreamError::Driver("hand over a buffer", e))?;
        }
        node.start().map_err(|e| StreamError::Driver("start the stream", e))?;
        let exported = buffers.iter().filter(|buffer| buffer.dma_buf().is_some()).count();
        tracing::debug!("{} buffers, {exported} of them exported as DMA-BUF", buffers.len());
        let pool = PixelPool::new(buffers);
        Ok(Self { node, layout, pool, sequence: FrameCount::default(), counts: StreamCounts::default() })
    }

    /// The node, for its controls.
    pub fn node(&self) -> &N {
        &self.node
    }

    /// What was lost so far.
    pub fn counts(&self) -> StreamCounts {
        StreamCounts { gaps: self.sequence.gaps, ..self.counts }
    }

    /// The newest picture; waits for one so long at most. Older ones that wait go back to the driver.
    pub fn next(&mut self, longest: Duration) -> Result<StreamedPicture, StreamError> {
        while let Some(index) = self.pool.take_back() {
            self.queue(index)?;
        }
        if let Some(picture) = self.newest()? {
            return Ok(picture);
        }
        match self.node.wait(longest).map_err(|e| failed("wait for a frame", e))? {
            Ready::Gone => Err(StreamError::Gone),
            Ready::Nothing => Err(StreamError::Nothing),
            Ready::Filled => self.newest()?.ok_or(StreamError::Nothing),
        }
    }

    fn newest(&mut self) -> Result<Option<StreamedPicture>, StreamError> {
        let mut newest: Option<(u64, Filled)> = None;
        while let Some(filled) = self.node.dequeue().map_err(|e| failed("take a frame", e))? {
            let sequence = self.sequence.next(filled.sequence);
            if filled.has_error || filled.used.saturating_sub(filled.skipped) < self.layout.least_bytes() {
                self.counts.damaged += 1;
                self.queue(filled.index)?;
                continue;
            }
            if let Some((_, older)) = newest.replace((sequence, filled)) {
                self.counts.passed_over += 1;
                self.queue(older.index)?;
            }
        }
        let Some((sequence, filled)) = newest else { return Ok(None) };
        match self.pool.lend(filled.index, self.layout, filled.used) {
            Some(Ok(pixels)) => {
                // What is refused here is dropped, and comes back by itself.
                let pixels = pixels.after(filled.skipped).ok();
                self.counts.damaged += u64::from(pixels.is_none());
                Ok(pixels.map(|pixels| StreamedPicture { sequence, filled, pixels }))
            }
            // A driver that says more bytes than its buffer has, or names a buffer that it does not hold.
            Some(Err(_)) => {
                self.counts.damaged += 1;
                self.queue(filled.index)?;
                Ok(None)
            }
            None => {
                self.counts.damaged += 1;
                Ok(None)
            }
        }
    }

    fn queue(&mut self, index: usize) -> Result<(), StreamError> {
        self.node.queue(index).map_err(|e| failed("hand back a buffer", e))
    }
}

fn failed(action: &'static str, error: io::Error) -> StreamError {
    match error.raw_os_error() {
        Some(ENODEV) => StreamError::Gone,
        _ => StreamError::Driver(action, error),
    }
}

impl<N: VideoNode> Drop for Stream<N> {
    fn drop(&mut self) {
        // Nothing can be done where the camera is gone.
        let _ = self.node.stop();
    }
}
