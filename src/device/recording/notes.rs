//! What a recording says of its own making: one MCAP metadata record at its start, of names and texts. Pure.

use super::pictures::PictureCoding;
use super::places::u32_at;
use super::rig::rig_in_short;
use crate::model::rig::Rig;
use std::collections::BTreeMap;

/// Name of the record.
pub const NAME: &str = "halflight.recording";

/// Who made a recording, and of what. What is empty is left out of the file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingOrigin {
    /// With its verb, like `halflight synth`.
    pub program: String,
    /// Of the program.
    pub version: String,
    /// The recorded device by its name, like `synthetic:frames=90`.
    pub device: String,
    /// As `key=value`, divided by commas.
    pub settings: String,
    /// What is before the camera, by name.
    pub scene: String,
}

impl RecordingOrigin {
    /// The texts of the record. The library stands in for a program that does not say its name.
    pub fn texts(&self, rig: Option<&Rig>, coding: PictureCoding) -> BTreeMap<String, String> {
        let (program, version) = match self.program.as_str() {
            "" => ("halflight", env!("CARGO_PKG_VERSION")),
            program => (program, self.version.as_str()),
        };
        let pictures = match coding {
            PictureCoding::Jpeg(quality) => format!("jpeg {quality}"),
            PictureCoding::Png => "png".to_owned(),
            PictureCoding::Raw => "raw".to_owned(),
        };
        let rig = rig.map(rig_in_short).unwrap_or_default();
        let all = [
            ("program", program),
            ("version", version),
            ("device", &self.device),
            ("settings", &self.settings),
            ("scene", &self.scene),
            ("pictures", &pictures),
            ("rig", &rig),
        ];
        let stated = all.into_iter().filter(|(_, text)| !text.is_empty());
        stated.map(|(name, text)| (name.to_owned(), text.to_owned())).collect()
    }
}

/// The texts of a metadata record of ours; `None` for those of others and for bytes that are none.
pub(super) fn read(body: &[u8]) -> Option<BTreeMap<String, String>> {
    let mut rest = body;
    if take_text(&mut rest)? != NAME {
        return None;
    }
    let length = take_length(&mut rest)?;
    let mut pairs = rest.get(..length)?;
    let mut texts = BTreeMap::new();
    while !pairs.is_empty() {
        let name = take_text(&mut pairs)?;
        texts.insert(name.to_owned(), take_text(&mut pairs)?.to_owned());
    }
    Some(texts)
}

fn take_length(rest: &mut &[u8]) -> Option<usize> {
    let (length, tail) = rest.split_at_checked(4)?;
    *rest = tail;
    usize::try_from(u32_at(length, 0)).ok()
}

fn take_text<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let length = take_length(rest)?;
    let (text, tail) = rest.split_at_checked(length)?;
    *rest = tail;
    std::str::from_utf8(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(name: &str, texts: &BTreeMap<String, String>) -> Vec<u8> {
        let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
        let pairs: Vec<u8> = texts.iter().flat_map(|(k, v)| [text(k), text(v)].concat()).collect();
        [text(name), (pairs.len() as u32).to_le_bytes().to_vec(), pairs].concat()
    }

    proptest! {
        #[test]
        fn texts_come_back(texts in prop::collection::btree_map(".{0,9}", ".{0,20}", 0..6)) {
            prop_assert_eq!(read(&written("other", &texts)), None);
            let whole = written(NAME, &texts);
            // Cut anywhere it is none.
            for cut in 0..whole.len() {
                prop_assert_eq!(read(&whole[..cut]), None);
            }
            prop_assert_eq!(read(&whole), Some(texts));
        }

        #[test]
        fn any_bytes_are_read_or_none(bytes in prop::collection::vec(any::<u8>(), 0..60), is_named: bool) {
            let head = if is_named { written(NAME, &BTreeMap::new())[..4 + NAME.len()].to_vec() } else { vec![] };
            let texts = read(&[head, bytes.clone()].concat());
            prop_assert!(texts.is_none_or(|texts| texts.len() * 8 <= bytes.len()));
        }
    }

    #[test]
    fn what_is_empty_is_left_out() {
        let origin = RecordingOrigin { scene: "a table".into(), ..RecordingOrigin::default() };
        let texts = origin.texts(None, PictureCoding::Jpeg(93));
        let names: Vec<&str> = texts.keys().map(String::as_str).collect();
        assert_eq!(names, ["pictures", "program", "scene", "version"]);
        assert_eq!(texts["pictures"], "jpeg 93");
    }
}
