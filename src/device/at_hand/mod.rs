//! What is plugged into the machine, told by the kernel's files: nothing is opened, so nothing is disturbed.
//!
//! [`PluggedMachine`] is a root folder and a judge of rights, so that tests bring a tree of their own.

pub mod inertial;
pub mod rights;
#[cfg(feature = "serial")]
pub mod serial_ports;

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The longest file that is read, bytes.
const LONGEST: u64 = 4096;
/// Entries of a folder that are looked at.
const MOST_ENTRIES: usize = 256;

/// Where the kernel's files are, and who may use them.
#[derive(Clone, Debug)]
pub struct PluggedMachine {
    root: PathBuf,
    may_use: fn(&Path) -> bool,
}

impl Default for PluggedMachine {
    fn default() -> Self {
        Self::new("/", rights::may_read_and_write)
    }
}

impl PluggedMachine {
    /// A machine whose `/sys`, `/dev` and `/etc` are below `root`; `may_use` tells whether a path may be read and written.
    pub fn new(root: impl Into<PathBuf>, may_use: fn(&Path) -> bool) -> Self {
        Self { root: root.into(), may_use }
    }

    /// The place of an absolute path in this machine.
    fn at(&self, path: impl AsRef<Path>) -> PathBuf {
        let path = path.as_ref();
        self.root.join(path.strip_prefix("/").unwrap_or(path))
    }

    fn has(&self, path: impl AsRef<Path>) -> bool {
        self.at(path).exists()
    }

    fn may_use(&self, path: impl AsRef<Path>) -> bool {
        (self.may_use)(&self.at(path))
    }

    fn text(&self, path: impl AsRef<Path>) -> Option<String> {
        let bytes = self.bytes(path)?;
        Some(String::from_utf8_lossy(&bytes).trim().to_owned())
    }

    fn bytes(&self, path: impl AsRef<Path>) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        File::open(self.at(path)).ok()?.take(LONGEST).read_to_end(&mut bytes).ok()?;
        Some(bytes)
    }

    /// Names in a folder that begin so, the lower number first.
    fn names(&self, folder: &str, begin: &str) -> Vec<String> {
        let entries = fs::read_dir(self.at(folder)).into_iter().flatten().flatten().take(MOST_ENTRIES);
        let mut names: Vec<String> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .filter(|name| name.starts_with(begin))
            .collect();
        names.sort_by(|a, b| (a.len(), a).cmp(&(b.len(), b)));
        names
    }
}

#[cfg(test)]
mod tests;
