//! Looks at the settings file: by content, once it has come to rest.

use crate::config::file;
use crate::model::time::Timestamp;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A file is read when nothing about it has changed for so long, seconds: whoever writes it is done then.
const REST_S: f64 = 0.08;

/// What of a file changes when it is written or replaced, a symlink's target too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileStamp {
    modified: Option<SystemTime>,
    /// When anything about it changed last, seconds and nanoseconds: no writer can set it back.
    changed: (i64, i64),
    length: u64,
    device: u64,
    inode: u64,
}

/// Follows one file. A file that is missing or empty is being written: it says nothing.
#[derive(Debug)]
pub struct Watcher {
    path: PathBuf,
    /// The content that was told last.
    told: String,
    stamp: Option<FileStamp>,
    /// Since when the stamp is what it is.
    since: Timestamp,
    /// Nothing has changed since the file was read.
    is_read: bool,
}

impl Watcher {
    /// Follows a file whose content is known so far.
    pub fn new(path: &Path, known: &str) -> Self {
        Self {
            path: path.to_owned(),
            told: known.to_owned(),
            stamp: None,
            since: Timestamp::default(),
            is_read: false,
        }
    }

    /// The next look reads the file again when it is at rest, and tells its content even where it was told before.
    pub fn read_again(&mut self) {
        self.is_read = false;
        self.told.clear();
    }

    fn stamp_now(&self) -> Option<FileStamp> {
        let about = std::fs::metadata(&self.path).ok().filter(std::fs::Metadata::is_file)?;
        Some(FileStamp {
            modified: about.modified().ok(),
            changed: (about.ctime(), about.ctime_nsec()),
            length: about.len(),
            device: about.dev(),
            inode: about.ino(),
        })
    }

    /// Looks at the file. Returns its content where that is another than was told last.
    pub fn look(&mut self, now: Timestamp) -> Option<&str> {
        let stamp = self.stamp_now();
        if stamp != self.stamp {
            (self.stamp, self.since, self.is_read) = (stamp, now, false);
        }
        let length = stamp?.length;
        let is_at_rest = now.seconds_since(self.since) >= REST_S;
        if self.is_read || !is_at_rest || length == 0 {
            return None;
        }
        // A file that cannot be read now is looked at again.
        let content = file::text(&self.path).ok()?;
        // One that was written while it was read, too.
        self.is_read = self.stamp_now() == stamp;
        if !self.is_read {
            return None;
        }
        if content.is_empty() || content == self.told {
            return None;
        }
        self.told = content;
        Some(&self.told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct FolderOfSettings(PathBuf);

    impl FolderOfSettings {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("halflight-watch-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        fn write(&self, name: &str, text: &str) -> PathBuf {
            let path = self.0.join(name);
            std::fs::write(&path, text).unwrap();
            path
        }
    }

    impl Drop for FolderOfSettings {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds)
    }

    /// What is told at each of these times.
    fn looks<const N: usize>(watcher: &mut Watcher, seconds: [f64; N]) -> [Option<String>; N] {
        seconds.map(|seconds| watcher.look(at(seconds)).map(str::to_owned))
    }

    fn some(content: &str) -> Option<String> {
        Some(content.to_owned())
    }

    #[test]
    fn content_is_told_once_and_only_at_rest() {
        let folder = FolderOfSettings::new("rest");
        let path = folder.write("a.toml", "x = 1");
        let mut watcher = Watcher::new(&path, "x = 1");
        assert_eq!(looks(&mut watcher, [0.0, 1.0]), [None, None], "nothing new");
        folder.write("a.toml", "x = 22");
        assert_eq!(watcher.look(at(2.0)), None, "it may be written still");
        assert_eq!(watcher.look(at(2.07)), None);
        folder.write("a.toml", "x = 333");
        assert_eq!(watcher.look(at(2.1)), None, "it was");
        assert_eq!(watcher.look(at(2.2)), Some("x = 333"));
        assert_eq!(watcher.look(at(9.0)), None);
    }

    #[test]
    fn missing_and_empty_files_are_being_written() {
        let folder = FolderOfSettings::new("missing");
        let path = folder.write("a.toml", "x = 1");
        let mut watcher = Watcher::new(&path, "");
        std::fs::remove_file(&path).unwrap();
        assert_eq!(looks(&mut watcher, [0.0, 1.0]), [None, None]);
        folder.write("a.toml", "");
        assert_eq!(looks(&mut watcher, [2.0, 3.0]), [None, None]);
        folder.write("a.toml", "x = 1");
        assert_eq!(looks(&mut watcher, [4.0, 5.0]), [None, some("x = 1")]);
        // Gone and back with the same content: nothing has changed.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(watcher.look(at(6.0)), None);
        folder.write("a.toml", "x = 1");
        assert_eq!(looks(&mut watcher, [7.0, 8.0]), [None, None]);
    }

    #[test]
    fn a_swapped_link_is_noticed_though_no_file_was_written() {
        let folder = FolderOfSettings::new("link");
        let (one, two) = (folder.write("one.toml", "x = 1"), folder.write("two.toml", "x = 2"));
        let long_ago = SystemTime::UNIX_EPOCH;
        for path in [&one, &two] {
            std::fs::File::options().write(true).open(path).unwrap().set_modified(long_ago).unwrap();
        }
        let (link, next) = (folder.0.join("link.toml"), folder.0.join("next"));
        std::os::unix::fs::symlink(&one, &link).unwrap();
        let mut watcher = Watcher::new(&link, "x = 1");
        assert_eq!(looks(&mut watcher, [0.0, 1.0]), [None, None]);
        std::os::unix::fs::symlink(&two, &next).unwrap();
        std::fs::rename(&next, &link).unwrap();
        assert_eq!(looks(&mut watcher, [2.0, 3.0]), [None, some("x = 2")]);
    }
}
