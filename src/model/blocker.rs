//! Spheres that stand for virtual objects where these block soft light (Section 6.2 of [Now11]).

use glam::Vec3;

/// One such sphere, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockerSphere {
    /// Centre, metres.
    pub centre_world: Vec3,
    /// Radius, metres, above 0.
    pub radius_m: f32,
    /// Which body it belongs to: a body's own surface does not count its own spheres.
    pub body: u32,
}
