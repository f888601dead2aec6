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

/// Half the width of a webcam's picture, radians, where nobody has measured the lens.
const GUESSED_HALF_WIDTH: f64 = 30.0 / 180.0 * std::f64::consts::PI;

impl Rig {
    /// A guess for a camera that nobody has measured: 60 degrees wide, no distortion; tags and ball are not known.
    pub fn guessed(width: u32, height: u32) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let focal = 0.5 * w / GUESSED_HALF_WIDTH.tan();
        let lens = Lens::pinhole(width, height, focal, focal, 0.5 * w, 0.5 * h);
        Self { lens, tags: Vec::new(), ball: None }
    }
}
