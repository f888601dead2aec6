//! What a rig file says of its inertial sensor: the `[imu]` table. Every mistake names its key, its value and what is allowed.

use super::wire::{PROTOCOLS, Protocol, resync::LONGEST_FRAME};
use crate::parameters::nearest;
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use text::{ImuTable, RigFile};

/// Symbols a second of serial ports.
pub const BAUD: std::ops::RangeInclusive<u32> = 1200..=4_000_000;
/// Samples a second of sensors.
pub const RATE_HZ: std::ops::RangeInclusive<f64> = 1.0..=4000.0;
/// The most bytes of an `[imu]` table.
pub const LONGEST_TEXT: usize = 64 * 1024;
/// The most fields of a described frame.
const MOST_FIELDS: usize = 10;

/// A mistake in an `[imu]` table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("imu.{key} = {value}: {allowed}")]
pub struct DescriptionError {
    /// The key within the table.
    pub key: String,
    /// What it says.
    pub value: String,
    /// What it may say.
    pub allowed: String,
}

fn wrong(key: &str, value: impl ToString, allowed: impl ToString) -> DescriptionError {
    DescriptionError { key: key.to_owned(), value: value.to_string(), allowed: allowed.to_string() }
}

/// Everything that a rig states of its inertial sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuDescription {
    /// The sensor, as `device.imu` names it.
    pub name: Option<String>,
    /// The protocol, where the device's name does not say it.
    pub protocol: Option<String>,
    /// Symbols a second of a serial port; `None`: what the protocol's makers set.
    pub baud: Option<u32>,
    /// Samples a second; `None`: what the protocol's makers set.
    pub rate_hz: Option<f64>,
    /// The sensor's axes to those of the samples (x right, y down, z ahead where it is mounted so).
    pub imu_from_sensor: DQuat,
    /// The samples' axes to the camera's, where the rig states it.
    pub camera_from_imu: Option<DQuat>,
    /// The frame or report, for `described`.
    pub frame: Option<FrameTable>,
}

impl Default for ImuDescription {
    fn default() -> Self {
        Self {
            name: None,
            protocol: None,
            baud: None,
            rate_hz: None,
            imu_from_sensor: DQuat::IDENTITY,
            camera_from_imu: None,
            frame: None,
        }
    }
}

/// Types of numbers in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum NumberType {
    U8,
    I8,
    U16le,
    I16le,
    U16be,
    I16be,
    U32le,
    I32le,
    I32be,
    F32le,
}

impl NumberType {
    /// Its length.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16le | Self::I16le | Self::U16be | Self::I16be => 2,
            Self::U32le | Self::I32le | Self::I32be | Self::F32le => 4,
        }
    }

    fn is_unsigned(self) -> bool {
        matches!(self, Self::U8 | Self::U16le | Self::U16be | Self::U32le)
    }
}

/// What a field is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[allow(missing_docs)]
pub enum FieldQuantity {
    #[serde(rename = "gyro.x")]
    GyroX,
    #[serde(rename = "gyro.y")]
    GyroY,
    #[serde(rename = "gyro.z")]
    GyroZ,
    #[serde(rename = "accel.x")]
    AccelX,
    #[serde(rename = "accel.y")]
    AccelY,
    #[serde(rename = "accel.z")]
    AccelZ,
    #[serde(rename = "quat.w")]
    QuatW,
    #[serde(rename = "quat.x")]
    QuatX,
    #[serde(rename = "quat.y")]
    QuatY,
    #[serde(rename = "quat.z")]
    QuatZ,
}

impl FieldQuantity {
    /// Its place among rates, forces and the quaternion.
    pub(crate) fn slot(self) -> usize {
        self as usize
    }
}

/// One number of a described frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameField {
    /// First byte, from the frame's own first.
    pub offset: usize,
    /// How it is stored.
    pub kind: NumberType,
    /// To rad/s, m/s^2 or 1; negative where the axis points the other way.
    pub scale: f64,
    /// What it is, in the sensor's axes.
    pub to: FieldQuantity,
}

/// Checksums of described frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Checksum {
    /// There is none.
    #[default]
    None,
    /// Eight bits of the sum.
    Sum8,
    /// Exclusive or.
    Xor8,
    /// CRC-16/MODBUS, low byte first.
    Crc16,
}

