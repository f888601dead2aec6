//! Inertial samples.

use super::time::Timestamp;

/// One inertial sample in the IMU's own frame (x right, y down, z forward where it is mounted so).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Time on the camera's clock, as far as the device knows it.
    pub t: Timestamp,
    /// Angular rate.
    pub gyro_rad_s: [f64; 3],
    /// Specific force (gravity shows as +9.81 upwards at rest).
    pub accel_m_s2: [f64; 3],
}
