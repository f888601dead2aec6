//! What the simulated camera says of itself: USB's and UVC's descriptors, and what usb-redir wants to know beside them.

/// The endpoint that pictures come from.
pub const ENDPOINT: u8 = 0x81;
/// Entities of the video control interface.
pub const TERMINAL: u8 = 1;
pub const PROCESSING: u8 = 2;
/// Pictures that the camera makes, by the number of their frame descriptor less one.
pub const SIZES: [(usize, usize); 2] = [(640, 480), (320, 240)];
/// Times between frames, 100 ns.
pub const INTERVALS: [u32; 5] = [333_333, 400_000, 666_666, 1_000_000, 2_000_000];
const CLOCK_HZ: u32 = 48_000_000;
const VENDOR: u16 = 0x1d6b;
const PRODUCT: u16 = 0x0102;
const VERSION: u16 = 0x0100;
/// Class of a device whose functions span several interfaces.
const CLASS: [u8; 3] = [0xef, 2, 1];
const YUY2: [u8; 16] = *b"YUY2\x00\x00\x10\x00\x80\x00\x00\xaa\x00\x38\x9b\x71";
const STRINGS: [&str; 3] = ["half-light", "Simulated camera", "0001"];

fn device() -> Vec<u8> {
    let mut bytes = vec![18, 1, 0, 2, CLASS[0], CLASS[1], CLASS[2], 64];
    for number in [VENDOR, PRODUCT, VERSION] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend([1, 2, 3, 1]);
    bytes
}

fn frame_descriptor(index: u8, (width, height): (usize, usize)) -> Vec<u8> {
    let size = (2 * width * height) as u32;
    let mut bytes = vec![26 + 4 * INTERVALS.len() as u8, 0x24, 5, index, 0];
    bytes.extend((width as u16).to_le_bytes());
    bytes.extend((height as u16).to_le_bytes());
    for number in [size * 8 * 5, size * 8 * 30, size, INTERVALS[0]] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.push(INTERVALS.len() as u8);
    INTERVALS.iter().for_each(|interval| bytes.extend(interval.to_le_bytes()));
    bytes
}

/// The video control interface: a terminal with automatic exposure and exposure time, a unit with brightness and gain.
fn control_interface() -> Vec<u8> {
    let terminal = [18, 0x24, 2, TERMINAL, 1, 2, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0x0a, 0, 0];
    let processing = [11, 0x24, 5, PROCESSING, TERMINAL, 0, 0, 2, 1, 2, 0];
    let output = [9, 0x24, 3, 3, 1, 1, 0, PROCESSING, 0];
    let total = 13 + terminal.len() + processing.len() + output.len();
    let mut bytes = vec![13, 0x24, 1, 0, 1, total as u8, 0];
    bytes.extend(CLOCK_HZ.to_le_bytes());
    bytes.extend([1, 1]);
    [&terminal[..], &processing, &output].iter().for_each(|part| bytes.extend(*part));
    bytes
}

/// The streaming interface. Its endpoint stands in alternate setting 0, and there is no other setting: so the driver takes
/// bulk transfers.
fn streaming_interface() -> Vec<u8> {
    let mut formats = vec![27, 0x24, 4, 1, SIZES.len() as u8];
    formats.extend(YUY2);
    formats.extend([16, 1, 0, 0, 0, 0]);
    for (index, size) in SIZES.into_iter().enumerate() {
        formats.extend(frame_descriptor(index as u8 + 1, size));
    }
    formats.extend([6, 0x24, 13, 1, 1, 4]);
    let total = (14 + formats.len()) as u16;
    let mut bytes = vec![14, 0x24, 1, 1];
    bytes.extend(total.to_le_bytes());
    bytes.extend([ENDPOINT, 0, 3, 0, 0, 0, 1, 0]);
    bytes.extend(formats);
    bytes
}

fn configuration() -> Vec<u8> {
    let mut parts = vec![8, 11, 0, 2, 0x0e, 3, 0, 0];
    parts.extend([9, 4, 0, 0, 0, 0x0e, 1, 0, 0]);
    parts.extend(control_interface());
    parts.extend([9, 4, 1, 0, 1, 0x0e, 2, 0, 0]);
    parts.extend(streaming_interface());
    parts.extend([7, 5, ENDPOINT, 2, 0, 2, 0]);
    let mut bytes = vec![9, 2];
    bytes.extend(((9 + parts.len()) as u16).to_le_bytes());
    bytes.extend([2, 1, 0, 0x80, 250]);
    bytes.extend(parts);
    bytes
}

fn string(index: u8) -> Option<Vec<u8>> {
    // Number 0 lists the languages: English.
    let units: Vec<u16> = match index {
        0 => vec![0x0409],
        _ => STRINGS.get(usize::from(index) - 1)?.encode_utf16().collect(),
    };
    let mut bytes = vec![2 + 2 * units.len() as u8, 3];
    units.iter().for_each(|unit| bytes.extend(unit.to_le_bytes()));
    Some(bytes)
}

/// The descriptor that GET_DESCRIPTOR asks for by type and index.
pub fn by_value(value: u16) -> Option<Vec<u8>> {
    let [index, kind] = value.to_le_bytes();
    match kind {
        1 => Some(device()),
        2 => Some(configuration()),
        3 => string(index),
        // What a high-speed device would be at full speed.
        6 => Some(vec![10, 6, 0, 2, CLASS[0], CLASS[1], CLASS[2], 64, 1, 0]),
        _ => None,
    }
}

/// Which endpoints there are: of each its type, interval, interface; then packet sizes.
pub fn endpoint_info() -> Vec<u8> {
    let mut bytes = vec![255; 32];
    let bulk = usize::from((ENDPOINT & 0x80) >> 3 | ENDPOINT & 15);
    (bytes[0], bytes[16], bytes[bulk]) = (0, 0, 2);
    bytes.extend([0; 32]);
    bytes.extend((0..32).map(|end| u8::from(end == bulk)));
    for end in 0..32 {
        let size: u16 = if end == bulk { 512 } else { 64 };
        bytes.extend(size.to_le_bytes());
    }
    bytes
}

/// Which interfaces there are: of each its number, class, subclass, protocol.
pub fn interface_info() -> Vec<u8> {
    let mut bytes = 2_u32.to_le_bytes().to_vec();
    for two in [[0, 1], [0x0e, 0x0e], [1, 2], [0, 0]] {
        bytes.extend(two);
        bytes.extend([0; 30]);
    }
    bytes
}

/// A high-speed device with these numbers is there.
pub fn connect() -> Vec<u8> {
    let mut bytes = vec![2, CLASS[0], CLASS[1], CLASS[2]];
    for number in [VENDOR, PRODUCT, VERSION] {
        bytes.extend(number.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_what_the_descriptors_say() {
        let bytes = configuration();
        assert_eq!(usize::from(u16::from_le_bytes([bytes[2], bytes[3]])), bytes.len());
        let mut at = 0;
        while at < bytes.len() {
            assert!(bytes[at] >= 2, "a descriptor of no length at {at}");
            at += usize::from(bytes[at]);
        }
        assert_eq!(at, bytes.len());
        assert_eq!(device().len(), 18);
        assert_eq!((endpoint_info().len(), interface_info().len(), connect().len()), (160, 132, 10));
    }
}
