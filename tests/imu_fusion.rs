//! VQF as this program calls it, on real sensors with optical truth, against its authors' own implementation on the same samples:
//! the package `vqf` 2.1 of Python (C++ inside), sampling time 1/285.714285 s, its own parameters, 6D.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::DQuat;
use halflight::device::imu::fusion::Fusion;
use std::path::Path;
use support::wanted;

/// Columns of a trial.
const COLUMNS: usize = 17;

/// Rows of a NumPy file of f32 in C order.
fn rows(path: &Path) -> Vec<[f64; COLUMNS]> {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..7], b"\x93NUMPY\x01");
    let head = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let text = std::str::from_utf8(&bytes[10..10 + head]).unwrap();
    assert!(text.contains("'<f4'") && text.contains("False") && text.contains(", 17)"), "{text}");
    let numbers = bytes[10 + head..].as_chunks::<4>().0;
    let rows = numbers.as_chunks::<COLUMNS>().0;
    rows.iter().map(|row| row.map(|number| f64::from(f32::from_le_bytes(number)))).collect()
}

/// Root mean squares of the whole error and of the tilt's, degrees, where the trial says that errors count.
fn errors(rows: &[[f64; COLUMNS]]) -> [f64; 2] {
    let period_s = 1.0 / 285.714285;
    let mut fusion = Fusion::new(period_s).unwrap();
    let (mut squares, mut count) = ([0.0; 2], 0.0);
    for row in rows {
        let three = |from: usize| [row[from], row[from + 1], row[from + 2]];
        let estimate = fusion.update(three(0), three(3), period_s).unwrap();
        let truth = DQuat::from_xyzw(row[10], row[11], row[12], row[9]);
        if row[16] != 1.0 || !truth.is_finite() {
            continue;
        }
        let error = estimate * truth.normalize().inverse();
        let whole = 2.0 * error.w.abs().min(1.0).acos();
        let tilt = 2.0 * error.w.hypot(error.z).min(1.0).acos();
        squares[0] += whole.powi(2);
        squares[1] += tilt.powi(2);
        count += 1.0;
    }
    assert!(count > 20_000.0, "{count}");
    squares.map(|square| f64::sqrt(square / count).to_degrees())
}

#[test]
fn the_error_is_the_reference_implementation_s() {
    let Some(shared) = support::shared("imu_fusion") else { return };
    for (trial, id, reference) in [
        ("02_undisturbed_slow_rotation_B", "imu.vqf.slow", [0.7028, 0.4288]),
        ("30_disturbed_stationary_magnet_C", "imu.vqf.magnet", [10.1037, 1.2503]),
    ] {
        let [whole, tilt] = errors(&rows(&shared.join(format!("data/imu/broad/{trial}.npy"))));
        println!("{trial}: {whole:.4} and {tilt:.4} degrees, the reference {reference:?}");
        wanted::hold(id, whole - reference[0]);
        wanted::hold(&format!("{id}.tilt"), tilt - reference[1]);
    }
}
