//! Finding frames in bytes that may hold garbage: a reader looks at the oldest byte, and where no frame begins there, at the
//! next. A wrong frame gives up one byte only, since a true one may begin within it.

use crate::imu::sample::WireSample;

/// The longest frame of any protocol, bytes.
pub const LONGEST_FRAME: usize = 255;
/// Bytes that wait at most.
const CAPACITY: usize = 1024;

/// What a reader sees at the beginning of some bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WireLook {
    /// A frame may begin here; more bytes are needed.
    More,
    /// No frame begins here.
    Nothing,
    /// A frame whose checksum is wrong.
    WrongSum,
    /// A sound frame of so many bytes without a sample of its own.
    Part(usize),
    /// A sound frame of so many bytes, and its sample.
    Sample(usize, WireSample),
}

/// The bytes that no frame has been made of yet.
#[derive(Clone, Debug)]
pub struct ByteWindow {
    bytes: [u8; CAPACITY],
    begin: usize,
    end: usize,
}

impl Default for ByteWindow {
    fn default() -> Self {
        Self { bytes: [0; CAPACITY], begin: 0, end: 0 }
    }
}

impl ByteWindow {
    /// Takes as many bytes as there is room for; returns the rest.
    pub fn fill<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        // What waits is shorter than a frame, so there is always room after this.
        self.bytes.copy_within(self.begin..self.end, 0);
        (self.begin, self.end) = (0, self.end - self.begin);
        let (now, later) = bytes.split_at(bytes.len().min(CAPACITY - self.end));
        self.bytes[self.end..self.end + now.len()].copy_from_slice(now);
        self.end += now.len();
        later
    }

    /// The oldest first.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[self.begin..self.end]
    }

    /// Gives up so many of the oldest.
    pub fn skip(&mut self, count: usize) {
        self.begin = (self.begin + count).min(self.end);
    }
}

/// Sum of all bytes, eight bits.
pub fn sum8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Signed 16 bits, low byte first; 0 beyond the end.
pub fn i16_at(bytes: &[u8], at: usize) -> f64 {
    let byte = |k: usize| bytes.get(k).copied().unwrap_or(0);
    f64::from(i16::from_le_bytes([byte(at), byte(at + 1)]))
}
