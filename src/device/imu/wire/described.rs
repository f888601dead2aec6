//! Frames that a table describes: header, length, checksum, index, fields.

use super::resync::{WireLook, sum8};
use crate::imu::description::{Checksum, FrameTable, NumberType};
use crate::imu::sample::{SampleStamp, WireSample};
use crate::model::time::Timestamp;
use glam::DQuat;

/// Looks for a frame at the beginning of these bytes.
pub fn look(table: &FrameTable, bytes: &[u8], arrival: Timestamp) -> WireLook {
    if bytes.iter().zip(&table.header).any(|(byte, head)| byte != head) {
        return WireLook::Nothing;
    }
    let Some(frame) = bytes.get(..table.length) else { return WireLook::More };
    if !is_sum_right(table, frame) {
        return WireLook::WrongSum;
    }
    sample(table, frame, arrival).map_or(WireLook::Nothing, |sample| WireLook::Sample(table.length, sample))
}

/// Reads the fields of a whole frame or report; `None` where it is too short, or its quaternion is none.
pub fn sample(table: &FrameTable, frame: &[u8], arrival: Timestamp) -> Option<WireSample> {
    // 0..3 gyro, 3..6 force, 6..10 quaternion w, x, y, z.
    let mut values = [0.0; 10];
    for field in &table.fields {
        values[field.to.slot()] = read(field.kind, frame, field.offset)? * field.scale;
    }
    let three = |from: usize| [values[from], values[from + 1], values[from + 2]];
    let mut sample = WireSample::empty(arrival);
    sample.gyro_rad_s = table.has(0).then(|| three(0));
    sample.accel_m_s2 = table.has(3).then(|| three(3));
    if table.has(6) {
        let quaternion = DQuat::from_xyzw(values[7], values[8], values[9], values[6]);
        if !((quaternion.length() - 1.0).abs() <= 0.02) {
            return None;
        }
        sample.orientation = Some(quaternion.normalize());
    }
    if let Some((offset, kind)) = table.counter {
        let modulus = 1 << (8 * kind.bytes().min(2));
        sample.stamp = SampleStamp::Count { value: read(kind, frame, offset)? as u32 % modulus, modulus };
    }
    if let Some((offset, kind, tick_s)) = table.clock {
        let bits = 8 * kind.bytes() as u32;
        sample.stamp = SampleStamp::Ticks { value: read(kind, frame, offset)? as u64, bits, tick_s };
    }
    Some(sample)
}

/// One number of a frame.
fn read(kind: NumberType, frame: &[u8], offset: usize) -> Option<f64> {
    let bytes = frame.get(offset..offset.checked_add(kind.bytes())?)?;
    let two = || bytes.try_into().ok().map(|b: [u8; 2]| b);
    let four = || bytes.try_into().ok().map(|b: [u8; 4]| b);
    Some(match kind {
        NumberType::U8 => f64::from(bytes[0]),
        NumberType::I8 => f64::from(bytes[0].cast_signed()),
        NumberType::U16le => f64::from(u16::from_le_bytes(two()?)),
        NumberType::I16le => f64::from(i16::from_le_bytes(two()?)),
        NumberType::U16be => f64::from(u16::from_be_bytes(two()?)),
        NumberType::I16be => f64::from(i16::from_be_bytes(two()?)),
        NumberType::U32le => f64::from(u32::from_le_bytes(four()?)),
        NumberType::I32le => f64::from(i32::from_le_bytes(four()?)),
        NumberType::I32be => f64::from(i32::from_be_bytes(four()?)),
        NumberType::F32le => f64::from(f32::from_le_bytes(four()?)),
    })
}

fn is_sum_right(table: &FrameTable, frame: &[u8]) -> bool {
    let at = table.sum_at;
    let summed = frame.get(table.sum_from..at).unwrap_or_default();
    let stated = |k: usize| frame.get(at + k).copied().unwrap_or(0);
    match table.checksum {
        Checksum::None => true,
        Checksum::Sum8 => sum8(summed) == stated(0),
        Checksum::Xor8 => summed.iter().fold(0, |sum, byte| sum ^ byte) == stated(0),
        Checksum::Crc16 => crc16(summed) == u16::from_le_bytes([stated(0), stated(1)]),
    }
}

/// CRC-16/MODBUS: polynomial 0xA001 reflected, begins at 0xFFFF.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xA001 } else { c >> 1 })
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_checksum_is_the_catalogue_s() {
        assert_eq!(super::crc16(b"123456789"), 0x4B37);
    }
}
