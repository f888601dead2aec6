//! How the camera moves, and what an IMU on it feels.

use super::{
    options::SyntheticSubject,
    random::{normal, uniform},
};
use crate::math::pose::Pose;
use crate::model::{imu::ImuSample, time::Timestamp};
use crate::{DeviceError, ErrorKind, ImuSource, ImuTruth};
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Gravity, world frame, m/s^2.
pub const GRAVITY_M_S2: DVec3 = DVec3::new(0.0, 0.0, -9.806_65);
/// Samples a second of the IMU.
pub const IMU_RATE_HZ: f64 = 200.0;
/// Standard deviation of one gyroscope sample, rad/s.
pub const GYRO_NOISE_RAD_S: f64 = 0.003;
/// Standard deviation of one accelerometer sample, m/s^2.
pub const ACCEL_NOISE_M_S2: f64 = 0.03;

/// A slow drift about the table with the small jitter of a hand: sums of sines, smooth for all times.
#[derive(Clone, Debug)]
pub struct Trajectory {
    seed: u64,
    strength: f64,
    view: SyntheticSubject,
}

/// One sum of three sines with phases of its own; its largest value is at most 1.
fn sway(seed: u64, channel: u64, t: f64, rates_hz: [f64; 3]) -> f64 {
    let weights = [0.55, 0.28, 0.17];
    (0..3)
        .map(|k| {
            let phase = uniform([seed, channel, k as u64]);
            let rate = rates_hz[k] * (0.85 + 0.3 * uniform([seed, channel, k as u64 + 8]));
            weights[k] * (TAU * (rate * t + phase)).sin()
        })
        .sum()
}

impl Trajectory {
    /// `strength` scales all movement: 1 as held by hand, 0 on a tripod.
    pub fn new(seed: u64, strength: f64, view: SyntheticSubject) -> Self {
        Self { seed, strength, view }
    }

    /// Camera to world at a true time, seconds.
    pub fn world_from_camera(&self, t: f64) -> Pose {
        let slow = |channel| self.strength * sway(self.seed, channel, t, [0.10, 0.21, 0.37]);
        let fast = |channel| self.strength * sway(self.seed, channel, t, [1.3, 2.6, 4.3]);
        if self.view == SyntheticSubject::Room {
            // Before the table, at the height of a sitting head.
            let eye = DVec3::new(-0.08 + 0.16 * slow(1), -1.18 + 0.08 * slow(2), 0.32 + 0.07 * slow(3))
                + DVec3::new(fast(4), fast(5), fast(6)) * 0.002;
            let target = DVec3::new(-0.16 + 0.03 * slow(7), 0.1, -0.22 + 0.02 * slow(9))
                + DVec3::new(fast(8), 0.0, fast(10)) * 0.002;
            let roll = (1.5 * slow(11) + 0.15 * fast(12)).to_radians();
            let level = Pose::look_at(eye, target, DVec3::Z);
            return Pose::new(level.rotation * DQuat::from_rotation_z(roll), eye);
        }
        let azimuth = (-83.0 + 15.0 * slow(1)).to_radians();
        let distance = 0.62 + 0.035 * slow(2);
        let height = 0.43 + 0.045 * slow(3);
        let middle = DVec3::new(0.035, 0.05, 0.0);
        let eye = middle
            + DVec3::new(distance * azimuth.cos(), distance * azimuth.sin(), height)
            + DVec3::new(fast(4), fast(5), fast(6)) * 0.0016;
        let target =
            middle + DVec3::new(0.012 * slow(7) + 0.0016 * fast(8), 0.010 * slow(9) + 0.0016 * fast(10), 0.0);
        let roll = (1.8 * slow(11) + 0.18 * fast(12)).to_radians();
        let level = Pose::look_at(eye, target, DVec3::Z);
        Pose::new(level.rotation * DQuat::from_rotation_z(roll), eye)
    }

    /// Angular rate in the camera's frame, rad/s, and specific force there, m/s^2 (gravity shows as +9.81 upwards).
    pub fn felt(&self, t: f64) -> (DVec3, DVec3) {
        let h = 1e-3;
        let (before, now, after) =
            (self.world_from_camera(t - h), self.world_from_camera(t), self.world_from_camera(t + h));
        let turn = before.rotation.conjugate() * after.rotation;
        let rate = turn.to_scaled_axis() / (2.0 * h);
        let acceleration = (before.translation - now.translation * 2.0 + after.translation) / (h * h);
        (rate, now.rotation.conjugate() * (acceleration - GRAVITY_M_S2))
    }
}

/// The synthetic IMU: mounted at the camera's centre, its axes the camera's.
#[derive(Debug)]
pub struct SyntheticImu {
    trajectory: Arc<Trajectory>,
    truth: ImuTruth,
    seed: u64,
    start_s: f64,
    end_s: f64,
    next: u64,
}

impl SyntheticImu {
    /// Samples from `start_s` to `end_s`, true time.
    pub fn new(
        trajectory: Arc<Trajectory>,
        seed: u64,
        noise: f64,
        time_offset_s: f64,
        span_s: (f64, f64),
    ) -> Self {
        let draw = |channel, scale: f64| {
            std::array::from_fn(|axis| scale * normal([seed ^ 0x1b1a5, channel, axis as u64]))
        };
        let truth = ImuTruth {
            gyro_bias_rad_s: draw(0, 0.006 * noise),
            accel_bias_m_s2: draw(1, 0.04 * noise),
            time_offset_s,
            gyro_noise_rad_s: GYRO_NOISE_RAD_S * noise,
            accel_noise_m_s2: ACCEL_NOISE_M_S2 * noise,
        };
        Self { trajectory, truth, seed, start_s: span_s.0, end_s: span_s.1, next: 0 }
    }
}

impl ImuSource for SyntheticImu {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        let t = self.start_s + self.next as f64 / IMU_RATE_HZ;
        let stated = Timestamp::from_seconds(t + self.truth.time_offset_s);
        if t > self.end_s {
            let action = format!("sample {}: the last one was given", self.next);
            return Err(DeviceError::new("synthetic IMU", action, ErrorKind::Ended));
        }
        if stated > deadline {
            return Err(DeviceError::again());
        }
        let (rate, force) = self.trajectory.felt(t);
        let noise = |channel: u64, scale: f64| {
            DVec3::from_array(std::array::from_fn(|axis| {
                scale * normal([self.seed ^ 0x6a0, channel + 2 * axis as u64, self.next])
            }))
        };
        let gyro = rate + DVec3::from(self.truth.gyro_bias_rad_s) + noise(0, self.truth.gyro_noise_rad_s);
        let accel = force + DVec3::from(self.truth.accel_bias_m_s2) + noise(1, self.truth.accel_noise_m_s2);
        self.next += 1;
        Ok(ImuSample { t: stated, gyro_rad_s: gyro.to_array(), accel_m_s2: accel.to_array() })
    }

    fn imu_truth(&self) -> Option<ImuTruth> {
        Some(self.truth)
    }

    fn delivers_at_once(&self) -> bool {
        true
    }
}
