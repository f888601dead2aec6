//! What is known of a frame once it is done.

use crate::model::{
    estimate::{LightEstimate, PoseEstimate},
    time::Timestamp,
};
use crate::plan::governor::Choice;

/// What the viewer got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The camera picture with virtual objects and their shadows.
    Relit,
    /// The camera picture alone, and why.
    PassedThrough(&'static str),
}

impl Shown {
    /// Whether virtual objects are missing.
    pub fn is_passed_through(self) -> bool {
        matches!(self, Self::PassedThrough(_))
    }
}

/// A stage of the pipeline, for timings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Find tags, solve the pose.
    Track,
    /// Warp older frames into this view.
    Register,
    /// Merge to linear radiance.
    Merge,
    /// Read the light and split it.
    Light,
    /// Shade, composite, back through the response.
    Relight,
    /// All of it.
    Frame,
}

impl Stage {
    /// All, in order.
    pub const ALL: [Self; 6] =
        [Self::Track, Self::Register, Self::Merge, Self::Light, Self::Relight, Self::Frame];

    /// For tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Track => "track",
            Self::Register => "register",
            Self::Merge => "merge",
            Self::Light => "light",
            Self::Relight => "relight",
            Self::Frame => "frame",
        }
    }
}

/// What is known of a frame once it is done.
#[derive(Clone, Debug)]
pub struct FrameOutcome {
    /// The source's count.
    pub sequence: u64,
    /// Middle of its exposure.
    pub t: Timestamp,
    /// Where the camera was, if known.
    pub pose: Option<PoseEstimate>,
    /// The light, if known.
    pub light: Option<LightEstimate>,
    /// What the viewer got.
    pub shown: Shown,
    /// Wall time of each stage, milliseconds, in the order of `Stage::ALL`.
    pub stage_ms: [f32; Stage::ALL.len()],
    /// What the governor has chosen for the next frame, where there is one.
    pub choice: Option<Choice>,
}
