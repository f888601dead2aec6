//! Shadows of near light in a known room, Sections 3 to 8 of [Gib03] as corrected: patches, transfers, the sets of
//! sources and receivers, the hierarchy of shafts between them, and what a moving object may hide in a frame.
//! `sources` cuts the marked sources into representatives.

pub mod error;
pub mod faces;
pub mod field;
pub mod fill;
pub mod form_factor;
pub mod frame;
pub mod intensity;
pub mod irradiance;
pub mod marks;
pub mod objects;
pub mod octree;
pub mod patches;
pub mod prepare;
pub mod probe;
pub mod reflectance;
pub mod representatives;
pub mod sets;
pub mod shadow_edges;
pub mod shaft;
pub mod shafts;
pub mod soundness;
pub mod subtract;
pub mod sun_blockers;
pub mod sun_shadows;
pub mod suns;
pub mod transfer;
pub mod two_sets;

#[cfg(test)]
mod fixture;
