//! What the gyroscope shows at rest, from tags: how far it says the camera turned, against how far the tags say it did.

use super::{rates::RateRing, turn_between};
use crate::model::estimate::PoseEstimate;
use glam::{DMat3, DQuat, DVec3};

/// Before anything is known, rad/s: 3 degrees a second, as a cheap sensor may be off.
const UNKNOWN_RAD_S: f64 = 0.05;
/// How fast a bias wanders, rad/s in the root of a second.
const WANDER_RAD_S: f64 = 2e-4;
/// Two tag poses are compared over at least this time, seconds: the error of a pose is divided by it.
const LEAST_BASE_S: f64 = 1.0;
/// ... and at most over this.
const LONGEST_BASE_S: f64 = 3.0;
/// Part of that time that the samples must cover.
const COVERED: f64 = 0.98;
/// Determinant of a bias's effect, over the cube of the time, below which it cannot be told: the camera turned too far.
const LEAST_EFFECT: f64 = 0.02;
/// Step with which the effect of a bias is found, rad/s.
const STEP_RAD_S: f64 = 1e-3;
/// No gyroscope is off by more, rad/s; a larger one is a wrong pose or a broken sensor.
const LARGEST_RAD_S: f64 = 0.35;

/// The same filter for each axis: mean and variance.
#[derive(Clone, Debug)]
pub struct BiasFilter {
    mean_rad_s: DVec3,
    variance: f64,
    reference: Option<PoseEstimate>,
    last: Option<PoseEstimate>,
}

impl Default for BiasFilter {
    fn default() -> Self {
        Self { mean_rad_s: DVec3::ZERO, variance: UNKNOWN_RAD_S * UNKNOWN_RAD_S, reference: None, last: None }
    }
}

impl BiasFilter {
    /// Sensor axes, rad/s.
    pub fn mean(&self) -> DVec3 {
        self.mean_rad_s
    }

    /// Standard deviation of each axis, rad/s.
    pub fn sigma(&self) -> f64 {
        self.variance.sqrt()
    }

    /// Forgets the tags, not the bias.
    pub fn forget_reference(&mut self) {
        (self.reference, self.last) = (None, None);
    }

    /// Learns from a tag pose that is newer than the one before.
    pub fn tag(&mut self, tag: &PoseEstimate, rates: &RateRing, camera_from_imu: DQuat, noise_rad_s: f64) {
        if let Some(last) = self.last.replace(*tag) {
            let dt = tag.t.seconds_since(last.t);
            self.variance += WANDER_RAD_S * WANDER_RAD_S * dt;
            self.variance = self.variance.min(UNKNOWN_RAD_S * UNKNOWN_RAD_S);
        }
        let Some(reference) = self.reference else {
            self.reference = Some(*tag);
            return;
        };
        let base_s = tag.t.seconds_since(reference.t);
        if base_s < LEAST_BASE_S {
            return;
        }
        self.reference = Some(*tag);
        if base_s > LONGEST_BASE_S {
            return;
        }
        let pose_sigma = reference.sigma_rotation_rad.hypot(tag.sigma_rotation_rad).max(1e-4);
        let by_tags = reference.world_from_camera.rotation.conjugate() * tag.world_from_camera.rotation;
        // How much farther the gyroscope says that the camera turned, with this bias taken off.
        let left = |bias: DVec3| {
            let by_gyro = rates.turn(reference.t, tag.t, bias, camera_from_imu);
            (turn_between(by_tags, by_gyro.rotation), by_gyro.covered_s)
        };
        let (now, covered_s) = left(self.mean_rad_s);
        if covered_s < COVERED * base_s {
            return;
        }
        // One step of Newton: where the camera turns, a bias does not act along its own axis.
        let effect = DMat3::from_cols_array_2d(
            &[DVec3::X, DVec3::Y, DVec3::Z]
                .map(|axis| ((left(self.mean_rad_s + axis * STEP_RAD_S).0 - now) / STEP_RAD_S).to_array()),
        );
        if !(effect.determinant().abs() > LEAST_EFFECT * base_s.powi(3)) {
            return;
        }
        let inverse = effect.inverse();
        let per_axis = inverse.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt() / 3f64.sqrt();
        let walk_rad = noise_rad_s * (rates.spacing_s() * base_s).sqrt();
        self.measure(self.mean_rad_s - inverse * now, pose_sigma.hypot(walk_rad) * per_axis);
    }

    fn measure(&mut self, bias_rad_s: DVec3, sigma_rad_s: f64) {
        let variance = sigma_rad_s * sigma_rad_s;
        let is_sound = bias_rad_s.is_finite() && bias_rad_s.length() < LARGEST_RAD_S && variance > 0.0;
        if !is_sound {
            return;
        }
        let gain = self.variance / (self.variance + variance);
        self.mean_rad_s += (bias_rad_s - self.mean_rad_s) * gain;
        self.variance *= 1.0 - gain;
    }
}
