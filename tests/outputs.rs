//! What the tool does where its outputs cannot be written, are there already, or have odd names.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::assets::pictures;
use halflight::model::image::Image;
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-outputs-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn at(&self, name: impl AsRef<OsStr>) -> PathBuf {
        self.0.join(name.as_ref())
    }

    fn names(&self) -> Vec<OsString> {
        let mut names: Vec<_> = std::fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn tool<S: AsRef<OsStr>>(arguments: &[S]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_halflight")).args(arguments).output().unwrap()
}

fn status(output: &Output) -> i32 {
    output.status.code().unwrap_or_else(|| panic!("{}", String::from_utf8_lossy(&output.stderr)))
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// An environment picture of a few texels.
fn sky(folder: &Folder, name: impl AsRef<OsStr>) -> PathBuf {
    let file = folder.at(name);
    pictures::save_hdr(&file, &Image::filled(16, 8, [1.0, 0.5, 0.25])).unwrap();
    file
}

fn light(sky: &Path, out: &Path) -> Output {
    tool(&[
        OsStr::new("light"),
        sky.as_os_str(),
        OsStr::new("--as"),
        OsStr::new("equirect"),
        OsStr::new("--out"),
        out.as_os_str(),
    ])
}

#[test]
fn a_full_disk_says_so_and_the_old_file_survives() {
    let folder = Folder::new("full");
    let sky = sky(&folder, "sky.hdr");
    // A name that leads to a device which is always full.
    for name in ["full.png", "full.hdr", "full.exr"] {
        let link = folder.at(name);
        std::os::unix::fs::symlink("/dev/full", &link).unwrap();
        let output = light(&sky, &link);
        assert_eq!(status(&output), 2, "{name}: {}", said(&output));
        assert!(said(&output).contains("cannot be written"), "{name}: {}", said(&output));
    }
    // A file-size limit stands for a disk that fills up while the file is written.
    let out = folder.at("old.exr");
    std::fs::write(&out, "old").unwrap();
    let program = env!("CARGO_BIN_EXE_halflight");
    let line = format!(
        "trap '' XFSZ; ulimit -f 8; exec {program} light {} --as equirect --out-height 512 --out {}",
        sky.display(),
        out.display()
    );
    let output = Command::new("bash").args(["-c", &line]).output().unwrap();
    assert_eq!(status(&output), 2, "{}", said(&output));
    assert_eq!(std::fs::read(&out).unwrap(), b"old");
    assert_eq!(folder.names().len(), 5, "nothing half written is left: {:?}", folder.names());
}

#[test]
fn closed_and_full_standard_streams_kill_nothing() {
    let run = |out: Stdio, err: Stdio, arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
        command.args(arguments).stdout(out).stderr(err).status().unwrap().code()
    };
    let full = || Stdio::from(File::options().write(true).open("/dev/full").unwrap());
    // A pipe that nobody reads.
    let broken = || {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        Stdio::from(writer)
    };
    for arguments in [&["check", "--manual"][..], &["--help"], &["replay", "--help"], &["--version"]] {
        assert_eq!(run(full(), Stdio::null(), arguments), Some(2), "{arguments:?}");
        assert_eq!(run(broken(), Stdio::null(), arguments), Some(0), "{arguments:?}");
        assert_eq!(run(Stdio::null(), broken(), arguments), Some(0), "{arguments:?}");
    }
    for wrong in [&["check", "/no/such.toml"][..], &["render"], &["check", "/no/such.toml", "--json"]] {
        assert_eq!(run(Stdio::null(), broken(), wrong), Some(2), "{wrong:?}");
        assert_eq!(run(broken(), full(), wrong), Some(2), "{wrong:?}");
    }
}

#[test]
fn odd_names_work() {
    let folder = Folder::new("names");
    for name in [&b"a,b=1,c"[..], b"not \xff\xfe utf-8", b"with:colon"] {
        let named = |ending: &[u8]| folder.at(OsString::from_vec([name, ending].concat()));
        let (sky, out) = (sky(&folder, named(b".hdr").file_name().unwrap()), named(b".png"));
        let output = light(&sky, &out);
        assert_eq!(status(&output), 0, "{}", said(&output));
        assert!(out.is_file());
        let recording = named(b".mcap");
        let text = OsStr::new;
        let synth = [
            text("record"),
            text("synthetic:frames=3,size=64x48,texel_mm=20"),
            text("--out"),
            recording.as_os_str(),
            text("--json"),
        ];
        let output = tool(&synth);
        assert_eq!(status(&output), 0, "{}", said(&output));
        assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap()["frames"], 3);
        let (scene, config) = (named(b".toml"), named(b".settings.toml"));
        std::fs::write(&scene, "[[surface]]\nshape = \"plane\"").unwrap();
        std::fs::write(&config, "[quality]\npcf_taps = 2").unwrap();
        let out = named(b"-out");
        let replay = [
            text("replay"),
            recording.as_os_str(),
            text("--scene"),
            scene.as_os_str(),
            text("--config"),
            config.as_os_str(),
            text("--out"),
            out.as_os_str(),
            text("--json"),
        ];
        let output = tool(&replay);
        assert_eq!(status(&output), 0, "{}", said(&output));
        assert!(out.join("frames/frame_000002.png").is_file() && out.join("report.json").is_file());
        for arguments in [
            [text("check"), scene.as_os_str(), text("--json")],
            [text("check"), config.as_os_str(), text("--json")],
        ] {
            assert_eq!(status(&tool(&arguments)), 0);
        }
    }
}

