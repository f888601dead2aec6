//! Report descriptors: which input reports a HID device sends, how long they are, and what their fields are.
//!
//! Source: USB Implementers Forum, "Device Class Definition for HID 1.11", section 6.2.2. Everything is bounded before it is
//! taken; no bytes make this panic.

/// The longest descriptor, bytes (the kernel's own limit).
pub const LONGEST: usize = 4096;
/// The most input reports, and fields of all of them.
const MOST_REPORTS: usize = 64;
const MOST_FIELDS: usize = 1024;
/// The longest report, bits.
const MOST_BITS: u32 = 8 * 4096;
/// How deep global items may be pushed.
const DEEPEST: usize = 8;
/// The usage page of standard sensors.
pub const SENSOR_PAGE: u16 = 0x20;

/// A run of equal numbers in an input report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputField {
    /// Usage page of the first number.
    pub page: u16,
    /// Its usage within the page.
    pub usage: u16,
    /// First bit, after the report's number.
    pub bit: u32,
    /// Bits of each number.
    pub bits: u32,
    /// How many.
    pub count: u32,
    /// Whether they mean nothing.
    pub is_padding: bool,
}

/// What comes under one number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct InputReport {
    /// Its number; 0 where the device does not number its reports.
    pub id: u8,
    /// Bits without the number.
    pub bits: u32,
    /// In their order.
    pub fields: Vec<InputField>,
}

impl InputReport {
    /// Bytes of a read: with the number, where reports are numbered.
    pub fn bytes(&self) -> usize {
        self.bits.div_ceil(8) as usize + usize::from(self.id != 0)
    }
}

/// What a device says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptor {
    /// Usage page and usage of each top-level collection.
    pub collections: Vec<(u16, u16)>,
    /// What it sends.
    pub inputs: Vec<InputReport>,
}

/// Why a descriptor is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("report descriptor, byte {at}: {why}")]
pub struct DescriptorError {
    /// From 0.
    pub at: usize,
    /// What is wrong.
    pub why: &'static str,
}

#[derive(Clone, Copy, Default)]
struct Globals {
    page: u16,
    bits: u32,
    count: u32,
    id: u8,
}

#[derive(Default)]
struct DescriptorReader {
    found: Descriptor,
    globals: Globals,
    pushed: Vec<Globals>,
    usage: Option<(u16, u16)>,
    depth: u32,
    fields: usize,
}

/// Reads a report descriptor.
pub fn read(bytes: &[u8]) -> Result<Descriptor, DescriptorError> {
    let mut reader = DescriptorReader::default();
    let mut at = 0;
    if bytes.len() > LONGEST {
        return Err(DescriptorError { at: LONGEST, why: "longer than 4096 bytes" });
    }
    while at < bytes.len() {
        let wrong = |why| DescriptorError { at, why };
        let head = bytes[at];
        if head == 0xFE {
            // A long item: its length, its tag, its content. None is defined.
            let length = bytes.get(at + 1).copied().ok_or_else(|| wrong("a long item is cut"))?;
            at += 3 + usize::from(length);
            continue;
        }
        let length = [0, 1, 2, 4][usize::from(head & 3)];
        let content = bytes.get(at + 1..at + 1 + length).ok_or_else(|| wrong("an item is cut"))?;
        let value = content.iter().rev().fold(0u32, |value, byte| value << 8 | u32::from(*byte));
        reader.item(head & 0xFC, value, length).map_err(wrong)?;
        at += 1 + length;
    }
    if reader.depth != 0 {
        return Err(DescriptorError { at, why: "a collection is not closed" });
    }
    Ok(reader.found)
}

