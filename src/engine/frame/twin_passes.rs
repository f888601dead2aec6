//! The door by which an engine on a device runs single passes on their twins (`--cpu KERNEL`, and what the device cannot
//! hold). The engine on the processor stands behind it; `crate::door` opens it.

use super::{FrameJob, FrameState};
use crate::model::picture::Picture;
use crate::plan::{Pass, PassSet};

/// The twins of all drawing passes.
pub(crate) trait TwinPasses: Send {
    /// A frame begins that uses these passes: frees the twins' own memory of all others.
    fn begin(&mut self, uses: PassSet);

    /// Runs a pass. What it reads is in `state` (of `Tonemap`: in `out`), and what it writes goes there; passes that measure
    /// do nothing here.
    fn run(&mut self, pass: Pass, job: &FrameJob<'_>, state: &mut FrameState, out: &mut Picture);
}
