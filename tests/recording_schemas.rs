//! Every message of our recordings keeps to the schema that its channel carries, JSON and protobuf alike; checksums and notes are
//! right; what is written is read back with the same bits.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/descriptor_set.rs"]
mod descriptor_set;
#[path = "support/fresh_recording.rs"]
mod fresh_recording;
#[path = "support/json_schema.rs"]
mod json_schema;

use descriptor_set::{Types, Value};
use fresh_recording::{Folder, desk, halflight, room, synth};
use glam::{DQuat, DVec3};
use halflight::device::open::open;
use halflight::device::recording::schema::{Topic, schema};
use halflight::device::recording::{
    Message, PictureCoding, RecordingReader, RecordingWriter, Setup, TopicNames, messages,
};
use halflight::math::lens::{Distortion, Lens};
use halflight::math::pose::Pose;
use halflight::model::imu::ImuSample;
use halflight::model::rig::Rig;
use halflight::model::time::Timestamp;
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

/// What does not fit, with its topic.
fn misfits_of(bytes: &[u8]) -> (BTreeSet<String>, Vec<String>) {
    let (mut topics, mut found) = (BTreeSet::new(), Vec::new());
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let channel = &message.channel;
        let schema = channel.schema.as_ref().unwrap();
        topics.insert(channel.topic.clone());
        match (schema.encoding.as_str(), channel.message_encoding.as_str()) {
            ("jsonschema", "json") => {
                let rules = serde_json::from_slice(&schema.data).unwrap();
                let value = serde_json::from_slice(&message.data).unwrap();
                json_schema::misfits(&value, &rules, &channel.topic, &mut found);
            }
            ("protobuf", "protobuf") => {
                let types = Types::read(&schema.data).unwrap();
                found.extend(types.decode(&schema.name, &message.data).err());
            }
            other => found.push(format!("{}: {other:?}", channel.topic)),
        }
    }
    (topics, found)
}

fn names(topics: &[Topic]) -> BTreeSet<String> {
    topics.iter().map(|topic| topic.name().to_owned()).collect()
}

#[test]
fn every_message_keeps_to_its_own_schema() {
    let folder = Folder::new("own-schemas");
    for path in [desk(&folder.0), room(&folder.0)] {
        let (topics, found) = misfits_of(&std::fs::read(&path).unwrap());
        assert_eq!((topics, found), (names(&Topic::ALL), vec![]), "{}", path.display());
    }
}

fn pinhole() -> Lens {
    Lens::pinhole(48, 32, 40.3, 40.7, 24.25, 16.5)
}

/// No ball, no tags, no response, a time before 0, and numbers that JSON cannot say.
#[test]
fn bare_recordings_keep_to_their_schemas_too() {
    let setup = Setup { rig: Some(Rig { lens: pinhole(), tags: vec![], ball: None }), ..Setup::default() };
    let mut writer =
        RecordingWriter::new("test", Cursor::new(Vec::new()), PictureCoding::Png, setup).unwrap();
    let sample =
        |t, x| ImuSample { t: Timestamp(t), gyro_rad_s: [x, 0.0, -0.0], accel_m_s2: [1e-300, x, 1.0] };
    writer
        .write_imu(&[sample(-5, 0.5), sample(3, f64::NAN), sample(4, f64::INFINITY), sample(5, 2.0)])
        .unwrap();
    let (written, target) = writer.finish().unwrap();
    assert_eq!(written.imu_samples, 2);
    let (topics, found) = misfits_of(&target.into_inner());
    assert_eq!((topics, found), (names(&[Topic::Calibration, Topic::Rig, Topic::Imu]), vec![]));
}

/// What older recordings said: null for a ball that is not there, and lists of lists.
#[test]
fn misfits_are_found() {
    let rules = serde_json::from_slice(&schema(Topic::Rig, false).2).unwrap();
    let mut found = Vec::new();
    let old = serde_json::json!({"timestamp": {"sec": 0, "nsec": 1_000_000_000}, "ball": null, "response_log_exposure": [[]]});
    json_schema::misfits(&old, &rules, "rig", &mut found);
    assert_eq!(found.len(), 4, "{found:?}");
    let types = Types::read(&schema(Topic::TruthPose, false).2).unwrap();
    for bad in [&[0x08, 1][..], &[0x12, 1], &[0x22, 0], &[0x1a, 2, 0x08, 1]] {
        assert!(types.decode("foxglove.PoseInFrame", bad).is_err(), "{bad:?}");
    }
}

