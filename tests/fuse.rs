//! The gyroscope carries the camera's rotation where the tag is out of sight, on sequences with exact truth. The tags' poses
//! are the true ones here, and mounting and time offset of the sensor are known: this is the prediction alone, not the
//! detector and not calibration.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DQuat, DVec3};
use halflight::math::pose::Pose;
use halflight::model::{
    estimate::{PoseEstimate, Provenance},
    imu::ImuSample,
    time::Timestamp,
};
use halflight::track::fuse::{FuseOptions, Fuser};
use std::path::Path;

/// Rows of numbers of a table, without its head; cells that are no numbers are NaN.
fn table(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.trim().parse().unwrap_or(f64::NAN)).collect())
        .collect()
}

/// Nanoseconds since the first frame: f64 would round the full time.
fn time_of(cell: f64) -> Timestamp {
    Timestamp(cell as i64)
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Runs a sequence; returns, for each frame without a tag that is at most 1 s after one, the age in seconds and the error of
/// the rotation in degrees.
fn errors_without_tag(folder: &Path) -> Vec<(f64, f64)> {
    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("truth.json")).unwrap()).unwrap();
    let q = numbers(&truth["camera_from_imu"]["q_wxyz"]);
    let offset_s = truth["time_offset_s"].as_f64().unwrap();
    let mut fuser = Fuser::new(FuseOptions {
        camera_from_imu: DQuat::from_xyzw(q[1], q[2], q[3], q[0]),
        time_offset_s: offset_s,
        ..FuseOptions::default()
    });
    let seen: Vec<usize> = table(&folder.join("tags.csv"))
        .iter()
        .filter(|row| row.last().is_some_and(|visible| *visible >= 0.99))
        .map(|row| row[0] as usize)
        .collect();
    let mut samples = table(&folder.join("imu.csv")).into_iter().peekable();
    let mut errors = Vec::new();
    let mut last_tag: Option<Timestamp> = None;
    for frame in table(&folder.join("truth.csv")) {
        let t = time_of(frame[1]);
        while let Some(row) = samples.next_if(|row| time_of(row[0]).plus_seconds(-offset_s) <= t) {
            fuser.imu(&ImuSample {
                t: time_of(row[0]),
                gyro_rad_s: [row[1], row[2], row[3]],
                accel_m_s2: [row[4], row[5], row[6]],
            });
        }
        let rotation = DQuat::from_xyzw(frame[6], frame[7], frame[8], frame[5]);
        let pose = Pose::new(rotation, DVec3::new(frame[2], frame[3], frame[4]));
        if seen.contains(&(frame[0] as usize)) {
            let tag = PoseEstimate {
                t,
                world_from_camera: pose,
                provenance: Provenance::Measured,
                sigma_position_m: 0.002,
                sigma_rotation_rad: 0.002,
            };
            assert!(fuser.tag(&tag));
            assert_eq!(fuser.pose_at(t), Some(tag), "at its own time a tag's pose is what it is");
            last_tag = Some(t);
        } else if let (Some(last), Some(estimate)) = (last_tag, fuser.pose_at(t)) {
            let age_s = t.seconds_since(last);
            if age_s <= 1.0 {
                assert_eq!(estimate.provenance, Provenance::Predicted { age_s });
                errors.push((age_s, estimate.world_from_camera.angle_to(&pose).to_degrees()));
            }
        }
    }
    errors
}

#[test]
fn the_gyroscope_carries_the_rotation_while_the_tag_is_out_of_sight() {
    let Some(shared) = support::shared("the_gyroscope_carries_the_rotation_while_the_tag_is_out_of_sight")
    else {
        return;
    };
    for sequence in ["desk_loses_tag", "desk_brackets", "turn_low_texture"] {
        let errors = errors_without_tag(&shared.join("tracking").join(sequence));
        let worst = errors.iter().fold(0.0f64, |worst, (_, error)| worst.max(*error));
        let oldest = errors.iter().fold(0.0f64, |oldest, (age, _)| oldest.max(*age));
        println!(
            "{sequence}: {} frames up to {oldest:.2} s after a tag, {worst:.3} degrees at worst",
            errors.len()
        );
        assert!(errors.len() >= 15, "{sequence}: {} frames", errors.len());
        // Integrated with the true bias from the first frame the sensor stays within 0.02 to 0.07 degrees (the sequences' own
        // figure). Reached: 0.020, 0.041 and 0.040 degrees.
        assert!(worst < 0.07, "{sequence}: {worst} degrees");
    }
}
