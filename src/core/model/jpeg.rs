//! Tells whether a JPEG is all there (ITU-T T.81): decoders fill what is missing with grey.

mod scan;
mod tables;

use scan::ScanComponent;
use std::borrow::Cow;
use tables::{HuffmanTable, ListedCodes};

/// What a component's frame header says.
#[derive(Clone, Copy, Debug)]
struct Component {
    id: u8,
    /// Sampling factors, across and down.
    sampling: [usize; 2],
    /// A scan has held it.
    is_there: bool,
}

/// What is known of a picture from its frame header.
#[derive(Clone, Debug)]
struct FrameHeader {
    /// Baseline or extended sequential, with Huffman coding.
    is_sequential: bool,
    width: usize,
    height: usize,
    components: Vec<Component>,
}

impl FrameHeader {
    /// Of a start-of-frame segment; `None` where it is too short, or says what no picture can be.
    fn read(marker: u8, segment: &[u8]) -> Option<Self> {
        let number =
            |at: usize| Some(usize::from(u16::from_be_bytes([*segment.get(at)?, *segment.get(at + 1)?])));
        let count = usize::from(*segment.get(5)?);
        let rows = segment.get(6..6 + 3 * count)?.chunks_exact(3);
        let components: Vec<Component> = rows
            .map(|row| Component {
                id: row[0],
                sampling: [usize::from(row[1] >> 4), usize::from(row[1] & 15)],
                is_there: false,
            })
            .collect();
        if !components.iter().all(|c| c.sampling.iter().all(|factor| (1..=4).contains(factor))) {
            return None;
        }
        let (height, width) = (number(1)?, number(3)?);
        Some(Self { is_sequential: marker <= 0xc1, width, height, components })
    }

    /// Blocks of each component in a coded unit, and coded units, of a scan of these components.
    fn units(&self, scanned: &[usize]) -> (Vec<usize>, usize) {
        let largest = |k: usize| self.components.iter().map(|c| c.sampling[k]).max().unwrap_or(1);
        let side = |length: usize, k: usize| match scanned {
            // A component alone has its own grid of blocks.
            [only] => (length * self.components[*only].sampling[k]).div_ceil(largest(k)).div_ceil(8),
            _ => length.div_ceil(8 * largest(k)),
        };
        let blocks = match scanned {
            [_] => vec![1],
            _ => scanned.iter().map(|k| self.components[*k].sampling.iter().product()).collect(),
        };
        (blocks, side(self.width, 0) * side(self.height, 1))
    }
}

/// A JPEG of which nothing is missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WholeJpeg<'a> {
    /// The file from its first marker to its end-of-image marker: drivers fill buffers up with bytes after it.
    pub bytes: &'a [u8],
    /// It brings the Huffman tables that it uses. Cameras that stream may leave them out.
    pub has_huffman_tables: bool,
}

impl<'a> WholeJpeg<'a> {
    /// The file with the standard Huffman tables (T.81, K.3.3) before its own where some that it uses are missing: what USB
    /// cameras leave out.
    pub fn with_tables(&self) -> Cow<'a, [u8]> {
        if self.has_huffman_tables {
            return Cow::Borrowed(self.bytes);
        }
        let content = tables::standard();
        let length = (content.len() as u16 + 2).to_be_bytes();
        let (start, rest) = self.bytes.split_at(2);
        Cow::Owned([start, &[0xff, 0xc4], &length, &content, rest].concat())
    }
}

/// What the markers before a scan said.
struct MarkerFacts {
    frame: Option<FrameHeader>,
    interval: usize,
    /// Class (0 DC, 1 AC) and number of a table.
    huffman: [[Option<Box<HuffmanTable>>; 4]; 2],
    misses_tables: bool,
}

impl MarkerFacts {
    /// Takes the tables of a segment's content.
    fn define(&mut self, mut content: &[u8]) {
        while let Some((name, listed, rest)) = ListedCodes::read(content) {
            if let Some(slot) =
                self.huffman.get_mut(usize::from(name >> 4)).and_then(|c| c.get_mut(usize::from(name & 15)))
            {
                *slot = Some(Box::new(HuffmanTable::new(listed)));
            }
            content = rest;
        }
    }

    /// Puts the standard tables where the file has none.
    fn add_standard(&mut self) {
        let own = std::mem::take(&mut self.huffman);
        self.define(&tables::standard());
        for (known, own) in self.huffman.iter_mut().flatten().zip(own.into_iter().flatten()) {
            if own.is_some() {
                *known = own;
            }
        }
        self.misses_tables = true;
    }

