//! Oculus Rift DK2 (2833:0021) and CV1 (2833:0031): report 11, 64 bytes, two samples each at 1000 Hz.
//!
//! Source: the layout that the OpenHMD project documents (its driver `drv_oculus_rift`). Byte 0 report number, 3 number of new
//! samples, 4..6 samples before these, 8..12 the sensor's clock in microseconds at the last sample, 12..28 and 28..44 the samples:
//! forces, then rates, each three signed numbers of 21 bits, high bit first, in 0.0001 m/s^2 and 0.0001 rad/s. Axes: x right, y
//! up, z back. The values are raw: the headset's own calibration is not applied. Never tried on the hardware.

use crate::imu::sample::{SampleStamp, WireSample};
use crate::model::time::Timestamp;

/// The number of the report.
pub const REPORT: u8 = 11;
/// Its bytes.
pub const LENGTH: usize = 64;
/// Samples a second.
pub const RATE_HZ: f64 = 1000.0;
/// Feature report 17: report 11 is wanted for another 10,000 ms.
pub const KEEP_ALIVE: [u8; 6] = [17, 0, 0, REPORT, 0x10, 0x27];
/// Seconds between two of them.
pub const KEEP_ALIVE_S: f64 = 3.0;
/// Samples that one report holds at most.
const SAMPLES: usize = 2;

/// Gives the samples of one report; returns whether it is one.
pub fn read(report: &[u8], arrival: Timestamp, out: &mut impl FnMut(WireSample)) -> bool {
    if report.len() != LENGTH || report[0] != REPORT {
        return false;
    }
    let new = usize::from(report[3]).min(SAMPLES);
    let clock_us = u32::from_le_bytes([report[8], report[9], report[10], report[11]]);
    for (k, sample) in report[12..].chunks_exact(16).take(new).enumerate() {
        let before_us = 1000 * (new - 1 - k) as u32;
        out(WireSample {
            stamp: SampleStamp::Ticks {
                value: clock_us.wrapping_sub(before_us).into(),
                bits: 32,
                tick_s: 1e-6,
            },
            accel_m_s2: Some(three(&sample[..8])),
            gyro_rad_s: Some(three(&sample[8..])),
            ..WireSample::empty(arrival)
        });
    }
    true
}

/// Three signed numbers of 21 bits in 8 bytes, as 0.0001 of a unit.
fn three(bytes: &[u8]) -> [f64; 3] {
    let all = bytes.iter().fold(0u64, |all, byte| all << 8 | u64::from(*byte));
    [0, 21, 42].map(|from| {
        // The number's highest bit becomes the sign of 64.
        let signed = (all << from).cast_signed() >> 43;
        signed as f64 * 1e-4
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pack(values: [i64; 3]) -> [u8; 8] {
        let bits = values.iter().fold(0u64, |all, v| all << 21 | (v.cast_unsigned() & 0x1F_FFFF));
        (bits << 1).to_be_bytes()
    }

    #[test]
    fn a_report_has_its_samples_at_their_times() {
        let mut report = [0u8; LENGTH];
        report[0] = REPORT;
        report[3] = 2;
        report[8..12].copy_from_slice(&500u32.to_le_bytes());
        report[12..20].copy_from_slice(&pack([1, -2, 98_100]));
        report[20..28].copy_from_slice(&pack([-1_048_576, 1_048_575, 0]));
        let mut samples = Vec::new();
        assert!(read(&report, Timestamp(5), &mut |sample| samples.push(sample)));
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[0].stamp, SampleStamp::Ticks { value: 0xFFFF_FE0C, bits: 32, tick_s: 1e-6 });
        let near =
            |a: Option<[f64; 3]>, b: [f64; 3]| a.unwrap().iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(near(samples[0].accel_m_s2, [1e-4, -2e-4, 9.81]));
        assert!(near(samples[0].gyro_rad_s, [-104.8576, 104.8575, 0.0]));
        report[3] = 0;
        assert!(read(&report, Timestamp(5), &mut |_| panic!("no sample is new")));
        assert!(!read(&report[..63], Timestamp(5), &mut |_| {}));
    }
}
