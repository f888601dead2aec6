//! Results of long computations, kept in files from run to run under a hash of all that goes in.

use super::error::{AssetError, read_file};
use glam::Vec3;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Bytes of a SHA-256.
pub const HASH: usize = 32;

/// SHA-256 of an algorithm's version and all its input.
pub type Key = [u8; HASH];

/// The key of what was made of `input`.
pub fn key(input: &[u8]) -> Key {
    Sha256::digest(input).into()
}

/// Where a folder keeps what belongs to a key: `kind` is a folder of its own in it.
pub fn cache_file(folder: &Path, kind: &str, key: &Key) -> PathBuf {
    let name: String = key.iter().map(|b| format!("{b:02x}")).collect();
    folder.join(kind).join(format!("{name}.bin"))
}

/// What `decode` makes of a kept file's content; `None` where there is none. A file is the key, the content, and the SHA-256 of
/// both: one that is cut, altered or of another key, or that `decode` refuses, is warned of and counts as none.
pub fn read<T>(file: &Path, key: &Key, decode: impl FnOnce(&[u8]) -> Option<T>) -> Option<T> {
    if !file.exists() {
        return None;
    }
    let known = match read_file(file) {
        Ok(bytes) => content(&bytes, key).and_then(decode),
        Err(error) => {
            tracing::warn!("{error}; it is made anew");
            return None;
        }
    };
    if known.is_none() {
        tracing::warn!("{}: damaged, or not what its name says; it is made anew", file.display());
    }
    known
}

fn content<'a>(bytes: &'a [u8], key: &Key) -> Option<&'a [u8]> {
    let (content, checksum) = bytes.split_at_checked(bytes.len().checked_sub(HASH)?)?;
    let sound = content.starts_with(key) && self::key(content) == *checksum;
    if sound { content.get(HASH..) } else { None }
}

/// Keeps a content under a key.
///
/// # Errors
/// The file or its folder cannot be written.
pub fn write(file: &Path, key: &Key, content: &[u8]) -> Result<(), AssetError> {
    let failed = |e: std::io::Error| AssetError::new(file, "cannot be written").cause(e);
    let mut bytes = Vec::with_capacity(content.len() + 2 * HASH);
    bytes.extend_from_slice(key);
    bytes.extend_from_slice(content);
    let checksum = self::key(&bytes);
    bytes.extend_from_slice(&checksum);
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    // A reader never sees half a file: written beside it, then moved.
    let beside = file.with_extension(format!("{}.part", std::process::id()));
    std::fs::write(&beside, bytes).map_err(failed)?;
    std::fs::rename(&beside, file).map_err(failed)
}

/// Little-endian numbers, one after the other.
#[derive(Default)]
pub struct Bytes(pub Vec<u8>);

impl Bytes {
    /// One number.
    pub fn number(&mut self, number: u32) {
        self.0.extend(number.to_le_bytes());
    }

    /// Several.
    pub fn numbers(&mut self, list: &[u32]) {
        self.0.reserve(4 * list.len());
        list.iter().for_each(|x| self.0.extend(x.to_le_bytes()));
    }

    /// Several of 16 bits.
    pub fn shorts(&mut self, list: &[u16]) {
        self.0.reserve(2 * list.len());
        list.iter().for_each(|x| self.0.extend(x.to_le_bytes()));
    }

    /// Several of 64 bits.
    pub fn longs(&mut self, list: &[u64]) {
        self.0.reserve(8 * list.len());
        list.iter().for_each(|x| self.0.extend(x.to_le_bytes()));
    }

    /// Several.
    pub fn floats(&mut self, list: &[f32]) {
        self.0.reserve(4 * list.len());
        list.iter().for_each(|x| self.0.extend(x.to_le_bytes()));
    }

    /// Several.
    pub fn doubles(&mut self, list: &[f64]) {
        list.iter().for_each(|x| self.0.extend(x.to_le_bytes()));
    }
}

/// The other way round; `None` where the bytes end early.
pub struct Reader<'a>(pub &'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    /// One number.
    pub fn number(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// One number.
    pub fn float(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }

    /// Three.
    pub fn floats(&mut self) -> Option<[f32; 3]> {
        Some([self.float()?, self.float()?, self.float()?])
    }

    /// A place or a direction.
    pub fn place(&mut self) -> Option<Vec3> {
        self.floats().map(Vec3::from)
    }

    /// Three.
    pub fn doubles(&mut self) -> Option<[f64; 3]> {
        let mut next = || self.take().map(f64::from_le_bytes);
        Some([next()?, next()?, next()?])
    }

    /// `count` numbers of N bytes each.
    pub fn many<const N: usize, T>(&mut self, count: usize, of: impl Fn([u8; N]) -> T) -> Option<Vec<T>> {
        let (list, rest) = self.0.split_at_checked(count.checked_mul(N)?)?;
        self.0 = rest;
        let (list, _) = list.as_chunks::<N>();
        Some(list.iter().map(|bytes| of(*bytes)).collect())
    }

    /// A list whose length stands before it; of `bytes` each at least, so that no length asks for more than there is.
    pub fn list<T>(&mut self, bytes: usize, one: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.number()? as usize;
        (count.checked_mul(bytes)? <= self.0.len()).then(|| (0..count).map(|_| one(self)).collect())?
    }
}
