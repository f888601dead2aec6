//! What the first messages of a file say.

use crate::math::lens::Lens;
use crate::model::frame::Exposure;
use crate::recording::{RecordingReader, Topic, messages, pictures::stated_exposure};
use crate::{DeviceError, ErrorKind};
use std::io::{Read, Seek};

/// What the first messages of a file say.
#[derive(Default)]
pub(super) struct Prelude {
    pub(super) lens: Option<Lens>,
    pub(super) parts: Option<messages::RigParts>,
    /// Each once.
    pub(super) exposures: Vec<Exposure>,
}

/// Pictures whose exposures are looked at before the first frame.
const PICTURES_FOR_EXPOSURES: u32 = 9;

impl Prelude {
    /// Reads until the calibration and some pictures have come.
    pub(super) fn read<R: Read + Seek>(
        device: &str,
        reader: &mut RecordingReader<R>,
        stated: Option<Exposure>,
    ) -> Result<Self, DeviceError> {
        let mut prelude = Self::default();
        let mut images = 0;
        // All of a chunk's setup stands before its first picture; a few more frames tell the exposures.
        while let Some(message) = reader.next_message()? {
            let refuse = |why: String| {
                DeviceError::new(device, format!("{}: {why}", message.place()), ErrorKind::Refused)
            };
            match message.topic {
                Topic::Calibration => {
                    prelude.lens = Some(messages::read_calibration(&message).map_err(refuse)?);
                }
                Topic::Rig => prelude.parts = Some(messages::read_rig(&message).map_err(refuse)?),
                // One that is of no use is counted when its picture comes.
                Topic::Exposure => {
                    prelude
                        .exposures
                        .extend(messages::read_exposure(&message).ok().map(|note| note.exposure));
                }
                Topic::Image => {
                    images += 1;
                    if !reader.has(Topic::Exposure) {
                        prelude.exposures.extend(stated.or_else(|| stated_exposure(&message)));
                    }
                }
                _ => {}
            }
            if images >= PICTURES_FOR_EXPOSURES && prelude.lens.is_some() {
                break;
            }
        }
        let mut distinct: Vec<Exposure> = Vec::new();
        for exposure in std::mem::take(&mut prelude.exposures) {
            if !distinct.contains(&exposure) {
                distinct.push(exposure);
            }
        }
        prelude.exposures = distinct;
        Ok(prelude)
    }
}
