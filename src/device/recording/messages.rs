//! Between the model's values and the messages of a recording. Pure. Bad messages give `None` or text that
//! says what is wrong; never a panic.

use super::channels::{Encoding, Message, SchemaKind};
use super::{cdr, foxglove};
use crate::math::{
    lens::Lens,
    pose::Pose,
    sh::{MAX_COEFFICIENTS, MAX_ORDER},
};
use crate::model::limits::{MAX_GAIN, MAX_PLACE_M, MAX_TIME_S};
use crate::model::{
    estimate::{PoseEstimate, Provenance},
    frame::{Exposure, RawFrame},
    imu::ImuSample,
    light::RadianceSh,
    time::Timestamp,
};
use crate::{ImuTruth, Truth};
use glam::DVec3;
use serde::{Deserialize, Serialize};

pub use super::frames::{write_calibration, write_pose, write_transform};
pub use super::rig::{RigParts, read_rig, write_rig};

/// A time as Foxglove's schemas have it.
#[derive(Serialize, Deserialize)]
pub(super) struct Time {
    pub(super) sec: i64,
    pub(super) nsec: u32,
}

const NANOSECONDS: i64 = 1_000_000_000;

impl From<Timestamp> for Time {
    fn from(t: Timestamp) -> Self {
        Self { sec: t.0.div_euclid(NANOSECONDS), nsec: t.0.rem_euclid(NANOSECONDS) as u32 }
    }
}

impl From<Time> for Timestamp {
    fn from(t: Time) -> Self {
        Self(t.sec.saturating_mul(NANOSECONDS).saturating_add(i64::from(t.nsec)))
    }
}

#[derive(Serialize, Deserialize)]
pub(super) struct VectorMessage {
    x: f64,
    y: f64,
    z: f64,
}

