//! What blocks the light.

pub mod blockers;
pub mod openness;
pub mod shadow_maps;
