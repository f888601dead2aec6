//! Settings that change while the daemon runs: each takes effect as if it had been there from the start.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::config::{Settings, file, keys::KEYS, resolve, settings::RunMode};
use halflight::daemon::{
    commands::Commands,
    host::Host,
    prepare::prepare,
    run::run_from,
    settings_thread::{Asks, FollowedFile, LiveSettings, SettingsThread, Wishes},
};
use halflight::device::clock::MonotonicClock;
use halflight::model::{image::Rgb8Image, picture::PictureView};
use halflight::pipeline::{
    Change, PipelineError,
    event::{Awaited, Command, Event},
    inbox::Inbox,
    turns::{FinishedFrame, FrameSink},
};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Arc, OnceLock};

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
        let path = std::env::temp_dir().join(format!("halflight-live-scene-{}.toml", process::id()));
        std::fs::write(&path, SCENE).unwrap();
        path
    })
}

/// Ten small frames of the virtual room, made once.
fn recording() -> &'static Path {
    static RECORDING: OnceLock<PathBuf> = OnceLock::new();
    RECORDING.get_or_init(|| {
        let path = std::env::temp_dir().join(format!("halflight-live-{}.mcap", process::id()));
        let out = path.to_str().unwrap();
        let made = process::Command::new(env!("CARGO_BIN_EXE_halflight"))
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

/// Keeps the pictures; something may be done after any of them.
struct Pictures<F: FnMut(usize)> {
    all: Vec<Rgb8Image>,
    after: F,
}

impl<F: FnMut(usize)> FrameSink for Pictures<F> {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        self.all.push(finished.picture.display.clone());
        (self.after)(self.all.len());
        Ok(true)
    }
}

/// The pictures of a run. `typed` gives what is typed after so many pictures (0: before the first), if anything: settings, or
/// mistakes.
fn pictures(
    settings: &Settings,
    typed: impl Fn(usize) -> Option<Result<Settings, String>>,
) -> Vec<Rgb8Image> {
    let prepared = prepare(settings, &Host::default()).unwrap();
    let mut live = LiveSettings::new(settings, Arc::clone(prepared.pipeline.scene()), &prepared.cycle);
    let inbox = Arc::<Inbox>::default();
    let mut type_after = |done| {
        if let Some(Ok(typed)) = typed(done)
            && let Some(change) = live.change_to(&typed)
        {
            inbox.put_change(change);
        }
    };
    type_after(0);
    let mut sink = Pictures { all: Vec::new(), after: type_after };
    run_from(Arc::clone(&inbox), prepared, settings, &mut sink).unwrap();
    sink.all
}

#[test]
fn a_changed_key_acts_as_if_it_had_been_there_from_the_start() {
    let plain = pictures(&base(), |_| None);
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
        let from_the_start = pictures(&typed(line).unwrap(), |_| None);
        assert!(from_the_start.last() != plain.last(), "{line} changes nothing");
        let changed = pictures(&base(), |done| (done == 0).then(|| typed(line)));
        assert!(changed == from_the_start, "{line}: changed later, it draws something else");
    }
}

#[test]
fn a_view_comes_and_goes_and_mistakes_change_nothing() {
    let settings = Settings { frames: 10, ..base() };
    let plain = pictures(&settings, |_| None);
    let mirrors = pictures(&Settings { frames: 10, ..typed("present.view = \"mirror\"").unwrap() }, |_| None);
    let got = pictures(&settings, |done| match done {
        3 => Some(typed("present.view = \"mirrors\"")),
        4 => Some(typed("present.view = \"mirror\"")),
        7 => Some(typed("engine.threads = 2\npresent.view = \"final\"")),
        _ => None,
    });
    for (index, picture) in got.iter().enumerate() {
        let want = if (4..7).contains(&index) { &mirrors } else { &plain };
        assert!(*picture == want[index], "picture {index}");
    }
    assert!(plain[5] != mirrors[5]);
}

