//! Tells whether a JPEG is all there, by its markers (ITU-T T.81, Annex B): decoders fill what is missing with grey.

/// What is known of a picture from its frame header.
#[derive(Clone, Copy, Debug, Default)]
struct FrameHeader {
    /// Baseline or extended sequential, with Huffman coding.
    is_sequential: bool,
    width: usize,
    height: usize,
    components: usize,
    /// Largest sampling factors, across and down.
    sampling: [usize; 2],
}

impl FrameHeader {
    /// Of a start-of-frame segment; `None` where it is too short.
    fn read(marker: u8, segment: &[u8]) -> Option<Self> {
        let number =
            |at: usize| Some(usize::from(u16::from_be_bytes([*segment.get(at)?, *segment.get(at + 1)?])));
        let components = usize::from(*segment.get(5)?);
        let mut sampling = [1, 1];
        for k in 0..components {
            let factors = usize::from(*segment.get(6 + 3 * k + 1)?);
            sampling = [sampling[0].max(factors >> 4), sampling[1].max(factors & 15)];
        }
        let (height, width) = (number(1)?, number(3)?);
        Some(Self { is_sequential: marker <= 0xc1, width, height, components, sampling })
    }

    /// Minimum coded units of a scan that holds all components together.
    fn units(&self) -> usize {
        let [across, down] = self.sampling.map(|factor| 8 * factor.max(1));
        self.width.div_ceil(across) * self.height.div_ceil(down)
    }
}

/// A JPEG of which nothing is missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WholeJpeg<'a> {
    /// The file from its first marker to its end-of-image marker: drivers fill buffers up with bytes after it.
    pub bytes: &'a [u8],
    /// It brings Huffman tables. Cameras that stream may leave them out.
    pub has_huffman_tables: bool,
}

/// Reads the markers of a JPEG: it must end with its end-of-image marker, and its scans must hold as many restart intervals as
/// they should. What follows the marker does not matter. Pictures without restart intervals are not counted through: one that
/// lost data in its middle and kept its end passes.
///
/// # Errors
/// What is missing.
pub fn whole(bytes: &[u8]) -> Result<WholeJpeg<'_>, String> {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return Err("it does not begin as a JPEG file".into());
    }
    let cut = || format!("cut: it ends after {} bytes without an end-of-image marker", bytes.len());
    let (mut frame, mut interval, mut has_huffman_tables) = (None, 0usize, false);
    let mut at = 2;
    loop {
        let marker;
        (marker, at) = next_marker(bytes, at).ok_or_else(cut)?;
        match marker {
            0xd9 if frame.is_none() => return Err("it ends before its picture".into()),
            0xd9 => return Ok(WholeJpeg { bytes: &bytes[..at], has_huffman_tables }),
            // Without a segment.
            0x01 | 0xd0..=0xd8 => continue,
            _ => {}
        }
        let length = bytes.get(at..at + 2).ok_or_else(cut)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]])).max(2);
        let segment = bytes.get(at + 2..at + length).ok_or_else(cut)?;
        at += length;
        match marker {
            0xc4 => has_huffman_tables = true,
            0xc0..=0xcf if ![0xc8, 0xcc].contains(&marker) => frame = FrameHeader::read(marker, segment),
            0xdd => interval = segment.first_chunk::<2>().map_or(0, |n| u16::from_be_bytes(*n).into()),
            0xda => {
                let restarts;
                (restarts, at) = skip_scan(bytes, at);
                let frame = frame.ok_or("it has no size before its scan")?;
                let all_together = segment.first().map(|n| usize::from(*n)) == Some(frame.components);
                if frame.is_sequential && all_together && frame.components > 1 && interval > 0 {
                    let wanted = frame.units().div_ceil(interval).saturating_sub(1);
                    if restarts < wanted {
                        return Err(format!("cut: {restarts} of its {wanted} restart markers"));
                    }
                }
            }
            _ => {}
        }
    }
}

/// The next marker from a place on, and the place behind it.
fn next_marker(bytes: &[u8], from: usize) -> Option<(u8, usize)> {
    let rest = bytes.get(from..)?;
    let at = rest.windows(2).position(|pair| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff))?;
    Some((rest[at + 1], from + at + 2))
}

/// Restart markers in a scan's coded data, and where the data ends.
fn skip_scan(bytes: &[u8], from: usize) -> (usize, usize) {
    let (mut restarts, mut at) = (0, from);
    while let Some((marker, next)) = next_marker(bytes, at) {
        if !(0xd0..=0xd7).contains(&marker) {
            return (restarts, next - 2);
        }
        restarts += 1;
        at = next;
    }
    (restarts, bytes.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(marker: u8, content: &[u8]) -> Vec<u8> {
        let length = (content.len() + 2) as u16;
        [&[0xff, marker], &length.to_be_bytes()[..], content].concat()
    }

    /// 32 x 16 pixels, 4:2:0, a restart interval of one unit of 16 x 16, some coded bytes.
    fn picture(restarts: usize) -> Vec<u8> {
        let mut bytes = vec![0xff, 0xd8];
        bytes.extend(segment(0xe0, b"JFIF\0\xff\xd9"));
        bytes.extend(segment(0xc0, &[8, 0, 16, 0, 32, 3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1]));
        bytes.extend(segment(0xdd, &[0, 1]));
        bytes.extend(segment(0xda, &[3, 1, 0, 2, 0x11, 3, 0x11, 0, 63, 0]));
        for k in 0..=restarts {
            bytes.extend([0x12, 0xff, 0, 0x34]);
            if k < restarts {
                bytes.extend([0xff, 0xd0 + (k % 8) as u8]);
            }
        }
        bytes.extend([0xff, 0xd9]);
        bytes
    }

    #[test]
    fn a_whole_picture_is_whole_whatever_follows() {
        let mut bytes = picture(1);
        let length = bytes.len();
        bytes.extend([0xff, 0xd8, 1, 2, 3]);
        assert_eq!(whole(&bytes), Ok(WholeJpeg { bytes: &bytes[..length], has_huffman_tables: false }));
    }

    #[test]
    fn every_cut_is_noticed() {
        let bytes = picture(1);
        for length in 0..bytes.len() {
            assert!(whole(&bytes[..length]).is_err(), "{length} of {}", bytes.len());
        }
    }

    #[test]
    fn a_lost_interval_is_noticed() {
        assert_eq!(whole(&picture(0)), Err("cut: 0 of its 1 restart markers".into()));
    }

    #[test]
    fn lengths_that_lie_do_not_panic() {
        let bytes = picture(1);
        for at in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xd9, 0xff] {
                let mut changed = bytes.clone();
                changed[at] = value;
                let _ = whole(&changed);
            }
        }
    }
}
