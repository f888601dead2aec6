//! Foxglove's schemas, in JSON and in protobuf. Pure; any bytes give a message or an error.

use super::lens::CalibrationFields;
use super::messages::{PoseInFrame, Time, parse};
use super::wire::{WireField, fields};
use crate::model::{base64, time::Timestamp};
use glam::{DQuat, DVec3};
use serde::Deserialize;

/// Fields of a protobuf message by their numbers, the last of each; lists of numbers are gathered.
struct Proto<'a> {
    found: Vec<(u32, WireField<'a>)>,
}

impl<'a> Proto<'a> {
    fn read(message: &'a [u8]) -> Result<Self, String> {
        let found = fields(message).collect::<Option<Vec<_>>>().ok_or("it is not valid protobuf")?;
        Ok(Self { found })
    }

    fn last(&self, number: u32) -> Option<WireField<'a>> {
        self.found.iter().rev().find(|(n, _)| *n == number).map(|(_, field)| *field)
    }

    fn bytes(&self, number: u32) -> &'a [u8] {
        match self.last(number) {
            Some(WireField::Bytes(bytes)) => bytes,
            _ => &[],
        }
    }

    fn text(&self, number: u32) -> Result<&'a str, String> {
        std::str::from_utf8(self.bytes(number)).map_err(|_e| format!("field {number} is not UTF-8"))
    }

    fn whole(&self, number: u32) -> u64 {
        match self.last(number) {
            Some(WireField::Fixed32(n)) => u64::from(n),
            Some(WireField::Varint(n) | WireField::Fixed64(n)) => n,
            _ => 0,
        }
    }

    fn u32(&self, number: u32) -> u32 {
        u32::try_from(self.whole(number)).unwrap_or(u32::MAX)
    }

    fn f64(&self, number: u32) -> f64 {
        match self.last(number) {
            Some(WireField::Fixed64(bits)) => f64::from_bits(bits),
            _ => 0.0,
        }
    }

    /// Numbers one by one or packed.
    fn f64s(&self, number: u32) -> Result<Vec<f64>, String> {
        let mut all = Vec::new();
        for (_, field) in self.found.iter().filter(|(n, _)| *n == number) {
            match field {
                WireField::Fixed64(bits) => all.push(f64::from_bits(*bits)),
                WireField::Bytes(packed) if packed.len() % 8 == 0 => {
                    let bits = packed.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b));
                    all.extend(bits);
                }
                _ => return Err(format!("field {number} is no list of doubles")),
            }
        }
        Ok(all)
    }

    /// A `google.protobuf.Timestamp`.
    fn time(&self, number: u32) -> Result<Timestamp, String> {
        let time = Self::read(self.bytes(number))?;
        Ok(Time { sec: time.whole(1) as i64, nsec: time.u32(2) }.into())
    }
}

/// `foxglove.CameraCalibration` in protobuf.
pub(super) fn calibration_of_protobuf(message: &[u8]) -> Result<CalibrationFields, String> {
    let m = Proto::read(message)?;
    Ok(CalibrationFields {
        width: m.u32(2),
        height: m.u32(3),
        distortion_model: m.text(4)?.to_owned(),
        d: m.f64s(5)?,
        k: m.f64s(6)?,
    })
}

/// The same in JSON.
pub(super) fn calibration_of_json(message: &[u8]) -> Result<CalibrationFields, String> {
    parse(message)
}

/// `foxglove.PoseInFrame`: time, rotation, translation.
pub(super) fn pose_of_protobuf(message: &[u8]) -> Result<(Timestamp, DQuat, DVec3), String> {
    let m = Proto::read(message)?;
    let pose = Proto::read(m.bytes(3))?;
    let (place, turn) = (Proto::read(pose.bytes(1))?, Proto::read(pose.bytes(2))?);
    let rotation = DQuat::from_xyzw(turn.f64(1), turn.f64(2), turn.f64(3), turn.f64(4));
    Ok((m.time(1)?, rotation, DVec3::new(place.f64(1), place.f64(2), place.f64(3))))
}

/// The same in JSON.
pub(super) fn pose_of_json(message: &[u8]) -> Result<(Timestamp, DQuat, DVec3), String> {
    let m: PoseInFrame = parse(message)?;
    let o = m.pose.orientation;
    Ok((m.timestamp.into(), DQuat::from_xyzw(o.x, o.y, o.z, o.w), m.pose.position.into()))
}

/// `foxglove.CompressedImage`: its time, format and data.
pub(super) struct CompressedImage<'a> {
    pub(super) t: Timestamp,
    pub(super) format: String,
    pub(super) data: std::borrow::Cow<'a, [u8]>,
}

/// Its last field of each number counts, as the encoding's guide asks.
pub(super) fn compressed_of_protobuf(message: &[u8]) -> Result<CompressedImage<'_>, String> {
    let m = Proto::read(message)?;
    let format = String::from_utf8_lossy(m.bytes(3)).into_owned();
    Ok(CompressedImage { t: m.time(1)?, format, data: m.bytes(2).into() })
}

#[derive(Deserialize)]
struct CompressedMessage {
    timestamp: Option<serde_json::Value>,
    #[serde(default)]
    format: String,
    data: String,
}

/// 0 where it is written in no way that is known: the log's time stands in.
fn time_of(timestamp: Option<serde_json::Value>) -> Timestamp {
    let time = timestamp.and_then(|value| serde_json::from_value::<Time>(value).ok());
    time.map_or(Timestamp(0), Timestamp::from)
}

/// In JSON, its data in base64.
pub(super) fn compressed_of_json(message: &[u8]) -> Result<CompressedImage<'static>, String> {
    let CompressedMessage { timestamp, format, data } = parse(message)?;
    let data = base64::decode(&data).ok_or("data is not base64")?.into();
    Ok(CompressedImage { t: time_of(timestamp), format, data })
}

/// `foxglove.RawImage`.
pub(super) struct RawImage<'a> {
    pub(super) t: Timestamp,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) encoding: String,
    pub(super) step: u32,
    pub(super) data: std::borrow::Cow<'a, [u8]>,
}

/// Numbers that are left out are 0, as the encoding's guide asks.
pub(super) fn raw_of_protobuf(message: &[u8]) -> Result<RawImage<'_>, String> {
    let m = Proto::read(message)?;
    let encoding = m.text(4)?.to_owned();
    Ok(RawImage {
        t: m.time(1)?,
        width: m.u32(2),
        height: m.u32(3),
        encoding,
        step: m.u32(5),
        data: m.bytes(6).into(),
    })
}

#[derive(Deserialize)]
struct RawMessage {
    timestamp: Option<serde_json::Value>,
    width: u32,
    height: u32,
    encoding: String,
    step: u32,
    data: String,
}

/// In JSON, its data in base64.
pub(super) fn raw_of_json(message: &[u8]) -> Result<RawImage<'static>, String> {
    let RawMessage { timestamp, width, height, encoding, step, data } = parse(message)?;
    let data = base64::decode(&data).ok_or("data is not base64")?.into();
    Ok(RawImage { t: time_of(timestamp), width, height, encoding, step, data })
}