#[test]
fn what_is_there_is_refused_or_replaced_never_mixed() {
    let folder = Folder::new("mixed");
    let recording = folder.at("a.mcap").display().to_string();
    let synth = |more: &[&str]| {
        tool(&[&["synth", "--frames", "2", "--size", "64x48", "--raw", "--out", &recording], more].concat())
    };
    assert_eq!(status(&synth(&[])), 0);
    let first = std::fs::read(&recording).unwrap();
    let again = synth(&["--seed", "9"]);
    assert!(status(&again) == 2 && said(&again).contains("--force"), "{}", said(&again));
    assert_eq!(std::fs::read(&recording).unwrap(), first);
    assert_eq!(status(&synth(&["--seed", "9", "--force"])), 0);
    assert_ne!(std::fs::read(&recording).unwrap(), first);
    let recorded = folder.at("b.mcap").display().to_string();
    let record = |more: &[&str]| tool(&[&["record", &recording, "--out", &recorded], more].concat());
    assert_eq!([status(&record(&[])), status(&record(&[])), status(&record(&["--force"]))], [0, 2, 0]);

    let out = folder.at("run").display().to_string();
    let replay = |frames: &str| tool(&["replay", &recording, "--frames", frames, "--out", &out]);
    assert_eq!(status(&replay("2")), 0);
    let frame = folder.at("run/frames/frame_000001.png");
    assert!(frame.is_file());
    assert_eq!(status(&replay("1")), 0);
    assert!(!frame.exists(), "the earlier run's picture is gone");
    std::fs::write(folder.at("run/notes.txt"), "mine").unwrap();
    let refused = replay("1");
    assert!(status(&refused) == 2 && said(&refused).contains("notes.txt"), "{}", said(&refused));
    assert!(folder.at("run/report.json").is_file() && folder.at("run/notes.txt").is_file());
}

#[test]
fn checks_that_cost_nothing_come_first() {
    let folder = Folder::new("first");
    let recording = folder.at("a.mcap").display().to_string();
    let made = tool(&["record", "synthetic:frames=3,size=64x48,texel_mm=20", "--out", &recording]);
    assert_eq!(status(&made), 0);
    let refused = |arguments: &[&str], words: &[&str]| {
        let output = tool(arguments);
        assert_eq!(status(&output), 2, "{arguments:?}: {}", said(&output));
        for word in words {
            assert!(said(&output).contains(word), "{arguments:?}: {}", said(&output));
        }
    };
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/still.toml");
    refused(&["explain", &recording, "--frame", "3"], &["--frame = 3", "3 frames, numbered 0 to 2"]);
    refused(&["figures", &recording, "--scene", scene, "--frame", "3", "--out", "x"], &["numbered 0 to 2"]);
    let nowhere = folder.at("no/such.png").display().to_string();
    refused(&["render", scene, "--out", &nowhere], &["there is no folder", "no"]);
    refused(&["synth", "--out", &nowhere], &["there is no folder"]);
    for verb in
        [&["render", scene][..], &["synth", "--out", "x.mcap"], &["trace", scene, "--out", "x"], &["devices"]]
    {
        refused(&[verb, &["--threads", "257"]].concat(), &["--threads = 257", "0..=256"]);
    }
    refused(&["render", scene, "--set", "quality.pcf_taps=99"], &["quality.pcf_taps = 99", "1..=8"]);
    refused(&["render", scene, "--set", "quality.pcf_tap=2"], &["did you mean quality.pcf_taps"]);
}

#[test]
fn mistakes_come_as_json_too() {
    let folder = Folder::new("json");
    let wrong = folder.at("wrong.toml");
    std::fs::write(&wrong, "[light]\norder = 99\n[quality]\npcf_tap = 1\n").unwrap();
    let output = tool(&[OsStr::new("check"), wrong.as_os_str(), OsStr::new("--json")]);
    assert_eq!(status(&output), 2);
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let mistakes = told["error"]["mistakes"].as_array().unwrap();
    assert_eq!((mistakes.len(), &mistakes[0]["line"], &mistakes[0]["column"]), (2, &2.into(), &9.into()));
    let usage = tool(&["render", "--json"]);
    assert_eq!(serde_json::from_slice::<Value>(&usage.stdout).unwrap()["error"]["exit_status"], 2);
    let scene = folder.at("scene.toml");
    std::fs::write(&scene, "[ball]\ncentre = [0, 0]\n[[object]]\nshape = \"sofa\"\n").unwrap();
    let output = tool(&[OsStr::new("check"), scene.as_os_str()]);
    assert!(status(&output) == 2 && said(&output).contains("scene.toml:2:10:"), "{}", said(&output));
    assert!(said(&output).contains("scene.toml:4:9:") && said(&output).contains("ball.radius_m"));
}
