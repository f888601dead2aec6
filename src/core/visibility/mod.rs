//! What blocks the light.

pub mod blockers;
pub mod fit_boxes;
pub mod fit_spheres;
pub mod lobes;
pub mod openness;
pub mod point_maps;
pub mod proxies;
pub mod shadow_maps;
pub mod transfer;
