//! The camera's pose between tags: the gyroscope turns it, its velocity moves it. Pure: time comes with the calls.
//!
//! This is prediction from the last tag, not a filter: the accelerometer is not used, and a tag's pose is believed as it
//! comes. Frames: `world_from_camera`; q <- q exp(rate dt) with the rate in the camera's axes.

use crate::math::pose::Pose;
use crate::model::{
    estimate::{PoseEstimate, Provenance},
    imu::ImuSample,
    time::Timestamp,
};
use bias::BiasFilter;
use glam::{DQuat, DVec3};
use rates::RateRing;

mod bias;
mod rates;

pub use rates::SampleCounts;

/// What is known of the inertial sensor, and how long is predicted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FuseOptions {
    /// Turns directions from the sensor's axes to the camera's.
    pub camera_from_imu: DQuat,
    /// Stated time minus true time of the samples, seconds.
    pub time_offset_s: f64,
    /// Standard deviation of one gyroscope sample, rad/s.
    pub gyro_noise_rad_s: f64,
    /// With a gyroscope the pose is predicted so long after the last tag, seconds; then it is held.
    pub predict_with_gyro_s: f64,
    /// Without one it is predicted so long, seconds.
    pub predict_alone_s: f64,
    /// Time constant with which the velocity dies away after the last tag, seconds.
    pub velocity_decay_s: f64,
}

impl Default for FuseOptions {
    fn default() -> Self {
        Self {
            camera_from_imu: DQuat::IDENTITY,
            time_offset_s: 0.0,
            gyro_noise_rad_s: 0.005,
            predict_with_gyro_s: 1.0,
            predict_alone_s: 0.25,
            velocity_decay_s: 0.25,
        }
    }
}

/// Accelerations of a camera in a hand, which a constant velocity knows nothing of.
const ACCELERATION_M_S2: f64 = 2.0;
/// The same for turning.
const ACCELERATION_RAD_S2: f64 = 6.0;
/// Speed of a camera in a hand, for when no velocity is known yet.
const SPEED_M_S: f64 = 0.5;
/// The same for turning.
const SPEED_RAD_S: f64 = 1.5;
/// Time constant of the filter of the velocity between tags, seconds.
const VELOCITY_TAU_S: f64 = 0.06;
/// Two tags nearer in time than this say nothing of the speed, seconds.
const LEAST_STEP_S: f64 = 1e-3;
/// A longer gap between two tags says nothing of the speed, seconds.
const LONGEST_STEP_S: f64 = 0.25;
/// Tag poses that are kept, for times before the newest.
const KEPT_TAGS: usize = 8;

/// Of the camera: its centre in the world's axes, its rotation in its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct CameraVelocity {
    linear_m_s: DVec3,
    turning_rad_s: DVec3,
}

/// Follows the camera from the poses of tags and a gyroscope. Memory is bounded: the newest 2048 samples and 8 tag poses.
#[derive(Clone, Debug)]
pub struct Fuser {
    options: FuseOptions,
    rates: RateRing,
    bias: BiasFilter,
    /// The newest last; rises in time.
    tags: Vec<PoseEstimate>,
    velocity: Option<CameraVelocity>,
}

impl Fuser {
    /// Knows nothing yet.
    pub fn new(options: FuseOptions) -> Self {
        Self {
            options,
            rates: RateRing::default(),
            bias: BiasFilter::default(),
            tags: Vec::with_capacity(KEPT_TAGS),
            velocity: None,
        }
    }

    /// Forgets poses and samples, e.g. when a recording starts again; keeps the bias.
    pub fn reset(&mut self) {
        self.rates.clear();
        self.bias.forget_reference();
        self.tags.clear();
        self.velocity = None;
    }

    /// Takes a sample of the inertial sensor. Samples may be swapped within 20 ms; what is older, has the time of another,
    /// is not finite or faster than 35 rad/s is left out and counted. Returns whether the sample was taken.
    pub fn imu(&mut self, sample: &ImuSample) -> bool {
        let t = sample.t.plus_seconds(-self.options.time_offset_s);
        self.rates.insert(t, DVec3::from(sample.gyro_rad_s))
    }

    /// Takes the pose of the tags in a picture. Only what was measured counts, finite and newer than the pose before; a
    /// prediction is no measurement. Returns whether the pose was taken.
    pub fn tag(&mut self, estimate: &PoseEstimate) -> bool {
        let pose = &estimate.world_from_camera;
        let is_sound = pose.rotation.is_finite()
            && pose.translation.is_finite()
            && estimate.sigma_position_m.is_finite()
            && estimate.sigma_rotation_rad.is_finite();
        let is_newer = self.tags.last().is_none_or(|last| estimate.t > last.t);
        if estimate.provenance != Provenance::Measured || !is_sound || !is_newer {
            return false;
        }
        self.follow_velocity(estimate);
        let rotation_camera_from_imu = self.options.camera_from_imu;
        self.bias.tag(estimate, &self.rates, rotation_camera_from_imu, self.options.gyro_noise_rad_s);
        if self.tags.len() == KEPT_TAGS {
            self.tags.remove(0);
        }
        self.tags.push(*estimate);
        true
    }

    /// Samples taken and left out so far.
    pub fn sample_counts(&self) -> SampleCounts {
        self.rates.counts()
    }

    /// What the gyroscope shows at rest, sensor axes, and the standard deviation of each axis, rad/s.
    pub fn gyro_bias_rad_s(&self) -> ([f64; 3], f64) {
        (self.bias.mean().to_array(), self.bias.sigma())
    }

