//! From what a protocol states to what the program takes: times, axes, and the orientation, whoever makes it.

use super::arrival::Arrivals;
use super::fusion::Fusion;
use super::gates::is_possible;
use super::sample::{GRAVITY_M_S2, WireSample};
use crate::model::imu::{FusedBy, ImuOrientation, ImuSample};
use glam::{DQuat, DVec3};
use std::collections::VecDeque;

/// Samples that wait for the one who asks; older ones are dropped.
pub const WAITING: usize = 256;

/// What becomes of the samples of one sensor.
pub struct Assembler {
    arrivals: Arrivals,
    imu_from_sensor: DQuat,
    fusion: Option<Fusion>,
    before: Option<ImuOrientation>,
    orientation: Option<ImuOrientation>,
    waiting: VecDeque<WireSample>,
    dropped: u64,
}

impl Assembler {
    /// Takes the sensor's samples a second, and its axes to those of the samples.
    pub fn new(rate_hz: f64, imu_from_sensor: DQuat) -> Self {
        Self {
            arrivals: Arrivals::new(1.0 / rate_hz),
            imu_from_sensor,
            fusion: None,
            before: None,
            orientation: None,
            waiting: VecDeque::with_capacity(WAITING),
            dropped: 0,
        }
    }

    /// Takes a sample off the wire. Where too many wait, the oldest is dropped and counted.
    pub fn put(&mut self, sample: WireSample) {
        if !is_possible(&sample) {
            self.dropped += 1;
            return;
        }
        if self.waiting.len() == WAITING {
            self.waiting.pop_front();
            self.dropped += 1;
        }
        self.waiting.push_back(sample);
    }

    /// The next sample, where one waits.
    pub fn take(&mut self) -> Option<ImuSample> {
        while let Some(sample) = self.waiting.pop_front() {
            if let Some(sample) = self.assemble(&sample) {
                return Some(sample);
            }
        }
        None
    }

    /// Whether a sample waits (it may yet be left out).
    pub fn has_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// The orientation at the sample last taken.
    pub fn orientation(&self) -> Option<ImuOrientation> {
        self.orientation
    }

    /// Samples that were left out: too many at once, not in order of time, or not possible.
    pub fn dropped(&self) -> u64 {
        self.dropped + self.arrivals.dropped()
    }

    fn assemble(&mut self, wire: &WireSample) -> Option<ImuSample> {
        let t = self.arrivals.time(wire.arrival, wire.stamp)?;
        let turned = |v: [f64; 3]| self.imu_from_sensor * DVec3::from(v);
        let (gyro, accel) = (wire.gyro_rad_s.map(turned), wire.accel_m_s2.map(turned));
        let own = wire.orientation.map(|level_from_sensor| ImuOrientation {
            t,
            level_from_imu: level_from_sensor * self.imu_from_sensor.inverse(),
            fused_by: FusedBy::Sensor,
        });
        let before = std::mem::replace(&mut self.before, own);
        // A sensor that gives no rates turned from one orientation to the next.
        let gyro = gyro.or_else(|| {
            let (before, own) = (before?, own?);
            // Where samples came so late that their times began anew, those tell.
            let since_s = Some(self.arrivals.since_last_s()).filter(|since_s| *since_s > 0.0);
            mean_rate(&before, &own, since_s.unwrap_or_else(|| own.t.seconds_since(before.t)))
        })?;
        // One that gives no forces is taken to feel gravity alone.
        let accel =
            accel.or_else(|| Some(own?.level_from_imu.inverse() * DVec3::new(0.0, 0.0, GRAVITY_M_S2)))?;
        let sample = ImuSample { t, gyro_rad_s: gyro.to_array(), accel_m_s2: accel.to_array() };
        self.orientation = own.or_else(|| self.fuse(&sample));
        Some(sample)
    }

