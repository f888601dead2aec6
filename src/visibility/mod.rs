//! What blocks the light.

pub mod openness;
pub mod shadow_maps;
