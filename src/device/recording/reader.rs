//! Reads a recording, whole or damaged: messages in the order of the file. A chunk counts only when its checksum is right or was
//! not computed. Nothing in a file can make it panic; it holds one chunk of at most `LARGEST_CHUNK` bytes and one message.

use super::channels::{Channels, Message, TopicNames};
use super::clock::TimeLine;
use super::places::{FilePlace, read_at, walk};
use super::records::{Records, Stop};
use super::schema::Topic;
use crate::{DeviceError, ErrorKind};
use mcap::{
    MAGIC, parse_record,
    records::{Record, op},
};
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

/// What was wrong with a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The file ends before its summary.
    pub cut: bool,
    /// Chunks whose checksum or structure is wrong, or that are too large; skipped.
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

    /// What is wrong with the file itself, in words; `None` where it is whole (its messages may still be of no use).
    pub fn of_file(&self) -> Option<String> {
        let several = |n: u64, one: &str| match n {
            0 => None,
            1 => Some(format!("1 {one}")),
            n => Some(format!("{n} {one}s")),
        };
        let parts = [
            self.cut.then(|| "it ends before its summary".to_owned()),
            several(self.chunks, "chunk with a wrong checksum, structure or size"),
            several(self.gaps, "gap between chunks"),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

/// Chunks in which channels are looked for where the file has no summary.
const FIRST_PLACES: usize = 4;

/// Reads messages in the order of the file.
pub struct RecordingReader<R> {
    device: String,
    source: R,
    places: Vec<FilePlace>,
    next_place: usize,
    open: Option<Records>,
    channels: Channels,
    /// Messages a channel, as the indexes say.
    counts: BTreeMap<u16, u64>,
    damage: Damage,
    line: TimeLine,
    numbers: BTreeMap<Topic, u64>,
    notes: BTreeMap<String, String>,
}

impl<R: Read + Seek> RecordingReader<R> {
    /// Finds the chunks. `Refused` unless the source begins as an MCAP file.
    pub fn open(device: impl Into<String>, source: R) -> Result<Self, DeviceError> {
        Self::open_topics(device, source, TopicNames::default())
    }

    /// The same with topics that are asked for. `Refused` also where several topics could be the pictures.
    pub fn open_topics(
        device: impl Into<String>,
        mut source: R,
        wanted: TopicNames,
    ) -> Result<Self, DeviceError> {
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
        let mut channels = Channels::new(wanted);
        let found = walk(&mut source, length, &mut channels).map_err(|e| failed("read the file", e))?;
        let damage =
            Damage { cut: found.is_cut, gaps: found.gaps, chunks: found.too_large, ..Damage::default() };
        let mut reader = Self {
            device,
            source,
            places: found.places,
            next_place: 0,
            open: None,
            channels,
            counts: found.counts,
            damage,
            line: TimeLine::default(),
            numbers: BTreeMap::new(),
            notes: found.notes.unwrap_or_default(),
        };
        reader.find_channels()?;
        let refuse = |why| DeviceError::new(&reader.device, format!("open: {why}"), ErrorKind::Refused);
        reader.channels.settle().map_err(refuse)?;
        Ok(reader)
    }

    /// Reads the definitions of the first chunks where the file has no summary.
    fn find_channels(&mut self) -> Result<(), DeviceError> {
        if !self.channels.is_empty() {
            return Ok(());
        }
        for place in self.places.iter().copied().take(FIRST_PLACES) {
            let Ok(mut records) = Records::open(&mut self.source, place) else { continue };
            let channels = &mut self.channels;
            loop {
                match records.next(&mut self.source, |opcode, data| channels.define(opcode, data)) {
                    Ok(()) => {}
                    Err(Stop::Read(e)) => return Err(self.broken(e)),
                    Err(Stop::End | Stop::Damaged) => break,
                }
            }
        }
        Ok(())
    }

    /// What the file says of its making (`notes`); empty where it says nothing.
    pub fn notes(&self) -> &BTreeMap<String, String> {
        &self.notes
    }

    /// What was wrong so far.
    pub fn damage(&self) -> Damage {
        self.damage
    }

    /// Counts a message that its reader could not use.
    pub fn count_bad_message(&mut self) {
        self.damage.messages += 1;
    }

    /// How often the recording's clock stepped back by more than a second so far.
    pub fn clock_steps(&self) -> u64 {
        self.line.steps()
    }

    /// Whether a topic has been defined in what was read so far.
    pub fn has(&self, topic: Topic) -> bool {
        self.channels.of(topic).next().is_some()
    }

    /// How many messages of a topic the file holds, as far as its indexes say.
    pub fn count(&self, topic: Topic) -> u64 {
        self.channels.of(topic).filter_map(|id| self.counts.get(&id)).sum()
    }

    /// Back to the first message. Damage that is found again is not counted again.
    pub fn rewind(&mut self) {
        self.next_place = 0;
        self.open = None;
        self.damage.chunks = 0;
        self.damage.messages = 0;
        self.line = TimeLine::default();
        self.numbers.clear();
    }

    /// The next message of a known topic; `None` at the end. Damaged chunks are skipped and counted.
    pub fn next_message(&mut self) -> Result<Option<Message>, DeviceError> {
        loop {
            let Some(records) = &mut self.open else {
                let Some(place) = self.places.get(self.next_place).copied() else { return Ok(None) };
                self.next_place += 1;
                match Records::open(&mut self.source, place) {
                    Ok(records) => self.open = Some(records),
                    Err(Stop::Read(e)) => return Err(self.broken(e)),
                    Err(Stop::Damaged | Stop::End) => self.damage.chunks += 1,
                }
                continue;
            };
            let (channels, line, numbers) = (&mut self.channels, &mut self.line, &mut self.numbers);
            let taken = records.next(&mut self.source, |opcode, data| {
                if opcode != op::MESSAGE {
                    channels.define(opcode, data);
                    return Taken::Nothing;
                }
                take_message(data, channels, line, numbers)
            });
            match taken {
                Ok(Taken::Message(message)) => return Ok(Some(message)),
                Ok(Taken::Nothing) => {}
                Ok(Taken::Unknown) => self.damage.messages += 1,
                Err(Stop::End) => self.open = None,
                Err(Stop::Damaged) => {
                    self.damage.chunks += 1;
                    self.open = None;
                }
                Err(Stop::Read(e)) => return Err(self.broken(e)),
            }
        }
    }

    fn broken(&self, e: std::io::Error) -> DeviceError {
        DeviceError::new(&self.device, "read the file", ErrorKind::Reopen).because(e)
    }
}

/// What became of a record.
enum Taken {
    Message(Message),
    /// A definition, or a message of a topic that plays no part.
    Nothing,
    /// A message that belongs to no channel, or is too short for its own head.
    Unknown,
}

fn take_message(
    record: &[u8],
    channels: &Channels,
    line: &mut TimeLine,
    numbers: &mut BTreeMap<Topic, u64>,
) -> Taken {
    let Ok(Record::Message { header, data }) = parse_record(op::MESSAGE, record) else {
        return Taken::Unknown;
    };
    let Some(channel) = channels.get(header.channel_id) else { return Taken::Unknown };
    let Some(topic) = channel.part else { return Taken::Nothing };
    let raw = i64::try_from(header.log_time).unwrap_or(i64::MAX);
    let shift_ns = line.shift(header.channel_id, raw);
    let number = numbers.entry(topic).or_default();
    *number += 1;
    Taken::Message(Message {
        topic,
        name: Arc::clone(&channel.name),
        schema: Arc::clone(&channel.schema),
        encoding: channel.encoding(),
        encoding_name: Arc::clone(&channel.encoding_name),
        number: *number,
        log_time: raw.saturating_add(shift_ns),
        shift_ns,
        content: data.into_owned(),
    })
}