/// The next change that comes into an inbox; the test fails where none does.
fn next_change(inbox: &Inbox) -> Box<Change> {
    let clock = MonotonicClock::default();
    let awaited = Awaited { frame: true, deadline: halflight::device::Clock::now(&clock).plus_seconds(60.0) };
    match inbox.take(awaited, &clock) {
        Event::Command(Command::Change(change)) => change,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_thread_follows_the_file_and_brings_what_is_ready() {
    let path = std::env::temp_dir().join(format!("halflight-live-followed-{}.toml", process::id()));
    std::fs::write(&path, "").unwrap();
    let prepared = prepare(&base(), &Host::default()).unwrap();
    let scene = Arc::clone(prepared.pipeline.scene());
    let live = LiveSettings::new(&base(), Arc::clone(&scene), &prepared.cycle);
    let inbox = Arc::<Inbox>::default();
    let clock = Arc::new(MonotonicClock::default());
    let file = FollowedFile { path: path.clone(), content: String::new(), read: Box::new(typed) };
    let wishes = Arc::new(Wishes::new(&base()));
    let asks = Asks { wishes: Arc::clone(&wishes), read_again: Arc::default() };
    let follows = SettingsThread::start(Some(file), asks, live, Arc::clone(&inbox), clock).unwrap();
    std::fs::write(&path, "present.view = \"mirror\"").unwrap();
    let change = next_change(&inbox);
    assert_eq!(change.options.view, PictureView::Mirror);
    assert!(change.scene.is_none(), "the bodies are as they were");
    // A mistake changes nothing; what comes after it does.
    std::fs::write(&path, "present.view = \"mirrors\"").unwrap();
    std::fs::write(&path, "present.view = \"mirror\"\nquality.spheres = 6").unwrap();
    let change = next_change(&inbox);
    assert_eq!(change.options.quality.spheres, 6);
    let dressed = change.scene.expect("dressed on the thread");
    assert!(dressed.figures.iter().zip(&scene.figures).any(|(new, old)| new.spheres != old.spheres));
    // A command is a wish, and comes after what the file has said.
    let commands = Commands::new(Arc::clone(&inbox), wishes);
    assert_eq!(commands.answer("set present.hud true"), "present.hud = true");
    let change = next_change(&inbox);
    assert!(change.options.hud && change.options.view == PictureView::Mirror, "the file's still holds");
    drop(follows);
    std::fs::remove_file(path).unwrap();
}

#[test]
fn commands_say_what_is_and_what_is_allowed() {
    let inbox = Arc::<Inbox>::default();
    let wishes = Arc::new(Wishes::new(&base()));
    let commands = Commands::new(Arc::clone(&inbox), Arc::clone(&wishes));
    let answer = |line: &str| commands.answer(line);
    assert_eq!(answer("get present.view"), "present.view = \"final\"");
    assert_eq!(answer("get light").matches("; ").count() + 1, answer("get light").matches(" = ").count());
    assert_eq!(answer(" set present.view  mirror "), "present.view = \"mirror\"");
    assert_eq!(answer("set quality.pcf_taps 3"), "quality.pcf_taps = 3");
    let wished = wishes.settings();
    assert_eq!((wished.view, wished.quality.pcf_taps), (PictureView::Mirror, 3), "wishes add up");
    for (line, says) in [
        ("set present.view mirrors", "mirror"),
        ("set quality.pcf_taps 1000", "must be"),
        ("set engine.threads 2", "next start"),
        ("set present.vew mirror", "did you mean present.view?"),
        ("get nothing.such", "unknown key"),
        ("set present.view", "a key and a value"),
        ("reboot", "Known: help"),
        ("", "Known: help"),
    ] {
        let reply = answer(line);
        assert!(reply.starts_with("error: ") && reply.contains(says), "{line}: {reply}");
        assert!(!reply.contains('\n'));
    }
    assert_eq!(wishes.settings(), wished, "a mistake changes nothing");
    assert!(answer("status").starts_with("turns 0 "));
    assert_eq!(answer("stop"), "the daemon ends");
    assert!(matches!(inbox.try_take(false), Some(Event::Command(Command::Stop))));
}
