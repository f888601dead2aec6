//! Where a file's chunks and the messages outside of chunks lie: found by walking its records. Where the walk meets something
//! impossible, it looks for the next place that can be a chunk.

use super::channels::Channels;
use super::notes;
use mcap::{MAGIC, records::op};
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};

/// Most bytes of a chunk, packed or unpacked, and of a message.
pub const LARGEST_CHUNK: u64 = 1 << 27;
/// Bytes of a schema or channel record outside the chunks.
const LARGEST_DEFINITION: u64 = 1 << 20;
/// Records outside of chunks are read together up to so many bytes.
const LARGEST_RUN: u64 = 1 << 20;
/// Opcode and length.
pub(super) const RECORD_HEAD: u64 = 9;
/// A chunk record's fields before its data, with an empty name of the compression.
pub(super) const CHUNK_HEAD: usize = 8 + 8 + 8 + 4 + 4 + 8;
/// Longest name of a compression, "zstd".
const LONGEST_NAME: usize = 4;
/// A footer's fields.
const FOOTER_BYTES: u64 = 20;

/// What lies at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PlaceKind {
    /// A chunk whose records are compressed.
    Packed,
    /// A chunk whose records stand as they are.
    Plain,
    /// Records outside of chunks.
    Loose,
}

/// A part of the file with messages.
#[derive(Clone, Copy, Debug)]
pub(super) struct FilePlace {
    pub(super) start: u64,
    pub(super) end: u64,
    pub(super) kind: PlaceKind,
}

/// What a walk found.
#[derive(Debug, Default)]
pub(super) struct FoundPlaces {
    pub(super) places: Vec<FilePlace>,
    /// Messages a channel, as the indexes say.
    pub(super) counts: BTreeMap<u16, u64>,
    /// The file ends before its summary.
    pub(super) is_cut: bool,
    /// Places where records did not follow one another and the next chunk was searched.
    pub(super) gaps: u64,
    /// Records that are too large to be read.
    pub(super) too_large: u64,
    /// What the file says of its making.
    pub(super) notes: Option<BTreeMap<String, String>>,
}

/// Walks over all records of a file.
pub(super) fn walk<R: Read + Seek>(
    source: &mut R,
    length: u64,
    channels: &mut Channels,
) -> std::io::Result<FoundPlaces> {
    let mut found = FoundPlaces::default();
    let mut at = MAGIC.len() as u64;
    // No chunk lies before this place that is not known.
    let mut sure = at;
    loop {
        let mut head = [0u8; RECORD_HEAD as usize + CHUNK_HEAD + LONGEST_NAME];
        let got = read_at(source, at, &mut head)?;
        let (opcode, size) = (head[0], u64_at(&head, 1));
        let end = at.saturating_add(RECORD_HEAD).saturating_add(size);
        let whole = got >= RECORD_HEAD as usize && end <= length;
        let known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
        match (opcode, chunk_place(&head[..got], at, length)) {
            (op::CHUNK, Some(place)) => {
                found.places.push(place);
                (at, sure) = (place.end, place.end);
                continue;
            }
            (op::FOOTER, _) if whole && size == FOOTER_BYTES => return Ok(found),
            (op::CHUNK | op::FOOTER, _) => {}
            _ if whole && known => {
                let fields = &head[RECORD_HEAD as usize..got];
                if note(source, &mut found, channels, (opcode, at, size), fields)? {
                    at = end;
                    continue;
                }
            }
            _ => {}
        }
        match search(source, sure, length)? {
            Some(place) => {
                found.gaps += 1;
                found.places.push(place);
                (at, sure) = (place.end, place.end);
            }
            None => {
                found.is_cut = true;
                return Ok(found);
            }
        }
    }
}