impl DescriptorReader {
    fn item(&mut self, tag: u8, value: u32, length: usize) -> Result<(), &'static str> {
        match tag {
            // Main items; local ones end with each.
            0x80 => {
                self.input(value)?;
                self.usage = None;
            }
            0x90 | 0xB0 => self.usage = None,
            0xA0 => {
                if self.depth == 0 && self.found.collections.len() < MOST_REPORTS {
                    self.found.collections.push(self.usage.unwrap_or((self.globals.page, 0)));
                }
                self.depth += 1;
                self.usage = None;
            }
            0xC0 => {
                self.depth = self.depth.checked_sub(1).ok_or("a collection ends that never began")?;
                self.usage = None;
            }
            // Global items.
            0x04 => self.globals.page = u16::try_from(value).ok().ok_or("a usage page above 65535")?,
            0x74 => self.globals.bits = value,
            0x94 => self.globals.count = value,
            0x84 => {
                let id = u8::try_from(value).ok().filter(|id| *id != 0);
                self.globals.id = id.ok_or("a report number that is not within 1..=255")?;
            }
            0xA4 if self.pushed.len() < DEEPEST => self.pushed.push(self.globals),
            0xA4 => return Err("more than 8 pushes"),
            0xB4 => self.globals = self.pushed.pop().ok_or("a pop without a push")?,
            // The first usage, or the smallest of a range; four bytes have the page too.
            0x08 | 0x18 if self.usage.is_none() => {
                let page = if length == 4 { (value >> 16) as u16 } else { self.globals.page };
                self.usage = Some((page, value as u16));
            }
            _ => {}
        }
        Ok(())
    }

    fn input(&mut self, flags: u32) -> Result<(), &'static str> {
        let Globals { bits, count, id, page } = self.globals;
        let all =
            bits.checked_mul(count).filter(|all| *all <= MOST_BITS).ok_or("a report above 4096 bytes")?;
        let inputs = &mut self.found.inputs;
        let place = match inputs.iter().position(|report| report.id == id) {
            Some(place) => place,
            None if inputs.len() == MOST_REPORTS => return Err("more than 64 input reports"),
            None => {
                inputs.push(InputReport { id, ..InputReport::default() });
                inputs.len() - 1
            }
        };
        let report = &mut inputs[place];
        self.fields += 1;
        if self.fields > MOST_FIELDS || report.bits + all > MOST_BITS {
            return Err("a report above 4096 bytes, or more than 1024 fields");
        }
        let (page, usage) = self.usage.unwrap_or((page, 0));
        report.fields.push(InputField {
            page,
            usage,
            bit: report.bits,
            bits,
            count,
            is_padding: flags & 1 == 1,
        });
        report.bits += all;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A vendor's page 0xFF00, report 3: a counter of 8 bits, six numbers of 16, padding.
    const VENDOR: [u8; 38] = [
        0x06, 0x00, 0xFF, 0x09, 0x01, 0xA1, 0x01, 0x85, 0x03, 0x75, 0x08, 0x95, 0x01, 0x09, 0x02, 0x81, 0x02,
        0x75, 0x10, 0x95, 0x06, 0x19, 0x10, 0x29, 0x15, 0x81, 0x02, 0x75, 0x08, 0x95, 0x02, 0x81, 0x01, 0x95,
        0x01, 0x91, 0x02, 0xC0,
    ];

    #[test]
    fn reports_and_fields_are_found() {
        let found = read(&VENDOR).unwrap();
        assert_eq!(found.collections, [(0xFF00, 1)]);
        let [report] = &found.inputs[..] else { panic!("{found:?}") };
        assert_eq!((report.id, report.bits, report.bytes()), (3, 120, 16));
        assert_eq!(
            report.fields[1],
            InputField { page: 0xFF00, usage: 0x10, bit: 8, bits: 16, count: 6, is_padding: false }
        );
        assert!(report.fields[2].is_padding);
    }

    #[test]
    fn what_is_none_is_told() {
        let error = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
        assert!(error(&VENDOR[..37]).contains("not closed"));
        assert!(error(&[0x06, 0x00]).contains("byte 0: an item is cut"));
        assert!(error(&[0xC0]).contains("never began"));
        assert!(error(&[0x85, 0x00]).contains("within 1..=255"));
        assert!(error(&[0x77, 0xFF, 0xFF, 0xFF, 0xFF, 0x95, 0xFF, 0x81, 0x02]).contains("above 4096 bytes"));
        assert!(error(&[0xB4]).contains("without a push") && error(&[0xA4; 9]).contains("8 pushes"));
        assert!(error(&[0; LONGEST + 1]).contains("longer than"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let _ = read(&bytes);
        }

        #[test]
        fn damaged_ones_too(at in 0usize..38, byte in any::<u8>()) {
            let mut bytes = VENDOR;
            bytes[at] = byte;
            let _ = read(&bytes);
        }
    }
}
