//! Room in the cache folder: leftovers of writers that died are swept, and what was not used for the longest time goes
//! when all together is too large.

use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// When a file was used last, seconds and nanoseconds.
type LastUse = (i64, i64);

/// Ending of what is being written.
const PART: &str = "part";
/// Ending of what is kept.
const KEPT: &str = "bin";

/// Writes beside a file, then moves it there: a reader never sees half a file. While it is written it is locked, which
/// tells others that its writer lives.
pub fn write_locked(file: &Path, bytes: &[u8]) -> io::Result<()> {
    let beside = file.with_extension(format!("{}.{PART}", std::process::id()));
    let written = File::create(&beside).and_then(|mut target| {
        // Where a file system has no locks, only the sweep of others is lost.
        let _ = target.try_lock();
        target.write_all(bytes)?;
        std::fs::rename(&beside, file)
    });
    if written.is_err() {
        // What half of it there is helps nobody.
        let _ = std::fs::remove_file(&beside);
    }
    written
}

/// Removes what dead writers have left in a folder of one kind.
pub fn sweep(folder: &Path) {
    for (path, _, _) in files(folder, PART) {
        let Ok(file) = File::options().write(true).open(&path) else { continue };
        match file.try_lock() {
            Ok(()) => remove(&path),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
        }
    }
}

/// Notes that a file was used now.
pub fn touch(file: &Path) {
    // The system notes the time of every change of a file's length, to the same length, too. A cache that may only be read
    // still serves.
    let _ = File::options().append(true).open(file).and_then(|f| f.set_len(f.metadata()?.len()));
}

/// Removes what was not used for the longest time until all kinds below `folder` together have at most so many bytes,
/// and what dead writers have left.
pub fn make_room(folder: &Path, most_bytes: u64) {
    let mut kept = Vec::new();
    for kind in folders(folder) {
        sweep(&kind);
        kept.extend(files(&kind, KEPT));
    }
    let mut total: u64 = kept.iter().map(|(_, bytes, _)| bytes).sum();
    kept.sort_by(|(a, _, before), (b, _, after)| before.cmp(after).then_with(|| a.cmp(b)));
    for (path, bytes, _) in kept {
        if total <= most_bytes {
            break;
        }
        remove(&path);
        total = total.saturating_sub(bytes);
    }
}

fn remove(path: &Path) {
    if let Err(error) = std::fs::remove_file(path) {
        tracing::debug!("{} stays in the cache: {error}", path.display());
    }
}

fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|e| e.file_type().is_ok_and(|t| t.is_dir())).map(|e| e.path()).collect()
}

/// Regular files of one ending with their bytes and the time of their last use.
fn files(folder: &Path, ending: &str) -> Vec<(PathBuf, u64, LastUse)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let of = |entry: std::fs::DirEntry| {
        let (path, about) = (entry.path(), entry.metadata().ok()?);
        let is_ours = about.is_file() && path.extension() == Some(OsStr::new(ending));
        is_ours.then(|| (path, about.len(), (about.mtime(), about.mtime_nsec())))
    };
    entries.filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, SystemTime};

    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("halflight-room-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(path.join("kind")).unwrap();
        path
    }

    fn put(path: &Path, bytes: usize, age_s: u64) {
        std::fs::write(path, vec![0; bytes]).unwrap();
        let time = SystemTime::now() - Duration::from_secs(age_s);
        File::options().append(true).open(path).unwrap().set_modified(time).unwrap();
    }

    #[test]
    fn what_was_not_used_for_the_longest_time_goes_first() {
        let folder = folder("bound");
        let file = |name: &str| folder.join("kind").join(name);
        for (name, age_s) in [("a.bin", 400), ("b.bin", 300), ("c.bin", 200), ("d.bin", 100)] {
            put(&file(name), 1000, age_s);
        }
        std::fs::write(file("notes.txt"), vec![0; 5000]).unwrap();
        touch(&file("a.bin"));
        make_room(&folder, 4000);
        assert!(["a.bin", "b.bin", "c.bin", "d.bin"].iter().all(|name| file(name).exists()));
        make_room(&folder, 2500);
        let there: Vec<_> = ["a.bin", "b.bin", "c.bin", "d.bin"].map(|name| file(name).exists()).into();
        assert_eq!(there, [true, false, false, true]);
        make_room(&folder, 0);
        assert!(!file("a.bin").exists() && file("notes.txt").exists(), "what is not ours stays");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn leftovers_of_the_dead_go_and_those_of_the_living_stay() {
        let folder = folder("swept");
        let (dead, alive) = (folder.join("kind/x.99999999.part"), folder.join("kind/y.1.part"));
        put(&dead, 10, 0);
        let writer = File::create(&alive).unwrap();
        writer.lock().unwrap();
        make_room(&folder, 1 << 20);
        assert!(!dead.exists() && alive.exists());
        drop(writer);
        sweep(&folder.join("kind"));
        assert!(!alive.exists());
        write_locked(&folder.join("kind/z.bin"), b"abc").unwrap();
        assert_eq!(std::fs::read_dir(folder.join("kind")).unwrap().count(), 1);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