/// Takes what is useful from a record outside the chunks; false where it cannot be what it says.
fn note<R: Read + Seek>(
    source: &mut R,
    found: &mut FoundPlaces,
    channels: &mut Channels,
    (opcode, at, size): (u8, u64, u64),
    head: &[u8],
) -> std::io::Result<bool> {
    match opcode {
        op::MESSAGE_INDEX => {
            // Channel, bytes of the list, then 16 bytes a message.
            let bytes = u32_at(head, 2);
            if size < 6 || u64::from(bytes) + 6 != size {
                return Ok(false);
            }
            *found.counts.entry(u32_at(head, 0) as u16).or_default() += u64::from(bytes / 16);
        }
        op::SCHEMA | op::CHANNEL if size <= LARGEST_DEFINITION => {
            let mut bytes = vec![0; size as usize];
            if read_at(source, at + RECORD_HEAD, &mut bytes)? == bytes.len() {
                channels.define(opcode, &bytes);
            }
        }
        op::METADATA if size <= LARGEST_DEFINITION && found.notes.is_none() => {
            let mut bytes = vec![0; size as usize];
            if read_at(source, at + RECORD_HEAD, &mut bytes)? == bytes.len() {
                found.notes = notes::read(&bytes);
            }
        }
        op::MESSAGE if size > LARGEST_CHUNK => found.too_large += 1,
        op::MESSAGE => {
            *found.counts.entry(u32_at(head, 0) as u16).or_default() += 1;
            let end = at + RECORD_HEAD + size;
            match found.places.last_mut() {
                Some(run)
                    if run.kind == PlaceKind::Loose && run.end == at && end - run.start <= LARGEST_RUN =>
                {
                    run.end = end;
                }
                _ => found.places.push(FilePlace { start: at, end, kind: PlaceKind::Loose }),
            }
        }
        _ => {}
    }
    Ok(true)
}

/// The first place from here on that can be a chunk.
fn search<R: Read + Seek>(source: &mut R, from: u64, length: u64) -> std::io::Result<Option<FilePlace>> {
    const BLOCK: usize = 1 << 16;
    const OVERLAP: usize = RECORD_HEAD as usize + CHUNK_HEAD + LONGEST_NAME;
    let mut block = vec![0u8; BLOCK + OVERLAP];
    let mut start = from;
    while start < length {
        let got = read_at(source, start, &mut block)?;
        for i in (0..got.min(BLOCK)).filter(|i| block[*i] == op::CHUNK) {
            let head = &block[i..got.min(i + OVERLAP)];
            if let Some(place) = chunk_place(head, start + i as u64, length) {
                return Ok(Some(place));
            }
        }
        start += BLOCK as u64;
    }
    Ok(None)
}

/// The chunk that begins with these bytes, if its lengths agree with one another and with the file's.
fn chunk_place(head: &[u8], at: u64, length: u64) -> Option<FilePlace> {
    let fields = head.get(RECORD_HEAD as usize..).filter(|f| f.len() >= CHUNK_HEAD)?;
    let size = u64_at(head, 1);
    let name = u32_at(fields, 28) as usize;
    let kind = if name > 0 { PlaceKind::Packed } else { PlaceKind::Plain };
    if name > 0 && ![&b"lz4"[..], b"zstd"].contains(&fields.get(32..32usize.checked_add(name)?)?) {
        return None;
    }
    let held = (fields.len() >= 40 + name).then(|| u64_at(fields, 32 + name))?;
    let end = at.checked_add(RECORD_HEAD)?.checked_add(size)?;
    let agrees = size == (CHUNK_HEAD + name) as u64 + held.min(LARGEST_CHUNK + 1)
        && u64_at(fields, 0) <= u64_at(fields, 8)
        && end <= length;
    (head[0] == op::CHUNK && agrees).then_some(FilePlace { start: at, end, kind })
}

/// Whether records follow one another to the very end.
pub(super) fn records_fit(mut bytes: &[u8]) -> bool {
    while !bytes.is_empty() {
        let size = usize::try_from(u64_at(bytes, 1)).unwrap_or(usize::MAX);
        match bytes.get(RECORD_HEAD as usize..).and_then(|rest| rest.get(size..)) {
            Some(rest) => bytes = rest,
            None => return false,
        }
    }
    true
}

/// Little-endian number; missing bytes count as 0.
pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut n = [0; 8];
    for (slot, byte) in n.iter_mut().zip(bytes.iter().skip(at)) {
        *slot = *byte;
    }
    u64::from_le_bytes(n)
}

pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u64_at(bytes, at) as u32
}

/// Fills the buffer from a place as far as the source reaches; how far.
pub(super) fn read_at<R: Read + Seek>(source: &mut R, at: u64, buffer: &mut [u8]) -> std::io::Result<usize> {
    source.seek(SeekFrom::Start(at))?;
    let mut got = 0;
    while got < buffer.len() {
        match source.read(&mut buffer[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(got)
}
