//! Prediction against rotations that are known exactly.

use super::rates::KEPT_SAMPLES;
use super::*;
use proptest::prelude::*;

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(seconds)
}

fn seen(seconds: f64, rotation: DQuat, translation: DVec3) -> PoseEstimate {
    PoseEstimate {
        t: at(seconds),
        world_from_camera: Pose::new(rotation, translation),
        provenance: Provenance::Measured,
        sigma_position_m: 0.002,
        sigma_rotation_rad: 0.005,
    }
}

fn sample(seconds: f64, rate: DVec3) -> ImuSample {
    ImuSample { t: at(seconds), gyro_rad_s: rate.to_array(), accel_m_s2: [0.0, 0.0, 9.81] }
}

/// A camera that nods and sways: its rotation, and its rate in its own axes by central differences.
fn swaying(t: f64) -> DQuat {
    DQuat::from_rotation_z(0.5 * (3.0 * t).sin())
        * DQuat::from_rotation_x(0.4 * (5.0 * t).sin())
        * DQuat::from_rotation_y(0.3 * (4.0 * t).cos())
}

fn swaying_rate(t: f64) -> DVec3 {
    let h = 1e-4;
    (swaying(t - h).conjugate() * swaying(t + h)).to_scaled_axis() / (2.0 * h)
}

fn angle(a: DQuat, b: DQuat) -> f64 {
    turn_between(a, b).length()
}

#[test]
fn a_constant_turn_is_predicted_exactly() {
    let rate = DVec3::new(0.3, -0.8, 0.5);
    let mut fuser = Fuser::new(FuseOptions::default());
    fuser.tag(&seen(1.0, DQuat::IDENTITY, DVec3::ZERO));
    for k in 0..=60 {
        assert!(fuser.imu(&sample(0.9 + 0.005 * f64::from(k), rate)));
    }
    for ahead in [0.0013, 0.0333, 0.1, 0.2, 0.25] {
        let estimate = fuser.pose_at(at(1.0 + ahead)).unwrap();
        let exact = DQuat::from_scaled_axis(rate * ahead);
        assert!(angle(estimate.world_from_camera.rotation, exact) < 1e-9, "{ahead}");
        assert!(
            matches!(estimate.provenance, Provenance::Predicted { age_s } if (age_s - ahead).abs() < 1e-9)
        );
    }
}

#[test]
fn a_turn_about_changing_axes_is_followed() {
    // 200 samples a second. Reached: 4.7e-5 rad, of which the bend of the rate between samples is the most; without the
    // second-order term 5.2e-5.
    let mut fuser = Fuser::new(FuseOptions::default());
    fuser.tag(&seen(1.0, swaying(1.0), DVec3::ZERO));
    for k in 0..=220 {
        let t = 0.95 + 0.005 * f64::from(k);
        fuser.imu(&sample(t, swaying_rate(t)));
    }
    for k in 1..=10 {
        let t = 1.0 + 0.1 * f64::from(k);
        let error = angle(fuser.pose_at(at(t)).unwrap().world_from_camera.rotation, swaying(t));
        assert!(error < 5e-5, "{t}: {error}");
    }
}

#[test]
fn mounting_and_offset_of_the_sensor_are_taken_off() {
    let camera_from_imu = DQuat::from_scaled_axis(DVec3::new(0.7, -1.1, 0.4));
    let options = FuseOptions { camera_from_imu, time_offset_s: 0.017, ..FuseOptions::default() };
    let mut fuser = Fuser::new(options);
    fuser.tag(&seen(1.0, swaying(1.0), DVec3::ZERO));
    for k in 0..=100 {
        let t = 0.95 + 0.005 * f64::from(k);
        fuser.imu(&sample(t + 0.017, camera_from_imu.conjugate() * swaying_rate(t)));
    }
    let error = angle(fuser.pose_at(at(1.4)).unwrap().world_from_camera.rotation, swaying(1.4));
    assert!(error < 5e-5, "{error}");
}

#[test]
fn the_pose_of_a_tag_comes_back_bit_for_bit_at_its_own_time() {
    let mut fuser = Fuser::new(FuseOptions::default());
    assert!(fuser.pose_at(at(1.0)).is_none());
    let mut given = Vec::new();
    for k in 0..20 {
        let t = 1.0 + f64::from(k) / 30.0;
        for j in 0..7 {
            fuser.imu(&sample(t - 0.03 + 0.005 * f64::from(j), swaying_rate(t)));
        }
        let tag = seen(t, swaying(t), DVec3::new(0.1 * t, 0.2, (7.0 * t).sin()));
        assert!(fuser.tag(&tag));
        assert_eq!(fuser.pose_at(tag.t), Some(tag));
        given.push(tag);
    }
    for tag in &given[given.len() - KEPT_TAGS..] {
        assert_eq!(fuser.pose_at(tag.t), Some(*tag));
    }
    // Older than all that is kept: the oldest, with its own time.
    assert_eq!(fuser.pose_at(at(0.5)), Some(given[given.len() - KEPT_TAGS]));
    let between = fuser.pose_at(at(1.0 + 18.5 / 30.0)).unwrap();
    assert_eq!(between.provenance, Provenance::Interpolated);
    assert!(angle(between.world_from_camera.rotation, swaying(1.0 + 18.5 / 30.0)) < 2e-3);
}

