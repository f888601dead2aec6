//! BNO08x in UART-RVC mode: 100 frames a second of 19 bytes at 115,200 baud, fused by the sensor.
//!
//! Source: CEVA, "BNO08X Data Sheet", section "UART-RVC protocol": 0xAA 0xAA, index, yaw, pitch, roll (0.01 degrees), forces
//! along x, y, z (0.001 g), all signed 16 bits with the low byte first, three bytes of status, and the sum of all bytes after
//! the header. Angles turn about z, then y, then x; z is up. The first two bytes of status may have values (BNO086); the last is 0.

use super::resync::{WireLook, i16_at, sum8};
use crate::imu::sample::{GRAVITY_M_S2, SampleStamp, WireSample, z_up_from_yaw_pitch_roll};
use crate::model::time::Timestamp;

/// Bytes in a frame.
pub const LENGTH: usize = 19;

/// Looks for a frame at the beginning of these bytes.
pub fn look(bytes: &[u8], arrival: Timestamp) -> WireLook {
    if bytes.iter().zip([0xAA, 0xAA]).any(|(byte, head)| *byte != head) {
        return WireLook::Nothing;
    }
    let Some(frame) = bytes.get(..LENGTH) else { return WireLook::More };
    if sum8(&frame[2..LENGTH - 1]) != frame[LENGTH - 1] {
        return WireLook::WrongSum;
    }
    let degrees = [3, 5, 7].map(|at| i16_at(frame, at) * 0.01);
    if degrees[0].abs() > 180.0 || degrees[1].abs() > 90.0 || degrees[2].abs() > 180.0 || frame[17] != 0 {
        return WireLook::Nothing;
    }
    let accel = [9, 11, 13].map(|at| i16_at(frame, at) * 1e-3 * GRAVITY_M_S2);
    WireLook::Sample(
        LENGTH,
        WireSample {
            stamp: SampleStamp::Count { value: u32::from(frame[2]), modulus: 256 },
            orientation: Some(z_up_from_yaw_pitch_roll(degrees[0], degrees[1], degrees[2])),
            accel_m_s2: Some(accel),
            ..WireSample::empty(arrival)
        },
    )
}
