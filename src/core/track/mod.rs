//! Where the camera is: tags, their poses, the plane that they lie in.

pub mod align;
pub mod blurred;
pub mod drawing;
pub mod edges;
pub mod fuse;
pub mod minima;
pub mod normal;
pub mod plane;
pub mod refine;
pub mod region;
pub mod rig_pose;
pub mod state;
pub mod tag;
pub mod tag_pose;
pub mod template;