    /// Reads a scan whose header has this content and whose data begins at a place.
    fn scan(&mut self, header: &[u8], bytes: &[u8], at: usize) -> Result<(), String> {
        let frame = self.frame.as_mut().ok_or("it has no size before its scan")?;
        let unsound = || "damaged: its scan's header".to_owned();
        let count = usize::from(*header.first().ok_or_else(unsound)?);
        let rows = header.get(1..1 + 2 * count).ok_or_else(unsound)?;
        let mut scanned = Vec::new();
        for row in rows.chunks_exact(2) {
            let k = frame.components.iter().position(|c| c.id == row[0]).ok_or_else(unsound)?;
            frame.components[k].is_there = true;
            scanned.push((k, usize::from(row[1] >> 4), usize::from(row[1] & 15)));
        }
        if !frame.is_sequential {
            return Ok(());
        }
        let places: Vec<usize> = scanned.iter().map(|(k, ..)| *k).collect();
        let (blocks, units) = frame.units(&places);
        let has = |class: usize, number: usize| self.huffman[class].get(number).is_some_and(Option::is_some);
        if scanned.iter().any(|(_, dc, ac)| !has(0, *dc) || !has(1, *ac)) {
            self.add_standard();
        }
        let table = |class: usize, number: usize| {
            let table = self.huffman[class].get(number).and_then(Option::as_deref);
            table.ok_or_else(|| format!("it has no Huffman table {number}"))
        };
        let components = scanned.iter().zip(blocks).map(|((_, dc, ac), blocks)| {
            Ok(ScanComponent { blocks, dc: table(0, *dc)?, ac: table(1, *ac)? })
        });
        let components = components.collect::<Result<Vec<_>, String>>()?;
        scan::hold_units(bytes, at, &components, units, self.interval)
    }
}

/// Reads a JPEG but for its pixels: it must end with its end-of-image marker, hold a scan of each component, and the scans of a
/// sequential picture must hold as many coded units as its size asks for. What follows the marker does not matter. Units of
/// progressive pictures are not counted: one that lost data in its middle and kept its end passes.
///
/// # Errors
/// What is missing.
pub fn whole(bytes: &[u8]) -> Result<WholeJpeg<'_>, String> {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return Err("it does not begin as a JPEG file".into());
    }
    let cut = || format!("cut: it ends after {} bytes without an end-of-image marker", bytes.len());
    let mut said =
        MarkerFacts { frame: None, interval: 0, huffman: Default::default(), misses_tables: false };
    let mut at = 2;
    loop {
        let marker;
        (marker, at) = next_marker(bytes, at).ok_or_else(cut)?;
        match marker {
            0xd9 => return said.ended(&bytes[..at]),
            // Without a segment.
            0x01 | 0xd0..=0xd8 => continue,
            _ => {}
        }
        let length = bytes.get(at..at + 2).ok_or_else(cut)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]])).max(2);
        let segment = bytes.get(at + 2..at + length).ok_or_else(cut)?;
        at += length;
        match marker {
            0xc4 => said.define(segment),
            0xc0..=0xcf if ![0xc8, 0xcc].contains(&marker) => said.frame = FrameHeader::read(marker, segment),
            0xdd => said.interval = segment.first_chunk::<2>().map_or(0, |n| u16::from_be_bytes(*n).into()),
            0xda => {
                let end = end_of_scan(bytes, at);
                if end == bytes.len() {
                    return Err(cut());
                }
                said.scan(segment, bytes, at)?;
                at = end;
            }
            _ => {}
        }
    }
}

impl MarkerFacts {
    /// Judges a file that has come to its end.
    fn ended(self, bytes: &[u8]) -> Result<WholeJpeg<'_>, String> {
        let frame = self.frame.ok_or("it ends before its picture")?;
        let there = frame.components.iter().filter(|c| c.is_there).count();
        if there < frame.components.len() {
            return Err(format!("cut: it holds {there} of its {} components", frame.components.len()));
        }
        Ok(WholeJpeg { bytes, has_huffman_tables: !self.misses_tables })
    }
}

/// The next marker from a place on, and the place behind it.
fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let rest = bytes.get(from..)?;
    let at = rest.windows(2).position(|pair| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff))?;
    Some((rest[at + 1], from + at + 2))
}

/// Where a scan's coded data ends: the next marker that is no restart marker, or the end of the bytes.
fn end_of_scan(bytes: &[u8], from: usize) -> usize {
    let mut at = from;
    while let Some((marker, next)) = next_marker(bytes, at) {
        if !(0xd0..=0xd7).contains(&marker) {
            return next - 2;
        }
        at = next;
    }
    bytes.len()
}

#[cfg(test)]
mod tests;
