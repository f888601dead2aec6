//! Every line of docs/tool.md runs as it is printed, in a fresh clone.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Lines that take minutes in a build for tests.
const SLOW: [&str; 2] = ["halflight tradeoff", "halflight replay tests/recordings/room.mcap"];
/// A line that takes minutes in any build, and what runs the verb: it is run where HALFLIGHT_ALL_EXAMPLES=1.
const SLOWEST: (&str, &str) = ("halflight tradeoff", "tests/tradeoff.rs");

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The release build, if there is one; else the build for tests, which leaves out what is slow.
fn programs() -> (PathBuf, bool) {
    let built = Path::new(env!("CARGO_BIN_EXE_halflight"));
    let release = built.parent().unwrap().with_file_name("release");
    let is_new = |path: &Path| {
        let time = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
        time(path).zip(time(&root().join("docs/tool.md"))).is_some_and(|(built, page)| built >= page)
    };
    let is_release = is_new(&release.join("halflight"));
    assert!(
        is_release || std::env::var_os("REQUIRE_RELEASE").is_none_or(|v| v != "1"),
        "REQUIRE_RELEASE=1, but there is no release build that is newer than docs/tool.md"
    );
    (if is_release { release } else { built.parent().unwrap().to_owned() }, is_release)
}

fn lines() -> Vec<String> {
    let page = std::fs::read_to_string(root().join("docs/tool.md")).unwrap();
    let block = page.split("```sh\n").nth(1).unwrap().split("```").next().unwrap();
    block.lines().map(str::to_owned).collect()
}

#[test]
fn every_line_by_example_runs_as_printed() {
    let (programs, is_release) = programs();
    // A clone: what is tracked, and a place for results.
    let clone = std::env::temp_dir().join(format!("halflight-examples-{}", std::process::id()));
    std::fs::create_dir_all(&clone).unwrap();
    symlink(root().join("tests"), clone.join("tests")).unwrap();
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").unwrap_or_default());
    let runs_all = std::env::var_os("HALFLIGHT_ALL_EXAMPLES").is_some_and(|v| v == "1");
    for line in lines() {
        if line.starts_with(SLOWEST.0) && !runs_all {
            support::skipped(&format!("example, {} runs it smaller: {line}", SLOWEST.1));
            continue;
        }
        if !is_release && SLOW.iter().any(|slow| line.starts_with(slow)) {
            support::skipped(&format!("example, too slow without a release build: {line}"));
            continue;
        }
        let done =
            Command::new("bash").args(["-c", &line]).current_dir(&clone).env("PATH", &path).output().unwrap();
        let errors = String::from_utf8_lossy(&done.stderr);
        if done.status.code() == Some(3) && line.contains("--engine gpu") {
            support::skip_gpu("example", &errors);
            continue;
        }
        assert!(done.status.success(), "{line}\n{errors}");
    }
    std::fs::remove_dir_all(clone).unwrap();
}

#[test]
fn every_verb_has_a_line() {
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
    ] {
        assert!(lines().iter().any(|line| line.starts_with(&format!("halflight {verb}"))), "{verb}");
    }
}
