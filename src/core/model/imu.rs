//! Inertial samples.

use super::time::Timestamp;
use glam::DQuat;

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

/// Who made an orientation of rates and forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FusedBy {
    /// The sensor itself; taken as it is.
    Sensor,
    /// This program, from the sensor's rates and forces.
    Host,
}

/// The orientation of an inertial sensor at the time of one of its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuOrientation {
    /// Time of the sample.
    pub t: Timestamp,
    /// The sample's frame to a level one with z up. Its heading begins anywhere, and drifts where no magnetometer holds it.
    pub level_from_imu: DQuat,
    /// The sensor, or this program.
    pub fused_by: FusedBy,
}