#[test]
fn only_newer_sound_measurements_count() {
    let mut fuser = Fuser::new(FuseOptions::default());
    let good = seen(1.0, DQuat::IDENTITY, DVec3::ZERO);
    assert!(fuser.tag(&good) && !fuser.tag(&good));
    assert!(!fuser.tag(&PoseEstimate { t: at(0.9), ..good }));
    assert!(!fuser.tag(&PoseEstimate {
        t: at(1.1),
        provenance: Provenance::Predicted { age_s: 0.1 },
        ..good
    }));
    assert!(!fuser.tag(&PoseEstimate { t: at(1.1), sigma_rotation_rad: f64::NAN, ..good }));
    let mut broken = PoseEstimate { t: at(1.1), ..good };
    broken.world_from_camera.translation.x = f64::NAN;
    assert!(!fuser.tag(&broken));
    assert_eq!(fuser.pose_at(at(1.0)), Some(good));
}

/// Runs tags at 30 Hz and samples at 200 Hz for so long; returns the bias found and its sigma.
fn bias_after(
    seconds: f64,
    bias: DVec3,
    rotation: impl Fn(f64) -> DQuat,
    rate: impl Fn(f64) -> DVec3,
) -> (DVec3, f64) {
    let mut fuser = Fuser::new(FuseOptions::default());
    let mut next_tag = 0.1;
    for k in 0..(seconds * 200.0) as u32 {
        let t = 0.005 * f64::from(k);
        fuser.imu(&sample(t, rate(t) + bias));
        if t > next_tag + 0.01 {
            fuser.tag(&seen(next_tag, rotation(next_tag), DVec3::ZERO));
            next_tag += 1.0 / 30.0;
        }
    }
    let (mean, sigma) = fuser.gyro_bias_rad_s();
    (DVec3::from(mean), sigma)
}

#[test]
fn the_bias_is_found_at_rest_and_in_motion() {
    let bias = DVec3::new(0.011, -0.02, 0.004);
    // Poses good to 7e-3 rad a pair, compared over 1 s each, 7 times: 2.7e-3 rad/s.
    let still = bias_after(8.0, bias, |_| DQuat::IDENTITY, |_| DVec3::ZERO);
    let moving = bias_after(8.0, bias, swaying, swaying_rate);
    // A slow steady turn looks like a bias to the gyroscope; the tags tell.
    let slow = DVec3::new(0.0, 0.0, 0.04);
    let turning = bias_after(8.0, bias, |t| DQuat::from_scaled_axis(slow * t), |_| slow);
    for (name, (mean, sigma)) in [("still", still), ("moving", moving), ("turning", turning)] {
        // The poses are exact here, so nothing is left but the start value, 0 with 0.05 rad/s, and the rounding of times.
        assert!(mean.distance(bias) < 3e-4 && (0.002..0.005).contains(&sigma), "{name}: {mean} {sigma}");
    }
}

#[test]
fn swapped_samples_are_sorted_and_bad_ones_left_out() {
    let run = |order: &[usize]| {
        let mut fuser = Fuser::new(FuseOptions::default());
        fuser.tag(&seen(0.0, DQuat::IDENTITY, DVec3::ZERO));
        for &k in order {
            let t = 0.005 * k as f64;
            fuser.imu(&sample(t, swaying_rate(t)));
        }
        (fuser.pose_at(at(0.03)).unwrap(), fuser)
    };
    let (straight, _) = run(&[0, 1, 2, 3, 4, 5, 6]);
    let (swapped, mut fuser) = run(&[1, 0, 3, 2, 6, 4, 5]);
    assert_eq!(straight, swapped);
    let bad = [
        sample(0.035, DVec3::new(f64::NAN, 0.0, 0.0)),
        sample(0.035, DVec3::new(0.0, f64::INFINITY, 0.0)),
        sample(0.035, DVec3::new(0.0, 0.0, -40.0)),
        sample(0.03, DVec3::ZERO),
        sample(0.005, DVec3::ONE),
    ];
    assert!(bad.iter().all(|sample| !fuser.imu(sample)));
    assert_eq!(fuser.sample_counts(), SampleCounts { taken: 7, absurd: 3, late: 2 });
    assert_eq!(fuser.pose_at(at(0.03)), Some(straight));
}

