//! Files that are there whole or not at all: written under another name beside their place, then moved there.
//!
//! Where writing fails (a disk is full, the process ends) the file that was there before stays as it was. What is no
//! regular file (`/dev/stdout`, a pipe) cannot be moved to: it is written as it is.

use super::error::AssetError;
use std::ffi::OsString;
use std::fs::{File, Metadata};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicUsize, Ordering},
};

/// Bytes of a file's name that its temporary name keeps: names end at 255.
const KEPT_OF_NAME: usize = 200;

/// Temporary files that are being written now.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Writes bytes to a file, whole or not at all.
///
/// # Errors
/// The file is named; what was there before stays.
pub fn write(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), AssetError> {
    let failed = |e: io::Error| AssetError::new(file, "cannot be written").cause(e);
    let mut whole = WholeFile::create(file).map_err(failed)?;
    whole.write_all(bytes.as_ref()).and_then(|()| whole.commit()).map_err(failed)
}

/// Removes what is being written now: for a process that ends at once.
pub fn forget_unfinished() {
    for file in UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        // Whoever ends has nobody to tell.
        let _ = std::fs::remove_file(file);
    }
}

/// A file that is being written. Without [`WholeFile::commit`] its place stays as it was.
#[derive(Debug)]
pub struct WholeFile {
    target: Option<BufWriter<File>>,
    /// Where it is written, and where it goes; `None`: written as it is.
    moved: Option<Move>,
}

#[derive(Debug)]
struct Move {
    from: PathBuf,
    to: PathBuf,
    /// Of the file that is replaced.
    before: Option<Metadata>,
}

impl WholeFile {
    /// Begins a file. A symbolic link stays a link: what it names is replaced.
    ///
    /// # Errors
    /// The folder is missing, or nothing can be made in it.
    pub fn create(file: &Path) -> io::Result<Self> {
        let before = std::fs::metadata(file).ok();
        if before.as_ref().is_some_and(|about| !about.is_file()) {
            let target = File::options().write(true).open(file)?;
            return Ok(Self { target: Some(BufWriter::new(target)), moved: None });
        }
        if before.as_ref().is_some_and(|about| about.permissions().readonly()) {
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, "it is write-protected"));
        }
        let to = if before.is_some() { file.canonicalize()? } else { file.to_owned() };
        let (from, target) = beside(&to)?;
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(from.clone());
        Ok(Self { target: Some(BufWriter::new(target)), moved: Some(Move { from, to, before }) })
    }

    /// Puts it in its place.
    ///
    /// # Errors
    /// The last bytes cannot be written, or it cannot be moved.
    pub fn commit(mut self) -> io::Result<()> {
        let Some(target) = self.target.take() else { return Ok(()) };
        let target = target.into_inner().map_err(io::IntoInnerError::into_error)?;
        let Some(moved) = &self.moved else { return Ok(()) };
        if let Some(before) = &moved.before {
            target.set_permissions(before.permissions())?;
        }
        drop(target);
        std::fs::rename(&moved.from, &moved.to)?;
        self.settle();
        Ok(())
    }

    /// Takes it off the list. Whether there was something to settle.
    fn settle(&mut self) -> Option<Move> {
        let moved = self.moved.take()?;
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).retain(|file| *file != moved.from);
        Some(moved)
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        // What could not be written is not written by dropping it.
        if let Some(target) = self.target.take() {
            let _ = target.into_parts();
        }
        if let Some(moved) = self.settle() {
            let _ = std::fs::remove_file(moved.from);
        }
    }
}

fn gone() -> io::Error {
    io::Error::other("the file is closed")
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.target.as_mut().ok_or_else(gone)?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.target.as_mut().ok_or_else(gone)?.flush()
    }
}

impl Seek for WholeFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.target.as_mut().ok_or_else(gone)?.seek(to)
    }
}

/// A new file beside another, of a name that nobody else uses.
fn beside(file: &Path) -> io::Result<(PathBuf, File)> {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let name =
        file.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "it has no name"))?;
    let kept = &name.as_bytes()[..name.len().min(KEPT_OF_NAME)];
    loop {
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let mut other = b".".to_vec();
        other.extend_from_slice(kept);
        other.extend_from_slice(format!(".{}-{count}.part", std::process::id()).as_bytes());
        let path = file.with_file_name(OsString::from_vec(other));
        match File::options().write(true).create_new(true).open(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            opened => return opened.map(|target| (path, target)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    struct FolderOfFiles(PathBuf);

    impl FolderOfFiles {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("halflight-whole-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        fn names(&self) -> Vec<String> {
            let entries = std::fs::read_dir(&self.0).unwrap();
            let mut names: Vec<_> =
                entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
            names.sort();
            names
        }
    }

    impl Drop for FolderOfFiles {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_file_is_replaced_whole_and_keeps_its_rights() {
        let folder = FolderOfFiles::new("replaced");
        let file = folder.0.join("a.bin");
        write(&file, "one").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o640)).unwrap();
        write(&file, "three").unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"three");
        assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o640);
        let link = folder.0.join("link");
        symlink(&file, &link).unwrap();
        write(&link, "four").unwrap();
        assert!(link.is_symlink() && std::fs::read(&file).unwrap() == b"four");
        assert_eq!(folder.names(), ["a.bin", "link"]);
    }

    #[test]
    fn without_commit_the_old_file_stays_and_nothing_else_is_left() {
        let folder = FolderOfFiles::new("dropped");
        let file = folder.0.join("a.bin");
        write(&file, "old").unwrap();
        let mut whole = WholeFile::create(&file).unwrap();
        whole.write_all(&[7; 100_000]).unwrap();
        assert_eq!((std::fs::read(&file).unwrap().as_slice(), folder.names().len()), (&b"old"[..], 2));
        drop(whole);
        assert_eq!((std::fs::read(&file).unwrap().as_slice(), folder.names().len()), (&b"old"[..], 1));
    }

    #[test]
    fn long_and_odd_names_work() {
        let folder = FolderOfFiles::new("names");
        for name in [vec![b'x'; 255], b"a,b\xff.png".to_vec()] {
            let file = folder.0.join(OsString::from_vec(name));
            write(&file, "1").unwrap();
            assert_eq!(std::fs::read(&file).unwrap(), b"1");
        }
        assert!(write(&folder.0.join("none/a"), "").is_err());
    }

    #[test]
    fn a_full_device_says_so_and_stays_a_device() {
        let full = Path::new("/dev/full");
        for bytes in [1usize, 100_000] {
            let error = write(full, vec![1u8; bytes]).unwrap_err().to_string();
            assert!(error.starts_with("/dev/full: cannot be written"), "{error}");
        }
        assert!(!std::fs::metadata(full).unwrap().is_file());
    }
}
