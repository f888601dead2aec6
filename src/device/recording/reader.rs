//! Reads a recording, whole or damaged. Chunks are found by walking the file's records; where the walk meets
//! something impossible, it looks for the next place that can be a chunk. A chunk counts only when its
//! checksum is right. Nothing in a file can make it panic or take more memory than `LARGEST_CHUNK` a chunk.

use super::schema::Topic;
use crate::{DeviceError, ErrorKind};
use mcap::{
    MAGIC, parse_record,
    records::{Record, op},
    sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions},
};
use std::collections::{BTreeMap, VecDeque};
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

/// Bytes of a chunk, packed or unpacked.
const LARGEST_CHUNK: u64 = 1 << 28;
/// Bytes of a schema or channel record outside the chunks.
const LARGEST_DEFINITION: u64 = 1 << 20;
/// Opcode and length.
const RECORD_HEAD: u64 = 9;
/// A chunk record's fields before its data, with an empty name of the compression.
const CHUNK_HEAD: usize = 8 + 8 + 8 + 4 + 4 + 8;
/// Longest name of a compression, "zstd".
const LONGEST_NAME: usize = 4;

/// What was wrong with a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The file ends before its summary.
    pub cut: bool,
    /// Chunks whose checksum or structure is wrong; skipped.
    pub chunks: u64,
    /// Places where records did not follow one another and the next chunk was searched.
    pub gaps: u64,
    /// Messages that could not be understood or belong to nothing; skipped.
    pub messages: u64,
}

impl Damage {
    /// How many things were wrong.
    pub fn warnings(&self) -> u64 {
        u64::from(self.cut) + self.chunks + self.gaps + self.messages
    }
}

/// One message of a known topic.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Which stream it belongs to.
    pub topic: Topic,
    /// Name of its schema.
    pub schema: Arc<str>,
    /// Time in the file, nanoseconds.
    pub log_time: u64,
    /// As written, not decoded.
    pub content: Vec<u8>,
}

#[derive(Clone, Copy, Debug)]
struct ChunkPlace {
    start: u64,
    end: u64,
    packed: bool,
}

/// Topic and schema name of a channel.
type Channels = BTreeMap<u16, (Option<Topic>, Arc<str>)>;

/// Reads messages in the order of the file.
pub struct RecordingReader<R> {
    device: String,
    source: R,
    chunks: Vec<ChunkPlace>,
    next_chunk: usize,
    queue: VecDeque<Message>,
    schemas: BTreeMap<u16, Arc<str>>,
    channels: Channels,
    /// Messages a channel, as the indexes say.
    counts: BTreeMap<u16, u64>,
    damage: Damage,
}

impl<R: Read + Seek> RecordingReader<R> {
    /// Finds the chunks. `Refused` unless the source begins as an MCAP file.
    pub fn open(device: impl Into<String>, mut source: R) -> Result<Self, DeviceError> {
        let device = device.into();
        let failed = |action: &str, e: std::io::Error| {
            DeviceError::new(&device, action, ErrorKind::Refused).because(e)
        };
        let length = source.seek(SeekFrom::End(0)).map_err(|e| failed("measure the file", e))?;
        let mut magic = [0u8; MAGIC.len()];
        let head = read_at(&mut source, 0, &mut magic).map_err(|e| failed("read the file's head", e))?;
        if head < MAGIC.len() || magic != *MAGIC {
            let action = format!("open: the file ({length} bytes) does not begin as an MCAP recording");
            return Err(DeviceError::new(&device, action, ErrorKind::Refused));
        }
        let mut reader = Self {
            device,
            source,
            chunks: Vec::new(),
            next_chunk: 0,
            queue: VecDeque::new(),
            schemas: BTreeMap::new(),
            channels: Channels::new(),
            counts: BTreeMap::new(),
            damage: Damage::default(),
        };
        reader.walk(length).map_err(|e| reader.broken(e))?;
        Ok(reader)
    }

    /// What was wrong so far.
    pub fn damage(&self) -> Damage {
        self.damage
    }

    /// Counts a message that its reader could not use.
    pub fn count_bad_message(&mut self) {
        self.damage.messages += 1;
    }

    /// Whether a topic has been defined in what was read so far.
    pub fn has(&self, topic: Topic) -> bool {
        self.channels.values().any(|(t, _)| *t == Some(topic))
    }

