//! Layer 5: wiring. From settings to a running pipeline.

pub mod blocker_spheres;
pub mod cache_folder;
pub mod engines;
mod governing;
pub mod host;
pub mod known_room;
pub mod live_settings;
pub mod picture_folder;
pub mod run;
pub mod vertex_transfer;
