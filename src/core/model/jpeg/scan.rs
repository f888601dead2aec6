//! Counts a sequential scan's coded units by reading its codes, without making pixels of them (ITU-T T.81, F.2.2).

use super::tables::HuffmanTable;

/// Bytes that may stand between the last unit and the next marker: some cameras write a few. More are what was to be read, and was
/// not, because something before them is missing.
const MOST_LEFT_BYTES: usize = 32;

/// One component of a scan.
pub(super) struct ScanComponent<'a> {
    /// Blocks of 8 x 8 in each coded unit.
    pub(super) blocks: usize,
    pub(super) dc: &'a HuffmanTable,
    pub(super) ac: &'a HuffmanTable,
}

/// Bits of coded data up to the next marker.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The next bits, from the upper end.
    held: u64,
    count: u32,
    /// Bits that were asked for beyond the end.
    missing: u32,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 56 {
            let Some(&byte) = self.bytes.get(self.at) else { return };
            if byte == 0xff {
                // A byte of 255 is followed by 0; anything else is a marker, before which bytes of 255 may stand.
                if self.bytes.get(self.at + 1) != Some(&0) {
                    return;
                }
                self.at += 1;
            }
            self.at += 1;
            self.held |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    fn skip(&mut self, bits: u32) {
        self.missing += bits.saturating_sub(self.count);
        self.held <<= bits;
        self.count = self.count.saturating_sub(bits);
    }

    /// The value of the next code; `None` where no code of the table comes.
    fn value(&mut self, table: &HuffmanTable) -> Option<u8> {
        if self.count < 32 {
            self.fill();
        }
        let (length, value) = table.find((self.held >> 48) as u16)?;
        self.skip(length);
        Some(value)
    }
}

/// Reads one block of 64 coefficients; `None` where it holds what no block can.
fn block(bits: &mut Bits<'_>, component: &ScanComponent<'_>) -> Option<()> {
    let size = bits.value(component.dc).filter(|size| *size <= 16)?;
    bits.skip(size.into());
    let mut place = 1;
    while place < 64 {
        let value = bits.value(component.ac)?;
        let (zeros, size) = (u32::from(value >> 4), u32::from(value & 15));
        if size == 0 && zeros != 15 {
            break;
        }
        place += zeros + 1;
        bits.skip(size);
    }
    (place <= 64).then_some(())
}

/// Whether the scan that begins at a place holds as many units as it should, in intervals of `interval` units (0: all in one).
///
/// # Errors
/// How many it holds.
pub(super) fn hold_units(
    bytes: &[u8],
    mut at: usize,
    components: &[ScanComponent<'_>],
    units: usize,
    interval: usize,
) -> Result<(), String> {
    let interval = if interval == 0 { units } else { interval };
    let mut done = 0;
    while done < units {
        let mut bits = Bits { bytes, at, held: 0, count: 0, missing: 0 };
        let end = units.min(done + interval);
        while done < end {
            for component in components {
                for _ in 0..component.blocks {
                    let read = block(&mut bits, component);
                    if bits.missing > 0 {
                        return Err(format!("cut: its scan holds {done} of {units} coded units"));
                    }
                    read.ok_or_else(|| {
                        format!("damaged: coded unit {done} of {units} holds what no code stands for")
                    })?;
                }
            }
            done += 1;
        }
        let marker = super::next_marker(bytes, bits.at);
        let unread = marker.map_or(0, |(_, next)| (next - 2).saturating_sub(bits.at));
        let left = unread + bits.count as usize / 8;
        if left > MOST_LEFT_BYTES {
            return Err(format!("damaged: {left} bytes are left over after {done} of {units} coded units"));
        }
        if done < units {
            at = match marker {
                Some((0xd0..=0xd7, next)) => next,
                _ => return Err(format!("cut: its scan holds {done} of {units} coded units")),
            };
        }
    }
    Ok(())
}
