//! `--json` is what docs/json says it is.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/json_schema.rs"]
mod json_schema;

use json_schema::misfits;
use serde_json::Value;
use std::path::PathBuf;
use std::process::Command;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn schema(verb: &str) -> Value {
    let text = std::fs::read_to_string(root().join(format!("docs/json/{verb}.json"))).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn check(verb: &str, arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_halflight"))
        .arg(verb)
        .args(arguments)
        .arg("--json")
        .current_dir(root())
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    let told: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{verb}: {e}: {errors}"));
    let mut found = Vec::new();
    let name = if output.status.success() { verb } else { "error" };
    misfits(&told, &schema(name), verb, &mut found);
    assert!(found.is_empty(), "{verb} {arguments:?}: {found:?}");
    assert_eq!(told["format"], 1);
    told
}

#[test]
fn every_verb_keeps_to_its_schema() {
    let folder = std::env::temp_dir().join(format!("halflight-schemas-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let at = |name: &str| folder.join(name).display().to_string();
    let scene = "tests/scenes/still.toml";
    check("synth", &["--frames", "13", "--size", "128x96", "--out", &at("a.mcap")]);
    check("record", &[&at("a.mcap"), "--frames", "2", "--out", &at("b.mcap")]);
    let replayed = check("replay", &[&at("a.mcap"), "--out", &at("run")]);
    let stored: Value =
        serde_json::from_str(&std::fs::read_to_string(at("run/report.json")).unwrap()).unwrap();
    assert_eq!(replayed["digest"], stored["digest"]);
    assert!(replayed["stages"]["frame"]["median_ms"].is_number());
    let rendered = check("render", &[scene, "--digest"]);
    // Nothing is both done and left out.
    for plan in [&replayed["plan"], &rendered] {
        let names = |list: &str| -> Vec<String> {
            let list = plan[list].as_array().into_iter().flatten();
            list.map(|pass| pass["pass"].as_str().unwrap().to_owned()).collect()
        };
        let (done, kept, left_out) = (names("passes"), names("kept"), names("left_out"));
        assert!(!done.is_empty());
        assert!(done.iter().all(|pass| !left_out.contains(pass) && !kept.contains(pass)), "{plan}");
        assert!(kept.iter().all(|pass| !left_out.contains(pass)), "{plan}");
    }
    check("explain", &[scene]);
    check("trace", &[scene, "--samples", "1", "--step-px", "8", "--out", &at("truth"), "--digest"]);
    check("light", &["tests/scenes/room.hdr", "--as", "equirect"]);
    let tags =
        check("tags", &[&at("run/frames/frame_000000.png"), "--focal", "100,100,64,48", "--size", "0.1"]);
    assert!(tags["tags"].is_array());
    check("spheres", &["tests/scenes/walker.glb", "--count", "4", "--fresh"]);
    check("reproduce", &["gib03-fig3", "--out", &at("papers")]);
    check("stress", &["--only", "spheres"]);
    check("devices", &[]);
    check("rig", &[]);
    check("rig", &["--out", &at("rig.toml")]);
    check("calibrate", &["latency", "synthetic:frames=30,size=64x48,texel_mm=20", "--frames", "24"]);
    for file in ["tests/scenes/room-settings.toml", scene, "tests/scenes/room.glb"] {
        check("check", &[file]);
    }
    check("render", &["no/such.toml"]);
    check("replay", &["no/such.mcap"]);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn every_verb_has_a_schema_and_a_misfit_is_seen() {
    for verb in [
        "replay",
        "render",
        "explain",
        "trace",
        "figures",
        "light",
        "hdr",
        "tags",
        "record",
        "calibrate",
        "rig",
        "spheres",
        "room",
        "synth",
        "reproduce",
        "tradeoff",
        "stress",
        "check",
        "devices",
        "error",
    ] {
        let schema = schema(verb);
        assert!(schema["required"].as_array().unwrap().contains(&"format".into()), "{verb}");
        let mut found = Vec::new();
        misfits(&serde_json::json!({ "format": 2 }), &schema, verb, &mut found);
        assert!(!found.is_empty(), "{verb}");
    }
}
