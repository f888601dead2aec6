//! Between the model's values and the messages of a recording. Pure. Bad messages give `None` or text that
//! says what is wrong; never a panic.

use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
    sh::{MAX_COEFFICIENTS, MAX_ORDER},
};
use crate::model::{
    estimate::{PoseEstimate, Provenance},
    frame::{Exposure, RawFrame},
    imu::ImuSample,
    light::RadianceSh,
    response::Response,
    rig::{MirrorBall, Rig, TagPlacement},
    time::Timestamp,
};
use crate::{ImuTruth, Truth};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

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
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

impl From<DVec3> for Vector {
    fn from(v: DVec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Vector> for DVec3 {
    fn from(v: Vector) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

/// Bytes of a value as JSON. Not finite numbers become null, which reading refuses.
fn json<T: Serialize>(message: &T) -> Vec<u8> {
    serde_json::to_vec(message).unwrap_or_default()
}

fn parse<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, String> {
    serde_json::from_slice(bytes).map_err(|e| e.to_string())
}

#[derive(Serialize, Deserialize)]
struct CalibrationMessage {
    timestamp: Time,
    frame_id: String,
    width: u32,
    height: u32,
    distortion_model: String,
    #[serde(rename = "D")]
    d: Vec<f64>,
    #[serde(rename = "K")]
    k: Vec<f64>,
    #[serde(rename = "R")]
    r: Vec<f64>,
    #[serde(rename = "P")]
    p: Vec<f64>,
}

/// A lens as `foxglove.CameraCalibration`.
pub fn write_calibration(t: Timestamp, lens: &Lens) -> Vec<u8> {
    // Pixel centres: 0.5 here, 0 in OpenCV.
    let (fx, fy, cx, cy) = (lens.fx, lens.fy, lens.cx - 0.5, lens.cy - 0.5);
    let (model, d) = match lens.distortion {
        Distortion::None => ("plumb_bob", vec![0.0; 5]),
        Distortion::RadialTangential(k) => ("rational_polynomial", k.to_vec()),
        Distortion::Equidistant(k) => ("kannala_brandt", k.to_vec()),
    };
    json(&CalibrationMessage {
        timestamp: t.into(),
        frame_id: "camera".into(),
        width: lens.width,
        height: lens.height,
        distortion_model: model.into(),
        d,
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    })
}

/// The lens of a `foxglove.CameraCalibration`.
pub fn read_calibration(bytes: &[u8]) -> Result<Lens, String> {
    let m: CalibrationMessage = parse(bytes)?;
    let &[fx, _, cx, _, fy, cy, ..] = m.k.as_slice() else {
        return Err(format!("K has {} numbers, must have 9", m.k.len()));
    };
    let coefficients = |most: usize| {
        let padded: Vec<f64> = m.d.iter().copied().chain(std::iter::repeat(0.0)).take(most).collect();
        (m.d.len() <= most).then_some(padded).ok_or(format!("D has {} numbers, at most {most}", m.d.len()))
    };
    let distortion = match m.distortion_model.as_str() {
        "" => Distortion::None,
        "plumb_bob" if m.d.iter().all(|k| *k == 0.0) => Distortion::None,
        "plumb_bob" | "rational_polynomial" => {
            Distortion::RadialTangential(coefficients(8)?.try_into().unwrap_or([0.0; 8]))
        }
        "kannala_brandt" | "equidistant" => {
            Distortion::Equidistant(coefficients(4)?.try_into().unwrap_or([0.0; 4]))
        }
        other => {
            let known = "plumb_bob, rational_polynomial, kannala_brandt";
            return Err(format!("distortion_model \"{other}\": must be one of {known}"));
        }
    };
    let sound = fx > 0.0 && fy > 0.0 && cx.is_finite() && cy.is_finite() && m.width > 0 && m.height > 0;
    if !sound || m.d.iter().any(|k| !k.is_finite()) {
        return Err(format!(
            "width {}, height {}, fx {fx}, fy {fy}: must be positive, and all numbers finite",
            m.width, m.height
        ));
    }
    Ok(Lens { width: m.width, height: m.height, fx, fy, cx: cx + 0.5, cy: cy + 0.5, distortion })
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
pub fn read_exposure(bytes: &[u8]) -> Result<ExposureNote, String> {
    let m: ExposureMessage = parse(bytes)?;
    if !(m.time_s > 0.0 && m.gain > 0.0) {
        return Err(format!("time_s {}, gain {}: must be positive", m.time_s, m.gain));
    }
    let exposure = Exposure { time_s: m.time_s, gain: m.gain };
    Ok(ExposureNote { sequence: m.sequence, t_mid: Timestamp(m.t_mid_ns), exposure })
}

#[derive(Serialize, Deserialize)]
struct ImuMessage {
    timestamp: Time,
    t_ns: i64,
    angular_velocity: Vector,
    linear_acceleration: Vector,
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

/// The sample in a `halflight.Imu`.
pub fn read_imu(bytes: &[u8]) -> Result<ImuSample, String> {
    let m: ImuMessage = parse(bytes)?;
    let (gyro, accel) = (DVec3::from(m.angular_velocity), DVec3::from(m.linear_acceleration));
    Ok(ImuSample { t: Timestamp(m.t_ns), gyro_rad_s: gyro.to_array(), accel_m_s2: accel.to_array() })
}

#[derive(Serialize, Deserialize)]
struct TagMessage {
    id: u32,
    side_m: f64,
    position_m: [f64; 3],
    orientation_xyzw: [f64; 4],
}

#[derive(Serialize, Deserialize)]
struct BallMessage {
    centre_world_m: [f64; 3],
    radius_m: f64,
    reflectance_rgb: [f32; 3],
}

#[derive(Serialize, Deserialize)]
struct RigMessage {
    timestamp: Time,
    tags: Vec<TagMessage>,
    ball: Option<BallMessage>,
    response_log_exposure: Option<Vec<Vec<f32>>>,
}

/// `halflight.Rig`: all of the rig but its lens, and the response.
pub fn write_rig(t: Timestamp, rig: &Rig, response: Option<&Response>) -> Vec<u8> {
    let tags = rig.tags.iter().map(|tag| TagMessage {
        id: tag.id,
        side_m: tag.side_m,
        position_m: tag.world_from_tag.translation.to_array(),
        orientation_xyzw: tag.world_from_tag.rotation.to_array(),
    });
    json(&RigMessage {
        timestamp: t.into(),
        tags: tags.collect(),
        ball: rig.ball.map(|ball| BallMessage {
            centre_world_m: ball.centre_world.to_array(),
            radius_m: ball.radius_m,
            reflectance_rgb: ball.reflectance_rgb,
        }),
        response_log_exposure: response
            .map(|response| response.log_exposure().iter().map(|g| g.to_vec()).collect()),
    })
}

/// Tags, ball and response of a `halflight.Rig`.
pub type RigParts = (Vec<TagPlacement>, Option<MirrorBall>, Option<Response>);

/// Reads a `halflight.Rig`.
pub fn read_rig(bytes: &[u8]) -> Result<RigParts, String> {
    let m: RigMessage = parse(bytes)?;
    let tags = m.tags.into_iter().map(|tag| {
        let rotation = DQuat::from_array(tag.orientation_xyzw);
        let good = tag.side_m > 0.0 && (rotation.length() - 1.0).abs() < 1e-3;
        // The quaternion stays as written, so that a recording gives back exactly what went in.
        let world_from_tag = Pose { rotation, translation: tag.position_m.into() };
        good.then_some(TagPlacement { id: tag.id, side_m: tag.side_m, world_from_tag }).ok_or(format!(
            "tag {}: side_m {} must be positive, orientation_xyzw of unit length",
            tag.id, tag.side_m
        ))
    });
    let tags = tags.collect::<Result<_, _>>()?;
    let ball = m.ball.map(|ball| MirrorBall {
        surface_radius_m: None,
        centre_world: ball.centre_world_m.into(),
        radius_m: ball.radius_m,
        reflectance_rgb: ball.reflectance_rgb,
    });
    if let Some(ball) = ball.filter(|b| !(b.radius_m > 0.0 && b.reflectance_rgb.iter().all(|r| *r > 0.0))) {
        return Err(format!("ball: radius_m {} and reflectance_rgb must be positive", ball.radius_m));
    }
    let response = match m.response_log_exposure {
        None => None,
        Some(tables) => Some(read_response(tables).ok_or(
            "response_log_exposure: must be three tables of 256 finite numbers that never decrease",
        )?),
    };
    Ok((tags, ball, response))
}

fn read_response(tables: Vec<Vec<f32>>) -> Option<Response> {
    let tables: Vec<[f32; 256]> = tables.into_iter().map(|t| t.try_into().ok()).collect::<Option<_>>()?;
    Response::new(tables.try_into().ok()?)
}

#[derive(Serialize, Deserialize)]
struct Orientation {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Serialize, Deserialize)]
struct PoseMessage {
    position: Vector,
    orientation: Orientation,
}

#[derive(Serialize, Deserialize)]
struct PoseInFrame {
    timestamp: Time,
    frame_id: String,
    pose: PoseMessage,
}

/// The camera in the world as `foxglove.PoseInFrame`.
pub fn write_pose(t: Timestamp, world_from_camera: &Pose) -> Vec<u8> {
    let q = world_from_camera.rotation;
    json(&PoseInFrame {
        timestamp: t.into(),
        frame_id: "world".into(),
        pose: PoseMessage {
            position: world_from_camera.translation.into(),
            orientation: Orientation { x: q.x, y: q.y, z: q.z, w: q.w },
        },
    })
}

/// Reads a `foxglove.PoseInFrame`.
pub fn read_pose(bytes: &[u8]) -> Result<PoseEstimate, String> {
    let m: PoseInFrame = parse(bytes)?;
    let o = m.pose.orientation;
    let rotation = DQuat::from_xyzw(o.x, o.y, o.z, o.w);
    if (rotation.length() - 1.0).abs() > 1e-3 {
        return Err(format!("orientation has length {}, must be 1", rotation.length()));
    }
    Ok(PoseEstimate {
        t: m.timestamp.into(),
        world_from_camera: Pose { rotation, translation: m.pose.position.into() },
        provenance: Provenance::Measured,
        sigma_position_m: 0.0,
        sigma_rotation_rad: 0.0,
    })
}

#[derive(Serialize, Deserialize)]
struct LightMessage {
    timestamp: Time,
    sh_order: usize,
    sh_rgb: Vec<[f32; 3]>,
    to_light_world: [f32; 3],
}

/// `halflight.Truth`: the light of a truth.
pub fn write_light(t: Timestamp, truth: &Truth) -> Vec<u8> {
    json(&LightMessage {
        timestamp: t.into(),
        sh_order: truth.light.order,
        sh_rgb: truth.light.rows().to_vec(),
        to_light_world: truth.to_light_world,
    })
}

/// Light and direction of a `halflight.Truth`.
pub fn read_light(bytes: &[u8]) -> Result<(RadianceSh, [f32; 3]), String> {
    let m: LightMessage = parse(bytes)?;
    if !(1..=MAX_ORDER).contains(&m.sh_order) || m.sh_rgb.len() != m.sh_order * m.sh_order {
        return Err(format!(
            "sh_order {} with {} rows: must be 1..=6 and its square",
            m.sh_order,
            m.sh_rgb.len()
        ));
    }
    let mut rgb = [[0.0; 3]; MAX_COEFFICIENTS];
    rgb[..m.sh_rgb.len()].copy_from_slice(&m.sh_rgb);
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
pub fn read_imu_truth(bytes: &[u8]) -> Result<ImuTruth, String> {
    let m: ImuTruthMessage = parse(bytes)?;
    Ok(ImuTruth {
        gyro_bias_rad_s: m.gyro_bias_rad_s,
        accel_bias_m_s2: m.accel_bias_m_s2,
        time_offset_s: m.time_offset_s,
        gyro_noise_rad_s: m.gyro_noise_rad_s,
        accel_noise_m_s2: m.accel_noise_m_s2,
    })
}
