//! What lies on each topic of a recording; `docs/recordings.md` says it for readers.
//!
//! | topic | schema | encoding |
//! |---|---|---|
//! | `/camera/image` | `foxglove.CompressedImage` or `foxglove.RawImage` | protobuf |
//! | `/camera/calibration` | `foxglove.CameraCalibration` | protobuf |
//! | `/camera/exposure` | `halflight.Exposure`: what the sensor applied to the image of the same time | JSON |
//! | `/imu` | `halflight.Imu` | JSON |
//! | `/rig` | `halflight.Rig`: tags, ball, response | JSON |
//! | `/tf` | `foxglove.FrameTransform`: tags and ball in the world; the camera, where its pose is known | protobuf |
//! | `/truth/pose` | `foxglove.PoseInFrame`: the camera in the world | protobuf |
//! | `/truth/light` | `halflight.Truth` | JSON |
//! | `/truth/imu` | `halflight.ImuTruth` | JSON |
//!
//! Older recordings have calibration and poses in JSON; the reader takes both.
//!
//! Foxglove has no schema for inertial samples. Ours keeps the field names of ROS's `sensor_msgs/Imu`
//! (`angular_velocity`, `linear_acceleration`), but as JSON with a schema of its own: every viewer plots it,
//! and the file does not pretend to come from ROS, whose message needs covariances that nobody knows here.
//!
//! Viewers know a part of JSON Schema: arrays of numbers and of objects, but no arrays of arrays and no choice of types.
//! So colours are objects of r, g and b, and what is not known is left out rather than null.
//!
//! Pixels: the calibration's K follows OpenCV and ROS, where the centre of the first pixel is 0; a `Lens` has it
//! at 0.5. So cx and cy differ by 0.5.

