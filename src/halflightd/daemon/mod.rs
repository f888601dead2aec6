//! Layer 7: wiring. From settings to a running pipeline.

pub mod blocker_spheres;
pub mod cache_folder;
pub mod commands;
pub mod dress;
pub mod engines;
pub mod environment;
pub mod exit;
mod governing;
pub mod host;
pub mod known_room;
pub mod log;
pub mod picture_folder;
pub mod prepare;
pub mod run;
pub mod settings_thread;
pub mod stop_signals;
pub mod version;
pub mod vertex_transfer;
pub mod watchdog;
pub mod watcher;
