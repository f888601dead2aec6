//! Layer 1: plain data. No behaviour beyond keeping its own invariants, no file formats: what a cache keeps derives serde's
//! traits (`keep`).

pub mod animation;
pub mod base64;
pub mod blocker;
pub mod environment;
pub mod estimate;
pub mod frame;
pub mod image;
pub mod imu;
pub mod jpeg;
pub mod keep;
pub mod light;
pub mod limits;
pub mod path_text;
pub mod picture;
pub mod pixels;
pub mod quality;
pub mod response;
pub mod rig;
pub mod room;
pub mod scene;
pub mod sensor;
pub mod time;
pub mod transfer;
