//! WitMotion's frames: 0x55, a kind, eight bytes and the sum of all before. Frames of one moment follow each other with rising
//! kinds; together they are a sample.
//!
//! Source: WitMotion, "WT901 communication protocol": kind 0x51 forces (16 g full scale), 0x52 rates (2000 degrees/s), 0x53
//! roll, pitch, yaw (180 degrees), 0x59 quaternion w, x, y, z (1), each a signed 16 bits with the low byte first, of 32,768.
//! Angles turn about z, then y, then x; z is up. There is no index: the order of the kinds stands in for it.

use super::resync::{WireLook, i16_at, sum8};
use crate::imu::sample::{GRAVITY_M_S2, WireSample, z_up_from_yaw_pitch_roll};
use crate::model::time::Timestamp;
use glam::DQuat;

/// Bytes in a frame.
pub const LENGTH: usize = 11;
/// The kinds: from time of day to the quaternion and GPS accuracy.
const KINDS: std::ops::RangeInclusive<u8> = 0x50..=0x5A;

/// The frames of one moment.
#[derive(Clone, Debug)]
pub struct FrameGroup {
    sample: WireSample,
    /// Kinds seen in this group, a bit each; those of the group before; those of a whole one.
    kinds: u16,
    before: u16,
    whole: u16,
}

impl Default for FrameGroup {
    fn default() -> Self {
        Self { sample: WireSample::empty(Timestamp(0)), kinds: 0, before: 0, whole: 0 }
    }
}

impl FrameGroup {
    /// Looks for a frame at the beginning of these bytes; the last frame of a group has the sample.
    pub fn look(&mut self, bytes: &[u8], arrival: Timestamp) -> WireLook {
        let is_head = bytes.first() == Some(&0x55) && bytes.get(1).is_none_or(|kind| KINDS.contains(kind));
        if !is_head {
            return WireLook::Nothing;
        }
        let Some(frame) = bytes.get(..LENGTH) else { return WireLook::More };
        if sum8(&frame[..LENGTH - 1]) != frame[LENGTH - 1] {
            return WireLook::WrongSum;
        }
        let bit = 1u16 << (frame[1] - KINDS.start());
        if self.kinds >= bit {
            self.close();
        }
        self.kinds |= bit;
        if !self.put(frame) {
            return WireLook::Nothing;
        }
        if self.kinds != self.whole || (self.sample.orientation.is_none() && self.sample.gyro_rad_s.is_none())
        {
            return WireLook::Part(LENGTH);
        }
        let sample = WireSample { arrival, ..self.sample };
        WireLook::Sample(LENGTH, sample)
    }

    /// Ends a group. Two groups of the same kinds in a row say what a whole one is.
    fn close(&mut self) {
        if self.kinds == self.before {
            self.whole = self.kinds;
        }
        self.before = self.kinds;
        self.kinds = 0;
        self.sample = WireSample::empty(Timestamp(0));
    }

    /// Takes the values of a frame; returns whether they can be.
    fn put(&mut self, frame: &[u8]) -> bool {
        let values = [2, 4, 6, 8].map(|at| i16_at(frame, at) / 32_768.0);
        let [x, y, z, w] = values;
        match frame[1] {
            0x51 => self.sample.accel_m_s2 = Some([x, y, z].map(|v| v * 16.0 * GRAVITY_M_S2)),
            0x52 => self.sample.gyro_rad_s = Some([x, y, z].map(|v| (v * 2000.0).to_radians())),
            // The quaternion is finer than the angles.
            0x53 if self.kinds & (1 << 9) == 0 => {
                if y.abs() > 0.5 {
                    return false;
                }
                self.sample.orientation = Some(z_up_from_yaw_pitch_roll(z * 180.0, y * 180.0, x * 180.0));
            }
            0x59 => {
                let quaternion = DQuat::from_xyzw(y, z, w, x);
                if (quaternion.length() - 1.0).abs() > 0.02 {
                    return false;
                }
                self.sample.orientation = Some(quaternion.normalize());
            }
            _ => {}
        }
        true
    }
}
