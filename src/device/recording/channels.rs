//! Which of a file's channels plays which part: by its topic's name, or by its schema's where only one topic has it.

use super::places::u32_at;
use super::schema::{self, Topic};
use mcap::records::{Record, op};
use std::collections::BTreeMap;
use std::sync::Arc;

/// How messages are written, by the channel's message encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Text.
    Json,
    /// Protocol Buffers.
    Protobuf,
    /// ROS 2.
    Cdr,
    /// Not read here.
    Other,
}

impl Encoding {
    fn of(name: &str) -> Self {
        match name {
            "json" => Self::Json,
            "protobuf" => Self::Protobuf,
            "cdr" => Self::Cdr,
            _ => Self::Other,
        }
    }
}

/// What a schema's name says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SchemaKind {
    /// `foxglove.CompressedImage`
    CompressedImage,
    /// `foxglove.RawImage`
    RawImage,
    /// `foxglove.CameraCalibration`
    Calibration,
    /// `foxglove.PoseInFrame`
    PoseInFrame,
    /// `sensor_msgs/msg/CompressedImage`
    RosCompressedImage,
    /// `sensor_msgs/msg/Image`
    RosImage,
    /// `sensor_msgs/msg/CameraInfo`
    RosCameraInfo,
    /// `sensor_msgs/msg/Imu`
    RosImu,
    /// One of half-light's own.
    Own,
    /// Not known here.
    Unknown,
}

impl SchemaKind {
    fn of(schema: &str) -> Self {
        match schema {
            schema::COMPRESSED_IMAGE => Self::CompressedImage,
            schema::RAW_IMAGE => Self::RawImage,
            "foxglove.CameraCalibration" => Self::Calibration,
            "foxglove.PoseInFrame" => Self::PoseInFrame,
            "sensor_msgs/msg/CompressedImage" => Self::RosCompressedImage,
            "sensor_msgs/msg/Image" => Self::RosImage,
            "sensor_msgs/msg/CameraInfo" => Self::RosCameraInfo,
            "sensor_msgs/msg/Imu" => Self::RosImu,
            own if own.starts_with("halflight.") => Self::Own,
            _ => Self::Unknown,
        }
    }
}

/// The part that a schema plays where its topic's name does not say it.
fn part_of(schema: &str) -> Option<Topic> {
    match (SchemaKind::of(schema), schema) {
        (
            SchemaKind::CompressedImage
            | SchemaKind::RawImage
            | SchemaKind::RosCompressedImage
            | SchemaKind::RosImage,
            _,
        ) => Some(Topic::Image),
        (SchemaKind::Calibration | SchemaKind::RosCameraInfo, _) => Some(Topic::Calibration),
        (SchemaKind::RosImu, _) | (_, "halflight.Imu") => Some(Topic::Imu),
        (_, "halflight.Exposure") => Some(Topic::Exposure),
        (_, "halflight.Rig") => Some(Topic::Rig),
        _ => None,
    }
}

/// Names of topics that were asked for; those not given are found by their usual names and their schemas.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TopicNames(pub BTreeMap<Topic, String>);

/// One message of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Which part it plays.
    pub topic: Topic,
    /// The topic as the file names it.
    pub name: Arc<str>,
    /// Name of its schema.
    pub schema: Arc<str>,
    /// How it is written.
    pub encoding: Encoding,
    /// Name of that, as the channel has it.
    pub encoding_name: Arc<str>,
    /// Which message of its part it is, from 1 on.
    pub number: u64,
    /// Time in the file, nanoseconds, on a line that never steps back by more than a second (`clock`).
    pub log_time: i64,
    /// What was added to the file's own time, nanoseconds.
    pub shift_ns: i64,
    /// As written, not decoded.
    pub content: Vec<u8>,
}

impl Message {
    /// What its schema says.
    pub fn kind(&self) -> SchemaKind {
        SchemaKind::of(&self.schema)
    }

    /// Why nothing here reads a message of this schema and encoding.
    pub fn unreadable(&self) -> String {
        let known = match self.topic {
            Topic::Image => {
                "foxglove.CompressedImage or foxglove.RawImage in protobuf or json, sensor_msgs/msg/CompressedImage or sensor_msgs/msg/Image in cdr"
            }
            Topic::Calibration => {
                "foxglove.CameraCalibration in json or protobuf, or sensor_msgs/msg/CameraInfo in cdr"
            }
            Topic::Imu => "halflight.Imu in json, or sensor_msgs/msg/Imu in cdr",
            Topic::TruthPose => "foxglove.PoseInFrame in json or protobuf",
            _ => "a schema of half-light's own in json",
        };
        format!("schema \"{}\" in message encoding \"{}\": must be {known}", self.schema, self.encoding_name)
    }

    /// Topic, number and time, for messages to people.
    pub fn place(&self) -> String {
        let t = self.log_time.saturating_sub(self.shift_ns) as f64 * 1e-9;
        format!("{}, message {} (log time {t:.6} s)", self.name, self.number)
    }
}