/// Foxglove's fields by message: name, number, type and label as `descriptor.proto` numbers them. Kept apart from the code.
const FOXGLOVE: [(&str, &str); 9] = [
    ("google.protobuf.Timestamp", "seconds=1:3 nanos=2:5"),
    ("foxglove.Vector3", "x=1:1 y=2:1 z=3:1"),
    ("foxglove.Quaternion", "x=1:1 y=2:1 z=3:1 w=4:1"),
    ("foxglove.Pose", "position=1:11 orientation=2:11"),
    ("foxglove.CompressedImage", "timestamp=1:11 data=2:12 format=3:9 frame_id=4:9"),
    ("foxglove.RawImage", "timestamp=1:11 width=2:7 height=3:7 encoding=4:9 step=5:7 data=6:12 frame_id=7:9"),
    (
        "foxglove.CameraCalibration",
        "timestamp=1:11 width=2:7 height=3:7 distortion_model=4:9 D=5:1* K=6:1* R=7:1* P=8:1* frame_id=9:9",
    ),
    ("foxglove.PoseInFrame", "timestamp=1:11 frame_id=2:9 pose=3:11"),
    (
        "foxglove.FrameTransform",
        "timestamp=1:11 parent_frame_id=2:9 child_frame_id=3:9 translation=4:11 rotation=5:11",
    ),
];

#[test]
fn descriptors_say_what_foxgloves_files_say() {
    let mut said = BTreeMap::new();
    for (topic, raw) in Topic::ALL.into_iter().flat_map(|topic| [(topic, false), (topic, true)]) {
        let (name, encoding, bytes) = schema(topic, raw);
        if encoding == "protobuf" {
            let types = Types::read(&bytes).unwrap();
            assert!(types.describe().contains_key(name), "{name}");
            said.extend(types.describe());
        }
    }
    let wanted = FOXGLOVE.map(|(name, fields)| (name.to_owned(), fields.to_owned()));
    assert_eq!(said, BTreeMap::from(wanted));
}

#[test]
fn frames_hang_below_the_world_where_the_truth_is() {
    let folder = Folder::new("frames");
    let bytes = std::fs::read(desk(&folder.0)).unwrap();
    let (mut children, mut poses, mut cameras) = (BTreeSet::new(), Vec::new(), Vec::new());
    let numbers = |value: &Value, of: [&str; 2]| of.map(|name| value.part(name).doubles());
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        if schema.encoding != "protobuf" {
            continue;
        }
        let value = Types::read(&schema.data).unwrap().decode(&schema.name, &message.data).unwrap();
        let time = value.part("timestamp");
        let t = time.part("seconds").whole() * 1_000_000_000 + time.part("nanos").whole();
        assert_eq!(t, message.log_time, "{}", message.channel.topic);
        match message.channel.topic.as_str() {
            "/tf" => {
                assert_eq!(value.part("parent_frame_id").text(), "world");
                let child = value.part("child_frame_id").text();
                if child == "camera" {
                    cameras.push((t, numbers(&value, ["translation", "rotation"])));
                }
                children.insert(child.to_owned());
            }
            "/truth/pose" => {
                assert_eq!(value.part("frame_id").text(), "world");
                poses.push((t, numbers(value.part("pose"), ["position", "orientation"])));
            }
            _ => assert_eq!(value.part("frame_id").text(), "camera", "{}", message.channel.topic),
        }
    }
    assert_eq!(children, ["ball", "camera", "tag_0"].map(str::to_owned).into());
    assert_eq!((poses.len(), &poses), (13, &cameras));
}

fn crc32(bytes: &[u8]) -> u32 {
    let bit = |c: u32| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 };
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |c, _| bit(c)))
}

/// The checksums of the data and of the summary, each over all bytes before it. Those of chunks are read by `mcap` itself.
#[test]
fn checksums_are_right() {
    let folder = Folder::new("checksums");
    let bytes = std::fs::read(room(&folder.0)).unwrap();
    let number = |at: usize, n: usize| {
        bytes[at..at + n].iter().rev().fold(0usize, |all, byte| all << 8 | usize::from(*byte))
    };
    let (mut at, mut seen) = (8, Vec::new());
    while at < bytes.len() - 8 {
        let (opcode, content, size) = (bytes[at], at + 9, number(at + 1, 8));
        match opcode {
            0x02 => {
                let start = number(content, 8);
                assert_eq!(number(content + 16, 4) as u32, crc32(&bytes[start..content + 16]), "summary");
            }
            // Start, end, size, then the checksum.
            0x06 => assert_ne!(number(content + 24, 4), 0, "a chunk without a checksum"),
            0x0f => assert_eq!(number(content, 4) as u32, crc32(&bytes[..at]), "data"),
            _ => {}
        }
        seen.push(opcode);
        at = content + size;
    }
    // Header, notes, a chunk, the end of the data, the footer.
    assert_eq!(seen[..3], [0x01, 0x0c, 0x06]);
    assert!(seen.contains(&0x0f) && seen.contains(&0x02));
}

fn notes(path: &std::path::Path) -> BTreeMap<String, String> {
    let file = std::fs::File::open(path).unwrap();
    RecordingReader::open_topics("test", file, TopicNames::default()).unwrap().notes().clone()
}