    /// The best that is known of the pose at `t`; `None` before the first tag.
    ///
    /// At the time of a kept tag pose it is that pose, bit for bit; between two of them it is interpolated; before all of them
    /// it is the oldest, with its own time. Later than all it is predicted: turned by the gyroscope as far as its samples
    /// reach (the last rate goes on for 60 ms), and moved by the velocity, which dies away. After 1 s, or 0.25 s where the
    /// gyroscope does not cover the time, the pose is held. *Uncertainty never shrinks with age.*
    pub fn pose_at(&self, t: Timestamp) -> Option<PoseEstimate> {
        let newest = self.tags.last()?;
        if t > newest.t {
            return Some(self.predict(newest, t));
        }
        let after = self.tags.iter().position(|tag| tag.t >= t)?;
        let next = self.tags[after];
        if next.t == t || after == 0 {
            return Some(next);
        }
        let before = self.tags[after - 1];
        let share = t.seconds_since(before.t) / next.t.seconds_since(before.t);
        Some(PoseEstimate {
            t,
            world_from_camera: before.world_from_camera.interpolate(&next.world_from_camera, share),
            provenance: Provenance::Interpolated,
            sigma_position_m: before.sigma_position_m.max(next.sigma_position_m),
            sigma_rotation_rad: before.sigma_rotation_rad.max(next.sigma_rotation_rad),
        })
    }

    fn predict(&self, tag: &PoseEstimate, t: Timestamp) -> PoseEstimate {
        let options = &self.options;
        let age_s = t.seconds_since(tag.t);
        let moved_s = age_s.min(options.predict_with_gyro_s);
        let turned =
            self.rates.turn(tag.t, tag.t.plus_seconds(moved_s), self.bias.mean(), options.camera_from_imu);
        // What the gyroscope does not cover, the velocity of the tags turns.
        let alone_s = self.spent(turned.uncovered_s.min(options.predict_alone_s));
        let velocity = self.velocity.unwrap_or_default();
        let rotation = tag.world_from_camera.rotation
            * turned.rotation
            * DQuat::from_scaled_axis(velocity.turning_rad_s * alone_s);
        let translation = tag.world_from_camera.translation + velocity.linear_m_s * self.spent(moved_s);
        let is_known = turned.covered_s > 0.0 || self.velocity.is_some();
        let is_predicted =
            is_known && age_s <= options.predict_with_gyro_s && turned.uncovered_s <= options.predict_alone_s;
        let (unknown_m, unknown_rad) = self.unknown(age_s, turned.covered_s);
        PoseEstimate {
            t,
            world_from_camera: Pose::new(rotation, translation),
            provenance: if is_predicted {
                Provenance::Predicted { age_s }
            } else {
                Provenance::Held { age_s }
            },
            sigma_position_m: tag.sigma_position_m + unknown_m,
            sigma_rotation_rad: tag.sigma_rotation_rad + unknown_rad,
        }
    }

    /// What a prediction of this age may be wrong by: metres, radians.
    fn unknown(&self, age_s: f64, covered_s: f64) -> (f64, f64) {
        let rest_s = (age_s - covered_s).max(0.0);
        let (speed_m_s, speed_rad_s) = match self.velocity {
            Some(_) => (0.0, 0.0),
            None => (SPEED_M_S, SPEED_RAD_S),
        };
        // White noise of the samples adds up as a walk; a wrong bias as time; what is not covered as of a hand.
        let walk = self.options.gyro_noise_rad_s * (self.rates.spacing_s() * covered_s).sqrt();
        let turning = 3f64.sqrt() * (walk + self.bias.sigma() * covered_s)
            + speed_rad_s * rest_s
            + 0.5 * ACCELERATION_RAD_S2 * rest_s * rest_s;
        (speed_m_s * age_s + 0.5 * ACCELERATION_M_S2 * age_s * age_s, turning)
    }

    /// How long a velocity that dies away acts as if it were constant, seconds.
    fn spent(&self, seconds: f64) -> f64 {
        let tau_s = self.options.velocity_decay_s;
        if tau_s > 0.0 { tau_s * (1.0 - (-seconds / tau_s).exp()) } else { 0.0 }
    }

    fn follow_velocity(&mut self, tag: &PoseEstimate) {
        let Some(last) = self.tags.last() else { return };
        let dt = tag.t.seconds_since(last.t);
        if dt < LEAST_STEP_S {
            return;
        }
        if dt > LONGEST_STEP_S {
            self.velocity = None;
            return;
        }
        let (from, to) = (&last.world_from_camera, &tag.world_from_camera);
        let now = CameraVelocity {
            linear_m_s: (to.translation - from.translation) / dt,
            turning_rad_s: turn_between(from.rotation, to.rotation) / dt,
        };
        let share = 1.0 - (-dt / VELOCITY_TAU_S).exp();
        self.velocity = Some(match self.velocity {
            None => now,
            Some(before) => CameraVelocity {
                linear_m_s: before.linear_m_s.lerp(now.linear_m_s, share),
                turning_rad_s: before.turning_rad_s.lerp(now.turning_rad_s, share),
            },
        });
    }
}

/// The rotation vector that turns `from` into `to`, in the axes of `from`, the short way round.
fn turn_between(from: DQuat, to: DQuat) -> DVec3 {
    let delta = from.conjugate() * to;
    let delta = if delta.w < 0.0 { -delta } else { delta };
    delta.to_scaled_axis()
}

#[cfg(test)]
mod tests;
