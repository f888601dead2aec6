//! What every test file may use: where the shared data is, and visible skips.
#![allow(dead_code)]

pub mod wanted;

use std::path::PathBuf;

/// The folder of shared test data (`../shared` or HALFLIGHT_SHARED). Where it is missing the test prints
/// SKIPPED and returns; REQUIRE_SHARED=1 makes that a failure.
pub fn shared(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("HALFLIGHT_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    if folder.join("golden/golden.json").is_file() {
        return Some(folder);
    }
    let why = format!("{test}: no shared data at {}", folder.display());
    assert!(std::env::var_os("REQUIRE_SHARED").is_none_or(|v| v != "1"), "REQUIRE_SHARED=1, but {why}");
    skipped(&why);
    None
}

/// Prints that a test was skipped, and writes it down for the table of wanted figures.
pub fn skipped(why: &str) {
    println!("SKIPPED {why}");
    eprintln!("SKIPPED {why}");
    wanted::note_skipped(why);
}

/// Reports that no adapter was found; REQUIRE_GPU=1 makes that a failure.
pub fn skip_gpu(test: &str, why: &str) {
    assert!(std::env::var_os("REQUIRE_GPU").is_none_or(|v| v != "1"), "REQUIRE_GPU=1, but {test}: {why}");
    skipped(&format!("{test}: {why}"));
}
