//! Recordings as the tool makes them today, with truth: of the desk with its ball, and of the room without one.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder that goes away with its value.
pub struct Folder(pub PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

pub fn halflight(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_halflight")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// 13 frames of the desk as JPEG, its shadows coarse: made at once.
pub fn desk(folder: &Path) -> PathBuf {
    let path = folder.join("desk.mcap");
    let device = "synthetic:frames=13,texel_mm=20,size=128x96";
    halflight(&["record", device, "--out", path.to_str().unwrap()]);
    path
}

/// The same by `synth`.
pub fn synth(folder: &Path) -> PathBuf {
    let path = folder.join("synth.mcap");
    halflight(&["synth", "--frames", "13", "--size", "128x96", "--out", path.to_str().unwrap()]);
    path
}

/// Four frames of the room, whose rig has no ball, as they are.
pub fn room(folder: &Path) -> PathBuf {
    let path = folder.join("room.mcap");
    let device = "synthetic:frames=4,view=room,texel_mm=20,size=128x96";
    halflight(&["record", device, "--raw", "--out", path.to_str().unwrap()]);
    path
}
