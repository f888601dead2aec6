//! The project's own files, for tests of how they are written.
#![allow(dead_code)]

use std::fs;
use std::path::{Path, PathBuf};

/// The project's top folder.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// All files below a folder (none where there is no such folder), as paths from the root with `/`, with their text.
/// Pictures and recordings, which are not text, are left out.
pub fn texts(folder: &str) -> Vec<(String, String)> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        let Ok(entries) = fs::read_dir(folder) else { return };
        for entry in entries.flatten() {
            let path = entry.path();
            if path.is_dir() { walk(&path, found) } else { found.push(path) }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), &mut found);
    found.sort();
    found
        .into_iter()
        .filter_map(|path| {
            let text = fs::read_to_string(&path).ok()?;
            let name = path.strip_prefix(root()).ok()?.to_string_lossy().replace('\\', "/");
            Some((name, text))
        })
        .collect()
}

/// All Rust and WGSL files of the project.
pub fn sources() -> Vec<(String, String)> {
    ["src", "shaders", "tests", "benches"]
        .into_iter()
        .flat_map(texts)
        .filter(|(path, _)| path.ends_with(".rs") || path.ends_with(".wgsl"))
        .collect()
}

/// Fails with all findings at once.
pub fn assert_none(rule: &str, findings: Vec<String>) {
    assert!(findings.is_empty(), "{rule}:\n  {}", findings.join("\n  "));
}
