//! The daemon's own pipeline on the bundled recording: accurate, repeatable, and the same for any thread count and
//! build profile.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use support::wanted;

const RECORDING: &str = "tests/recordings/desk.mcap";
const SCENE: &str = "tests/scenes/desk.toml";

fn replay(program: &Path, extra: &[&str]) -> Value {
    let output = Command::new(program)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["replay", RECORDING, "--scene", SCENE, "--json"])
        .args(extra)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn debug_build() -> PathBuf {
    PathBuf::from(env!("CARGO_BIN_EXE_halflight"))
}

/// The release build, if there is one at least as new as this test; REQUIRE_RELEASE=1 makes its lack a failure.
fn release_build(test: &str) -> Option<PathBuf> {
    let debug = debug_build();
    let path = debug.parent()?.parent()?.join("release/halflight");
    let modified = |p: &Path| std::fs::metadata(p).and_then(|m| m.modified()).ok();
    let source = modified(&Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.lock"));
    if path.is_file() && modified(&path) >= source {
        return Some(path);
    }
    let why = format!("{test}: no release build at {}", path.display());
    assert!(std::env::var_os("REQUIRE_RELEASE").is_none_or(|v| v != "1"), "REQUIRE_RELEASE=1, but {why}");
    println!("SKIPPED {why}");
    None
}

#[test]
fn light_and_pose_agree_with_the_truth() {
    let report = replay(&debug_build(), &[]);
    assert_eq!(report["frames"], 90);
    assert_eq!(report["dropped"], 0);
    let number = |path: &str| {
        report.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path} in {report:#}"))
    };
    println!("{:#}", report["light"]);
    println!("{:#}", report["pose"]);
    // The demand: the dominant direction within 2 degrees of the truth on every frame after the warm-up.
    wanted::hold("replay.direction", number("/light/direction_error/max_deg"));
    // Measured: 0.67 in the median, 0.77 at worst, the lamp being near (see below).
    assert!(number("/light/direction_error/median_deg") <= 0.75);
    // E_d against the truth at the ball's centre. Measured: medians 1.8, 2.4 and 1.2 %, worst 2.9, 3.5 and 3.0 % (red,
    // green, blue); it was 12, 9 and 11 % too low in the median while older frames were blended as 8-bit values.
    // Without JPEG (`synthetic:`) it is 4.4, 3.6 and 2.7 % too high, from a camera that stands still and without noise
    // 5.7, 4.7 and 4.0 %: the lamp is 2.0 m away, and the ball's mirrored rays come as from half its radius off its
    // centre, up to 0.03 m nearer to the lamp, which by the square of the distance makes up to 3 %, and 0.8 degrees in
    // direction. JPEG of quality 96 takes some of it away.
    for channel in 0..3 {
        let error = |part| number(&format!("/light/irradiance_error_rgb/{channel}/{part}_relative"));
        assert!(error("median") <= 0.03, "channel {channel}: {}", error("median"));
        assert!(error("max") <= 0.045, "channel {channel}: {}", error("max"));
    }
    // Tag pose within 2 mm and 0.5 degrees (median).
    wanted::hold("replay.position", number("/pose/position_error/median_mm"));
    wanted::hold("replay.rotation", number("/pose/rotation_error/median_deg"));
    assert!(report["pose"]["measured_frames"].as_u64().unwrap() >= 60);
    for stage in ["track", "merge", "light", "relight"] {
        assert!(number(&format!("/stages/{stage}/p95_ms")) >= number(&format!("/stages/{stage}/median_ms")));
    }
}

#[test]
fn digest_is_the_same_for_any_threads_and_twice() {
    let digest =
        |threads: &str| replay(&debug_build(), &["--frames", "8", "--threads", threads])["digest"].clone();
    let one = digest("1");
    assert_eq!(one.as_str().unwrap().len(), 64);
    assert_eq!(one, digest("2"));
    assert_eq!(one, digest("2"));
}

#[test]
fn digest_is_the_same_in_debug_and_release() {
    let Some(release) = release_build("digest_is_the_same_in_debug_and_release") else { return };
    let digest = |program: &Path| replay(program, &["--frames", "8"])["digest"].clone();
    assert_eq!(digest(&debug_build()), digest(&release));
}

#[test]
fn the_report_says_why_a_pass_runs() {
    let report = replay(&debug_build(), &["--frames", "4", "--rung", "hybrid", "--sh-order", "5"]);
    let plan = |list: &str| report["plan"][list].as_array().unwrap().clone();
    let reason_of = |name: &str| {
        let found = plan("passes").into_iter().find(|p| p["pass"] == name).unwrap();
        found["reason"].as_str().unwrap().to_owned()
    };
    assert_eq!(reason_of("compose/soft_shadow"), "virtual bodies stand in soft light over real surfaces");
    assert_eq!(reason_of("compose/composite"), "a picture is drawn");
    assert_eq!(reason_of("light/project_sh"), "measured light becomes SH");
    assert!(plan("left_out").iter().any(|p| p["pass"] == "nearfield/subtract"));
}

#[test]
fn a_recording_cut_short_is_replayed_up_to_there() {
    let whole = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(RECORDING)).unwrap();
    let folder = std::env::temp_dir().join(format!("halflight-cut-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("cut.mcap");
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let output = Command::new(debug_build())
        .args(["replay", path.to_str().unwrap(), "--json", "--frames", "5"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["frames"], 5);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_is_not_there_is_named() {
    for (arguments, words) in [
        (&["replay", "nowhere.mcap"][..], &["nowhere.mcap"][..]),
        (&["replay", "synthetic:frames=3", "--scene", "nowhere.toml"], &["nowhere.toml"]),
        (&["replay", "camera9:/dev/none"], &["camera9"]),
        (&["check", "nowhere.toml"], &["nowhere.toml"]),
    ] {
        let output = Command::new(debug_build()).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        for word in words {
            assert!(error.contains(word), "{arguments:?}: {error}");
        }
    }
}
