//! `halflight tradeoff` as a program: what it writes holds together, and the page works in a browser.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::config::presets::{self, PRESET_NAMES};
use halflight::model::quality::Quality;
use std::path::{Path, PathBuf};
use std::process::Command;

fn tradeoff(arguments: &[&str]) -> (i32, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_halflight")).arg("tradeoff").args(arguments).output().unwrap();
    (
        output.status.code().unwrap(),
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

fn folder(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("halflight-tradeoff-{name}-{}", std::process::id()))
}

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/desk.toml");

/// What all runs must leave: files that hold the same front, from cheap to accurate.
fn holds_together(out: &Path, told: &str) -> serde_json::Value {
    let told: serde_json::Value = serde_json::from_str(told).unwrap();
    let front = presets::front(&out.join("front.json").display().to_string()).unwrap();
    assert!(front.points.len() >= 2, "{}", front.points.len());
    for pair in front.points.windows(2) {
        assert!(pair[0].ms < pair[1].ms && pair[0].error > pair[1].error);
    }
    for name in &PRESET_NAMES[1..] {
        let owners = front.points.iter().filter(|p| p.presets.iter().any(|n| n == name));
        assert_eq!(owners.count(), 1, "{name}");
    }
    assert_eq!(told["front"].as_array().unwrap().len(), front.points.len());
    assert_eq!(front.over(&Quality::default()).steps().len(), front.points.len());
    let csv = std::fs::read_to_string(out.join("points.csv")).unwrap();
    let points: usize =
        told["subjects"].as_array().unwrap().iter().map(|s| s["points"].as_array().unwrap().len()).sum();
    assert_eq!(csv.lines().count(), 1 + points);
    told
}

/// Values and errors of the points that differ from the defaults by this alone, least value first. Which values were tried
/// depends on how long they took.
fn along(told: &serde_json::Value, key: &str) -> Vec<(i64, f64)> {
    let points = told["subjects"][0]["points"].as_array().unwrap();
    let value_of = |p: &serde_json::Value| {
        let settings = p["settings"].as_object().unwrap();
        (settings.len() == 1).then(|| settings.get(key)?.as_i64()).flatten()
    };
    let mut found: Vec<(i64, f64)> =
        points.iter().filter_map(|p| Some((value_of(p)?, p["error"].as_f64().unwrap()))).collect();
    found.sort_unstable_by_key(|(value, _)| *value);
    found
}

#[test]
fn accuracy_is_bought_with_maps_and_the_page_stands_in_a_browser() {
    let Some(shared) = support::shared("tradeoff of a reference case") else { return };
    let out = folder("case");
    let case = shared.join("reference/f1_studio_lamps_five").display().to_string();
    let folder = out.display().to_string();
    let (status, told, errors) =
        tradeoff(&[&case, "--quick", "--rounds", "1", "--tries", "12", "--out", &folder, "--json"]);
    assert_eq!(status, 0, "{errors}");
    let told = holds_together(&out, &told);
    // One lamp of several gets a map, or each of them some.
    let maps = along(&told, "quality.shadow_maps");
    let (few, many) = (maps[0], maps[maps.len() - 1]);
    assert!(few.0 == 1 && many.0 >= 16 && many.1 < 0.8 * few.1, "{maps:?}");
    // Every pass that was run is timed.
    let stages = told["subjects"][0]["points"][0]["stages"].as_array().unwrap();
    assert!(stages.iter().any(|s| s["stage"] == "compose/shade_surface"), "{stages:?}");
    let svg = std::fs::read_to_string(out.join("f1_studio_lamps_five.svg")).unwrap();
    assert!(
        svg.contains(">defaults</text>") && svg.contains("quality.shadow_maps") && svg.ends_with("</svg>\n")
    );

    let page = out.join("index.html");
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(!html.contains("http://") || !html.replace("http://www.w3.org/2000/svg", "").contains("http"));
    let Ok(shown) = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=4000", "--dump-dom"])
        .arg(format!("file://{}", page.display()))
        .output()
    else {
        println!("SKIPPED the page in a browser: chromium is not installed");
        std::fs::remove_dir_all(&out).unwrap();
        return;
    };
    let dom = String::from_utf8_lossy(&shown.stdout).into_owned();
    assert!(
        dom.contains("data-ready=\"1\""),
        "the page's script ran: {}",
        String::from_utf8_lossy(&shown.stderr)
    );
    let shots = told["subjects"][0]["points"].as_array().unwrap().len();
    assert!(dom.contains(&format!("data-shots=\"{shots}\"")));
    assert!(
        dom.contains("class=\"ours\" alt=\"the picture\" src=\"data:image/jpeg;base64,"),
        "a picture is shown"
    );
    std::fs::remove_dir_all(&out).unwrap();
}

/// A small still whose truth is traced here.
const BALL: &str = r#"
[camera]
lens = { width = 96, height = 72, fx = 100.0, fy = 100.0, cx = 48.0, cy = 36.0 }
position = [0.0, -0.55, 0.32]
look_at = [0.0, 0.0, 0.04]

[light]
constant = [0.35, 0.38, 0.45]
to_light = [-0.5, -0.35, 0.8]
irradiance_rgb = [2.2, 2.1, 1.9]

[[surface]]
name = "table"
shape = "plane"
half_extent = 0.6

[[object]]
name = "ball"
shape = "sphere"
radius_m = 0.06
position = [0.0, 0.0, 0.02]
material = { kind = "lambert", albedo_rgb = [0.16, 0.42, 0.62] }
"#;

#[test]
fn a_truth_is_traced_until_it_tells_and_folders_hold_one_run() {
    let out = folder("told");
    std::fs::create_dir_all(&out).unwrap();
    let scene = out.join("ball.toml");
    std::fs::write(&scene, BALL).unwrap();
    let (scene, folder) = (scene.display().to_string(), out.join("run").display().to_string());
    let run = |more: &[&str]| {
        let all = [&scene, "--quick", "--rounds", "1", "--tries", "0", "--samples", "8", "--out", &folder];
        tradeoff(&[&all, more].concat())
    };
    let noise = |told: &str| {
        let told: serde_json::Value = serde_json::from_str(told).unwrap();
        let (subject, front) = (&told["subjects"][0], told["front"].as_array().unwrap());
        let best = front.last().unwrap()["error"].as_f64().unwrap();
        println!("{} rays: noise {} beside {best}", subject["truth_samples"], subject["noise"]);
        (subject["noise"].as_f64().unwrap() / best, subject["noise_ended_by_limit"].as_bool().unwrap())
    };
    // A front that is all noise: what is said of it, and that no two presets are named.
    let (status, told, errors) = run(&["--most-samples", "8"]);
    assert_eq!(status, 0, "{errors}");
    assert!(told.contains("the limit of 8 rays a pixel ended it (--most-samples)"), "{told}");
    assert!(told.contains("draft, balanced, fine, reference: one point"), "{told}");
    let left = out.join("run/of_an_earlier_run.svg");
    std::fs::write(&left, "").unwrap();
    let (status, told, errors) = run(&["--json"]);
    assert_eq!(status, 0, "{errors}");
    let (share, ended_by_limit) = noise(&told);
    assert!(share <= 0.5 && !ended_by_limit, "{share}");
    assert!(!left.exists(), "the earlier run's files are gone");
    let html = std::fs::read_to_string(out.join("run/index.html")).unwrap();
    assert!(html.contains("without the objects"));
    std::fs::write(out.join("run/notes.txt"), "mine").unwrap();
    let (status, _, errors) = run(&[]);
    assert!(status == 2 && errors.contains("notes.txt"), "{errors}");
    std::fs::remove_dir_all(&out).unwrap();
}

#[test]
fn mistakes_are_named() {
    let out = folder("none").display().to_string();
    let refused = |arguments: &[&str], words: &[&str]| {
        let (status, told, errors) = tradeoff(&[arguments, &["--out", &out]].concat());
        assert_eq!(status, 2, "{told}{errors}");
        for word in words {
            assert!(errors.contains(word), "no {word:?} in {errors}");
        }
    };
    refused(&["/nowhere/case.json"], &["/nowhere/case.json"]);
    refused(&["/nowhere/desk.mcap"], &["/nowhere/desk.mcap", "--scene FILE is missing"]);
    refused(&[], &["SCENE|CASE|REC"]);
    // The desk is a scene for recordings: it has no camera of its own.
    refused(&[SCENE], &["desk.toml", "camera: must be given"]);
    refused(&[SCENE, "--rounds", "0"], &["--rounds"]);
    let one = ["synthetic:frames=3,size=160x120,texel_mm=10", "--scene", SCENE, "--frame", "1"];
    refused(&one, &["--frame = 1", "later frame"]);
}
