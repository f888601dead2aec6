//! The records of one place of a file, one after the other. A chunk's checksum is seen before its first record; a checksum of 0
//! was not computed. Packed chunks are unpacked from the file as they are read: no second copy is held.

use super::places::{
    CHUNK_HEAD, FilePlace, LARGEST_CHUNK, PlaceKind, RECORD_HEAD, read_at, records_fit, u32_at, u64_at,
};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::{Read, Seek};

/// Records of a place.
pub(super) enum Records {
    /// Of a compressed chunk.
    Packed { reader: Box<LinearReader>, at: u64, end: u64 },
    /// As they stand in memory.
    Plain { bytes: Vec<u8>, at: usize },
}

/// Why there is no next record.
#[derive(Debug)]
pub(super) enum Stop {
    /// There are no more.
    End,
    /// The chunk's checksum or structure is wrong.
    Damaged,
    /// The file cannot be read.
    Read(std::io::Error),
}

impl Records {
    /// Begins with a place.
    pub(super) fn open<R: Read + Seek>(source: &mut R, place: FilePlace) -> Result<Self, Stop> {
        let FilePlace { start, end, kind } = place;
        if kind == PlaceKind::Packed {
            let mut head = [0; RECORD_HEAD as usize + CHUNK_HEAD];
            let got = read_at(source, start, &mut head).map_err(Stop::Read)?;
            if got < head.len() || u64_at(&head[RECORD_HEAD as usize..], 16) > LARGEST_CHUNK {
                return Err(Stop::Damaged);
            }
            let options = LinearReaderOptions::default()
                .with_skip_start_magic(true)
                .with_skip_end_magic(true)
                .with_prevalidate_chunk_crcs(true)
                .with_record_length_limit(LARGEST_CHUNK as usize);
            let reader = Box::new(LinearReader::new_with_options(options));
            return Ok(Self::Packed { reader, at: start, end });
        }
        if end - start > LARGEST_CHUNK + RECORD_HEAD + CHUNK_HEAD as u64 {
            return Err(Stop::Damaged);
        }
        let mut bytes = vec![0; (end - start) as usize];
        if read_at(source, start, &mut bytes).map_err(Stop::Read)? < bytes.len() {
            return Err(Stop::Damaged);
        }
        let at = if kind == PlaceKind::Loose { 0 } else { RECORD_HEAD as usize + CHUNK_HEAD };
        let records = bytes.get(at..).ok_or(Stop::Damaged)?;
        if kind == PlaceKind::Plain {
            let fields = &bytes[RECORD_HEAD as usize..];
            let (stated, sum) = (u64_at(fields, 16), u32_at(fields, 24));
            if stated != records.len() as u64 || (sum != 0 && sum != crc32(records)) {
                return Err(Stop::Damaged);
            }
        }
        if !records_fit(records) {
            return Err(Stop::Damaged);
        }
        Ok(Self::Plain { bytes, at })
    }

    /// Hands the next record's opcode and content to `take`.
    pub(super) fn next<R: Read + Seek, T>(
        &mut self,
        source: &mut R,
        take: impl FnOnce(u8, &[u8]) -> T,
    ) -> Result<T, Stop> {
        match self {
            Self::Plain { bytes, at } => {
                let record = bytes.get(*at..).filter(|rest| !rest.is_empty()).ok_or(Stop::End)?;
                let size = u64_at(record, 1) as usize;
                let content = record.get(RECORD_HEAD as usize..RECORD_HEAD as usize + size);
                *at += RECORD_HEAD as usize + size;
                Ok(take(record[0], content.ok_or(Stop::Damaged)?))
            }
            Self::Packed { reader, at, end } => loop {
                match reader.next_event() {
                    None => return Err(Stop::End),
                    Some(Err(_damage)) => return Err(Stop::Damaged),
                    Some(Ok(LinearReadEvent::Record { opcode, data })) => return Ok(take(opcode, data)),
                    Some(Ok(LinearReadEvent::ReadRequest(need))) => {
                        let length = (*end - *at).min(need as u64) as usize;
                        let got = read_at(source, *at, reader.insert(length)).map_err(Stop::Read)?;
                        reader.notify_read(got);
                        *at += got as u64;
                    }
                }
            },
        }
    }
}

/// The checksum of a chunk's records (CRC-32 of ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0u32; 256];
        let mut i = 0;
        while i < 256 {
            let (mut c, mut bit) = (i as u32, 0);
            while bit < 8 {
                c = if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 };
                bit += 1;
            }
            table[i] = c;
            i += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum, byte| TABLE[(sum as u8 ^ byte) as usize] ^ (sum >> 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        assert_eq!(crc32(b""), 0);
    }
}
