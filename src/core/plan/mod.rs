//! A frame is data before it is work: the list of passes, each with its reason. Engines allocate and dispatch
//! exactly this list. What was decided on each effect, what that saves and what it can cost stands beside it.

pub mod bounds;
pub mod cost;
pub mod decision;
pub mod effects;
pub mod foresight;
pub mod front;
pub mod governor;
mod view_cone;
pub mod work;

pub use decision::{Decision, Effect, Verdict};
pub use foresight::Foresight;

use crate::model::quality::Quality;

/// A pass that an engine knows. Its name is the kernel's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Pass {
    /// `hdr/merge_bracket`
    MergeBracket,
    /// `light/unwrap_ball`
    UnwrapBall,
    /// `light/project_sh`
    ProjectSh,
    /// `visibility/shadow_maps`
    ShadowMaps,
    /// `compose/soft_shadow`: what virtual objects, as spheres, take of the soft light on real surfaces.
    SoftShadow,
    /// `visibility/point_maps`: the shadow maps of a known room's lights.
    PointMaps,
    /// `nearfield/subtract`: what virtual objects leave of a known room's light, as a ratio for each pixel.
    Subtract,
    /// `nearfield/subtract_displayed`: the same, taken from 8-bit values light by light.
    SubtractDisplayed,
    /// `compose/shade_object`: objects into a layer of premultiplied radiance and coverage, hidden by real surfaces.
    ShadeObject,
    /// `compose/shade_surface`: what virtual objects leave of the light on real surfaces, as a ratio for each pixel.
    ShadeSurface,
    /// `compose/composite`: background x ratio under the object layer.
    Composite,
    /// `compose/tonemap`: back through the camera's response.
    Tonemap,
}

impl Pass {
    /// The kernel's name: stem of the twin and of the shader.
    pub const fn name(self) -> &'static str {
        match self {
            Self::MergeBracket => "hdr/merge_bracket",
            Self::UnwrapBall => "light/unwrap_ball",
            Self::ProjectSh => "light/project_sh",
            Self::ShadowMaps => "visibility/shadow_maps",
            Self::SoftShadow => "compose/soft_shadow",
            Self::PointMaps => "visibility/point_maps",
            Self::Subtract => "nearfield/subtract",
            Self::SubtractDisplayed => "nearfield/subtract_displayed",
            Self::ShadeObject => "compose/shade_object",
            Self::ShadeSurface => "compose/shade_surface",
            Self::Composite => "compose/composite",
            Self::Tonemap => "compose/tonemap",
        }
    }

    /// All passes in the order in which a frame runs them.
    pub const ALL: [Self; 12] = [
        Self::MergeBracket,
        Self::UnwrapBall,
        Self::ProjectSh,
        Self::ShadowMaps,
        Self::SoftShadow,
        Self::PointMaps,
        Self::Subtract,
        Self::SubtractDisplayed,
        Self::ShadeObject,
        Self::ShadeSurface,
        Self::Composite,
        Self::Tonemap,
    ];
}

impl Pass {
    /// Whether it measures the light rather than draws: engines have calls of their own for those.
    pub const fn is_measuring(self) -> bool {
        matches!(self, Self::MergeBracket | Self::UnwrapBall | Self::ProjectSh)
    }

    /// The passes whose results it reads where they are there.
    pub const fn reads(self) -> PassSet {
        match self {
            Self::Subtract | Self::SubtractDisplayed | Self::ShadeObject => {
                PassSet::of(&[Self::ShadowMaps, Self::PointMaps])
            }
            Self::ShadeSurface => PassSet::of(&[Self::ShadowMaps, Self::SoftShadow]),
            Self::Composite => {
                PassSet::of(&[Self::Subtract, Self::SubtractDisplayed, Self::ShadeObject, Self::ShadeSurface])
            }
            Self::Tonemap => PassSet::of(&[Self::Composite]),
            _ => PassSet::of(&[]),
        }
    }
}

/// Some of the passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PassSet(u16);

impl PassSet {
    /// These.
    pub const fn of(passes: &[Pass]) -> Self {
        let (mut bits, mut i) = (0, 0);
        while i < passes.len() {
            bits |= 1 << passes[i] as u16;
            i += 1;
        }
        Self(bits)
    }

    /// Adds one.
    pub fn insert(&mut self, pass: Pass) {
        self.0 |= 1 << pass as u16;
    }

    /// Whether one is among them.
    pub const fn has(self, pass: Pass) -> bool {
        self.0 >> pass as u16 & 1 == 1
    }

    /// Those that are in both.
    pub const fn meet(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// In the order of a frame.
    pub fn iter(self) -> impl Iterator<Item = Pass> {
        Pass::ALL.into_iter().filter(move |pass| self.has(*pass))
    }
}

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
