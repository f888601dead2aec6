//! The table as TOML has it, before it is checked.

use super::{Checksum, FieldQuantity, FrameField, FrameTable, NumberType};
use serde::Deserialize;

#[derive(Deserialize)]
pub(super) struct RigFile {
    pub(super) imu: Option<ImuTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ImuTable {
    pub(super) name: Option<String>,
    pub(super) protocol: Option<String>,
    pub(super) baud: Option<u32>,
    pub(super) rate_hz: Option<f64>,
    pub(super) axes: Option<[String; 3]>,
    pub(super) rotation_q_wxyz: Option<[f64; 4]>,
    pub(super) camera_from_imu_q_wxyz: Option<[f64; 4]>,
    pub(super) frame: Option<FrameText>,
    #[serde(default)]
    pub(super) field: Vec<FieldText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameText {
    #[serde(default)]
    header: Vec<u8>,
    length: usize,
    #[serde(default)]
    checksum: Checksum,
    #[serde(default)]
    sum_from: usize,
    #[serde(default)]
    sum_at: usize,
    counter: Option<PlaceText>,
    clock: Option<ClockText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlaceText {
    offset: usize,
    #[serde(rename = "type")]
    kind: NumberType,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClockText {
    offset: usize,
    #[serde(rename = "type")]
    kind: NumberType,
    tick_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FieldText {
    offset: usize,
    #[serde(rename = "type")]
    kind: NumberType,
    scale: f64,
    to: FieldQuantity,
}

impl FrameText {
    pub(super) fn with(self, fields: Vec<FieldText>) -> FrameTable {
        FrameTable {
            header: self.header,
            length: self.length,
            checksum: self.checksum,
            sum_from: self.sum_from,
            sum_at: self.sum_at,
            counter: self.counter.map(|place| (place.offset, place.kind)),
            clock: self.clock.map(|clock| (clock.offset, clock.kind, clock.tick_s)),
            fields: fields
                .into_iter()
                .map(|f| FrameField { offset: f.offset, kind: f.kind, scale: f.scale, to: f.to })
                .collect(),
        }
    }
}
