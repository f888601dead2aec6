//! A frame is data before it is work: the list of passes, each with its reason. Engines allocate and dispatch
//! exactly this list.

pub mod effects;

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
    /// In order.
    pub passes: Vec<PlannedPass>,
    /// Passes left out, and why.
    pub left_out: Vec<PlannedPass>,
    /// Accuracy settings of this frame.
    pub quality: Quality,
}

impl FramePlan {
    /// Whether a pass is called for.
    pub fn has(&self, pass: Pass) -> bool {
        self.passes.iter().any(|p| p.pass == pass)
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
