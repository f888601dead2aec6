//! The one place that knows both engines: the engine on a device asks here for the twins that it runs single passes on.

use crate::{cpu::Twins, frame::TwinPasses};

/// Twins with memory of their own.
pub(crate) fn twins() -> Box<dyn TwinPasses> {
    Box::<Twins>::default()
}