    /// How many messages of a topic the file holds, as far as its indexes say.
    pub fn count(&self, topic: Topic) -> u64 {
        let of_topic = |id: &u16| self.channels.get(id).is_some_and(|(t, _)| *t == Some(topic));
        self.counts.iter().filter(|(id, _)| of_topic(id)).map(|(_, n)| n).sum()
    }

    /// Back to the first message. Damage that is found again is not counted again.
    pub fn rewind(&mut self) {
        self.next_chunk = 0;
        self.queue.clear();
        self.damage.chunks = 0;
        self.damage.messages = 0;
    }

    /// The next message of a known topic; `None` at the end. Damaged chunks are skipped and counted.
    pub fn next_message(&mut self) -> Result<Option<Message>, DeviceError> {
        loop {
            if let Some(message) = self.queue.pop_front() {
                return Ok(Some(message));
            }
            let Some(place) = self.chunks.get(self.next_chunk).copied() else { return Ok(None) };
            self.next_chunk += 1;
            let mut bytes = vec![0; (place.end - place.start) as usize];
            let got = read_at(&mut self.source, place.start, &mut bytes).map_err(|e| self.broken(e))?;
            if got < bytes.len() || self.unpack(&bytes, place.packed).is_none() {
                self.damage.chunks += 1;
                self.queue.clear();
            }
        }
    }

    fn broken(&self, e: std::io::Error) -> DeviceError {
        DeviceError::new(&self.device, "read the file", ErrorKind::Reopen).because(e)
    }

    /// Walks over all records of the file and notes chunks, definitions and counts.
    fn walk(&mut self, length: u64) -> std::io::Result<()> {
        let mut at = MAGIC.len() as u64;
        // No chunk lies before this place that is not known.
        let mut sure = at;
        loop {
            let mut head = [0u8; RECORD_HEAD as usize + CHUNK_HEAD + LONGEST_NAME];
            let got = read_at(&mut self.source, at, &mut head)?;
            let (opcode, size) = (head[0], u64_at(&head, 1));
            let end = at.saturating_add(RECORD_HEAD).saturating_add(size);
            let whole = got >= RECORD_HEAD as usize && end <= length;
            let known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
            let place = chunk_place(&head[..got], at, length);
            match (opcode, place) {
                (op::CHUNK, Some(place)) => {
                    self.chunks.push(place);
                    (at, sure) = (place.end, place.end);
                    continue;
                }
                (op::FOOTER, _) if whole => return Ok(()),
                (op::CHUNK, None) => {}
                _ if whole && known => {
                    self.note(opcode, at, size, &head[RECORD_HEAD as usize..got])?;
                    at = end;
                    continue;
                }
                _ => {}
            }
            match self.search(sure, length)? {
                Some(place) => {
                    self.damage.gaps += 1;
                    self.chunks.push(place);
                    (at, sure) = (place.end, place.end);
                }
                None => {
                    self.damage.cut = true;
                    return Ok(());
                }
            }
        }
    }

