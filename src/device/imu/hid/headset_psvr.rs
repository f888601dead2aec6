//! Sony PlayStation VR, first generation (054c:09af): 64 bytes on the interface of its sensors, two samples each at 2000 Hz.
//!
//! Source: the layout that the OpenHMD and Monado projects document (their drivers `drv_psvr`). From byte 16 and from byte 32: the
//! sensor's clock in microseconds (32 bits), rates, forces, each three signed 16 bits, low byte first, full scale 2000 degrees/s and
//! 2 g (16,384 for 1 g). Axes of the numbers: up, right, ahead; here x right, y up, z back. The headset must be switched on, by
//! its button. Never tried on the hardware.

use crate::imu::sample::{GRAVITY_M_S2, SampleStamp, WireSample};
use crate::imu::wire::resync::i16_at;
use crate::model::time::Timestamp;

/// Bytes of a report.
pub const LENGTH: usize = 64;
/// Samples a second.
pub const RATE_HZ: f64 = 2000.0;

/// Gives the samples of one report; returns whether it is one.
pub fn read(report: &[u8], arrival: Timestamp, out: &mut impl FnMut(WireSample)) -> bool {
    if report.len() != LENGTH {
        return false;
    }
    for sample in report[16..48].chunks_exact(16) {
        let clock_us = u32::from_le_bytes([sample[0], sample[1], sample[2], sample[3]]);
        let turned = |from: usize, scale: f64| {
            let [up, right, ahead] = [0, 2, 4].map(|at| i16_at(sample, from + at) * scale);
            Some([right, up, -ahead])
        };
        out(WireSample {
            stamp: SampleStamp::Ticks { value: clock_us.into(), bits: 32, tick_s: 1e-6 },
            gyro_rad_s: turned(4, (2000.0f64 / 32_768.0).to_radians()),
            accel_m_s2: turned(10, GRAVITY_M_S2 / 16_384.0),
            ..WireSample::empty(arrival)
        });
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_has_two_samples() {
        let mut report = [0u8; LENGTH];
        report[16..20].copy_from_slice(&1000u32.to_le_bytes());
        report[20..22].copy_from_slice(&16_384i16.to_le_bytes());
        report[26..28].copy_from_slice(&16_384i16.to_le_bytes());
        report[32..36].copy_from_slice(&1500u32.to_le_bytes());
        let mut samples = Vec::new();
        assert!(read(&report, Timestamp(1), &mut |sample| samples.push(sample)));
        assert!((samples[0].accel_m_s2.unwrap()[1] - GRAVITY_M_S2).abs() < 1e-12);
        assert!((samples[0].gyro_rad_s.unwrap()[1] - 1000f64.to_radians()).abs() < 1e-9);
        assert_eq!(samples[1].stamp, SampleStamp::Ticks { value: 1500, bits: 32, tick_s: 1e-6 });
        assert!(!read(&report[..10], Timestamp(1), &mut |_| {}));
    }
}
