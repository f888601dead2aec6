//! Orientation from rates and forces: VQF (Laidig and Seel, "VQF: Highly accurate IMU orientation estimation with bias
//! estimation and magnetic disturbance rejection", 2023), by the crate `vqf-rs`, with its authors' parameters.
//!
//! Without a magnetometer the heading begins anywhere and drifts by what is left of the gyroscope's bias. VQF calls this 6D.

use glam::DQuat;

/// The longest time over which one sample's rate is taken to hold, seconds.
pub const LONGEST_STEP_S: f64 = 0.1;

/// The filter of one sensor.
pub struct Fusion {
    filter: vqf_rs::VQF,
}

impl Fusion {
    /// Takes the time between samples, seconds; `None` where it is not within 0.0001 to 1.
    pub fn new(period_s: f64) -> Option<Self> {
        let is_sound = (1e-4..=1.0).contains(&period_s);
        is_sound.then(|| Self { filter: vqf_rs::VQF::new(period_s, None, None, None) })
    }

    /// Takes a sample and the seconds since the one before (more than the period where samples were lost; at most
    /// [`LONGEST_STEP_S`] count). Gives the sensor's axes to a level frame with z up. `None` for numbers that are not finite,
    /// which are left out.
    pub fn update(&mut self, gyro_rad_s: [f64; 3], accel_m_s2: [f64; 3], since_last_s: f64) -> Option<DQuat> {
        if !since_last_s.is_finite() || !gyro_rad_s.iter().chain(&accel_m_s2).all(|x| x.is_finite()) {
            return None;
        }
        self.filter.update_gyr_with_ts(gyro_rad_s, since_last_s.clamp(0.0, LONGEST_STEP_S));
        self.filter.update_acc(accel_m_s2);
        let q = self.filter.quat_6d();
        let level_from_imu = DQuat::from_xyzw(q.1, q.2, q.3, q.0);
        level_from_imu.is_finite().then_some(level_from_imu)
    }

    /// What the gyroscope shows at rest, rad/s.
    pub fn gyro_bias_rad_s(&self) -> [f64; 3] {
        self.filter.bias_estimate().0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn at_rest_the_tilt_is_gravity_s_and_the_bias_is_found() {
        let mut fusion = Fusion::new(0.01).unwrap();
        let up = DVec3::new(0.3, -0.4, 0.866).normalize();
        let mut tilt = None;
        for _ in 0..3000 {
            tilt = fusion.update([0.01, -0.02, 0.005], (up * 9.81).to_array(), 0.01);
        }
        assert!((tilt.unwrap() * up).angle_between(DVec3::Z) < 0.002);
        assert!((fusion.gyro_bias_rad_s()[1] + 0.02).abs() < 1e-3);
        assert!(fusion.update([f64::NAN, 0.0, 0.0], [0.0; 3], 0.01).is_none());
        assert!(Fusion::new(0.0).is_none() && Fusion::new(f64::NAN).is_none());
    }
}
