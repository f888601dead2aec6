//! What was decided on each effect of a frame, as data: for people (`halflight explain`, the overlay) and for tests.

use super::Pass;

/// Something that a frame may have or do without. Finer than a pass: one pass may draw several effects, and some cost no
/// pass of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Effect {
    /// Exposures merged to linear radiance.
    BracketMerge,
    /// The ball read out of the picture.
    BallUnwrap,
    /// Measured light projected to spherical harmonics.
    ShProjection,
    /// What mirrors and sharp gloss see of the place.
    MirrorPicture,
    /// Shadow maps of hard lights.
    ShadowMaps,
    /// Percentage-closer filtering of the hard shadows.
    ShadowFilter,
    /// Soft shadows of spheres on real surfaces.
    SoftShadows,
    /// Soft light at the vertices of objects: precomputed transfer, and what spheres of others take.
    VertexLight,
    /// Light of a known room at any point, for objects.
    IrradianceVolume,
    /// Shadow maps of a known room's lights.
    NearMaps,
    /// What objects take of a known room's light.
    NearShadows,
    /// Virtual objects.
    Objects,
    /// Shadows laid on real surfaces.
    SurfaceShadows,
    /// Objects over what is left of the place.
    Composition,
    /// Back through the camera's response.
    ToneMapping,
}

impl Effect {
    /// All, in the order of a frame.
    pub const ALL: [Self; 15] = [
        Self::BracketMerge,
        Self::BallUnwrap,
        Self::ShProjection,
        Self::MirrorPicture,
        Self::ShadowMaps,
        Self::ShadowFilter,
        Self::SoftShadows,
        Self::VertexLight,
        Self::IrradianceVolume,
        Self::NearMaps,
        Self::NearShadows,
        Self::Objects,
        Self::SurfaceShadows,
        Self::Composition,
        Self::ToneMapping,
    ];

    /// The pass that draws it, the first of its forms; `None`: it is a part of another's.
    pub fn pass(self) -> Option<Pass> {
        Pass::ALL.into_iter().find(|pass| pass.facts().effect == self)
    }

    /// The pass that it is a part of, where no pass draws it alone.
    pub const fn part_of(self) -> Option<Pass> {
        match self {
            Self::MirrorPicture | Self::VertexLight | Self::IrradianceVolume => Some(Pass::ShadeObject),
            Self::ShadowFilter => Some(Pass::ShadowMaps),
            _ => None,
        }
    }

    /// For tables and JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::BracketMerge => "bracket merge",
            Self::BallUnwrap => "ball unwrap",
            Self::ShProjection => "SH projection",
            Self::MirrorPicture => "mirror picture",
            Self::ShadowMaps => "shadow maps",
            Self::ShadowFilter => "shadow filter",
            Self::SoftShadows => "soft shadows",
            Self::VertexLight => "vertex light",
            Self::IrradianceVolume => "irradiance volume",
            Self::NearMaps => "near maps",
            Self::NearShadows => "near shadows",
            Self::Objects => "objects",
            Self::SurfaceShadows => "surface shadows",
            Self::Composition => "composition",
            Self::ToneMapping => "tone mapping",
        }
    }
}

/// What becomes of an effect in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EffectVerdict {
    /// It is computed.
    On,
    /// The result of an earlier frame is used: computing it anew would give the same bits.
    Kept,
    /// The frame does without.
    Off,
}

impl EffectVerdict {
    /// For tables and JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::On => "on",
            Self::Kept => "kept",
            Self::Off => "off",
        }
    }
}

/// One decision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// On what.
    pub effect: Effect,
    /// What was decided.
    pub verdict: EffectVerdict,
    /// Why, in a few words.
    pub reason: &'static str,
    /// Work that doing without it saves (`on`: would save), in millions of the units of `plan::work`.
    pub saving: f32,
    /// Bound on what doing without it changes (`on`: would change) in any pixel, as a share of what that pixel shows
    /// where nothing is in the way of the light. Infinite: no bound is known. Kept: 0. Off: at most
    /// [`LARGEST_ERROR`](super::LARGEST_ERROR).
    pub error_bound: f32,
}