/// A frame on a wire, or a report of a HID device.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTable {
    /// First bytes of every frame; of a report: its number, where reports are numbered.
    pub header: Vec<u8>,
    /// All bytes of a frame.
    pub length: usize,
    /// The kind of checksum.
    pub checksum: Checksum,
    /// The first byte that is summed.
    pub sum_from: usize,
    /// Where the checksum stands; what is summed ends before it.
    pub sum_at: usize,
    /// Offset and type of a counter of frames.
    pub counter: Option<(usize, NumberType)>,
    /// Offset and type of the sensor's clock, and its tick in seconds.
    pub clock: Option<(usize, NumberType, f64)>,
    /// The numbers.
    pub fields: Vec<FrameField>,
}

impl FrameTable {
    /// Whether the quantity with this slot is stated.
    pub(crate) fn has(&self, slot: usize) -> bool {
        self.fields.iter().any(|field| field.to.slot() == slot)
    }

    fn checked(self) -> Result<Self, DescriptionError> {
        if !(2..=LONGEST_FRAME).contains(&self.length) {
            return Err(wrong(
                "frame.length",
                self.length,
                format!("must be within 2..={LONGEST_FRAME} bytes"),
            ));
        }
        if self.header.len() >= self.length || self.header.len() > 8 {
            let allowed = "must be at most 8 bytes and shorter than the frame";
            return Err(wrong("frame.header", format!("{:?}", self.header), allowed));
        }
        let sum_bytes = match self.checksum {
            Checksum::None => 0,
            Checksum::Sum8 | Checksum::Xor8 => 1,
            Checksum::Crc16 => 2,
        };
        if sum_bytes > 0 && (self.sum_at + sum_bytes > self.length || self.sum_from >= self.sum_at) {
            let allowed = format!("must be after sum_from and within {} bytes", self.length);
            return Err(wrong("frame.sum_at", self.sum_at, allowed));
        }
        let within = |key: &str, offset: usize, kind: NumberType| {
            let fits = offset.saturating_add(kind.bytes()) <= self.length;
            let allowed = format!("{kind:?} must end within {} bytes", self.length);
            if fits { Ok(()) } else { Err(wrong(key, offset, allowed)) }
        };
        for (key, at) in
            [("frame.counter", self.counter), ("frame.clock", self.clock.map(|(at, kind, _)| (at, kind)))]
        {
            let Some((offset, kind)) = at else { continue };
            within(key, offset, kind)?;
            if !kind.is_unsigned() {
                return Err(wrong(key, format!("{kind:?}"), "must be u8, u16le, u16be or u32le"));
            }
        }
        if let Some((_, _, tick_s)) = self.clock.filter(|(_, _, tick_s)| !(1e-9..=1.0).contains(tick_s)) {
            return Err(wrong("frame.clock.tick_s", tick_s, "must be within 1e-9..=1 s"));
        }
        self.check_fields(within)?;
        Ok(self)
    }

    fn check_fields(
        &self,
        within: impl Fn(&str, usize, NumberType) -> Result<(), DescriptionError>,
    ) -> Result<(), DescriptionError> {
        if self.fields.is_empty() || self.fields.len() > MOST_FIELDS {
            return Err(wrong("field", self.fields.len(), format!("must be 1 to {MOST_FIELDS} tables")));
        }
        for (k, field) in self.fields.iter().enumerate() {
            within(&format!("field[{k}].offset"), field.offset, field.kind)?;
            if !(field.scale.abs() >= 1e-12 && field.scale.abs() <= 1e6) {
                return Err(wrong(&format!("field[{k}].scale"), field.scale, "must be 1e-12 to 1e6, + or -"));
            }
            if self.fields[..k].iter().any(|other| other.to == field.to) {
                return Err(wrong(&format!("field[{k}].to"), format!("{:?}", field.to), "is given twice"));
            }
        }
        let count = |from: usize, to: usize| (from..to).filter(|slot| self.has(*slot)).count();
        let (gyro, accel, quaternion) = (count(0, 3), count(3, 6), count(6, 10));
        let is_whole = |n: usize, all: usize| n == 0 || n == all;
        let is_enough = quaternion == 4 || (gyro == 3 && accel == 3);
        if !(is_whole(gyro, 3) && is_whole(accel, 3) && is_whole(quaternion, 4) && is_enough) {
            let value = format!("{gyro} of gyro, {accel} of accel, {quaternion} of quat");
            return Err(wrong("field", value, "must be all of quat, or all of gyro and accel"));
        }
        Ok(())
    }
}