    fn fuse(&mut self, sample: &ImuSample) -> Option<ImuOrientation> {
        if self.fusion.is_none() {
            // The filter's coefficients depend on the rate, which is measured first.
            if !self.arrivals.is_settled() {
                return None;
            }
            self.fusion = Fusion::new(self.arrivals.period_s());
        }
        let since_last_s = self.arrivals.since_last_s();
        let level_from_imu =
            self.fusion.as_mut()?.update(sample.gyro_rad_s, sample.accel_m_s2, since_last_s)?;
        Some(ImuOrientation { t: sample.t, level_from_imu, fused_by: FusedBy::Host })
    }
}

/// The constant rate that turns one orientation into the next, in the sensor's axes, rad/s.
fn mean_rate(before: &ImuOrientation, after: &ImuOrientation, dt: f64) -> Option<DVec3> {
    let turn = before.level_from_imu.inverse() * after.level_from_imu;
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let rate = turn.to_scaled_axis() / dt;
    (dt > 0.0 && rate.is_finite()).then_some(rate)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu::sample::SampleStamp;
    use crate::model::time::Timestamp;

    fn wire(k: u32) -> WireSample {
        WireSample {
            stamp: SampleStamp::Count { value: k % 256, modulus: 256 },
            ..WireSample::empty(Timestamp(i64::from(k) * 10_000_000))
        }
    }

    #[test]
    fn a_sensor_that_fuses_gives_rates_through_the_axes_it_is_mounted_with() {
        let mount = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let mut assembler = Assembler::new(100.0, mount);
        for k in 0..100 {
            let orientation = Some(DQuat::from_rotation_z(0.02 * f64::from(k)));
            assembler.put(WireSample { orientation, ..wire(k) });
        }
        let mut last = None;
        while let Some(sample) = assembler.take() {
            last = Some(sample);
        }
        let last = last.unwrap();
        // The sensor's z is the samples' -y.
        assert!(DVec3::from(last.gyro_rad_s).abs_diff_eq(DVec3::new(0.0, -2.0, 0.0), 1e-6), "{last:?}");
        assert!(DVec3::from(last.accel_m_s2).abs_diff_eq(DVec3::new(0.0, -GRAVITY_M_S2, 0.0), 1e-9));
        assert_eq!(assembler.orientation().unwrap().fused_by, FusedBy::Sensor);
    }

    #[test]
    fn no_sample_is_lost_where_a_pause_makes_times_begin_anew() {
        let mut assembler = Assembler::new(100.0, DQuat::IDENTITY);
        let mut given = 0;
        for k in 0..200 {
            let mut sample = wire(k);
            // From the hundredth on everything comes 0.4 s late.
            let late_s = if k >= 100 { 0.4 } else { 0.0 };
            sample.arrival = sample.arrival.plus_seconds(late_s);
            (sample.gyro_rad_s, sample.orientation) =
                (None, Some(DQuat::from_rotation_z(0.001 * f64::from(k))));
            assembler.put(sample);
            given += usize::from(assembler.take().is_some());
        }
        assert_eq!(given, 199, "all but the first, which has no rate");
    }

    #[test]
    fn a_raw_sensor_is_fused_here_and_says_so() {
        let mut assembler = Assembler::new(100.0, DQuat::IDENTITY);
        for k in 0..200 {
            let (gyro_rad_s, accel_m_s2) = (Some([0.0; 3]), Some([0.0, 0.0, 9.8]));
            assembler.put(WireSample { gyro_rad_s, accel_m_s2, ..wire(k) });
        }
        let mut count = 0;
        while assembler.take().is_some() {
            count += 1;
        }
        assert_eq!(count, 200);
        assert_eq!(assembler.orientation().unwrap().fused_by, FusedBy::Host);
    }

    #[test]
    fn a_flood_is_bounded_and_counted() {
        let mut assembler = Assembler::new(100.0, DQuat::IDENTITY);
        for k in 0..1000 {
            assembler.put(WireSample { gyro_rad_s: Some([0.0; 3]), accel_m_s2: Some([0.0; 3]), ..wire(k) });
        }
        let impossible = WireSample { gyro_rad_s: Some([f64::NAN; 3]), ..wire(1000) };
        assembler.put(impossible);
        assert_eq!(assembler.dropped(), 1000 - WAITING as u64 + 1);
    }
}
