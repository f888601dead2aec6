//! What a sensor's protocol states, before time lines and mounting.

use crate::model::time::Timestamp;
use glam::DQuat;

/// One standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.80665;

/// When the sensor made a sample, by its own count or clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SampleStamp {
    /// The protocol says nothing.
    Unstated,
    /// A counter of samples that wraps after `modulus` of them.
    Count {
        /// The counter.
        value: u32,
        /// Number of its values.
        modulus: u32,
    },
    /// The sensor's clock, which wraps after `bits` bits.
    Ticks {
        /// Reading of the clock.
        value: u64,
        /// Its width, 1 to 64.
        bits: u32,
        /// One tick, seconds by the sensor's clock.
        tick_s: f64,
    },
}

/// One sample in the sensor's own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WireSample {
    /// When its last byte was read, the program's clock.
    pub arrival: Timestamp,
    /// By the sensor's own count or clock.
    pub stamp: SampleStamp,
    /// The sensor's axes to a level frame with z up, where the sensor fuses by itself.
    pub orientation: Option<DQuat>,
    /// Angular rate.
    pub gyro_rad_s: Option<[f64; 3]>,
    /// Specific force (+9.81 upwards at rest).
    pub accel_m_s2: Option<[f64; 3]>,
}

impl WireSample {
    /// A sample without any value.
    pub fn empty(arrival: Timestamp) -> Self {
        Self { arrival, stamp: SampleStamp::Unstated, orientation: None, gyro_rad_s: None, accel_m_s2: None }
    }
}

/// What came over a wire so far, and what became of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WireCounts {
    /// Bytes taken.
    pub bytes: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
    /// Frames whose checksum is wrong.
    pub wrong_sums: u64,
    /// Frames that were caught by their index or by what a body can do.
    pub caught: u64,
    /// Samples given.
    pub samples: u64,
}

/// Turns angles about z, then y, then x (degrees) into the sensor's axes to a level frame with z up.
pub fn z_up_from_yaw_pitch_roll(yaw_deg: f64, pitch_deg: f64, roll_deg: f64) -> DQuat {
    DQuat::from_rotation_z(yaw_deg.to_radians())
        * DQuat::from_rotation_y(pitch_deg.to_radians())
        * DQuat::from_rotation_x(roll_deg.to_radians())
}
