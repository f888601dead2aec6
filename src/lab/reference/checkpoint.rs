//! A trace that was not finished, as bytes: it goes on from there bit for bit as if it had not been cut.
//!
//! Little-endian: the mark, the hash of scene and settings (what may differ is left out of it: how many samples there are to
//! be), passes done, samples that were dropped, the number of pixels, their sums, and SHA-256 of all that.

use super::sums::{NUMBERS, PixelSums};
use sha2::{Digest, Sha256};

const MARK: &[u8; 8] = b"hltrace1";
const HEAD: usize = MARK.len() + 32 + 4 + 8 + 8;
const HASH: usize = 32;

/// Why a checkpoint cannot be taken up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// Begins with something else.
    #[error("is no checkpoint of a trace")]
    NotOne,
    /// Too short or too long.
    #[error("has {bytes} bytes: must be {expected} (it was cut, or is of a picture of another size)")]
    Length {
        /// As found.
        bytes: usize,
        /// As they should be.
        expected: usize,
    },
    /// Some byte is not what was written.
    #[error("is damaged: its hash is not that of its content")]
    Damaged,
    /// Another scene, or other settings.
    #[error("belongs to another scene or to other settings (bounces, seed, samples a pass, step)")]
    Foreign,
}

/// What was done so far.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TraceProgress {
    pub passes: u32,
    pub dropped: u64,
    pub sums: Vec<PixelSums>,
}

impl TraceProgress {
    pub fn to_bytes(&self, digest: &[u8; 32]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEAD + self.sums.len() * NUMBERS * 8 + HASH);
        bytes.extend_from_slice(MARK);
        bytes.extend_from_slice(digest);
        bytes.extend_from_slice(&self.passes.to_le_bytes());
        bytes.extend_from_slice(&self.dropped.to_le_bytes());
        bytes.extend_from_slice(&(self.sums.len() as u64).to_le_bytes());
        for number in bytemuck::cast_slice::<PixelSums, f64>(&self.sums) {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        let hash = Sha256::digest(&bytes);
        bytes.extend_from_slice(&hash);
        bytes
    }

    pub fn from_bytes(bytes: &[u8], digest: &[u8; 32], pixels: usize) -> Result<Self, CheckpointError> {
        if bytes.len() < MARK.len() || &bytes[..MARK.len()] != MARK {
            return Err(CheckpointError::NotOne);
        }
        let expected = HEAD + pixels * NUMBERS * 8 + HASH;
        if bytes.len() != expected {
            return Err(CheckpointError::Length { bytes: bytes.len(), expected });
        }
        let (content, hash) = bytes.split_at(bytes.len() - HASH);
        if Sha256::digest(content).as_slice() != hash {
            return Err(CheckpointError::Damaged);
        }
        let (head, numbers) = content.split_at(HEAD);
        let at = MARK.len();
        if &head[at..at + 32] != digest {
            return Err(CheckpointError::Foreign);
        }
        let mut rest = &head[at + 32..];
        let mut take = |count: usize| {
            let (first, after) = rest.split_at(count);
            rest = after;
            first.iter().rev().fold(0u64, |sum, byte| sum << 8 | u64::from(*byte))
        };
        let (passes, dropped, count) = (take(4) as u32, take(8), take(8));
        if count != pixels as u64 || passes == 0 {
            return Err(CheckpointError::Damaged);
        }
        let numbers: Vec<f64> = numbers
            .chunks_exact(8)
            .map(|chunk| f64::from_le_bytes(chunk.try_into().unwrap_or_default()))
            .collect();
        let sums: Vec<PixelSums> = numbers
            .chunks_exact(NUMBERS)
            .map(|pixel| *bytemuck::from_bytes(bytemuck::cast_slice(pixel)))
            .collect();
        Ok(Self { passes, dropped, sums })
    }
}