#[test]
fn what_is_not_known_is_held_and_said() {
    let rate = DVec3::new(0.0, 0.0, 1.0);
    let still = DVec3::ZERO;
    let mut alone = Fuser::new(FuseOptions::default());
    alone.tag(&seen(0.0, DQuat::IDENTITY, still));
    let estimate = alone.pose_at(at(0.1)).unwrap();
    assert_eq!(estimate.provenance, Provenance::Held { age_s: 0.1 });
    assert_eq!(estimate.world_from_camera, Pose::IDENTITY);
    // Two tags give a velocity, which is believed for 0.25 s and dies away.
    alone.tag(&seen(1.0 / 30.0, DQuat::from_scaled_axis(rate / 30.0), DVec3::X * 0.3 / 30.0));
    let later = |ahead: f64| alone.pose_at(at(1.0 / 30.0 + ahead)).unwrap();
    assert!(matches!(later(0.2).provenance, Provenance::Predicted { .. }));
    assert!(matches!(later(0.3).provenance, Provenance::Held { .. }));
    let moved = |ahead: f64| later(ahead).world_from_camera.translation.x - 0.01;
    assert!((moved(0.02) - 0.3 * 0.02).abs() < 3e-4 && moved(5.0) < 0.3 * 0.25 + 1e-9);
    // With a gyroscope: predicted for a second, then held where it was.
    let mut with = Fuser::new(FuseOptions::default());
    with.tag(&seen(0.0, DQuat::IDENTITY, still));
    for k in 0..400 {
        with.imu(&sample(0.005 * f64::from(k), rate));
    }
    let turned = |t: f64| with.pose_at(at(t)).unwrap();
    assert!(matches!(turned(1.0).provenance, Provenance::Predicted { .. }));
    assert!(matches!(turned(1.01).provenance, Provenance::Held { .. }));
    assert!((angle(turned(1.8).world_from_camera.rotation, DQuat::IDENTITY) - 1.0).abs() < 1e-6);
    // A gap in the samples: nothing is made up for it.
    let mut gap = Fuser::new(FuseOptions::default());
    gap.tag(&seen(0.0, DQuat::IDENTITY, still));
    for k in (0..20).chain(60..100) {
        gap.imu(&sample(0.005 * f64::from(k), rate));
    }
    let after = gap.pose_at(at(0.45)).unwrap();
    assert!((angle(after.world_from_camera.rotation, DQuat::IDENTITY) - (0.45 - 0.205)).abs() < 1e-6);
    assert!(after.sigma_rotation_rad > turned(0.45).sigma_rotation_rad + 0.1);
}

#[test]
fn memory_is_bounded() {
    let mut fuser = Fuser::new(FuseOptions::default());
    let (samples, tags) = (fuser.rates.capacity(), fuser.tags.capacity());
    for k in 0..50_000 {
        let t = 0.001 * f64::from(k);
        fuser.imu(&sample(t, DVec3::ZERO));
        if k % 33 == 0 {
            fuser.tag(&seen(t, DQuat::IDENTITY, DVec3::ZERO));
        }
    }
    assert_eq!((fuser.rates.capacity(), fuser.tags.capacity()), (samples, tags));
    assert!(samples < 2 * KEPT_SAMPLES && fuser.sample_counts().taken == 50_000);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever comes in, what comes out is a pose, and it is less certain the farther it is ahead.
    #[test]
    fn no_input_breaks_it(steps in prop::collection::vec((0u8..8, -0.1f64..0.3, prop::array::uniform3(-40.0f64..40.0)), 1..200)) {
        let mut fuser = Fuser::new(FuseOptions::default());
        let mut t = 0.0;
        for (kind, dt, v) in steps {
            t += dt;
            let v = DVec3::from(v);
            match kind {
                0 => { fuser.tag(&seen(t, DQuat::from_scaled_axis(v), v)); }
                1 => { fuser.imu(&sample(t, DVec3::splat(f64::NAN))); }
                2 => fuser.reset(),
                _ => { fuser.imu(&sample(t, v)); }
            }
            let mut sigma = 0.0;
            for ahead in [-0.2, 0.0, 0.01, 0.1, 0.5, 2.0, 1e6] {
                let Some(pose) = fuser.pose_at(at(t + ahead)) else { continue };
                prop_assert!(pose.world_from_camera.translation.is_finite());
                prop_assert!((pose.world_from_camera.rotation.length() - 1.0).abs() < 1e-9);
                prop_assert!(pose.sigma_rotation_rad.is_finite() && pose.sigma_position_m.is_finite());
                prop_assert!(pose.sigma_rotation_rad >= sigma - 1e-12);
                sigma = pose.sigma_rotation_rad;
            }
        }
    }
}
