//! What an engine knows of a frame before it is planned: which results of earlier frames it holds that would come out the
//! same to the last bit.

use super::{Pass, PassSet};

/// Of one frame. As made by `default` an engine holds nothing, and nothing is known of what it would find.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Foresight {
    /// For each pass in the order of [`Pass::ALL`] whether its result is held and would come out the same again from the
    /// results of these passes; `None`: it would not, or is not held.
    pub held: [Option<PassSet>; Pass::ALL.len()],
    /// Shadow maps that throw a shadow on something that is seen; `None`: not known.
    pub maps_seen: Option<usize>,
    /// Whether the soft light at the vertices of objects would come out the same again.
    pub vertex_light_is_held: bool,
    /// Whether what mirrors see is the picture of the last frame.
    pub mirror_picture_is_held: bool,
}

impl Foresight {
    /// Nothing is held, nothing is known.
    pub const NONE: Self = Self {
        held: [None; Pass::ALL.len()],
        maps_seen: None,
        vertex_light_is_held: false,
        mirror_picture_is_held: false,
    };

    /// Whether a pass's result is held, in a frame that has these passes' results.
    pub fn holds(&self, pass: Pass, frame: PassSet) -> bool {
        self.held[pass as usize].is_some_and(|with| with.meet(pass.reads()) == frame.meet(pass.reads()))
    }
}
