//! Measured facts of one rig: camera, tag and ball.

use crate::math::{lens::Lens, pose::Pose};
use glam::DVec3;

/// A mirror ball at a known place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorBall {
    /// Centre, world frame, metres.
    pub centre_world: DVec3,
    /// Metres.
    pub radius_m: f64,
    /// Share of the light that it reflects, linear RGB within (0, 1].
    pub reflectance_rgb: [f32; 3],
    /// The surface under the ball is flat this far around it, metres; `None`: 12 radii of the ball.
    pub surface_radius_m: Option<f64>,
}

/// A tag36h11 tag at a known place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagPlacement {
    /// Its number.
    pub id: u32,
    /// Length of the black square's side, metres.
    pub side_m: f64,
    /// Tag frame (x right, y down in the tag's picture, z into the tag) to world.
    pub world_from_tag: Pose,
}

/// What is known of the set-up before the first frame: camera, tags, ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// The camera's lens.
    pub lens: Lens,
    /// Known tags.
    pub tags: Vec<TagPlacement>,
    /// The ball, where there is one.
    pub ball: Option<MirrorBall>,
}
