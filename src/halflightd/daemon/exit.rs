//! Exit statuses of both programs; docs/exit-codes.md is their table.

use crate::device::ErrorKind;
use crate::pipeline::PipelineError;

/// All is done.
pub const DONE: u8 = 0;
/// A bound that was asked for is broken, or a comparison failed.
pub const FAILED: u8 = 1;
/// What was asked for cannot be done as it was asked: usage, settings, input, output.
pub const INPUT: u8 = 2;
/// A device or an engine failed, or is not there.
pub const DEVICE: u8 = 3;
/// A signal ended it, and work is lost: 128 and the signal's number, as a shell has it.
pub const INTERRUPTED: u8 = 130;

/// The status for what ended a pipeline. Settings that can never work are [`INPUT`]; what may come right by itself is
/// [`DEVICE`].
pub fn status_of(error: &PipelineError) -> u8 {
    match error {
        PipelineError::Device(error) if error.kind == ErrorKind::Refused => INPUT,
        PipelineError::Setup(_) => INPUT,
        PipelineError::Device(_)
        | PipelineError::Engine(_)
        | PipelineError::Tracking(_)
        | PipelineError::Output(_) => DEVICE,
    }
}
