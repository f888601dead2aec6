//! Where the camera is.

pub mod plane;
pub mod tag;
pub mod tag_pose;
