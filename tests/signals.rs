//! Signals, settings that are read again, and outputs that go away, of both programs as they run.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-signals-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn at(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The daemon's program lies beside the tool's; `None` where it was not built.
fn daemon() -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_BIN_EXE_halflight")).with_file_name("halflightd");
    path.is_file().then_some(path)
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Reads lines until one holds a word.
fn wait_for(lines: &mut impl BufRead, word: &str) -> String {
    let mut all = String::new();
    loop {
        let mut line = String::new();
        assert!(lines.read_line(&mut line).unwrap() > 0, "no {word:?} in {all}");
        all += &line;
        if line.contains(word) {
            return all;
        }
    }
}

const ROOM: &str = "device.camera=\"synthetic:frames=1000000,size=64x48,texel_mm=20\"";

#[test]
fn the_daemon_ends_with_its_counts_reads_again_and_goes_on_without_its_folder() {
    let Some(program) = daemon() else {
        return println!("SKIPPED signals of the daemon: halflightd is not built");
    };
    let folder = Folder::new("daemon");
    let (config, pictures) = (folder.at("settings.toml"), folder.at("pictures"));
    std::fs::write(&config, "[present]\nhud = false\n").unwrap();
    for end in ["INT", "TERM"] {
        let mut child = Command::new(&program)
            .args(["--config", &config, "--set", ROOM, "--set", &format!("output.pictures=\"{pictures}\"")])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap());
        wait_for(&mut lines, "running");
        signal(&child, "HUP");
        wait_for(&mut lines, "the settings are read again");
        std::fs::rename(&pictures, folder.at(&format!("gone-{end}"))).unwrap();
        wait_for(&mut lines, "pictures are left out until they can be written");
        std::fs::create_dir_all(&pictures).unwrap();
        wait_for(&mut lines, "pictures are written again");
        signal(&child, end);
        let mut rest = String::new();
        lines.read_to_string(&mut rest).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0), "{rest}");
        let last = rest.lines().last().unwrap();
        assert!(last.contains("ended") && last.contains("frames="), "{rest}");
    }
}

#[test]
fn bad_settings_end_the_daemon_with_2_and_nothing_is_waited_for() {
    let Some(program) = daemon() else {
        return println!("SKIPPED settings of the daemon: halflightd is not built");
    };
    let folder = Folder::new("settings");
    let pipe = folder.at("pipe.toml");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let large = folder.at("large.toml");
    std::fs::write(&large, vec![b'\n'; 2 << 20]).unwrap();
    let run = |arguments: &[&str]| Command::new(&program).args(arguments).output().unwrap();
    for file in [pipe.as_str(), "/dev/zero", &large, "/no/such.toml", "/"] {
        let output = run(&["--config", file]);
        assert_eq!(output.status.code(), Some(2), "{file}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(file));
        let front = format!("quality.front=\"{file}\"");
        let output = run(&["--set", &front, "--set", "quality.budget_ms=9", "--set", "device.frames=1"]);
        // An empty text of the right size is no front either.
        assert_eq!(output.status.code(), Some(2), "{front}");
    }
    let camera = run(&["--set", "device.camera=\"replay:/no/such.mcap\""]);
    assert_eq!(camera.status.code(), Some(2));
}

#[test]
fn a_daemon_without_settings_says_what_it_does() {
    let Some(program) = daemon() else {
        return println!("SKIPPED the daemon without settings: halflightd is not built");
    };
    let folder = Folder::new("bare");
    let child = Command::new(program)
        .env("XDG_CACHE_HOME", folder.at("cache"))
        .env_remove("CACHE_DIRECTORY")
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // With or without a camera there is a picture: the place, or what is missing.
    let picture = folder.at("cache/halflight/picture.png");
    while !std::fs::metadata(&picture).is_ok_and(|about| about.len() > 1000) {
        std::thread::yield_now();
    }
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{text}");
    for word in [picture.as_str(), "Ctrl-C", "looks for a camera", "synthetic:", "ended"] {
        assert!(text.contains(word), "{word}: {text}");
    }
}

#[test]
fn record_and_synth_keep_what_they_have_and_other_verbs_leave_nothing() {
    let folder = Folder::new("tool");
    let program = env!("CARGO_BIN_EXE_halflight");
    for (verb, end) in [("synth", "INT"), ("record", "TERM")] {
        let out = folder.at(&format!("{verb}.mcap"));
        let mut command = Command::new(program);
        match verb {
            "synth" => command.args(["synth", "--frames", "1000000", "--size", "64x48"]),
            _ => command.args(["record", "synthetic:frames=1000000,size=64x48,texel_mm=20"]),
        };
        let child = command.args(["--out", &out, "--json"]).stdout(Stdio::piped()).spawn().unwrap();
        // The recording is there under another name as soon as the signals are followed, or a little before.
        let is_begun = || {
            let mut entries = std::fs::read_dir(&folder.0).unwrap().flatten();
            entries.any(|entry| {
                let is_part = entry.path().extension().is_some_and(|e| e == "part");
                is_part && entry.metadata().is_ok_and(|about| about.len() > 50_000)
            })
        };
        while !is_begun() {
            std::thread::yield_now();
        }
        signal(&child, end);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{verb}");
        let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let frames = told["frames"].as_u64().unwrap();
        assert!(frames > 0, "{told}");
        let (source, _) =
            halflight::device::replay::open(&halflight::device::replay::ReplayOptions::parse(&out).unwrap())
                .unwrap();
        assert_eq!(halflight::device::FrameSource::frames_left(&source), Some(frames));
    }
    let out = folder.at("truth");
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/still.toml");
    let child = Command::new(program)
        .args(["trace", scene, "--samples", "1000000", "--out", &out])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !PathBuf::from(&out).join(".halflight-run.json").is_file() {
        std::thread::yield_now();
    }
    signal(&child, "INT");
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(130));
}
