//! Estimates: every one says when, and how good.

use super::{
    light::{Lights, RadianceSh, SplitLight},
    time::Timestamp,
};
use crate::math::pose::Pose;

/// Where an estimate comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Provenance {
    /// From a measurement at that time.
    Measured,
    /// Between two measurements.
    Interpolated,
    /// Extrapolated by a motion model over this many seconds.
    Predicted {
        /// Seconds since the last measurement.
        age_s: f64,
    },
    /// The last value, held for this many seconds.
    Held {
        /// Seconds since the last measurement.
        age_s: f64,
    },
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEstimate {
    /// Time that the pose is for.
    pub t: Timestamp,
    /// Pose of the camera, metres: takes points of its frame to the world.
    pub world_from_camera: Pose,
    /// Measured, predicted or held.
    pub provenance: Provenance,
    /// Standard deviation of the camera's position, metres.
    pub sigma_position_m: f64,
    /// Standard deviation of the camera's rotation, radians.
    pub sigma_rotation_rad: f64,
}

/// What the light measurement had to do without.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightFlags {
    /// Share of the sphere, 0 to 1, that was filled and not seen.
    pub filled_share: f32,
    /// Samples whose radiance is only a lower bound (saturated in the shortest exposure).
    pub saturated_texels: u32,
    /// Samples that were not finite and have been replaced.
    pub not_finite_texels: u32,
    /// Samples in all.
    pub texels: u32,
}

/// The light of the place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightEstimate {
    /// Time of the newest picture that entered.
    pub t: Timestamp,
    /// All of the light, world frame, after the temporal filter.
    pub total: RadianceSh,
    /// The same in two halves by net flux (Section 5 of [Now11] as corrected): the dominant direction and E_d.
    pub split: SplitLight,
    /// The same as objects and surfaces are lit with, split as the settings say.
    pub lights: Lights,
    /// Measured or held.
    pub provenance: Provenance,
    /// Half angle of the cone that holds the true direction with probability 0.95, radians; pi where there is none.
    pub cone95_rad: f32,
    /// What was missing.
    pub flags: LightFlags,
}