impl From<DVec3> for VectorMessage {
    fn from(v: DVec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<VectorMessage> for DVec3 {
    fn from(v: VectorMessage) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

/// Bytes of a value as JSON. Not finite numbers become null, which reading refuses.
pub(super) fn json<T: Serialize>(message: &T) -> Vec<u8> {
    serde_json::to_vec(message).unwrap_or_default()
}

pub(super) fn parse<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, String> {
    serde_json::from_slice(bytes).map_err(|e| e.to_string())
}

/// One of half-light's own messages, which are JSON.
pub(super) fn own<'a, T: Deserialize<'a>>(message: &'a Message) -> Result<T, String> {
    match message.encoding {
        Encoding::Json => parse(&message.content),
        _ => Err(message.unreadable()),
    }
}

/// The lens of a `foxglove.CameraCalibration` (JSON, protobuf) or a `sensor_msgs/msg/CameraInfo`.
pub fn read_calibration(message: &Message) -> Result<Lens, String> {
    let content = message.content.as_slice();
    let fields = match (message.kind(), message.encoding) {
        (SchemaKind::Calibration, Encoding::Json) => foxglove::calibration_of_json(content),
        (SchemaKind::Calibration, Encoding::Protobuf) => foxglove::calibration_of_protobuf(content),
        (SchemaKind::RosCameraInfo, Encoding::Cdr) => cdr::camera_info(content),
        _ => Err(message.unreadable()),
    };
    fields?.lens()
}

/// What `/camera/exposure` says of one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureNote {
    /// The frame's number.
    pub sequence: u64,
    /// Its time.
    pub t_mid: Timestamp,
    /// As applied.
    pub exposure: Exposure,
}

#[derive(Serialize, Deserialize)]
struct ExposureMessage {
    timestamp: Time,
    sequence: u64,
    t_mid_ns: i64,
    time_s: f64,
    gain: f64,
}

/// `halflight.Exposure` of a frame.
pub fn write_exposure(frame: &RawFrame) -> Vec<u8> {
    let Exposure { time_s, gain } = frame.exposure;
    let (timestamp, sequence) = (frame.t_mid.into(), frame.sequence);
    json(&ExposureMessage { timestamp, sequence, t_mid_ns: frame.t_mid.0, time_s, gain })
}

/// The note in a `halflight.Exposure`; times and gains must be positive.
pub fn read_exposure(message: &Message) -> Result<ExposureNote, String> {
    let m: ExposureMessage = own(message)?;
    if !(m.time_s > 0.0 && m.time_s <= MAX_TIME_S && m.gain > 0.0 && m.gain <= MAX_GAIN) {
        return Err(format!(
            "time_s {}, gain {}: must be above 0, at most {MAX_TIME_S} s and {MAX_GAIN}",
            m.time_s, m.gain
        ));
    }
    let exposure = Exposure { time_s: m.time_s, gain: m.gain };
    Ok(ExposureNote { sequence: m.sequence, t_mid: Timestamp(m.t_mid_ns), exposure })
}

#[derive(Serialize, Deserialize)]
struct ImuMessage {
    timestamp: Time,
    t_ns: i64,
    angular_velocity: VectorMessage,
    linear_acceleration: VectorMessage,
}

/// `halflight.Imu`.
pub fn write_imu(sample: &ImuSample) -> Vec<u8> {
    json(&ImuMessage {
        timestamp: sample.t.into(),
        t_ns: sample.t.0,
        angular_velocity: DVec3::from(sample.gyro_rad_s).into(),
        linear_acceleration: DVec3::from(sample.accel_m_s2).into(),
    })
}

/// The sample in a `halflight.Imu` or a `sensor_msgs/msg/Imu`.
pub fn read_imu(message: &Message) -> Result<ImuSample, String> {
    let sample = match (message.kind(), message.encoding) {
        (SchemaKind::RosImu, Encoding::Cdr) => cdr::imu(&message.content)?,
        (SchemaKind::Own, Encoding::Json) => own_imu(&message.content)?,
        _ => return Err(message.unreadable()),
    };
    let numbers = sample.gyro_rad_s.iter().chain(&sample.accel_m_s2);
    // A sensor's own range ends far below.
    if let Some(bad) = numbers.copied().find(|x| !(-1e6..=1e6).contains(x)) {
        return Err(format!("a turning rate or acceleration of {bad}: must be within 1e6 of 0"));
    }
    Ok(sample)
}

fn own_imu(bytes: &[u8]) -> Result<ImuSample, String> {
    let m: ImuMessage = parse(bytes)?;
    let (gyro, accel) = (DVec3::from(m.angular_velocity), DVec3::from(m.linear_acceleration));
    Ok(ImuSample { t: Timestamp(m.t_ns), gyro_rad_s: gyro.to_array(), accel_m_s2: accel.to_array() })
}

#[derive(Deserialize)]
pub(super) struct Orientation {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
    pub(super) w: f64,
}

#[derive(Deserialize)]
pub(super) struct PoseMessage {
    pub(super) position: VectorMessage,
    pub(super) orientation: Orientation,
}

#[derive(Deserialize)]
pub(super) struct PoseInFrame {
    pub(super) timestamp: Time,
    pub(super) pose: PoseMessage,
}

/// Reads a `foxglove.PoseInFrame` (JSON, protobuf).
pub fn read_pose(message: &Message) -> Result<PoseEstimate, String> {
    let (t, rotation, translation) = match (message.kind(), message.encoding) {
        (SchemaKind::PoseInFrame, Encoding::Json) => foxglove::pose_of_json(&message.content)?,
        (SchemaKind::PoseInFrame, Encoding::Protobuf) => foxglove::pose_of_protobuf(&message.content)?,
        _ => return Err(message.unreadable()),
    };
    if !((rotation.length() - 1.0).abs() <= 1e-3) {
        return Err(format!("orientation has length {}, must be 1", rotation.length()));
    }
    if !translation.abs().cmple(DVec3::splat(MAX_PLACE_M)).all() {
        return Err(format!("position {translation}: must be within {MAX_PLACE_M} m of the origin"));
    }
    Ok(PoseEstimate {
        t,
        world_from_camera: Pose { rotation, translation },
        provenance: Provenance::Measured,
        sigma_position_m: 0.0,
        sigma_rotation_rad: 0.0,
    })
}

/// Written as an object; read as that or, as older recordings have it, a list of three.
#[derive(Serialize, Deserialize)]
pub(super) struct Colour<T> {
    pub(super) r: T,
    pub(super) g: T,
    pub(super) b: T,
}

impl<T> From<[T; 3]> for Colour<T> {
    fn from([r, g, b]: [T; 3]) -> Self {
        Self { r, g, b }
    }
}

impl<T> From<Colour<T>> for [T; 3] {
    fn from(Colour { r, g, b }: Colour<T>) -> Self {
        [r, g, b]
    }
}

#[derive(Serialize, Deserialize)]
struct LightMessage {
    timestamp: Time,
    sh_order: usize,
    sh_rgb: Vec<Colour<f32>>,
    to_light_world: [f32; 3],
}

/// `halflight.Truth`: the light of a truth.
pub fn write_light(t: Timestamp, truth: &Truth) -> Vec<u8> {
    json(&LightMessage {
        timestamp: t.into(),
        sh_order: truth.light.order,
        sh_rgb: truth.light.rows().iter().map(|row| Colour::from(*row)).collect(),
        to_light_world: truth.to_light_world,
    })
}

/// Light and direction of a `halflight.Truth`.
pub fn read_light(message: &Message) -> Result<(RadianceSh, [f32; 3]), String> {
    let m: LightMessage = own(message)?;
    if !(1..=MAX_ORDER).contains(&m.sh_order) || m.sh_rgb.len() != m.sh_order * m.sh_order {
        return Err(format!(
            "sh_order {} with {} rows: must be 1..=6 and its square",
            m.sh_order,
            m.sh_rgb.len()
        ));
    }
    let mut rgb = [[0.0; 3]; MAX_COEFFICIENTS];
    rgb.iter_mut().zip(m.sh_rgb).for_each(|(row, given)| *row = given.into());
    Ok((RadianceSh { order: m.sh_order, rgb }, m.to_light_world))
}

#[derive(Serialize, Deserialize)]
struct ImuTruthMessage {
    timestamp: Time,
    gyro_bias_rad_s: [f64; 3],
    accel_bias_m_s2: [f64; 3],
    time_offset_s: f64,
    gyro_noise_rad_s: f64,
    accel_noise_m_s2: f64,
}

/// `halflight.ImuTruth`.
pub fn write_imu_truth(t: Timestamp, truth: &ImuTruth) -> Vec<u8> {
    json(&ImuTruthMessage {
        timestamp: t.into(),
        gyro_bias_rad_s: truth.gyro_bias_rad_s,
        accel_bias_m_s2: truth.accel_bias_m_s2,
        time_offset_s: truth.time_offset_s,
        gyro_noise_rad_s: truth.gyro_noise_rad_s,
        accel_noise_m_s2: truth.accel_noise_m_s2,
    })
}

/// Reads a `halflight.ImuTruth`.
pub fn read_imu_truth(message: &Message) -> Result<ImuTruth, String> {
    let m: ImuTruthMessage = own(message)?;
    Ok(ImuTruth {
        gyro_bias_rad_s: m.gyro_bias_rad_s,
        accel_bias_m_s2: m.accel_bias_m_s2,
        time_offset_s: m.time_offset_s,
        gyro_noise_rad_s: m.gyro_noise_rad_s,
        accel_noise_m_s2: m.accel_noise_m_s2,
    })
}