use super::descriptor::ProtoFile;
use super::foxglove_types;
use serde_json::{Value, json};

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
    /// Frames within frames. For viewers: nothing here reads it.
    Transforms,
    /// The camera's true pose.
    TruthPose,
    /// The true light.
    TruthLight,
    /// The true faults of the IMU.
    TruthImu,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Image,
        Self::Calibration,
        Self::Exposure,
        Self::Imu,
        Self::Rig,
        Self::Transforms,
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
            Self::Transforms => "/tf",
            Self::TruthPose => "/truth/pose",
            Self::TruthLight => "/truth/light",
            Self::TruthImu => "/truth/imu",
        }
    }

    /// Whether a recording is read for it.
    pub fn is_read(self) -> bool {
        self != Self::Transforms
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

/// Name, encoding and bytes of a topic's schema; pictures may be raw.
pub fn schema(topic: Topic, raw: bool) -> (&'static str, &'static str, Vec<u8>) {
    let proto = |name: &'static str, file: &'static ProtoFile| (name, "protobuf", file.descriptor_set());
    match topic {
        Topic::Image if raw => proto(RAW_IMAGE, &foxglove_types::RAW_IMAGE),
        Topic::Image => proto(COMPRESSED_IMAGE, &foxglove_types::COMPRESSED_IMAGE),
        Topic::Calibration => proto("foxglove.CameraCalibration", &foxglove_types::CALIBRATION),
        Topic::Transforms => proto("foxglove.FrameTransform", &foxglove_types::FRAME_TRANSFORM),
        Topic::TruthPose => proto("foxglove.PoseInFrame", &foxglove_types::POSE_IN_FRAME),
        Topic::Exposure => own("halflight.Exposure", exposure(), &[]),
        Topic::Imu => own("halflight.Imu", imu(), &[]),
        Topic::Rig => own("halflight.Rig", rig(), &["ball", "response_log_exposure"]),
        Topic::TruthLight => own("halflight.Truth", truth(), &[]),
        Topic::TruthImu => own("halflight.ImuTruth", imu_truth(), &[]),
    }
}

/// The JSON Schema of one of our own messages: these properties and a time, all of them there but for the optional ones.
fn own(
    name: &'static str,
    mut properties: Value,
    optional: &[&str],
) -> (&'static str, &'static str, Vec<u8>) {
    let nanoseconds = json!({"type": "integer", "minimum": 0, "maximum": 999_999_999});
    properties["timestamp"] = object("time", json!({"sec": {"type": "integer"}, "nsec": nanoseconds}), &[]);
    let mut schema = object(name, properties, optional);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    (name, "jsonschema", schema.to_string().into_bytes())
}

fn object(title: &str, properties: Value, optional: &[&str]) -> Value {
    let names = properties.as_object().into_iter().flat_map(|map| map.keys());
    let required: Vec<&String> = names.filter(|name| !optional.contains(&name.as_str())).collect();
    json!({"title": title, "type": "object", "required": required, "properties": properties})
}

fn number(description: &str) -> Value {
    json!({"type": "number", "description": description})
}

fn integer(description: &str) -> Value {
    json!({"type": "integer", "description": description})
}

fn numbers(count: usize, description: &str) -> Value {
    let items = json!({"type": "number"});
    json!({"type": "array", "items": items, "minItems": count, "maxItems": count, "description": description})
}

fn vector(description: &str) -> Value {
    let x = || json!({"type": "number"});
    let mut vector = object("foxglove.Vector3", json!({"x": x(), "y": x(), "z": x()}), &[]);
    vector["description"] = json!(description);
    vector
}

fn exposure() -> Value {
    json!({
        "sequence": integer("Counts every frame that the camera made"),
        "t_mid_ns": integer("Middle of the exposure, nanoseconds"),
        "time_s": number("Exposure time, seconds"),
        "gain": number("Analogue times digital gain, 1 = none"),
    })
}

fn imu() -> Value {
    json!({
        "t_ns": integer("Time on the camera's clock, as far as known, nanoseconds"),
        "angular_velocity": vector("rad/s, in the sensor's own frame"),
        "linear_acceleration": vector("m/s^2, gravity included: +9.81 upwards at rest"),
    })
}

fn rig() -> Value {
    let tag = json!({
        "id": integer("Number in tag36h11"),
        "side_m": number("Side of the black square, metres"),
        "position_m": numbers(3, "Centre in the world, metres"),
        "orientation_xyzw": numbers(4, "World from tag, unit quaternion"),
    });
    let ball = json!({
        "centre_world_m": numbers(3, "Metres"),
        "radius_m": number("Metres"),
        "reflectance_rgb": numbers(3, "Share of the light that it reflects, linear"),
    });
    let table = || numbers(256, "For each 8-bit value");
    let mut response = object("response", json!({"r": table(), "g": table(), "b": table()}), &[]);
    response["description"] = json!("ln of radiance times seconds");
    json!({
        "tags": {"type": "array", "items": object("tag", tag, &[])},
        "ball": object("ball", ball, &[]),
        "response_log_exposure": response,
    })
}

fn truth() -> Value {
    let colour = json!({"r": {"type": "number"}, "g": {"type": "number"}, "b": {"type": "number"}});
    json!({
        "sh_order": integer("Bands of the harmonics; order squared rows"),
        "sh_rgb": {
            "type": "array",
            "items": object("colour", colour, &[]),
            "description": "Radiance, real orthonormal spherical harmonics with Condon-Shortley phase, row l(l+1)+m; world frame",
        },
        "to_light_world": numbers(3, "Direction of the light's first band, unit"),
    })
}

fn imu_truth() -> Value {
    json!({
        "gyro_bias_rad_s": numbers(3, "Added to every sample, rad/s"),
        "accel_bias_m_s2": numbers(3, "Added to every sample, m/s^2"),
        "time_offset_s": number("Stated time minus true time, seconds"),
        "gyro_noise_rad_s": number("Standard deviation of a sample, rad/s"),
        "accel_noise_m_s2": number("Standard deviation of a sample, m/s^2"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The part of JSON Schema that viewers take: objects with properties, numbers, text, and arrays of these, never of arrays.
    fn assert_simple(schema: &Value, place: &str) {
        match schema["type"].as_str() {
            Some("object") => {
                for (name, inner) in schema["properties"].as_object().unwrap() {
                    assert_simple(inner, &format!("{place}.{name}"));
                }
            }
            Some("array") => {
                assert_ne!(schema["items"]["type"], "array", "{place}");
                assert_simple(&schema["items"], place);
            }
            Some("number" | "integer" | "string") => {}
            other => panic!("{place}: {other:?}"),
        }
    }

    #[test]
    fn json_schemas_carry_their_name_and_are_what_viewers_take() {
        for topic in Topic::ALL {
            let (name, encoding, bytes) = schema(topic, false);
            assert_eq!(Topic::of(topic.name()), Some(topic));
            assert_eq!(encoding == "jsonschema", name.starts_with("halflight."), "{name}");
            if encoding == "jsonschema" {
                let parsed: Value = serde_json::from_slice(&bytes).unwrap();
                assert_eq!(parsed["title"], name);
                assert_eq!(parsed["properties"]["timestamp"]["title"], "time");
                assert_simple(&parsed, name);
            }
        }
    }

    #[test]
    fn what_may_be_missing_is_not_required() {
        let parsed: Value = serde_json::from_slice(&schema(Topic::Rig, false).2).unwrap();
        assert_eq!(parsed["required"], json!(["tags", "timestamp"]));
    }
}
