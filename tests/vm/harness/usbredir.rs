//! Packets of the usb-redir protocol, as far as a camera with one bulk endpoint needs them. Numbers are little-endian.

use std::io::{Error, ErrorKind, Read, Result, Write};

/// What a packet is; the numbers are the protocol's.
pub mod kind {
    pub const HELLO: u32 = 0;
    pub const DEVICE_CONNECT: u32 = 1;
    pub const INTERFACE_INFO: u32 = 4;
    pub const ENDPOINT_INFO: u32 = 5;
    pub const SET_CONFIGURATION: u32 = 6;
    pub const GET_CONFIGURATION: u32 = 7;
    pub const CONFIGURATION_STATUS: u32 = 8;
    pub const SET_ALTERNATE: u32 = 9;
    pub const GET_ALTERNATE: u32 = 10;
    pub const ALTERNATE_STATUS: u32 = 11;
    pub const CANCEL: u32 = 21;
    pub const CONTROL: u32 = 100;
    pub const BULK: u32 = 101;
}

/// How a transfer ended.
pub mod status {
    pub const DONE: u8 = 0;
    pub const CANCELLED: u8 = 1;
    pub const STALL: u8 = 4;
}

/// Device version, packet sizes of endpoints, long ids, long bulk transfers: without them no xHCI controller takes a device.
const CAPABILITIES: u32 = 1 << 1 | 1 << 4 | 1 << 5 | 1 << 6;
const LONG_IDS: u32 = 1 << 5;
/// Longer packets are none that a camera is sent.
const LONGEST: usize = 1 << 20;

/// One packet: its own header and its bytes are both in `body`.
pub struct Packet {
    pub kind: u32,
    pub id: u64,
    pub body: Vec<u8>,
}

/// Says hello, and waits for the other side's. From then on ids are long.
pub fn greet<S: Read + Write>(stream: &mut S) -> Result<()> {
    let mut hello = vec![0; 12 + 64];
    hello[4..8].copy_from_slice(&68_u32.to_le_bytes());
    hello[12..12 + 14].copy_from_slice(b"halflight test");
    hello.extend(CAPABILITIES.to_le_bytes());
    stream.write_all(&hello)?;
    let mut answer = [0; 12 + 68];
    stream.read_exact(&mut answer)?;
    let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| answer[at + k]));
    if word(0) != kind::HELLO || word(4) != 68 || word(76) & LONG_IDS == 0 {
        return Err(Error::new(ErrorKind::InvalidData, "no hello that a camera can work with"));
    }
    Ok(())
}

/// Reads the next packet.
pub fn read(stream: &mut impl Read) -> Result<Packet> {
    let mut head = [0; 16];
    stream.read_exact(&mut head)?;
    let word = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| head[at + k]));
    let length = word(4) as usize;
    if length > LONGEST {
        return Err(Error::new(ErrorKind::InvalidData, format!("a packet of {length} bytes")));
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body)?;
    Ok(Packet { kind: word(0), id: u64::from(word(8)) | u64::from(word(12)) << 32, body })
}

/// Writes one packet.
pub fn write(stream: &mut impl Write, kind: u32, id: u64, parts: [&[u8]; 2]) -> Result<()> {
    let length = (parts[0].len() + parts[1].len()) as u32;
    let mut bytes = Vec::with_capacity(16 + length as usize);
    bytes.extend(kind.to_le_bytes());
    bytes.extend(length.to_le_bytes());
    bytes.extend(id.to_le_bytes());
    parts.iter().for_each(|part| bytes.extend(*part));
    stream.write_all(&bytes)
}

/// A request on the control endpoint.
#[derive(Clone, Copy)]
pub struct Control {
    pub request: u8,
    pub request_type: u8,
    pub value: u16,
    pub index: u16,
    pub length: u16,
}

impl Control {
    /// Bytes of the header.
    const BYTES: usize = 10;

    /// The request of a packet, and the bytes that it brings.
    pub fn of(body: &[u8]) -> Option<(Self, &[u8])> {
        let (head, bytes) = body.split_at_checked(Self::BYTES)?;
        let short = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
        let control = Self {
            request: head[1],
            request_type: head[2],
            value: short(4),
            index: short(6),
            length: short(8),
        };
        Some((control, bytes))
    }

    /// Returns whether the device is to send bytes.
    pub fn is_read(self) -> bool {
        self.request_type & 0x80 != 0
    }

    /// The header of the answer.
    pub fn answer(self, status: u8, length: u16) -> [u8; Self::BYTES] {
        let endpoint = if self.is_read() { 0x80 } else { 0 };
        let ([a, b], [c, d], [e, f]) =
            (self.value.to_le_bytes(), self.index.to_le_bytes(), length.to_le_bytes());
        [endpoint, self.request, self.request_type, status, a, b, c, d, e, f]
    }
}

/// Bytes that a bulk packet asks for.
pub fn bulk_length(body: &[u8]) -> Option<usize> {
    let head: &[u8; 10] = body.first_chunk()?;
    Some(
        usize::from(head[2])
            | usize::from(head[3]) << 8
            | usize::from(head[8]) << 16
            | usize::from(head[9]) << 24,
    )
}

/// The header of a bulk packet's answer.
pub fn bulk_answer(endpoint: u8, status: u8, length: usize) -> [u8; 10] {
    let [a, b, c, d] = (length as u32).to_le_bytes();
    [endpoint, status, a, b, 0, 0, 0, 0, c, d]
}
