//! `halflight figures` as a program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::assets::pictures;
use std::process::Command;

fn figures(arguments: &[&str]) -> (i32, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_halflight")).arg("figures").args(arguments).output().unwrap();
    (
        output.status.code().unwrap(),
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/desk.toml");

#[test]
fn every_sheet_is_written() {
    let out = std::env::temp_dir().join(format!("halflight-figures-{}", std::process::id()));
    let folder = out.display().to_string();
    let room = "synthetic:frames=4,size=320x240,texel_mm=4";
    let (status, told, errors) =
        figures(&[room, "--scene", SCENE, "--out", &folder, "--frame", "3", "--json"]);
    assert_eq!(status, 0, "{errors}");
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told["written"].as_array().unwrap().len(), 5);
    let columns = [("light", 2), ("parts", 3), ("materials", 3), ("maps", 4), ("ladder", 4)];
    for (name, columns) in columns {
        let sheet = pictures::load_rgb8(&out.join(format!("desk_{name}.png"))).unwrap();
        // Pictures are at least 160 pixels wide, and hold more than paper and ink.
        assert!(sheet.width() >= columns * 160, "{name}: {}", sheet.width());
        let mut colours: Vec<[u8; 3]> = sheet.pixels().to_vec();
        colours.sort_unstable();
        colours.dedup();
        assert!(colours.len() > 50, "{name}: {} colours", colours.len());
    }
    std::fs::remove_dir_all(&out).unwrap();
}

#[test]
fn mistakes_are_named() {
    let out = std::env::temp_dir().join("halflight-figures-none").display().to_string();
    let refused = |arguments: &[&str], words: &[&str]| {
        let (status, told, errors) = figures(arguments);
        assert_eq!(status, 2, "{told}{errors}");
        for word in words {
            assert!(errors.contains(word), "no {word:?} in {errors}");
        }
    };
    refused(&["none.mcap", "--scene", SCENE, "--out", &out], &["none.mcap"]);
    refused(&["none.mcap", "--out", &out], &["--scene"]);
    let beyond = ["synthetic:frames=3", "--scene", SCENE, "--out", &out, "--frame", "3"];
    refused(&beyond, &["--frame = 3", "numbered 0 to 2"]);
    // After two frames of three exposures there is no light yet.
    let first =
        ["synthetic:frames=3,size=160x120,texel_mm=10", "--scene", SCENE, "--out", &out, "--frame", "1"];
    refused(&first, &["--frame = 1", "later frame"]);
}
