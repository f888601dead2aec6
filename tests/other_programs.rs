//! Our recordings in other people's programs: Python's `mcap` reads them with every checksum, decodes each protobuf message by the
//! schema in the file and holds each JSON message to its own; `rerun` makes pictures, a pinhole and transforms of them.
//!
//! Where Python or a package is missing, this is SKIPPED. `make test` puts the small packages into `target/python`; `rerun-sdk` is
//! large and used where it is installed. HALFLIGHT_PYTHON names another interpreter.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/fresh_recording.rs"]
mod fresh_recording;
mod support;

use fresh_recording::{Folder, desk, room};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs the script; `None` where there is no such interpreter.
fn script(python: &Path, arguments: &[&str]) -> Option<Output> {
    let script = root().join("tests/support/other_programs.py");
    Command::new(python).arg(script).args(arguments).output().ok()
}

/// An interpreter that has these packages; else the test prints SKIPPED.
fn python_with(test: &str, packages: &[&str]) -> Option<PathBuf> {
    let named = std::env::var_os("HALFLIGHT_PYTHON").map(PathBuf::from);
    let own = root().join("target/python/bin/python3");
    let arguments = [&["has"], packages].concat();
    let has = |python: &PathBuf| script(python, &arguments).is_some_and(|output| output.status.success());
    let found = named.into_iter().chain([own, PathBuf::from("python3")]).find(has);
    if found.is_none() {
        support::skipped(&format!("{test}: no Python with {}", packages.join(", ")));
    }
    found
}

/// Standard output of a program that must succeed.
fn said(output: &Output) -> String {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn pythons_mcap_decodes_every_message() {
    let name = "recordings in Python's mcap";
    let Some(python) = python_with(name, &["mcap", "mcap_protobuf"]) else { return };
    if python_with("JSON schemas in Python", &["jsonschema"]).as_ref() != Some(&python) {
        support::skipped("JSON schemas in Python: not the interpreter that has mcap");
    }
    let folder = Folder::new("python");
    let files = [(desk(&folder.0), 13, "CompressedImage"), (room(&folder.0), 4, "RawImage")];
    for (path, frames, picture) in files {
        let output = script(&python, &["mcap", path.to_str().unwrap()]).unwrap();
        let told: Value = serde_json::from_str(&said(&output)).unwrap();
        let topics = told["topics"].as_object().unwrap();
        assert_eq!(topics.len(), 9, "{topics:?}");
        for (name, topic) in topics {
            assert_eq!(topic["misfits"], Value::Array(vec![]), "{name}");
        }
        let place = |topic: &str| (topics[topic]["schema"].as_str().unwrap(), &topics[topic]["encoding"]);
        let protobuf = Value::from("protobuf");
        let picture = format!("foxglove.{picture}");
        assert_eq!(place("/camera/image"), (picture.as_str(), &protobuf));
        assert_eq!(place("/camera/calibration"), ("foxglove.CameraCalibration", &protobuf));
        assert_eq!(place("/truth/pose"), ("foxglove.PoseInFrame", &protobuf));
        assert_eq!(place("/tf"), ("foxglove.FrameTransform", &protobuf));
        assert_eq!(topics["/camera/image"]["count"], frames);
        let calibration =
            ["D", "K", "P", "R", "distortion_model", "frame_id", "height", "timestamp", "width"];
        assert_eq!(topics["/camera/calibration"]["fields"], serde_json::json!(calibration));
        let notes = &told["notes"]["halflight.recording"];
        assert!(notes["program"].as_str().unwrap().starts_with("halflight "), "{notes}");
    }
}

#[test]
fn rerun_shows_pictures_pinhole_and_transforms() {
    let Some(python) = python_with("recordings in rerun", &["rerun"]) else { return };
    let folder = Folder::new("rerun");
    let rerun = |arguments: &[&str]| {
        let output = Command::new(&python).args(["-m", "rerun"]).args(arguments).output().unwrap();
        said(&output)
    };
    for (path, picture) in [(desk(&folder.0), "EncodedImage"), (room(&folder.0), "Image")] {
        let made = path.with_extension("rrd");
        let made = made.to_str().unwrap();
        rerun(&["mcap", "convert", path.to_str().unwrap(), "--output", made]);
        let print = |entity: &str| {
            rerun(&["rrd", "print", "-vv", "--full-metadata", "true", "--entity", entity, made])
        };
        for (entity, archetype) in [
            ("/camera/image", picture),
            ("/camera/calibration", "Pinhole"),
            ("/tf", "Transform3D"),
            ("/truth/pose", "InstancePoses3D"),
        ] {
            let text = print(entity);
            assert!(text.contains(&format!("rerun.archetypes.{archetype}")), "{entity}: {text}");
        }
    }
}
