//! A frame is data before it is work: the list of passes, each with its reason. Engines allocate and dispatch
//! exactly this list. What was decided on each effect, what that saves and what it can cost stands beside it.

pub mod bounds;
pub mod cost;
pub mod decision;
pub mod effects;
pub mod foresight;
pub mod front;
pub mod governor;
mod look;
pub mod pass;
mod view_cone;
pub mod work;

pub use decision::{Decision, Effect, EffectVerdict};
pub use foresight::Foresight;
pub use pass::{Pass, PassSet, Product};

use crate::model::quality::Quality;

/// Effects are left out only where that changes no pixel by a larger share of what it shows where nothing is in the way of
/// the light: half a step of 8 bits at white through sRGB.
pub const LARGEST_ERROR: f32 = 0.002;

/// A pass that this frame runs, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedPass {
    /// Which.
    pub pass: Pass,
    /// Why it is called for, in a few words.
    pub reason: &'static str,
}

/// The work of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FramePlan {
    /// Those that are dispatched, in order.
    pub passes: Vec<PlannedPass>,
    /// Those whose result of an earlier frame is used.
    pub kept: Vec<PlannedPass>,
    /// Passes left out, and why.
    pub left_out: Vec<PlannedPass>,
    /// The camera's own picture is shown as it is: no pass is needed for that.
    pub passes_through: bool,
    /// What was decided on each effect, in the order of [`Effect::ALL`].
    pub decisions: Vec<Decision>,
    /// Accuracy settings of this frame.
    pub quality: Quality,
}

impl FramePlan {
    /// Whether a pass is dispatched.
    pub fn has(&self, pass: Pass) -> bool {
        self.passes.iter().any(|p| p.pass == pass)
    }

    /// Whether the result of an earlier frame is used for a pass.
    pub fn keeps(&self, pass: Pass) -> bool {
        self.kept.iter().any(|p| p.pass == pass)
    }

    /// All passes whose results the picture is drawn from: dispatched, or kept.
    pub fn uses(&self) -> PassSet {
        let mut set = PassSet::default();
        self.passes.iter().chain(&self.kept).for_each(|p| set.insert(p.pass));
        set
    }

    /// What was decided on an effect.
    pub fn decision(&self, effect: Effect) -> Option<&Decision> {
        self.decisions.iter().find(|d| d.effect == effect)
    }
}

/// How long one pass took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassTiming {
    /// Which.
    pub pass: Pass,
    /// Milliseconds, by timestamp queries or fenced wall time.
    pub ms: f32,
}
