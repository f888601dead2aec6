//! Exposure time and sensitivity that a camera writes into its JPEG files (Exif 2.3). Pure; any bytes give a value or none.

use crate::model::frame::Exposure;

/// Tags of the sub-folder, of the exposure time and of the sensitivity.
const SUB_FOLDER: u16 = 0x8769;
const EXPOSURE_TIME: u16 = 0x829a;
const SENSITIVITY: u16 = 0x8827;
/// Sensitivity that counts as a gain of 1.
const ISO_OF_GAIN_1: f64 = 100.0;

/// What a JPEG's Exif segment says; `None` without an exposure time. Without a sensitivity the gain is 1.
pub(super) fn exposure(jpeg: &[u8]) -> Option<Exposure> {
    let tiff = Tiff::find(jpeg)?;
    let main = tiff.u32(4)?;
    let sub = tiff.entry(main, SUB_FOLDER).and_then(|at| tiff.u32(at + 8));
    let entry = |tag: u16| sub.and_then(|folder| tiff.entry(folder, tag)).or_else(|| tiff.entry(main, tag));
    let rational = tiff.u32(entry(EXPOSURE_TIME)? + 8)? as usize;
    let time_s = f64::from(tiff.u32(rational)?) / f64::from(tiff.u32(rational + 4)?);
    let iso = entry(SENSITIVITY).and_then(|at| tiff.u16(at + 8)).filter(|iso| *iso > 0);
    let gain = iso.map_or(1.0, |iso| f64::from(iso) / ISO_OF_GAIN_1);
    (time_s > 0.0 && time_s.is_finite()).then_some(Exposure { time_s, gain })
}

struct Tiff<'a> {
    bytes: &'a [u8],
    is_little: bool,
}

impl<'a> Tiff<'a> {
    /// The segment, which stands before the picture.
    fn find(jpeg: &'a [u8]) -> Option<Self> {
        let mut at = 2;
        loop {
            let (marker, length) = (jpeg.get(at..at + 2)?, jpeg.get(at + 2..at + 4)?);
            if marker[0] != 0xff || marker[1] == 0xda {
                return None;
            }
            let end = at + 2 + usize::from(u16::from_be_bytes([length[0], length[1]])).max(2);
            let content = jpeg.get(at + 4..end)?;
            if let (0xe1, Some(bytes)) = (marker[1], content.strip_prefix(b"Exif\0\0")) {
                let is_little = bytes.starts_with(b"II");
                return (is_little || bytes.starts_with(b"MM")).then_some(Self { bytes, is_little });
            }
            at = end;
        }
    }

    fn u16(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk::<2>()?;
        Some(if self.is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk::<4>()?;
        Some(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// Where a tag's entry of 12 bytes stands in a folder.
    fn entry(&self, folder: u32, tag: u16) -> Option<usize> {
        let folder = folder as usize;
        let count = usize::from(self.u16(folder)?);
        (0..count).map(|k| folder + 2 + 12 * k).find(|at| self.u16(*at) == Some(tag))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A segment that says 1/`per_second` s at `iso`.
    pub(in super::super) fn segment(per_second: u32, iso: u16) -> Vec<u8> {
        let mut tiff = b"MM\0\x2a\0\0\0\x08".to_vec();
        let entry = |tag: u16, kind: u16, value: [u8; 4]| {
            [&tag.to_be_bytes()[..], &kind.to_be_bytes(), &[0, 0, 0, 1], &value].concat()
        };
        tiff.extend([0, 1]);
        tiff.extend(entry(SUB_FOLDER, 4, 26u32.to_be_bytes()));
        tiff.extend([0; 4]);
        tiff.extend([0, 2]);
        tiff.extend(entry(EXPOSURE_TIME, 5, 56u32.to_be_bytes()));
        tiff.extend(entry(SENSITIVITY, 3, [iso.to_be_bytes()[0], iso.to_be_bytes()[1], 0, 0]));
        tiff.extend([0; 4]);
        tiff.extend(1u32.to_be_bytes());
        tiff.extend(per_second.to_be_bytes());
        let length = (tiff.len() + 8) as u16;
        [&[0xff, 0xe1][..], &length.to_be_bytes(), b"Exif\0\0", &tiff].concat()
    }

    #[test]
    fn time_and_gain_are_found_and_any_damage_is_survived() {
        let jpeg = [&[0xff, 0xd8][..], &segment(60, 400), &[0xff, 0xd9]].concat();
        assert_eq!(exposure(&jpeg), Some(Exposure { time_s: 1.0 / 60.0, gain: 4.0 }));
        assert_eq!(exposure(&[0xff, 0xd8, 0xff, 0xd9]), None);
        for at in 0..jpeg.len() {
            let _ = exposure(&jpeg[..at]);
            for value in [0, 1, 0x7f, 0xff] {
                let mut changed = jpeg.clone();
                changed[at] = value;
                let _ = exposure(&changed);
            }
        }
        let never = [&[0xff, 0xd8][..], &segment(0, 400), &[0xff, 0xd9]].concat();
        assert_eq!(exposure(&never), None);
    }
}
