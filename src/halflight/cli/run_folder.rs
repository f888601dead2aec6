//! Folders that `--out` names: each holds one run's files and none of an earlier one's.
//!
//! A folder carries a stamp that says which names its run writes. The next run into it removes the files of those names and
//! puts its own stamp there. A folder that holds any other file is refused: it may be somebody's own. Other folders in it are
//! left as they are.

use super::{CliError, output::make_folder};
use crate::assets::whole;
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Name of the stamp.
const STAMP: &str = ".halflight-run.json";
/// Form of the stamp.
const FORMAT: u32 = 1;
/// Larger files are no stamps, bytes.
const LARGEST_STAMP: u64 = 1 << 16;

/// What a run leaves.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct RunStamp {
    format: u32,
    verb: String,
    /// Names below the folder, with `/` between; a `*` stands for any characters but `/`.
    files: Vec<String>,
}

/// Makes a folder ready for a run that writes files of these names: `frames/frame_*.png`.
///
/// # Errors
/// The folder holds something that no run has left there; it cannot be made or emptied.
pub fn begin(folder: &Path, verb: &str, files: &[&str]) -> Result<(), CliError> {
    let old = check(folder, files)?;
    make_folder(folder)?;
    for file in old {
        std::fs::remove_file(&file)
            .map_err(|e| CliError::on(file.display(), format!("cannot be removed: {e}")))?;
    }
    let files = files.iter().map(|&name| name.to_owned()).collect();
    let stamp = RunStamp { format: FORMAT, verb: verb.to_owned(), files };
    whole::write(&folder.join(STAMP), serde_json::to_string_pretty(&stamp)? + "\n")?;
    Ok(())
}

/// Looks whether a run may have a folder, and changes nothing. Gives the files that it would replace.
///
/// # Errors
/// The folder holds something that no run has left there.
pub fn check(folder: &Path, files: &[&str]) -> Result<Vec<PathBuf>, CliError> {
    let mut old = Vec::new();
    if folder.exists() {
        if !folder.is_dir() {
            return Err(CliError(format!("--out = {}: must be a folder", folder.display())));
        }
        let stamp = read_stamp(folder);
        let patterns = stamp.as_ref().map_or(&[][..], |stamp| &stamp.files);
        let of = |name: &str| name.split_once('/').map(|(folder, _)| folder.to_owned());
        let mut inner: Vec<String> =
            patterns.iter().map(String::as_str).chain(files.iter().copied()).filter_map(of).collect();
        inner.sort_unstable();
        inner.dedup();
        gather(folder, folder, patterns, &mut old)?;
        for name in inner.iter().map(|name| folder.join(name)).filter(|path| path.is_dir()) {
            gather(folder, &name, patterns, &mut old)?;
        }
    }
    Ok(old)
}

fn read_stamp(folder: &Path) -> Option<RunStamp> {
    let text = crate::config::file::regular_text(&folder.join(STAMP), LARGEST_STAMP).ok()?;
    serde_json::from_str(&text).ok().filter(|stamp: &RunStamp| stamp.format == FORMAT)
}

/// The files in `folder` of the run that left `patterns` in `top`.
fn gather(top: &Path, folder: &Path, patterns: &[String], files: &mut Vec<PathBuf>) -> Result<(), CliError> {
    let on = |e: std::io::Error| CliError::on(folder.display(), format!("cannot be read: {e}"));
    for entry in std::fs::read_dir(folder).map_err(on)? {
        let entry = entry.map_err(on)?;
        let path = entry.path();
        if entry.file_type().map_err(on)?.is_dir() {
            continue;
        }
        let below = path.strip_prefix(top).unwrap_or(&path);
        let is_own = patterns.iter().any(|pattern| matches(pattern, below.as_os_str()));
        if is_own || is_unfinished(&entry.file_name()) {
            files.push(path);
        } else if below.as_os_str() != STAMP {
            return Err(CliError(format!(
                "--out = {}: holds {}, which no run has left there: must be a new folder, an empty one, or one of an earlier run",
                top.display(),
                below.display()
            )));
        }
    }
    Ok(())
}

/// What a run that was killed was writing.
fn is_unfinished(name: &OsStr) -> bool {
    matches(".*.part", name)
}

