//! Protocols over a line of bytes. Pure: bytes and their time of arrival in, samples out; nothing is allocated for a sample.

pub mod described;
pub mod resync;
pub mod rvc;
pub mod witmotion;
pub mod ypr;

#[cfg(test)]
pub(crate) mod tests;

use super::description::FrameTable;
use super::gates::{GateVerdict, Gates};
use super::sample::{WireCounts, WireSample};
use crate::model::time::Timestamp;
use resync::{ByteWindow, WireLook};

/// A protocol over a line of bytes.
#[derive(Clone, Debug)]
pub enum Protocol {
    /// BNO08x in UART-RVC mode.
    Rvc,
    /// WitMotion's frames that begin with 0x55.
    WitMotion,
    /// Text lines `#YPR=`.
    Ypr,
    /// What a table describes.
    Described(FrameTable),
}

/// Names of the protocols, in the order of [`Protocol`].
pub const PROTOCOLS: [&str; 4] = ["rvc", "witmotion", "ypr", "described"];

impl Protocol {
    /// As names and settings call it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Rvc => PROTOCOLS[0],
            Self::WitMotion => PROTOCOLS[1],
            Self::Ypr => PROTOCOLS[2],
            Self::Described(_) => PROTOCOLS[3],
        }
    }

    /// Symbols a second that the makers set, and samples a second.
    pub fn usual_baud_and_rate(&self) -> (u32, f64) {
        match self {
            Self::Rvc => (115_200, 100.0),
            Self::WitMotion => (9600, 10.0),
            Self::Ypr => (57_600, 50.0),
            Self::Described(_) => (115_200, 100.0),
        }
    }
}

/// The reader of one protocol, with what it remembers between frames.
#[derive(Clone, Debug)]
enum ProtocolReader {
    Rvc,
    WitMotion(witmotion::FrameGroup),
    Ypr,
    Described(FrameTable),
}

impl ProtocolReader {
    fn look(&mut self, bytes: &[u8], arrival: Timestamp) -> WireLook {
        match self {
            Self::Rvc => rvc::look(bytes, arrival),
            Self::WitMotion(group) => group.look(bytes, arrival),
            Self::Ypr => ypr::look(bytes, arrival),
            Self::Described(table) => described::look(table, bytes, arrival),
        }
    }
}

/// Turns the bytes of one wire into samples.
#[derive(Clone, Debug)]
pub struct Wire {
    reader: ProtocolReader,
    window: ByteWindow,
    gates: Gates,
    counts: WireCounts,
}

impl Wire {
    /// Takes the protocol and the sensor's samples a second.
    pub fn new(protocol: &Protocol, rate_hz: f64) -> Self {
        let reader = match protocol {
            Protocol::Rvc => ProtocolReader::Rvc,
            Protocol::WitMotion => ProtocolReader::WitMotion(witmotion::FrameGroup::default()),
            Protocol::Ypr => ProtocolReader::Ypr,
            Protocol::Described(table) => ProtocolReader::Described(table.clone()),
        };
        Self {
            reader,
            window: ByteWindow::default(),
            gates: Gates::new(1.0 / rate_hz),
            counts: WireCounts::default(),
        }
    }

    /// Takes bytes that were read at one time; gives each whole sample to `out`.
    pub fn feed(&mut self, bytes: &[u8], arrival: Timestamp, mut out: impl FnMut(WireSample)) {
        self.counts.bytes += bytes.len() as u64;
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.window.fill(rest);
            self.read_frames(arrival, &mut out);
        }
    }

    fn read_frames(&mut self, arrival: Timestamp, out: &mut impl FnMut(WireSample)) {
        while !self.window.bytes().is_empty() {
            let step = match self.reader.look(self.window.bytes(), arrival) {
                WireLook::More => return,
                WireLook::Nothing => 1,
                WireLook::WrongSum => {
                    self.counts.wrong_sums += 1;
                    1
                }
                WireLook::Part(length) => {
                    self.window.skip(length);
                    continue;
                }
                WireLook::Sample(length, sample) => match self.gates.judge(&sample) {
                    GateVerdict::Follows => {
                        self.counts.samples += 1;
                        out(sample);
                        self.window.skip(length);
                        continue;
                    }
                    // A frame that is none may have eaten the beginning of a true one.
                    GateVerdict::HeldBack | GateVerdict::Impossible => {
                        self.counts.caught += 1;
                        1
                    }
                },
            };
            self.counts.skipped_bytes += step as u64;
            self.window.skip(step);
        }
    }

    /// What came so far, and what became of it.
    pub fn counts(&self) -> WireCounts {
        self.counts
    }
}
