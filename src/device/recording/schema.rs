//! What lies on each topic of a recording.
//!
//! | topic | schema | encoding |
//! |---|---|---|
//! | `/camera/image` | `foxglove.CompressedImage` or `foxglove.RawImage` | protobuf (no third more bytes for base64) |
//! | `/camera/calibration` | `foxglove.CameraCalibration` | JSON |
//! | `/camera/exposure` | `halflight.Exposure`: what the sensor applied to the image of the same time | JSON |
//! | `/imu` | `halflight.Imu` | JSON |
//! | `/rig` | `halflight.Rig`: tags, ball, response | JSON |
//! | `/truth/pose` | `foxglove.PoseInFrame`: the camera in the world | JSON |
//! | `/truth/light` | `halflight.Truth` | JSON |
//! | `/truth/imu` | `halflight.ImuTruth` | JSON |
//!
//! Foxglove has no schema for inertial samples. Ours keeps the field names of ROS's `sensor_msgs/Imu`
//! (`angular_velocity`, `linear_acceleration`), but as JSON with a schema of its own: every viewer plots it,
//! and the file does not pretend to come from ROS, whose message needs covariances that nobody knows here.
//!
//! Pixels: the calibration's K follows OpenCV and ROS, where the centre of the first pixel is 0; a `Lens` has it
//! at 0.5. So cx and cy differ by 0.5.

use super::wire::{FieldType, MessageType, WireWriter, describe_file};

/// One topic of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Pictures.
    Image,
    /// The lens.
    Calibration,
    /// Exposure of each picture.
    Exposure,
    /// Inertial samples.
    Imu,
    /// Tags, ball, response.
    Rig,
    /// The camera's true pose.
    TruthPose,
    /// The true light.
    TruthLight,
    /// The true faults of the IMU.
    TruthImu,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Image,
        Self::Calibration,
        Self::Exposure,
        Self::Imu,
        Self::Rig,
        Self::TruthPose,
        Self::TruthLight,
        Self::TruthImu,
    ];

    /// The name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image => "/camera/image",
            Self::Calibration => "/camera/calibration",
            Self::Exposure => "/camera/exposure",
            Self::Imu => "/imu",
            Self::Rig => "/rig",
            Self::TruthPose => "/truth/pose",
            Self::TruthLight => "/truth/light",
            Self::TruthImu => "/truth/imu",
        }
    }

    /// By its name in a file.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }
}

/// Name of the schema of compressed pictures.
pub const COMPRESSED_IMAGE: &str = "foxglove.CompressedImage";
/// Name of the schema of raw pictures.
pub const RAW_IMAGE: &str = "foxglove.RawImage";

const TIMESTAMP: MessageType = MessageType {
    name: "Timestamp",
    fields: &[("seconds", 1, FieldType::Int64), ("nanos", 2, FieldType::Int32)],
};
const TIMESTAMP_FILE: &str = "google/protobuf/timestamp.proto";
const TIMESTAMP_TYPE: FieldType = FieldType::Message(".google.protobuf.Timestamp");

const COMPRESSED_FIELDS: MessageType = MessageType {
    name: "CompressedImage",
    fields: &[
        ("timestamp", 1, TIMESTAMP_TYPE),
        ("frame_id", 4, FieldType::Text),
        ("data", 2, FieldType::Bytes),
        ("format", 3, FieldType::Text),
    ],
};

const RAW_FIELDS: MessageType = MessageType {
    name: "RawImage",
    fields: &[
        ("timestamp", 1, TIMESTAMP_TYPE),
        ("frame_id", 7, FieldType::Text),
        ("width", 2, FieldType::Fixed32),
        ("height", 3, FieldType::Fixed32),
        ("encoding", 4, FieldType::Text),
        ("step", 5, FieldType::Fixed32),
        ("data", 6, FieldType::Bytes),
    ],
};