    /// The first place from here on that can be a chunk.
    fn search(&mut self, from: u64, length: u64) -> std::io::Result<Option<ChunkPlace>> {
        const BLOCK: usize = 1 << 16;
        const OVERLAP: usize = RECORD_HEAD as usize + CHUNK_HEAD + LONGEST_NAME;
        let mut block = vec![0u8; BLOCK + OVERLAP];
        let mut start = from;
        while start < length {
            let got = read_at(&mut self.source, start, &mut block)?;
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

    /// Takes what is useful from a record outside the chunks.
    fn note(&mut self, opcode: u8, at: u64, size: u64, head: &[u8]) -> std::io::Result<()> {
        match opcode {
            op::MESSAGE_INDEX if size >= 6 && head.len() >= 6 => {
                // Channel, bytes of the list, then 16 bytes a message.
                let bytes = u32::from_le_bytes([head[2], head[3], head[4], head[5]]);
                if u64::from(bytes) + 6 == size {
                    *self.counts.entry(u16::from_le_bytes([head[0], head[1]])).or_default() +=
                        u64::from(bytes / 16);
                }
            }
            op::SCHEMA | op::CHANNEL if size <= LARGEST_DEFINITION => {
                let mut bytes = vec![0; size as usize];
                if read_at(&mut self.source, at + RECORD_HEAD, &mut bytes)? == bytes.len() {
                    define(opcode, &bytes, &mut self.schemas, &mut self.channels);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Queues the messages of one chunk; `None` where anything in it is wrong.
    fn unpack(&mut self, record: &[u8], packed: bool) -> Option<()> {
        let head = record.get(RECORD_HEAD as usize..)?;
        if u64_at(head, 16) > LARGEST_CHUNK || u32_at(head, 24) == 0 {
            return None;
        }
        if !packed && !records_fit(record.get(RECORD_HEAD as usize + CHUNK_HEAD..)?) {
            return None;
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LARGEST_CHUNK as usize);
        let mut reader = LinearReader::new_with_options(options);
        let mut rest = record;
        while let Some(event) = reader.next_event() {
            match event.ok()? {
                LinearReadEvent::ReadRequest(need) => {
                    let length = need.min(rest.len());
                    let (now, later) = rest.split_at(length);
                    reader.insert(length).copy_from_slice(now);
                    reader.notify_read(length);
                    rest = later;
                }
                LinearReadEvent::Record { opcode: op::MESSAGE, data } => {
                    let Ok(Record::Message { header, data }) = parse_record(op::MESSAGE, data) else {
                        return None;
                    };
                    match self.channels.get(&header.channel_id) {
                        None => self.damage.messages += 1,
                        Some((None, _)) => {}
                        Some((Some(topic), schema)) => self.queue.push_back(Message {
                            topic: *topic,
                            schema: Arc::clone(schema),
                            log_time: header.log_time,
                            content: data.into_owned(),
                        }),
                    }
                }
                LinearReadEvent::Record { opcode, data } => {
                    define(opcode, data, &mut self.schemas, &mut self.channels);
                }
            }
        }
        Some(())
    }
}

/// Takes a schema's name or a channel's topic.
fn define(opcode: u8, body: &[u8], schemas: &mut BTreeMap<u16, Arc<str>>, channels: &mut Channels) {
    if opcode != op::SCHEMA && opcode != op::CHANNEL {
        return;
    }
    match parse_record(opcode, body) {
        Ok(Record::Schema { header, .. }) => {
            schemas.insert(header.id, header.name.into());
        }
        Ok(Record::Channel(channel)) => {
            let schema = schemas.get(&channel.schema_id).cloned().unwrap_or_else(|| "".into());
            // A definition seen before its schema must not replace one that knows it.
            if !schema.is_empty() || !channels.contains_key(&channel.id) {
                channels.insert(channel.id, (Topic::of(&channel.topic), schema));
            }
        }
        _ => {}
    }
}

/// The chunk that begins with these bytes, if its lengths agree with one another and with the file's.
fn chunk_place(head: &[u8], at: u64, length: u64) -> Option<ChunkPlace> {
    let fields = head.get(RECORD_HEAD as usize..).filter(|f| f.len() >= CHUNK_HEAD)?;
    let size = u64_at(head, 1);
    let name = u32_at(fields, 28) as usize;
    let packed = name > 0;
    if packed && ![&b"lz4"[..], b"zstd"].contains(&fields.get(32..32usize.checked_add(name)?)?) {
        return None;
    }
    let held = (fields.len() >= 40 + name).then(|| u64_at(fields, 32 + name))?;
    let end = at.checked_add(RECORD_HEAD)?.checked_add(size)?;
    let agrees = size == (CHUNK_HEAD + name) as u64 + held.min(LARGEST_CHUNK + 1)
        && u64_at(fields, 0) <= u64_at(fields, 8)
        && end <= length;
    (head[0] == op::CHUNK && agrees).then_some(ChunkPlace { start: at, end, packed })
}

/// Whether records follow one another to the very end.
fn records_fit(mut bytes: &[u8]) -> bool {
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
fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut n = [0; 8];
    for (slot, byte) in n.iter_mut().zip(bytes.iter().skip(at)) {
        *slot = *byte;
    }
    u64::from_le_bytes(n)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u64_at(bytes, at) as u32
}

/// Fills the buffer from a place as far as the source reaches; how far.
fn read_at<R: Read + Seek>(source: &mut R, at: u64, buffer: &mut [u8]) -> std::io::Result<usize> {
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