impl ImuDescription {
    /// Reads the `[imu]` table of a rig file; `Ok(None)` where the file has none. Other tables are not looked at.
    pub fn from_toml(text: &str) -> Result<Option<Self>, DescriptionError> {
        if text.len() > LONGEST_TEXT {
            return Err(wrong(
                "..",
                format!("{} bytes", text.len()),
                format!("must be at most {LONGEST_TEXT}"),
            ));
        }
        let whole: RigFile = toml::from_str(text).map_err(|e| wrong("..", "", e))?;
        whole.imu.map(Self::from_table).transpose()
    }

    fn from_table(table: ImuTable) -> Result<Self, DescriptionError> {
        if let Some(baud) = table.baud.filter(|baud| !BAUD.contains(baud)) {
            return Err(wrong("baud", baud, format!("must be within {BAUD:?}")));
        }
        if let Some(rate) = table.rate_hz.filter(|rate| !RATE_HZ.contains(rate)) {
            return Err(wrong("rate_hz", rate, format!("must be within {RATE_HZ:?} Hz")));
        }
        let frame = match table.frame {
            Some(frame) => Some(frame.with(table.field).checked()?),
            None if !table.field.is_empty() => return Err(wrong("field", "..", "needs a table [imu.frame]")),
            None => None,
        };
        let imu_from_sensor = match (&table.axes, table.rotation_q_wxyz) {
            (Some(_), Some(q)) => {
                return Err(wrong("rotation_q_wxyz", format!("{q:?}"), "axes say it already"));
            }
            (Some(axes), None) => axis_map(axes)?,
            (None, Some(q)) => rotation("rotation_q_wxyz", q)?,
            (None, None) => DQuat::IDENTITY,
        };
        let camera_from_imu =
            table.camera_from_imu_q_wxyz.map(|q| rotation("camera_from_imu_q_wxyz", q)).transpose()?;
        let (name, protocol, baud, rate_hz) = (table.name, table.protocol, table.baud, table.rate_hz);
        Ok(Self { name, protocol, baud, rate_hz, imu_from_sensor, camera_from_imu, frame })
    }

    /// The protocol of a serial port: what the device's name says, else what the rig says.
    pub fn serial_protocol(&self, named: Option<&str>) -> Result<Protocol, DescriptionError> {
        let Some(name) = named.or(self.protocol.as_deref()) else {
            return Err(wrong("protocol", "nothing", format!("must be one of {}", PROTOCOLS.join(", "))));
        };
        match name {
            "rvc" => Ok(Protocol::Rvc),
            "witmotion" => Ok(Protocol::WitMotion),
            "ypr" => Ok(Protocol::Ypr),
            "described" => match &self.frame {
                Some(table) if !table.header.is_empty() => Ok(Protocol::Described(table.clone())),
                Some(_) => Err(wrong("frame.header", "[]", "must have a byte or more on a serial line")),
                None => Err(wrong("frame", "nothing", "a described protocol needs a table [imu.frame]")),
            },
            _ => {
                let hint = nearest(name, &PROTOCOLS).map(|p| format!("did you mean \"{p}\"? "));
                let allowed = format!("{}Known: {}", hint.unwrap_or_default(), PROTOCOLS.join(", "));
                Err(wrong("protocol", name, allowed))
            }
        }
    }
}

/// `["x", "-y", "-z"]`: the samples' x, y and z are these axes of the sensor. A right-handed map only.
fn axis_map(axes: &[String; 3]) -> Result<DQuat, DescriptionError> {
    let value = format!("{axes:?}");
    let mut rows = [DVec3::ZERO; 3];
    for (row, axis) in rows.iter_mut().zip(axes) {
        let (sign, letter) = axis.strip_prefix('-').map_or((1.0, axis.as_str()), |letter| (-1.0, letter));
        *row = sign
            * match letter {
                "x" => DVec3::X,
                "y" => DVec3::Y,
                "z" => DVec3::Z,
                _ => return Err(wrong("axes", value, "must be three of x, y, z, -x, -y, -z")),
            };
    }
    let matrix = DMat3::from_cols_array_2d(&rows.map(|row| row.to_array())).transpose();
    if (matrix.determinant() - 1.0).abs() > 1e-9 {
        return Err(wrong(
            "axes",
            value,
            "must be each axis once, right-handed (an even number of mirrorings)",
        ));
    }
    Ok(DQuat::from_mat3(&matrix))
}

fn rotation(key: &str, q: [f64; 4]) -> Result<DQuat, DescriptionError> {
    let rotation = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
    if !((rotation.length() - 1.0).abs() <= 1e-3) {
        return Err(wrong(key, format!("{q:?}"), "must be w, x, y, z of length 1 (within 0.001)"));
    }
    Ok(rotation.normalize())
}

mod text;

#[cfg(test)]
mod tests;