/// Name, encoding and bytes of a topic's schema; pictures may be raw.
pub fn schema(topic: Topic, raw: bool) -> (&'static str, &'static str, Vec<u8>) {
    let json = |name: &'static str, properties: &str| {
        let text = format!(
            r#"{{"title":"{name}","type":"object","properties":{{"timestamp":{TIME},{properties}}}}}"#
        );
        (name, "jsonschema", text.into_bytes())
    };
    match topic {
        Topic::Image if raw => (RAW_IMAGE, "protobuf", file_set("foxglove/RawImage.proto", &RAW_FIELDS)),
        Topic::Image => {
            (COMPRESSED_IMAGE, "protobuf", file_set("foxglove/CompressedImage.proto", &COMPRESSED_FIELDS))
        }
        Topic::Calibration => json(
            "foxglove.CameraCalibration",
            r#""frame_id":{"type":"string"},"width":{"type":"integer"},"height":{"type":"integer"},
"distortion_model":{"type":"string"},"D":{"type":"array","items":{"type":"number"}},
"K":{"type":"array","items":{"type":"number"},"minItems":9,"maxItems":9},
"R":{"type":"array","items":{"type":"number"},"minItems":9,"maxItems":9},
"P":{"type":"array","items":{"type":"number"},"minItems":12,"maxItems":12}"#,
        ),
        Topic::Exposure => json(
            "halflight.Exposure",
            r#""sequence":{"type":"integer","description":"Counts every frame that the camera made"},
"t_mid_ns":{"type":"integer","description":"Middle of the exposure, nanoseconds"},
"time_s":{"type":"number","description":"Exposure time, seconds"},
"gain":{"type":"number","description":"Analogue times digital gain, 1 = none"}"#,
        ),
        Topic::Imu => json(
            "halflight.Imu",
            &format!(
                r#""t_ns":{{"type":"integer","description":"Time on the camera's clock, as far as known, nanoseconds"}},
"angular_velocity":{VECTOR},"linear_acceleration":{VECTOR}"#
            ),
        ),
        Topic::Rig => json(
            "halflight.Rig",
            r#""tags":{"type":"array","items":{"type":"object","properties":{"id":{"type":"integer"},
"side_m":{"type":"number"},"position_m":{"type":"array","items":{"type":"number"}},
"orientation_xyzw":{"type":"array","items":{"type":"number"}}}}},
"ball":{"type":"object","properties":{"centre_world_m":{"type":"array","items":{"type":"number"}},
"radius_m":{"type":"number"},"reflectance_rgb":{"type":"array","items":{"type":"number"}}}},
"response_log_exposure":{"type":"array","description":"For r, g, b: ln of radiance times seconds for each 8-bit value",
"items":{"type":"array","items":{"type":"number"}}}"#,
        ),
        Topic::TruthPose => json(
            "foxglove.PoseInFrame",
            &format!(
                r#""frame_id":{{"type":"string"}},"pose":{{"title":"foxglove.Pose","type":"object","properties":{{
"position":{VECTOR},"orientation":{{"title":"foxglove.Quaternion","type":"object","properties":{{
"x":{{"type":"number"}},"y":{{"type":"number"}},"z":{{"type":"number"}},"w":{{"type":"number"}}}}}}}}}}"#
            ),
        ),
        Topic::TruthLight => json(
            "halflight.Truth",
            r#""sh_order":{"type":"integer"},"sh_rgb":{"type":"array",
"description":"Radiance, real orthonormal spherical harmonics with Condon-Shortley phase, row l(l+1)+m: r, g, b; world frame",
"items":{"type":"array","items":{"type":"number"}}},
"to_light_world":{"type":"array","items":{"type":"number"}}"#,
        ),
        Topic::TruthImu => json(
            "halflight.ImuTruth",
            r#""gyro_bias_rad_s":{"type":"array","items":{"type":"number"}},
"accel_bias_m_s2":{"type":"array","items":{"type":"number"}},"time_offset_s":{"type":"number"},
"gyro_noise_rad_s":{"type":"number"},"accel_noise_m_s2":{"type":"number"}"#,
        ),
    }
}

const TIME: &str = r#"{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}}"#;
const VECTOR: &str = r#"{"title":"foxglove.Vector3","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}}"#;

/// A `FileDescriptorSet` with this message and the time stamp that it needs.
fn file_set(file: &str, message: &MessageType) -> Vec<u8> {
    let mut set = WireWriter::new();
    describe_file(&mut set, TIMESTAMP_FILE, "google.protobuf", &[], &TIMESTAMP);
    describe_file(&mut set, file, "foxglove", &[TIMESTAMP_FILE], message);
    set.finish()
}

#[cfg(test)]
mod tests {
    use super::super::wire::{WireField, fields};
    use super::*;

    #[test]
    fn json_schemas_parse_and_carry_their_name() {
        for topic in Topic::ALL {
            let (name, encoding, bytes) = schema(topic, false);
            assert_eq!(Topic::of(topic.name()), Some(topic));
            if encoding == "jsonschema" {
                let parsed: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
                assert_eq!(parsed["title"], name);
                assert_eq!(parsed["properties"]["timestamp"]["title"], "time");
            }
        }
    }

    #[test]
    fn the_file_set_names_the_message_and_its_fields() {
        let set = file_set("foxglove/RawImage.proto", &RAW_FIELDS);
        let files: Vec<_> = fields(&set).map(|f| f.unwrap()).collect();
        assert_eq!(files.len(), 2);
        let WireField::Bytes(file) = files[1].1 else { panic!() };
        let parts: Vec<_> = fields(file).map(|f| f.unwrap()).collect();
        assert!(parts.contains(&(2, WireField::Bytes(b"foxglove"))));
        assert!(parts.contains(&(3, WireField::Bytes(TIMESTAMP_FILE.as_bytes()))));
        let message = parts.iter().find(|(n, _)| *n == 4).unwrap().1;
        let WireField::Bytes(message) = message else { panic!() };
        // A name and seven fields.
        assert_eq!(fields(message).filter(|f| f.is_some_and(|(n, _)| n == 2)).count(), 7);
        assert!(fields(message).any(|f| f == Some((1, WireField::Bytes(b"RawImage")))));
    }
}