/// Whether a name fits a pattern with at most one `*` in each of its parts.
fn matches(pattern: &str, name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    let (wanted, found) = (pattern.split('/'), name.split(|b| *b == b'/'));
    wanted.clone().count() == found.clone().count()
        && wanted.zip(found).all(|(wanted, found)| match wanted.split_once('*') {
            None => wanted.as_bytes() == found,
            Some((head, tail)) => {
                found.len() >= head.len() + tail.len()
                    && found.starts_with(head.as_bytes())
                    && found.ends_with(tail.as_bytes())
            }
        })
}

/// Refuses a file or folder that is there, where `--force` is not given. An empty folder is as good as none.
///
/// # Errors
/// It is there.
pub fn refuse_existing(out: &Path, force: bool) -> Result<(), CliError> {
    let is_empty_folder = || std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_none());
    // A device or a pipe is written to, not replaced.
    let is_special = std::fs::metadata(out).is_ok_and(|about| !about.is_file() && !about.is_dir());
    if force || is_special || !out.exists() || is_empty_folder() {
        return Ok(());
    }
    Err(CliError(format!("--out = {}: is there already; --force replaces it", out.display())))
}

/// Refuses a file whose folder is not there: it costs nothing to look before the work begins.
///
/// # Errors
/// There is no such folder.
pub fn need_folder_of(file: &Path) -> Result<(), CliError> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if folder.is_dir() {
        return Ok(());
    }
    Err(CliError(format!("--out = {}: there is no folder {}", file.display(), folder.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct FolderOfRuns(PathBuf);

    impl FolderOfRuns {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("halflight-run-{name}-{}", std::process::id()));
            let _ = std::fs::remove_dir_all(&path);
            Self(path)
        }

        fn put(&self, name: &str) {
            let file = self.0.join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, name).unwrap();
        }

        fn has(&self, name: &str) -> bool {
            self.0.join(name).exists()
        }
    }

    impl Drop for FolderOfRuns {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_run_replaces_the_one_before_and_leaves_those_beside_it() {
        let out = FolderOfRuns::new("replaced");
        begin(&out.0, "replay", &["frames/frame_*.png", "report.json"]).unwrap();
        for name in
            ["frames/frame_000001.png", "frames/frame_000002.png", "report.json", ".report.json.7-0.part"]
        {
            out.put(name);
        }
        begin(&out.0.join("room"), "figures", &["*.png"]).unwrap();
        out.put("room/a.png");
        begin(&out.0, "figures", &["*.png"]).unwrap();
        assert!(
            !out.has("frames/frame_000001.png")
                && !out.has("report.json")
                && !out.has(".report.json.7-0.part")
        );
        assert!(out.has("room/a.png"));
        assert_eq!(read_stamp(&out.0).unwrap().verb, "figures");
        begin(&out.0.join("room"), "figures", &["*.png"]).unwrap();
        assert!(!out.has("room/a.png"));
    }

    #[test]
    fn what_is_somebodys_own_is_refused_and_stays() {
        let out = FolderOfRuns::new("own");
        begin(&out.0, "replay", &["report.json"]).unwrap();
        let names = ["frames/frame_*.png", "report.json"];
        for name in ["notes.txt", "frames/notes.txt", "frames/frame_1.png"] {
            out.put("report.json");
            out.put(name);
            let refused = begin(&out.0, "replay", &names).unwrap_err().to_string();
            assert!(refused.contains(name), "{refused}");
            assert!(out.has(name) && out.has("report.json"), "nothing is removed");
            std::fs::remove_file(out.0.join(name)).unwrap();
        }
        out.put("deep/down/notes.txt");
        begin(&out.0, "replay", &names).unwrap();
        assert!(out.has("deep/down/notes.txt"), "a folder beside it is not looked at");
        std::fs::remove_file(out.0.join(STAMP)).unwrap();
        out.put("report.json");
        assert!(begin(&out.0, "replay", &["report.json"]).is_err(), "without a stamp nothing is known");
    }

    #[test]
    fn patterns_hold_within_one_folder() {
        let fits = |pattern: &str, name: &str| matches(pattern, OsStr::new(name));
        assert!(fits("frames/frame_*.png", "frames/frame_000001.png") && fits("a.json", "a.json"));
        assert!(!fits("*.png", "frames/a.png") && !fits("frames/*.png", "a.png") && !fits("a*a", "a"));
    }
}
