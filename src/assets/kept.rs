//! Results of long computations, kept in files from run to run under a hash of all that they were computed from.
//!
//! A file is eight bytes that name the format and its version, the hash of the input (SHA-256 of the input's kind, its
//! version and itself in postcard), the result in postcard, and the SHA-256 of all before. A file that is cut, altered, of
//! another format or of another input, or whose result does not fit the input, is not used: a warning is logged, and it is
//! written anew.

mod room;

pub use room::make_room;

use super::error::{AssetError, read_file};
use crate::model::keep::{Keeper, KeptInput};
use serde::{Serialize, de::DeserializeOwned};
use sha2::{Digest, Sha256};
use std::{
    io::{BufWriter, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

/// Name and version of the format. Another version where the same results are written as other bytes.
const FORMAT: [u8; 8] = *b"hl-kept1";
/// Bytes of a SHA-256.
const HASH: usize = 32;

/// SHA-256 of an input.
type InputHash = [u8; HASH];

/// A folder of kept results, or none.
#[derive(Debug, Default)]
pub struct Cache<'a> {
    folder: Option<&'a Path>,
    computed: AtomicUsize,
}

impl<'a> Cache<'a> {
    /// Results below `folder`, which need not exist; `None`: nothing is kept.
    pub fn new(folder: Option<&'a Path>) -> Self {
        Self { folder, computed: AtomicUsize::new(0) }
    }

    /// Results that it was asked for and that had to be computed.
    pub fn computed(&self) -> usize {
        self.computed.load(Ordering::Relaxed)
    }

    /// Where an input's result is kept.
    fn file<I: KeptInput>(&self, input: &I) -> Option<(PathBuf, InputHash)> {
        let folder = self.folder?;
        let hash = match hash_of(input) {
            Ok(hash) => hash,
            Err(error) => {
                tracing::warn!("{}: nothing is kept of this kind: {error}", I::KIND);
                return None;
            }
        };
        Some((folder.join(I::KIND).join(format!("{}.bin", hexadecimal(&hash))), hash))
    }
}

impl Keeper for Cache<'_> {
    fn keep<I: KeptInput, E>(
        &self,
        input: &I,
        compute: impl FnOnce() -> Result<I::Output, E>,
    ) -> Result<I::Output, E> {
        let file = self.file(input);
        let known = file.as_ref().and_then(|(file, hash)| read(file, hash, |output| input.accepts(output)));
        if let Some(known) = known {
            return Ok(known);
        }
        self.computed.fetch_add(1, Ordering::Relaxed);
        let output = compute()?;
        if let Some((file, hash)) = &file
            && let Err(error) = write(file, hash, &output)
        {
            tracing::warn!("{} is not kept: {error}", I::KIND);
        }
        Ok(output)
    }
}

/// Bytes as two hexadecimal digits each.
fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Hashes what is written to it.
struct Hashing(Sha256);

impl Write for Hashing {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn hash_of<I: KeptInput>(input: &I) -> Result<InputHash, Box<dyn std::error::Error>> {
    let writer = BufWriter::new(Hashing(Sha256::new()));
    let writer = postcard::to_io(&(I::KIND, I::VERSION, input.hashed()), writer)?;
    Ok(writer.into_inner().map_err(|e| e.into_error())?.0.finalize().into())
}

/// The result in a file, where it is whole, of this input, and accepted. No file is no reason to speak.
fn read<T: DeserializeOwned>(file: &Path, hash: &InputHash, accepts: impl FnOnce(&T) -> bool) -> Option<T> {
    if !file.exists() {
        return None;
    }
    let found = read_file(file).map_err(|e| e.to_string()).and_then(|bytes| {
        let output = decode(&bytes, hash).map_err(|what| format!("{}: {what}", file.display()))?;
        if accepts(&output) { Ok(output) } else { Err(format!("{}: not what its name says", file.display())) }
    });
    match found {
        Ok(output) => {
            room::touch(file);
            Some(output)
        }
        Err(what) => {
            tracing::warn!("{what}; it is made anew");
            None
        }
    }
}

fn decode<T: DeserializeOwned>(bytes: &[u8], hash: &InputHash) -> Result<T, String> {
    if !bytes.starts_with(&FORMAT) {
        return Err("of another program or version".into());
    }
    let checksum_at = bytes.len().saturating_sub(HASH);
    let (body, checksum) = bytes.split_at(checksum_at);
    if <[u8; HASH]>::from(Sha256::digest(body)) != *checksum {
        return Err("damaged".into());
    }
    let content = body[FORMAT.len()..].strip_prefix(hash).ok_or("of something else than its name says")?;
    match postcard::take_from_bytes(content) {
        Ok((output, [])) => Ok(output),
        Ok((_, rest)) => Err(format!("{} bytes too many", rest.len())),
        Err(error) => Err(error.to_string()),
    }
}

fn encode<T: Serialize>(hash: &InputHash, output: &T) -> Result<Vec<u8>, postcard::Error> {
    let mut bytes = FORMAT.to_vec();
    bytes.extend_from_slice(hash);
    let mut bytes = postcard::to_extend(output, bytes)?;
    let checksum = Sha256::digest(&bytes);
    bytes.extend_from_slice(&checksum);
    Ok(bytes)
}

fn write<T: Serialize>(file: &Path, hash: &InputHash, output: &T) -> Result<(), AssetError> {
    let failed = |e: std::io::Error| AssetError::new(file, "cannot be written").cause(e);
    let bytes = encode(hash, output).map_err(|e| AssetError::new(file, "cannot be written").cause(e))?;
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    if let Some(folder) = file.parent() {
        room::sweep(folder);
    }
    room::write_locked(file, &bytes).map_err(failed)
}

/// What an input's file is called.
#[cfg(test)]
pub(crate) fn name<I: KeptInput>(input: &I) -> String {
    hash_of(input).map(|hash| hexadecimal(&hash)).unwrap_or_default()
}

/// A result as it is written, and the other way round.
#[cfg(test)]
pub(crate) fn content<T: Serialize>(output: &T) -> Vec<u8> {
    postcard::to_stdvec(output).unwrap_or_default()
}

#[cfg(test)]
pub(crate) fn of_content<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    postcard::from_bytes(bytes).ok()
}

#[cfg(test)]
mod tests;
