//! What synthetic devices know of their world, for tests and for figures.

use crate::model::{estimate::PoseEstimate, light::RadianceSh};

/// What a synthetic source knows of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Exact camera pose at `t_mid`.
    pub pose: PoseEstimate,
    /// Exact light at the ball's centre, world frame, order 6: upper hemisphere of the room, unshadowed surface below.
    pub light: RadianceSh,
    /// Band-1 direction of `light` (gray 0.3/0.59/0.11), unit.
    pub to_light_world: [f32; 3],
}

/// What is wrong with an IMU, and by how much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuTruth {
    /// Added to every gyroscope sample, rad/s.
    pub gyro_bias_rad_s: [f64; 3],
    /// Added to every accelerometer sample, m/s^2.
    pub accel_bias_m_s2: [f64; 3],
    /// Stated time minus true time of every sample, seconds.
    pub time_offset_s: f64,
    /// Standard deviation of one gyroscope sample, rad/s.
    pub gyro_noise_rad_s: f64,
    /// Standard deviation of one accelerometer sample, m/s^2.
    pub accel_noise_m_s2: f64,
}
