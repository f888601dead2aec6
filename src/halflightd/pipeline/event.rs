//! Everything that can happen to the pipeline: one closed enum, one loop.

use super::{Change, Pipeline, PipelineError, feed::Feed, frame::FrameOutcome};
use crate::device::{DeviceError, Truth};
use crate::model::{frame::RawFrame, picture::Picture};

/// What can happen.
#[derive(Debug)]
pub enum Event {
    /// A frame, and how many were passed over since the last one because newer ones came.
    Frame {
        /// The frame.
        frame: RawFrame,
        /// Frames passed over by the feed.
        passed_over: u64,
        /// What the source knows of this frame, where it does.
        truth: Option<Box<Truth>>,
    },
    /// Settings have changed.
    Changed(Box<Change>),
    /// No frame came in time.
    Nothing,
    /// The source has no more.
    Ended,
    /// The source failed for good.
    Failed(DeviceError),
}

/// Takes finished pictures, on the pipeline's thread.
pub trait FrameSink {
    /// One picture with what is known of its frame. `false` asks to stop.
    fn accept(
        &mut self,
        raw: &RawFrame,
        truth: Option<&Truth>,
        outcome: &FrameOutcome,
        picture: &Picture,
    ) -> Result<bool, PipelineError>;
}

/// What one run did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunCounts {
    /// Frames that went through.
    pub frames: u64,
    /// Frames that the feed passed over for newer ones.
    pub passed_over: u64,
    /// Frames that are missing in the source's count.
    pub lost_by_source: u64,
    /// Frames shown without virtual objects.
    pub passed_through: u64,
}

/// Feeds events to the pipeline until the source ends, `frames` (0 = no limit) have gone through, or the sink asks to stop.
pub fn run(
    feed: &mut dyn Feed,
    pipeline: &mut Pipeline,
    sink: &mut dyn FrameSink,
    frames: u64,
) -> Result<RunCounts, PipelineError> {
    let mut counts = RunCounts::default();
    let mut last_sequence: Option<u64> = None;
    loop {
        match feed.next_event() {
            Event::Frame { frame, passed_over, truth } => {
                counts.passed_over += passed_over;
                if let Some(last) = last_sequence {
                    counts.lost_by_source +=
                        frame.sequence.saturating_sub(last + 1).saturating_sub(passed_over);
                }
                last_sequence = Some(frame.sequence);
                let outcome = pipeline.frame(&frame)?;
                counts.frames += 1;
                counts.passed_through += u64::from(outcome.shown.is_passed_through());
                let go_on = sink.accept(&frame, truth.as_deref(), &outcome, pipeline.picture())?;
                if !go_on || (frames > 0 && counts.frames >= frames) {
                    return Ok(counts);
                }
            }
            Event::Changed(change) => pipeline.change(*change)?,
            Event::Nothing => {}
            Event::Ended => return Ok(counts),
            Event::Failed(error) => return Err(PipelineError::Device(error)),
        }
    }
}