/// A channel of the file.
#[derive(Clone, Debug)]
pub(super) struct FileChannel {
    pub(super) name: Arc<str>,
    pub(super) schema: Arc<str>,
    pub(super) encoding_name: Arc<str>,
    pub(super) part: Option<Topic>,
}

impl FileChannel {
    pub(super) fn encoding(&self) -> Encoding {
        Encoding::of(&self.encoding_name)
    }
}

/// All channels that have been defined so far.
#[derive(Debug, Default)]
pub(super) struct Channels {
    schemas: BTreeMap<u16, Arc<str>>,
    all: BTreeMap<u16, FileChannel>,
    wanted: TopicNames,
    /// Names of the topics that play a part.
    taken: BTreeMap<Topic, Arc<str>>,
    is_settled: bool,
}

impl Channels {
    pub(super) fn new(wanted: TopicNames) -> Self {
        Self { wanted, ..Self::default() }
    }

    pub(super) fn get(&self, id: u16) -> Option<&FileChannel> {
        self.all.get(&id)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Channels that play a part.
    pub(super) fn of(&self, topic: Topic) -> impl Iterator<Item = u16> {
        self.all.iter().filter(move |(_, c)| c.part == Some(topic)).map(|(id, _)| *id)
    }

    /// Takes a schema's name or a channel from a record.
    pub(super) fn define(&mut self, opcode: u8, body: &[u8]) {
        if opcode != op::SCHEMA && opcode != op::CHANNEL || !lengths_fit(opcode, body) {
            return;
        }
        match mcap::parse_record(opcode, body) {
            Ok(Record::Schema { header, .. }) => {
                self.schemas.insert(header.id, header.name.into());
            }
            Ok(Record::Channel(found)) => {
                let schema = self.schemas.get(&found.schema_id).cloned().unwrap_or_else(|| "".into());
                // A definition seen before its schema must not replace one that knows it.
                if self.all.get(&found.id).is_some_and(|known| {
                    schema.is_empty() || (*known.name == *found.topic && known.schema == schema)
                }) {
                    return;
                }
                let mut channel = FileChannel {
                    name: found.topic.into(),
                    schema,
                    encoding_name: found.message_encoding.into(),
                    part: None,
                };
                if self.is_settled {
                    channel.part = self.part_of_late(&channel);
                }
                self.all.insert(found.id, channel);
            }
            _ => {}
        }
    }

    /// The part of a channel by its topic's name: the one that was asked for, or the usual one.
    fn by_name(&self, name: &str) -> Option<Topic> {
        let asked = |topic: &Topic| self.wanted.0.get(topic);
        Topic::ALL.into_iter().filter(|topic| topic.is_read()).find(|topic| match asked(topic) {
            Some(wanted) => wanted == name,
            None => topic.name() == name,
        })
    }

    /// The part of a channel that is defined after the others were settled.
    fn part_of_late(&mut self, channel: &FileChannel) -> Option<Topic> {
        let part = self.by_name(&channel.name).or_else(|| {
            let part = part_of(&channel.schema)?;
            let is_free = !self.wanted.0.contains_key(&part) && !self.taken.contains_key(&part);
            (is_free || self.taken.get(&part) == Some(&channel.name)).then_some(part)
        })?;
        self.taken.entry(part).or_insert_with(|| Arc::clone(&channel.name));
        Some(part)
    }

    /// Decides which channels play which part, once those of the file's summary or of its first chunks are known.
    ///
    /// # Errors
    /// Several topics could be the pictures, and none is named.
    pub(super) fn settle(&mut self) -> Result<(), String> {
        self.is_settled = true;
        let named: Vec<(u16, Topic)> =
            self.all.iter().filter_map(|(id, c)| Some((*id, self.by_name(&c.name)?))).collect();
        for (id, part) in named {
            self.give(id, part);
        }
        // Pictures first: a calibration is that of their camera.
        for part in [Topic::Image, Topic::Calibration, Topic::Exposure, Topic::Imu, Topic::Rig] {
            if self.taken.contains_key(&part) || self.wanted.0.contains_key(&part) {
                continue;
            }
            let Some(name) = self.choose(part)? else { continue };
            let ids: Vec<u16> = self
                .all
                .iter()
                .filter(|(_, c)| c.name == name && part_of(&c.schema) == Some(part))
                .map(|(id, _)| *id)
                .collect();
            ids.into_iter().for_each(|id| self.give(id, part));
        }
        Ok(())
    }

    fn give(&mut self, id: u16, part: Topic) {
        if let Some(channel) = self.all.get_mut(&id) {
            channel.part = Some(part);
            self.taken.entry(part).or_insert_with(|| Arc::clone(&channel.name));
        }
    }

    /// The one topic whose schema plays a part.
    fn choose(&self, part: Topic) -> Result<Option<Arc<str>>, String> {
        let mut names: Vec<Arc<str>> = self
            .all
            .values()
            .filter(|c| c.part.is_none() && part_of(&c.schema) == Some(part))
            // Depth and video streams that image_transport writes in the same type.
            .filter(|c| !c.name.ends_with("/compressedDepth") && !c.name.ends_with("/theora"))
            .map(|c| Arc::clone(&c.name))
            .collect();
        names.sort();
        names.dedup();
        if part == Topic::Image {
            // The same pictures, once more compressed.
            let all = names.clone();
            let base = |name: &str| name.strip_suffix("/compressed").map(str::to_owned);
            names.retain(|name| base(name).is_none_or(|base| !all.iter().any(|other| **other == *base)));
            if names.len() > 1 {
                let names: Vec<&str> = names.iter().map(|name| &**name).collect();
                return Err(format!(
                    "several topics hold pictures: {}: one must be named, like replay:FILE,image_topic={}",
                    names.join(", "),
                    names[0]
                ));
            }
            return Ok(names.pop());
        }
        // That of the pictures' camera: the most leading steps of its name in common.
        let image = self.taken.get(&Topic::Image);
        let steps = |name: &str| {
            let Some(image) = image else { return 0 };
            image.split('/').zip(name.split('/')).take_while(|(a, b)| a == b).count()
        };
        let most = names.iter().map(|name| steps(name)).max();
        Ok(names.into_iter().find(|name| Some(steps(name)) == most))
    }
}

/// Whether the texts of a schema or a channel lie within its record: the library makes room for their lengths before it looks.
fn lengths_fit(opcode: u8, body: &[u8]) -> bool {
    // Behind a text at a place.
    let behind = |at: usize, end: usize| {
        let length = body.get(at..at.checked_add(4)?).map(|length| u32_at(length, 0) as usize)?;
        at.checked_add(4)?.checked_add(length).filter(|behind| *behind <= end)
    };
    let end = body.len();
    let ids = if opcode == op::SCHEMA { 2 } else { 4 };
    // Name and encoding, then a schema's bytes or a channel's list of pairs.
    let Some(last) = behind(ids, end).and_then(|at| behind(at, end)) else { return false };
    let Some(end) = behind(last, end) else { return false };
    let mut at = last + 4;
    while opcode == op::CHANNEL && at < end {
        match behind(at, end) {
            Some(next) => at = next,
            None => return false,
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(list: &[(&str, &str)], wanted: TopicNames) -> Result<Vec<(String, Topic)>, String> {
        let mut channels = Channels::new(wanted);
        for (id, (name, schema)) in list.iter().enumerate() {
            let channel = FileChannel {
                name: (*name).into(),
                schema: (*schema).into(),
                encoding_name: "cdr".into(),
                part: None,
            };
            channels.all.insert(id as u16, channel);
        }
        channels.settle()?;
        Ok(channels.all.values().filter_map(|c| Some((c.name.to_string(), c.part?))).collect())
    }

    const TWO_CAMERAS: [(&str, &str); 6] = [
        ("/left/camera_info", "sensor_msgs/msg/CameraInfo"),
        ("/left/image_raw", "sensor_msgs/msg/Image"),
        ("/left/image_raw/compressed", "sensor_msgs/msg/CompressedImage"),
        ("/right/camera_info", "sensor_msgs/msg/CameraInfo"),
        ("/right/image_raw", "sensor_msgs/msg/Image"),
        ("/imu/data", "sensor_msgs/msg/Imu"),
    ];

    #[test]
    fn one_camera_is_found_by_its_schemas() {
        let found = settled(&[TWO_CAMERAS[3], TWO_CAMERAS[4], TWO_CAMERAS[5]], TopicNames::default());
        let want = [
            ("/right/camera_info", Topic::Calibration),
            ("/right/image_raw", Topic::Image),
            ("/imu/data", Topic::Imu),
        ];
        assert_eq!(found.unwrap(), want.map(|(name, topic)| (name.to_owned(), topic)).to_vec());
        // The same pictures twice: those without loss.
        let found = settled(&TWO_CAMERAS[..3], TopicNames::default()).unwrap();
        assert!(found.contains(&("/left/image_raw".into(), Topic::Image)) && found.len() == 2, "{found:?}");
    }

    #[test]
    fn of_two_cameras_one_must_be_named_and_brings_its_calibration() {
        let error = settled(&TWO_CAMERAS, TopicNames::default()).unwrap_err();
        assert!(error.contains("/left/image_raw, /right/image_raw"), "{error}");
        for side in ["left", "right"] {
            let wanted = TopicNames([(Topic::Image, format!("/{side}/image_raw"))].into());
            let found = settled(&TWO_CAMERAS, wanted).unwrap();
            assert!(found.contains(&(format!("/{side}/camera_info"), Topic::Calibration)), "{found:?}");
            assert!(found.contains(&(format!("/{side}/image_raw"), Topic::Image)), "{found:?}");
            assert_eq!(found.len(), 3);
        }
    }

    #[test]
    fn usual_names_win_over_schemas() {
        let list = [
            ("/camera/image", "foxglove.CompressedImage"),
            ("/debug/image", "foxglove.CompressedImage"),
            ("/camera/calibration", "foxglove.CameraCalibration"),
        ];
        let found = settled(&list, TopicNames::default()).unwrap();
        assert_eq!(found.len(), 2);
        assert!(found.contains(&("/camera/image".into(), Topic::Image)));
    }
}
