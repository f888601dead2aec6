//! Settings that change while the daemon runs: each takes effect as if it had been there from the start.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::config::{Settings, file, keys::KEYS, resolve, settings::RunMode};
use halflight::daemon::live_settings::LiveSettings;
use halflight::daemon::{
    host::Host,
    run::{prepare, run},
};
use halflight::device::Truth;
use halflight::model::{frame::RawFrame, image::Rgb8Image, picture::Picture};
use halflight::pipeline::{PipelineError, event::FrameSink, frame::FrameOutcome};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Three exposures make the first light, so the third picture is the first with objects.
const FRAMES: u64 = 3;

/// Bodies of few vertices, so that preparing them takes no time.
const SCENE: &str = r#"
[[surface]]
shape = "plane"
half_extent = 0.6

[[object]]
shape = "box"
size = [0.04, 0.05, 0.12]
position = [0.14, 0.06, 0.0]
material = { kind = "phong", albedo_rgb = [0.6, 0.5, 0.4], exponent = 8.0 }

[[object]]
shape = "cylinder"
radius_m = 0.02
height_m = 0.07
position = [0.13, -0.08, 0.0]
"#;

fn scene() -> &'static Path {
    static SCENE_FILE: OnceLock<PathBuf> = OnceLock::new();
    SCENE_FILE.get_or_init(|| {
        let path = std::env::temp_dir().join(format!("halflight-live-scene-{}.toml", std::process::id()));
        std::fs::write(&path, SCENE).unwrap();
        path
    })
}

/// Ten small frames of the virtual room, made once.
fn recording() -> &'static Path {
    static RECORDING: OnceLock<PathBuf> = OnceLock::new();
    RECORDING.get_or_init(|| {
        let path = std::env::temp_dir().join(format!("halflight-live-{}.mcap", std::process::id()));
        let out = path.to_str().unwrap();
        let made = Command::new(env!("CARGO_BIN_EXE_halflight"))
            .args(["synth", "--frames", "10", "--size", "256x192", "--raw", "--out", out])
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        path
    })
}

fn base() -> Settings {
    Settings {
        camera: format!("replay:{}", recording().display()),
        mode: RunMode::Lockstep,
        frames: FRAMES,
        scene_file: scene().to_str().unwrap().into(),
        ..Settings::default()
    }
}

fn typed(text: &str) -> Result<Settings, String> {
    let table = file::parse(text)?;
    resolve("live.toml", &table, &base()).map_err(|e| e.to_string())
}

/// Keeps the pictures; may write the settings file after any of them.
struct Pictures<F: FnMut(usize)> {
    all: Vec<Rgb8Image>,
    after: F,
}

impl<F: FnMut(usize)> FrameSink for Pictures<F> {
    fn accept(
        &mut self,
        _: &RawFrame,
        _: Option<&Truth>,
        _: &FrameOutcome,
        picture: &Picture,
    ) -> Result<bool, PipelineError> {
        self.all.push(picture.display.clone());
        (self.after)(self.all.len());
        Ok(true)
    }
}

fn pictures(
    settings: &Settings,
    live: Option<&mut LiveSettings>,
    after: impl FnMut(usize),
) -> Vec<Rgb8Image> {
    let mut sink = Pictures { all: Vec::new(), after };
    run(prepare(settings, &Host::default()).unwrap(), settings, live, &mut sink).unwrap();
    sink.all
}

/// A settings file of this test's own.
fn settings_file(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("halflight-live-{name}-{}.toml", std::process::id()))
}

fn followed(path: &Path, settings: &Settings) -> LiveSettings {
    let theirs = path.to_owned();
    let read = move || typed(&std::fs::read_to_string(&theirs).map_err(|e| e.to_string())?);
    LiveSettings::new(path.to_owned(), read, settings)
}

#[test]
fn a_changed_key_acts_as_if_it_had_been_there_from_the_start() {
    let path = settings_file("keys");
    let plain = pictures(&base(), None, |_| ());
    for line in [
        "light.order = 2",
        "light.split = \"paper\"",
        "light.lights = 1",
        "quality.rung = \"linear\"",
        "quality.spheres = 6",
        "quality.directions = 32",
        "quality.soft_step_px = 1",
        "quality.soft_at = \"vertex\"",
        "quality.shadow_maps = 2",
        "quality.shadow_map_texels = 96",
        "quality.pcf_taps = 8",
        "quality.coverage_samples = 1",
        "quality.phong_norm = \"paper\"",
        "quality.self_shadow = \"openness\"",
        "quality.brackets = 2",
        "quality.light_every = 4",
        "present.exposure_s = 0.004",
        "present.view = \"global\"",
    ] {
        let (name, _) = line.split_once(' ').unwrap();
        assert!(KEYS.iter().any(|key| key.name == name && key.is_live()), "{name} is not live");
        let from_the_start = pictures(&typed(line).unwrap(), None, |_| ());
        assert!(from_the_start.last() != plain.last(), "{line} changes nothing");
        std::fs::write(&path, "").unwrap();
        let mut live = followed(&path, &base());
        std::fs::write(&path, line).unwrap();
        let changed = pictures(&base(), Some(&mut live), |_| ());
        assert!(changed == from_the_start, "{line}: changed later, it draws something else");
    }
    std::fs::remove_file(path).unwrap();
}

#[test]
fn a_view_comes_and_goes_and_mistakes_change_nothing() {
    let path = settings_file("view");
    let settings = Settings { frames: 10, ..base() };
    let plain = pictures(&settings, None, |_| ());
    let mirrors =
        pictures(&Settings { frames: 10, ..typed("present.view = \"mirror\"").unwrap() }, None, |_| ());
    std::fs::write(&path, "").unwrap();
    let mut live = followed(&path, &settings);
    let got = pictures(&settings, Some(&mut live), |done| match done {
        3 => std::fs::write(&path, "present.view = \"mirrors\"").unwrap(),
        4 => std::fs::write(&path, "present.view = \"mirror\"").unwrap(),
        6 => std::fs::remove_file(&path).unwrap(),
        7 => std::fs::write(&path, "engine.threads = 2\npresent.view = \"final\"").unwrap(),
        _ => (),
    });
    std::fs::remove_file(path).unwrap();
    for (index, picture) in got.iter().enumerate() {
        let want = if (4..7).contains(&index) { &mirrors } else { &plain };
        assert!(*picture == want[index], "picture {index}");
    }
    assert!(plain[5] != mirrors[5]);
}
