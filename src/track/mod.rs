//! Where the camera is: tags, their poses, the plane that they lie in.

#[cfg(test)]
pub(crate) mod drawing;
pub mod edges;
pub mod plane;
pub mod refine;
pub mod rig_pose;
pub mod state;
pub mod tag;
pub mod tag_pose;
