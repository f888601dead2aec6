//! All settings that trade accuracy for time, in one value that travels with the frame.

use super::{blocker::Rung, light::MAX_LIGHTS};
use crate::math::sh::zonal::PhongNorm;

/// What becomes of the light: how much of it is hard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SplitKind {
    /// Up to four compact lights with their extent, found in the picture of the environment; the rest in SH.
    #[default]
    Compact,
    /// One directional light by net flux, Section 5 of [Now11] as corrected.
    Paper,
    /// The paper's, but no more than every band of the harmonics allows: where only SH is known of the light.
    Bounded,
    /// None: all light in SH.
    Sh,
}

impl SplitKind {
    /// All, as they are called in settings.
    pub const NAMES: [&str; 4] = ["compact", "paper", "bounded", "sh"];

    /// As in settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Compact => "compact",
            Self::Paper => "paper",
            Self::Bounded => "bounded",
            Self::Sh => "sh",
        }
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Compact, Self::Paper, Self::Bounded, Self::Sh].into_iter().find(|k| k.name() == name)
    }
}

/// How an object's own shadow under soft light is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SelfShadow {
    /// The soft light times the share of the hemisphere that each vertex leaves open.
    Openness,
    /// By precomputed transfer, where the object never moves; else by its openness.
    #[default]
    Transfer,
}

impl SelfShadow {
    /// All, as they are called in settings.
    pub const NAMES: [&str; 2] = ["openness", "transfer"];

    /// As in settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Openness => "openness",
            Self::Transfer => "transfer",
        }
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Openness, Self::Transfer].into_iter().find(|k| k.name() == name)
    }
}

/// Where soft shadows on real surfaces are evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SoftAt {
    /// For pixels, each or one of several (`Quality::soft_step_px`).
    #[default]
    Pixel,
    /// At the vertices of the surfaces, cut as finely as the shadow asks, and interpolated between them.
    Vertex,
}

impl SoftAt {
    /// All, as they are called in settings.
    pub const NAMES: [&str; 2] = ["pixel", "vertex"];

    /// As in settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Vertex => "vertex",
        }
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Pixel, Self::Vertex].into_iter().find(|k| k.name() == name)
    }
}

/// Which effects a frame has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effects {
    /// Those that the scene, the light and the view call for; what has not changed is kept.
    #[default]
    CalledFor,
    /// All that there is anything for, each made anew in every frame.
    All,
}

impl Effects {
    /// All, as they are called in settings.
    pub const NAMES: [&str; 2] = ["called_for", "all"];

    /// As in settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::CalledFor => "called_for",
            Self::All => "all",
        }
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::CalledFor, Self::All].into_iter().find(|k| k.name() == name)
    }
}

/// How what objects hide of a known room's light is taken from the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NearForm {
    /// In linear light, as a ratio: exact, whatever the order.
    #[default]
    Ratio,
    /// From 8-bit values, light by light, as [Gib03] did where displays could do no more.
    Ldr,
}

impl NearForm {
    /// All, as they are called in settings.
    pub const NAMES: [&str; 2] = ["ratio", "ldr"];

    /// As in settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ratio => "ratio",
            Self::Ldr => "ldr",
        }
    }

    /// Parses a name; `None` for one that is not known.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Ratio, Self::Ldr].into_iter().find(|k| k.name() == name)
    }
}

/// Accuracy settings of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Which effects there are.
    pub effects: Effects,
    /// What becomes of the light.
    pub split: SplitKind,
    /// How the visibility of many spheres is put together where they block soft light.
    pub rung: Rung,
    /// Directions that the rung `directions` tests, 32 to 256.
    pub directions: usize,
    /// Where soft shadows on real surfaces are evaluated.
    pub soft_at: SoftAt,
    /// Soft shadows on real surfaces are drawn on every n-th pixel of every n-th row: 1, 2 or 4.
    pub soft_step_px: u32,
    /// The soft half is damped until it shines negatively on no surface, and no more.
    pub dering: bool,
    /// Compact lights that are looked for: 1 to 4.
    pub lights: usize,
    /// n: hard lights, each with a shadow map, that compact lights are cut into, 1 to 64; in a known room its suns and near
    /// lights together, 1 to 256.
    pub shadow_maps: usize,
    /// In a known room more near lights are drawn than `shadow_maps`, up to four times as many, while they are wider than
    /// this on average, seen from the objects, degrees: 0 to 90, where 90 means never more.
    pub near_width_deg: f32,
    /// Spheres that stand for every body that blocks soft light, 4 to 64; 0: as many as the scene asks for.
    pub spheres: usize,
    /// SH order of the light, 2 to 6.
    pub sh_order: usize,
    /// How an object's own shadow under soft light is found.
    pub self_shadow: SelfShadow,
    /// How Phong lobes are scaled.
    pub phong_norm: PhongNorm,
    /// Shadow map texels a side, 64 to 4096.
    pub shadow_map_texels: u32,
    /// Taps a side of the percentage-closer filter, 1 to 8. In a known room: places a side on each light that its shadow comes
    /// from.
    pub pcf_taps: u32,
    /// How a known room's light is taken away.
    pub near_form: NearForm,
    /// Coverage samples a pixel at object edges: 1 or 4.
    pub coverage_samples: u32,
    /// Frames merged into one HDR picture, 1 to 9.
    pub brackets: usize,
    /// The light is measured on every n-th frame, 1 or more.
    pub light_every: u32,
}

impl Quality {
    /// [`Quality::near_width_deg`] in radians; infinite where more lights than `shadow_maps` are never drawn.
    pub fn near_width_rad(&self) -> f32 {
        if self.near_width_deg < 90.0 { self.near_width_deg.to_radians() } else { f32::INFINITY }
    }
}

impl Default for Quality {
    fn default() -> Self {
        Self {
            effects: Effects::CalledFor,
            split: SplitKind::Compact,
            rung: Rung::Directions,
            directions: 128,
            soft_at: SoftAt::Pixel,
            soft_step_px: 4,
            dering: false,
            lights: MAX_LIGHTS,
            shadow_maps: 8,
            near_width_deg: 8.0,
            spheres: 0,
            sh_order: 4,
            self_shadow: SelfShadow::Transfer,
            phong_norm: PhongNorm::EnergySafe,
            shadow_map_texels: 1024,
            pcf_taps: 4,
            near_form: NearForm::Ratio,
            coverage_samples: 4,
            brackets: 3,
            light_every: 1,
        }
    }
}
