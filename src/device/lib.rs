//! Layer 3, the door to the world: cameras, IMUs, recordings, clocks. Implementers owe what the traits say.

use halflight_core::model;
use halflight_math as math;

pub mod clock;
pub mod error;
pub mod open;
pub mod parameters;
pub mod record;
pub mod recording;
pub mod replay;
pub mod synthetic;

use crate::model::{
    estimate::PoseEstimate,
    frame::{Exposure, RawFrame},
    imu::ImuSample,
    rig::Rig,
    time::Timestamp,
};
pub use error::{DeviceError, ErrorKind};

/// A camera. Frames come in order of time; exposure and gain as the sensor truly applied them;
/// `t_mid` on the monotonic clock.
pub trait FrameSource: Send {
    /// The next frame; `Again` if none came by the deadline, `Ended` after the last one.
    fn next_frame(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError>;

    /// Asks for a cycle of exposures, used in turn; returns what will really be used. A source that cannot
    /// choose (a recording) returns what it has.
    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError>;

    /// What the source knows of its rig: lens, tags, ball. `None` where the configuration must say.
    fn rig(&self) -> Option<Rig>;

    /// The response the source states for its camera, if any.
    fn response(&self) -> Option<crate::model::response::Response> {
        None
    }

    /// Frames to come, where known (for progress bars).
    fn frames_left(&self) -> Option<u64> {
        None
    }

    /// The truth for the frame last returned, where the source knows it (synthetic, or recorded from synthetic).
    fn truth(&mut self) -> Option<Truth> {
        None
    }
}

/// An inertial sensor.
pub trait ImuSource: Send {
    /// Appends all samples with time up to `until`, in order of time.
    fn samples_until(&mut self, until: Timestamp, out: &mut Vec<ImuSample>) -> Result<(), DeviceError>;

    /// What is wrong with the sensor, where the source knows it (synthetic, or recorded from synthetic).
    fn imu_truth(&self) -> Option<ImuTruth> {
        None
    }
}

/// A clock on the monotonic time line of the frames.
pub trait Clock: Send {
    /// Now.
    fn now(&self) -> Timestamp;
    /// Waits until then (a manual clock jumps).
    fn wait_until(&mut self, t: Timestamp);
}

/// What a synthetic source knows of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Exact camera pose at `t_mid`.
    pub pose: PoseEstimate,
    /// Exact light at the ball's centre, world frame, order 6: upper hemisphere of the room, unshadowed surface below.
    pub light: crate::model::light::RadianceSh,
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

impl FrameSource for Box<dyn FrameSource> {
    fn next_frame(&mut self, deadline: Timestamp) -> Result<RawFrame, DeviceError> {
        (**self).next_frame(deadline)
    }

    fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<Vec<Exposure>, DeviceError> {
        (**self).set_exposures(exposures)
    }

    fn rig(&self) -> Option<Rig> {
        (**self).rig()
    }

    fn response(&self) -> Option<crate::model::response::Response> {
        (**self).response()
    }

    fn frames_left(&self) -> Option<u64> {
        (**self).frames_left()
    }

    fn truth(&mut self) -> Option<Truth> {
        (**self).truth()
    }
}

impl ImuSource for Box<dyn ImuSource> {
    fn samples_until(&mut self, until: Timestamp, out: &mut Vec<ImuSample>) -> Result<(), DeviceError> {
        (**self).samples_until(until, out)
    }

    fn imu_truth(&self) -> Option<ImuTruth> {
        (**self).imu_truth()
    }
}