#[test]
fn notes_say_who_recorded_what_and_go_on_through_copies() {
    let folder = Folder::new("notes");
    let made = synth(&folder.0);
    let copy = folder.0.join("copy.mcap");
    let device = format!("replay:{}", made.display());
    halflight(&["record", &device, "--frames", "2", "--png", "--out", copy.to_str().unwrap()]);
    let (made, copy) = (notes(&made), notes(&copy));
    assert_eq!(made["program"], "halflight synth");
    assert_eq!(copy["program"], "halflight record");
    assert_eq!((made["device"].as_str(), &copy["device"]), ("synthetic", &device));
    assert!(made["settings"].starts_with("frames=13,size=128x96,exposures="), "{made:?}");
    assert_eq!(copy["settings"], "frames=2");
    assert_eq!((made["pictures"].as_str(), copy["pictures"].as_str()), ("jpeg 93", "png"));
    assert!(made["version"].starts_with(env!("CARGO_PKG_VERSION")));
    assert_eq!(made["scene"], "synthetic room, view desk");
    assert_eq!(copy["scene"], made["scene"]);
    let rig: serde_json::Value = serde_json::from_str(&copy["rig"]).unwrap();
    assert_eq!(copy["rig"], made["rig"]);
    assert_eq!((&rig["lens"]["width_px"], &rig["tags"][0]["id"]), (&128.into(), &0.into()));
    assert_eq!(rig["ball"]["radius_m"], 0.06);
    // Recordings of others, and older ones, say nothing.
    let old = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/recordings/desk.mcap");
    assert!(notes(old.as_ref()).is_empty());
}

/// A bundled recording has calibration and poses in JSON, and tables in lists of lists; its copy has today's form.
#[test]
fn an_older_recording_written_anew_is_the_same() {
    const FRAMES: u64 = 12;
    let folder = Folder::new("copies");
    let old = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/recordings/desk.mcap");
    let copy = folder.0.join("copy.mcap");
    let device = format!("replay:{old},frames={FRAMES}");
    halflight(&["record", &device, "--raw", "--out", copy.to_str().unwrap()]);
    let (topics, found) = misfits_of(&std::fs::read(&copy).unwrap());
    assert_eq!((topics, found), (names(&Topic::ALL), vec![]));
    let open = |path: &str| open(path).unwrap();
    let (mut a, mut b) = (open(old), open(copy.to_str().unwrap()));
    assert_eq!((a.frames.rig(), a.frames.response()), (b.frames.rig(), b.frames.response()));
    assert_eq!(b.frames.frames_left(), Some(FRAMES));
    let mut last = Timestamp(0);
    for _ in 0..FRAMES {
        let [one, other] = [&mut a, &mut b].map(|opened| opened.frames.next(Timestamp(i64::MAX)).unwrap());
        assert_eq!((one.sequence, one.t_mid, one.exposure), (other.sequence, other.t_mid, other.exposure));
        assert_eq!(one.pixels, other.pixels);
        let truth = a.frames.truth();
        assert!(truth.is_some() && truth == b.frames.truth());
        last = one.t_mid;
    }
    let [one, other] = [a.imu, b.imu].map(|imu| {
        let (mut imu, mut samples) = (imu.unwrap(), Vec::new());
        imu.samples_until(last, &mut samples).unwrap();
        (imu.imu_truth(), samples)
    });
    assert!(one.0.is_some() && one.1.len() > 60);
    assert_eq!(one, other);
}

fn message(topic: Topic, content: Vec<u8>) -> Message {
    let (name, _, _) = schema(topic, false);
    let encoding = halflight::device::recording::channels::Encoding::Protobuf;
    Message {
        topic,
        name: topic.name().into(),
        schema: name.into(),
        encoding,
        encoding_name: "protobuf".into(),
        number: 1,
        log_time: 0,
        shift_ns: 0,
        content,
    }
}

proptest! {
    #[test]
    fn poses_come_back_with_the_same_bits(
        t in any::<i64>(), q in prop::array::uniform4(-1.0f64..1.0), p in prop::array::uniform3(-1e4f64..1e4),
    ) {
        let q = DQuat::from_array(q);
        prop_assume!(q.length() > 1e-3);
        let pose = Pose { rotation: q.normalize(), translation: DVec3::from_array(p) };
        let content = messages::write_pose(Timestamp(t), &pose);
        let read = messages::read_pose(&message(Topic::TruthPose, content)).unwrap();
        prop_assert_eq!((read.t, read.world_from_camera), (Timestamp(t), pose));
    }

    #[test]
    fn lenses_come_back_with_the_same_bits(
        f in prop::array::uniform2(1.0f64..1e5), c in prop::array::uniform2(1u32..1 << 20),
        k in prop::array::uniform8(-1.0f64..1.0), kind in 0..3,
    ) {
        let distortion = match kind {
            0 => Distortion::None,
            1 => Distortion::RadialTangential(k),
            _ => Distortion::Equidistant([k[0], k[1], k[2], k[3]]),
        };
        // A half less and a half more are exact for such centres.
        let [cx, cy] = c.map(|c| f64::from(c) / 1024.0);
        let lens = Lens { distortion, ..Lens::pinhole(640, 480, f[0], f[1], cx, cy) };
        let content = messages::write_calibration(Timestamp(7), &lens);
        prop_assert_eq!(messages::read_calibration(&message(Topic::Calibration, content)).unwrap(), lens);
    }
}
