//! Foxglove's message types as its `.proto` files number them, as far as they are written here.

use super::descriptor::{
    ProtoFieldType::{Bytes, Double, Doubles, Fixed32, Int32, Int64, Message, Text},
    ProtoFile,
};

static TIMESTAMP: ProtoFile = ProtoFile {
    path: "google/protobuf/timestamp.proto",
    package: "google.protobuf",
    name: "Timestamp",
    fields: &[("seconds", 1, Int64), ("nanos", 2, Int32)],
};

static VECTOR: ProtoFile = ProtoFile {
    path: "foxglove/Vector3.proto",
    package: "foxglove",
    name: "Vector3",
    fields: &[("x", 1, Double), ("y", 2, Double), ("z", 3, Double)],
};

static QUATERNION: ProtoFile = ProtoFile {
    path: "foxglove/Quaternion.proto",
    package: "foxglove",
    name: "Quaternion",
    fields: &[("x", 1, Double), ("y", 2, Double), ("z", 3, Double), ("w", 4, Double)],
};

static POSE: ProtoFile = ProtoFile {
    path: "foxglove/Pose.proto",
    package: "foxglove",
    name: "Pose",
    fields: &[("position", 1, Message(&VECTOR)), ("orientation", 2, Message(&QUATERNION))],
};

/// `foxglove.CompressedImage`
pub static COMPRESSED_IMAGE: ProtoFile = ProtoFile {
    path: "foxglove/CompressedImage.proto",
    package: "foxglove",
    name: "CompressedImage",
    fields: &[
        ("timestamp", 1, Message(&TIMESTAMP)),
        ("frame_id", 4, Text),
        ("data", 2, Bytes),
        ("format", 3, Text),
    ],
};

/// `foxglove.RawImage`
pub static RAW_IMAGE: ProtoFile = ProtoFile {
    path: "foxglove/RawImage.proto",
    package: "foxglove",
    name: "RawImage",
    fields: &[
        ("timestamp", 1, Message(&TIMESTAMP)),
        ("frame_id", 7, Text),
        ("width", 2, Fixed32),
        ("height", 3, Fixed32),
        ("encoding", 4, Text),
        ("step", 5, Fixed32),
        ("data", 6, Bytes),
    ],
};

/// `foxglove.CameraCalibration`
pub static CALIBRATION: ProtoFile = ProtoFile {
    path: "foxglove/CameraCalibration.proto",
    package: "foxglove",
    name: "CameraCalibration",
    fields: &[
        ("timestamp", 1, Message(&TIMESTAMP)),
        ("frame_id", 9, Text),
        ("width", 2, Fixed32),
        ("height", 3, Fixed32),
        ("distortion_model", 4, Text),
        ("D", 5, Doubles),
        ("K", 6, Doubles),
        ("R", 7, Doubles),
        ("P", 8, Doubles),
    ],
};

/// `foxglove.PoseInFrame`
pub static POSE_IN_FRAME: ProtoFile = ProtoFile {
    path: "foxglove/PoseInFrame.proto",
    package: "foxglove",
    name: "PoseInFrame",
    fields: &[("timestamp", 1, Message(&TIMESTAMP)), ("frame_id", 2, Text), ("pose", 3, Message(&POSE))],
};

/// `foxglove.FrameTransform`
pub static FRAME_TRANSFORM: ProtoFile = ProtoFile {
    path: "foxglove/FrameTransform.proto",
    package: "foxglove",
    name: "FrameTransform",
    fields: &[
        ("timestamp", 1, Message(&TIMESTAMP)),
        ("parent_frame_id", 2, Text),
        ("child_frame_id", 3, Text),
        ("translation", 4, Message(&VECTOR)),
        ("rotation", 5, Message(&QUATERNION)),
    ],
};
