//! Recordings that other programs write: without chunks or checksums, messages in another order, clocks that are set, Foxglove's
//! schemas in JSON and protobuf, ROS 2's bags, pictures in many encodings. Made here by rule; the handed cases as well.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use halflight::device::recording::schema::{Topic, schema};
use halflight::device::recording::wire::WireWriter;
use halflight::device::recording::{PictureCoding, messages, pictures};
use halflight::device::replay::{ReplayImu, ReplayOptions, ReplaySource};
use halflight::device::{DeviceError, ErrorKind, FrameSource, ImuSource};
use halflight::math::lens::{Distortion, Lens};
use halflight::model::frame::{Exposure, RawFrame};
use halflight::model::image::Rgb8Image;
use halflight::model::imu::ImuSample;
use halflight::model::time::Timestamp;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

const SIZE: (usize, usize) = (48, 32);
const S: i64 = 1_000_000_000;
const START: i64 = 1_700_000_000 * S;
const STEP: i64 = S / 30;

fn lens() -> Lens {
    Lens {
        distortion: Distortion::RadialTangential([0.1, -0.02, 1e-3, -2e-3, 0.003, 0.0, 0.0, 0.0]),
        ..Lens::pinhole(SIZE.0 as u32, SIZE.1 as u32, 40.3, 40.7, 24.25, 16.5)
    }
}

fn picture(i: i64) -> Rgb8Image {
    let pixel = |p: usize| [(p % SIZE.0 * 5) as u8, (p / SIZE.0 * 7) as u8, (17 * i) as u8];
    Rgb8Image::from_pixels(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).map(pixel).collect()).unwrap()
}

fn frame(i: i64) -> RawFrame {
    let exposure = Exposure { time_s: [0.01, 0.02][i as usize % 2], gain: 1.5 };
    RawFrame {
        sequence: i as u64,
        t_mid: Timestamp(START + i * STEP),
        exposure,
        row_time_s: 0.0,
        pixels: Arc::new(picture(i)),
    }
}

/// A channel: topic, schema, its encoding, the messages' encoding.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Line(&'static str, &'static str, &'static str);

/// A message of a channel at a time of the log.
type Entry = (Line, i64, Vec<u8>);

fn own(topic: Topic) -> Line {
    let (name, encoding, _) = schema(topic, false);
    Line(topic.name(), name, if encoding == "jsonschema" { "json" } else { "protobuf" })
}

const ROS_IMAGE: Line = Line("/cam/image_raw", "sensor_msgs/msg/Image", "cdr");
const ROS_PACKED: Line = Line("/cam/image_raw/compressed", "sensor_msgs/msg/CompressedImage", "cdr");
const ROS_INFO: Line = Line("/cam/camera_info", "sensor_msgs/msg/CameraInfo", "cdr");
const ROS_IMU: Line = Line("/imu/data", "sensor_msgs/msg/Imu", "cdr");

fn write(options: mcap::WriteOptions, entries: &[Entry]) -> Vec<u8> {
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let mut channels = BTreeMap::new();
    for (sequence, (line, t, content)) in entries.iter().enumerate() {
        let channel_id = *channels.entry(line.clone()).or_insert_with(|| {
            let schema = writer.add_schema(line.1, "any", b"text").unwrap();
            writer.add_channel(schema, line.0, line.2, &BTreeMap::new()).unwrap()
        });
        let (log_time, sequence) = (*t as u64, sequence as u32);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, content).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn chunked() -> mcap::WriteOptions {
    mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)).compression_threads(0)
}

fn calibration() -> Entry {
    (own(Topic::Calibration), START, messages::write_calibration(Timestamp(START), &lens()))
}

/// A picture of ours as PNG.
fn image(i: i64) -> Entry {
    let t = START + i * STEP;
    (own(Topic::Image), t, pictures::write_image(Timestamp(t), &picture(i), PictureCoding::Png).unwrap())
}

fn exposure(i: i64) -> Entry {
    (own(Topic::Exposure), START + i * STEP, messages::write_exposure(&frame(i)))
}

/// As our own recordings are: six frames.
fn plain() -> Vec<Entry> {
    let mut all = vec![calibration()];
    (0..6).for_each(|i| all.extend([exposure(i), image(i)]));
    all
}

fn source(bytes: &[u8]) -> Result<ReplaySource<Cursor<&[u8]>>, DeviceError> {
    ReplaySource::new("replay:test", Cursor::new(bytes))
}

fn frames(source: &mut impl FrameSource) -> Vec<RawFrame> {
    let mut all = Vec::new();
    loop {
        match source.next(Timestamp(i64::MAX)) {
            Ok(frame) => all.push(frame),
            Err(error) => {
                assert_eq!(error.kind, ErrorKind::Ended, "{error}");
                return all;
            }
        }
    }
}

/// The six frames, and nothing to complain of.
fn assert_plain(bytes: &[u8], what: &str) {
    let mut source = source(bytes).unwrap();
    assert_eq!(source.rig().unwrap().lens, lens(), "{what}");
    assert_eq!(source.frames_left(), Some(6), "{what}");
    let found = frames(&mut source);
    assert_eq!(found.len(), 6, "{what}");
    for (i, got) in found.iter().enumerate() {
        let want = frame(i as i64);
        assert_eq!(
            (got.sequence, got.t_mid, got.exposure),
            (want.sequence, want.t_mid, want.exposure),
            "{what}"
        );
        assert_eq!(got.pixels, want.pixels, "{what}");
    }
    assert_eq!(source.damage().warnings(), 0, "{what}: {:?}", source.damage());
}

#[test]
fn chunks_and_checksums_may_be_left_out() {
    assert_plain(&write(chunked(), &plain()), "as ours");
    assert_plain(&write(chunked().use_chunks(false), &plain()), "without chunks");
    assert_plain(&write(chunked().calculate_chunk_crcs(false), &plain()), "without checksums");
    let bare = || chunked().compression(None);
    assert_plain(&write(bare(), &plain()), "not compressed");
    assert_plain(&write(bare().calculate_chunk_crcs(false), &plain()), "neither");
}

#[test]
fn messages_of_one_moment_come_in_any_order() {
    let mut turned = vec![calibration()];
    (0..6).for_each(|i| turned.extend([image(i), exposure(i)]));
    assert_plain(&write(chunked(), &turned), "pictures first");
    let mut apart = vec![calibration()];
    apart.extend((0..6).map(exposure));
    apart.extend((0..6).map(image));
    assert_plain(&write(chunked(), &apart), "all exposures first");
    let mut late = vec![calibration()];
    late.extend((0..6).map(image));
    late.extend((0..6).map(exposure));
    assert_plain(&write(chunked().use_chunks(false), &late), "all pictures first");
}

#[test]
fn a_picture_without_its_exposure_is_counted_and_the_rest_is_there() {
    let entries: Vec<Entry> =
        plain().into_iter().enumerate().filter(|(k, _)| *k != 5).map(|(_, e)| e).collect();
    let bytes = write(chunked(), &entries);
    let mut source = source(&bytes).unwrap();
    let found: Vec<u64> = frames(&mut source).iter().map(|f| f.sequence).collect();
    assert_eq!(found, [0, 1, 3, 4, 5]);
    assert_eq!((source.damage().messages, source.damage().of_file()), (1, None));
}

/// All times fall by an hour in the middle: what follows counts as later, after a gap, for camera and inertial sensor alike.
#[test]
fn a_clock_that_steps_back_begins_afresh() {
    const HOUR: i64 = 3600 * S;
    let mut entries = vec![calibration()];
    for i in 0..6i64 {
        let back = if i < 3 { 0 } else { HOUR };
        let t = START + i * STEP - back;
        let moved = RawFrame { t_mid: Timestamp(t), ..frame(i) };
        let sample = ImuSample { t: Timestamp(t + STEP / 2), gyro_rad_s: [0.1; 3], accel_m_s2: [9.0; 3] };
        entries.push((own(Topic::Exposure), t, messages::write_exposure(&moved)));
        entries.push((own(Topic::Image), t, image(i).2));
        entries.push((own(Topic::Imu), t + STEP / 2, messages::write_imu(&sample)));
    }
    for options in [chunked(), chunked().use_chunks(false)] {
        let bytes = write(options, &entries);
        let mut source = source(&bytes).unwrap();
        let found = frames(&mut source);
        let times: Vec<i64> = found.iter().map(|f| f.t_mid.0).collect();
        assert_eq!(times.len(), 6);
        let steps: Vec<i64> = times.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(steps[2] > S && steps.iter().enumerate().all(|(k, s)| k == 2 || *s == STEP), "{steps:?}");
        assert_eq!((source.clock_steps(), source.damage().warnings()), (1, 0));
        let mut imu = ReplayImu::new("replay:test", Cursor::new(bytes.as_slice())).unwrap();
        let mut samples = Vec::new();
        imu.samples_until(Timestamp(i64::MAX), &mut samples).unwrap();
        // Half a period after each frame, on both sides of the step.
        let halves: Vec<i64> = samples.iter().zip(&times).map(|(sample, t)| sample.t.0 - t).collect();
        assert_eq!(halves, [STEP / 2; 6]);
    }
}

#[test]
fn a_picture_that_is_a_little_late_is_refused_and_counted() {
    let mut entries = plain();
    let (line, t, content) = image(1);
    entries.extend([exposure(1), (line, t, content)]);
    let bytes = write(chunked(), &entries);
    let mut source = source(&bytes).unwrap();
    assert_eq!(frames(&mut source).len(), 6);
    assert_eq!((source.damage().messages, source.clock_steps()), (1, 0));
}

/// An Exif segment with 1/50 s and ISO 200, little-endian.
fn exif() -> Vec<u8> {
    let mut tiff = b"II\x2a\0\x08\0\0\0\x02\0".to_vec();
    for (tag, kind, value) in [(0x829au16, 5u16, 38u32), (0x8827, 3, 200)] {
        tiff.extend(tag.to_le_bytes());
        tiff.extend(kind.to_le_bytes());
        tiff.extend(1u32.to_le_bytes());
        tiff.extend(value.to_le_bytes());
    }
    tiff.extend([0; 4]);
    tiff.extend(1u32.to_le_bytes());
    tiff.extend(50u32.to_le_bytes());
    let length = (tiff.len() + 8) as u16;
    [&[0xff, 0xe1][..], &length.to_be_bytes(), b"Exif\0\0", &tiff].concat()
}

#[test]
fn without_a_topic_of_exposures_a_setting_exif_or_one_for_all_stands_in() {
    let mut entries = vec![calibration()];
    entries.extend((0..6).map(image));
    let bytes = write(chunked(), &entries);
    let exposures = |bytes: &[u8], parameters: &str| {
        let options = ReplayOptions::parse(&format!("x.mcap{parameters}")).unwrap();
        let mut source = ReplaySource::with_options("replay:test", Cursor::new(bytes), &options).unwrap();
        let asked = source.set_exposures(&[]).unwrap();
        let found = frames(&mut source);
        assert_eq!(found.len(), 6);
        assert!(found.windows(2).all(|w| w[0].exposure == w[1].exposure && w[0].t_mid < w[1].t_mid));
        assert_eq!(asked, [found[0].exposure]);
        found[0].exposure
    };
    let unknown = exposures(&bytes, "");
    assert!(unknown.time_s > 0.0 && unknown.gain == 1.0);
    assert_eq!(exposures(&bytes, ",exposure_s=0.025,gain=2"), Exposure { time_s: 0.025, gain: 2.0 });
    let mut entries = vec![calibration()];
    entries.extend((0..6).map(|i| {
        let jpeg = jpeg_of(i);
        let with_exif = [&jpeg[..2], &exif(), &jpeg[2..]].concat();
        (own(Topic::Image), START + i * STEP, packed_message(START + i * STEP, &with_exif, "jpeg"))
    }));
    let bytes = write(chunked(), &entries);
    assert_eq!(exposures(&bytes, ""), Exposure { time_s: 0.02, gain: 2.0 });
    assert_eq!(exposures(&bytes, ",exposure_s=0.5"), Exposure { time_s: 0.5, gain: 1.0 });
}

fn encoded(image: &Rgb8Image, format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let samples = image.pixels().as_flattened().to_vec();
    let buffer = image::RgbImage::from_raw(image.width() as u32, image.height() as u32, samples).unwrap();
    buffer.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn jpeg_of(i: i64) -> Vec<u8> {
    encoded(&picture(i), image::ImageFormat::Jpeg)
}

/// `foxglove.CompressedImage` in protobuf.
fn packed_message(t: i64, data: &[u8], format: &str) -> Vec<u8> {
    let mut w = WireWriter::new();
    w.message(1, |w| {
        w.varint(1, (t / S) as u64).varint(2, (t % S) as u64);
    });
    w.bytes(4, b"camera").bytes(2, data).bytes(3, format.as_bytes());
    w.finish()
}

#[test]
fn what_a_picture_is_its_first_bytes_say() {
    let said = ["jpeg", "JPEG", "image/jpeg", "rgb8; jpeg compressed bgr8", "", "png"];
    for (format, words) in
        [(image::ImageFormat::Png, said), (image::ImageFormat::WebP, said), (image::ImageFormat::Jpeg, said)]
    {
        let mut entries = vec![calibration()];
        for (i, word) in words.iter().enumerate() {
            let i = i as i64;
            let message = packed_message(START + i * STEP, &encoded(&picture(i), format), word);
            entries.extend([exposure(i), (own(Topic::Image), START + i * STEP, message)]);
        }
        if format == image::ImageFormat::Jpeg {
            let bytes = write(chunked(), &entries);
            assert_eq!(frames(&mut source(&bytes).unwrap()).len(), 6);
        } else {
            assert_plain(&write(chunked(), &entries), &format!("{format:?}"));
        }
    }
    // What it is not is said, and is no damage of the file.
    let mut entries = plain();
    let t = START + 6 * STEP;
    entries.extend([exposure(6), (own(Topic::Image), t, packed_message(t, b"GIF89a", "jpeg"))]);
    let bytes = write(chunked(), &entries);
    let mut source = source(&bytes).unwrap();
    assert_eq!(frames(&mut source).len(), 6);
    assert_eq!((source.damage().messages, source.damage().of_file()), (1, None));
}

/// Cut at every kind of place: never a frame, always counted once, and the others as they are.
#[test]
fn cut_pictures_are_refused_and_counted() {
    for format in [image::ImageFormat::Jpeg, image::ImageFormat::Png, image::ImageFormat::WebP] {
        let whole = encoded(&picture(2), format);
        for share in 0..24 {
            // The last bytes of a PNG are its end chunk.
            let keep = (whole.len() - 16) * share / 23;
            let mut entries = vec![calibration()];
            for i in 0..4 {
                let t = START + i * STEP;
                let data = if i == 2 {
                    whole[..keep].to_vec()
                } else {
                    encoded(&picture(i), image::ImageFormat::Png)
                };
                entries.extend([exposure(i), (own(Topic::Image), t, packed_message(t, &data, "jpeg"))]);
            }
            let bytes = write(chunked(), &entries);
            let mut source = source(&bytes).unwrap();
            let found = frames(&mut source);
            let numbers: Vec<u64> = found.iter().map(|f| f.sequence).collect();
            assert_eq!(numbers, [0, 1, 3], "{format:?}, {keep} of {}", whole.len());
            assert!(found.iter().all(|f| *f.pixels == picture(f.sequence as i64)));
            assert_eq!((source.damage().messages, source.damage().of_file()), (1, None));
        }
    }
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = three.iter().fold(0u32, |n, b| n << 8 | u32::from(*b)) << (8 * (3 - three.len()));
        (0..=three.len()).for_each(|k| text.push(LETTERS[(bits >> (18 - 6 * k)) as usize & 63] as char));
        (three.len()..3).for_each(|_| text.push('='));
    }
    text
}

fn json_time(t: i64) -> serde_json::Value {
    serde_json::json!({ "sec": t / S, "nsec": t % S })
}

#[test]
fn foxgloves_schemas_are_read_in_json_and_protobuf() {
    let mut w = WireWriter::new();
    let doubles = |list: &[f64]| list.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let l = lens();
    let Distortion::RadialTangential(d) = l.distortion else { panic!() };
    let k = [l.fx, 0.0, l.cx - 0.5, 0.0, l.fy, l.cy - 0.5, 0.0, 0.0, 1.0];
    // A tail of zeros, as OpenCV's fourteen.
    let d: Vec<f64> = d.iter().copied().chain([0.0; 6]).collect();
    w.fixed32(2, l.width).fixed32(3, l.height).bytes(4, b"rational_polynomial");
    w.bytes(5, &doubles(&d)).bytes(6, &doubles(&k));
    let in_protobuf: Entry =
        (Line("/camera/calibration", "foxglove.CameraCalibration", "protobuf"), START, w.finish());
    let mut entries = plain();
    entries[0] = in_protobuf;
    assert_plain(&write(chunked(), &entries), "calibration in protobuf");

    let json = |schema: &'static str, t: i64, mut value: serde_json::Value| -> Entry {
        value["timestamp"] = json_time(t);
        (Line("/camera/image", schema, "json"), t, value.to_string().into_bytes())
    };
    for schema in ["foxglove.CompressedImage", "foxglove.RawImage"] {
        let mut entries = vec![calibration()];
        for i in 0..6 {
            let t = START + i * STEP;
            let value = if schema == "foxglove.RawImage" {
                let data = base64(picture(i).pixels().as_flattened());
                serde_json::json!({ "width": SIZE.0, "height": SIZE.1, "encoding": "rgb8", "step": 3 * SIZE.0, "data": data })
            } else {
                serde_json::json!({ "format": "png", "data": base64(&encoded(&picture(i), image::ImageFormat::Png)) })
            };
            entries.extend([exposure(i), json(schema, t, value)]);
        }
        assert_plain(&write(chunked(), &entries), schema);
    }
    // An encoding that is not read is named with those that are.
    let mut entries = plain();
    entries[0].0 = Line("/camera/calibration", "foxglove.CameraCalibration", "cbor");
    let error = source(&write(chunked(), &entries)).err().unwrap().to_string();
    assert!(error.contains("/camera/calibration, message 1") && error.contains("\"cbor\""), "{error}");
}

/// Writes CDR: numbers at multiples of their size behind the head.
struct Cdr {
    bytes: Vec<u8>,
    is_little: bool,
}

impl Cdr {
    fn new(is_little: bool, t: i64) -> Self {
        let mut cdr = Self { bytes: vec![0, u8::from(is_little), 0, 0], is_little };
        cdr.put(((t / S) as u32).to_le_bytes()).put(((t % S) as u32).to_le_bytes()).text("optical");
        cdr
    }

    fn put<const N: usize>(&mut self, mut little: [u8; N]) -> &mut Self {
        while (self.bytes.len() - 4) % N != 0 {
            self.bytes.push(0);
        }
        if !self.is_little {
            little.reverse();
        }
        self.bytes.extend(little);
        self
    }

    fn u32(&mut self, n: u32) -> &mut Self {
        self.put(n.to_le_bytes())
    }

    fn f64s(&mut self, list: &[f64]) -> &mut Self {
        list.iter().for_each(|x| {
            self.put(x.to_le_bytes());
        });
        self
    }

    fn text(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.bytes());
        self.bytes.push(0);
        self
    }

    fn data(&mut self, data: &[u8]) -> &mut Self {
        self.u32(data.len() as u32);
        self.bytes.extend(data);
        self
    }

    fn finish(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }
}

/// A bag of six frames with an inertial sample after each.
fn bag(is_little: bool, is_packed: bool) -> Vec<Entry> {
    let l = lens();
    let Distortion::RadialTangential(d) = l.distortion else { panic!() };
    let mut info = Cdr::new(is_little, START);
    info.u32(l.height).u32(l.width).text("rational_polynomial").u32(8).f64s(&d);
    info.f64s(&[l.fx, 0.0, l.cx - 0.5, 0.0, l.fy, l.cy - 0.5, 0.0, 0.0, 1.0]).f64s(&[0.0; 9 + 12]);
    info.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0);
    let mut entries = vec![(ROS_INFO, START, info.finish())];
    for i in 0..6 {
        let t = START + i * STEP;
        let mut image = Cdr::new(is_little, t);
        if is_packed {
            image.text("rgb8; png compressed").data(&encoded(&picture(i), image::ImageFormat::Png));
        } else {
            image.u32(SIZE.1 as u32).u32(SIZE.0 as u32).text("rgb8").put([0u8]).u32(3 * SIZE.0 as u32);
            image.data(picture(i).pixels().as_flattened());
        }
        let mut imu = Cdr::new(is_little, t + STEP / 2);
        imu.f64s(&[0.0; 4 + 9])
            .f64s(&[0.1, 0.2, i as f64])
            .f64s(&[0.0; 9])
            .f64s(&[0.0, 0.0, 9.81])
            .f64s(&[0.0; 9]);
        // Written a moment after it was taken.
        let line = if is_packed { ROS_PACKED } else { ROS_IMAGE };
        entries.push((line, t + 3_000_000, image.finish()));
        entries.push((ROS_IMU, t + STEP / 2 + 1_000_000, imu.finish()));
    }
    entries
}

#[test]
fn bags_of_ros_2_are_read() {
    for (is_little, is_packed) in [(true, true), (true, false), (false, false)] {
        for options in [chunked(), chunked().use_chunks(false), chunked().calculate_chunk_crcs(false)] {
            let bytes = write(options, &bag(is_little, is_packed));
            let mut source = source(&bytes).unwrap();
            assert_eq!(source.rig().unwrap().lens, lens());
            let found = frames(&mut source);
            assert_eq!(found.len(), 6);
            for (i, got) in found.iter().enumerate() {
                assert_eq!((got.sequence, got.t_mid), (i as u64, frame(i as i64).t_mid));
                assert_eq!(*got.pixels, picture(i as i64));
            }
            assert_eq!(source.damage().warnings(), 0);
            let mut imu = ReplayImu::new("replay:test", Cursor::new(bytes.as_slice())).unwrap();
            let mut samples = Vec::new();
            imu.samples_until(Timestamp(i64::MAX), &mut samples).unwrap();
            assert_eq!(samples.len(), 6);
            assert_eq!(samples[4].gyro_rad_s, [0.1, 0.2, 4.0]);
            assert_eq!(samples[4].accel_m_s2, [0.0, 0.0, 9.81]);
            assert_eq!(samples[4].t.0, START + 4 * STEP + STEP / 2);
        }
    }
}

/// Each message cut at each place: an error or a message, and no panic; nothing is filled in.
#[test]
fn cut_messages_of_a_bag_are_refused() {
    let entries = bag(true, false);
    for (which, (_, _, content)) in entries.iter().take(3).enumerate() {
        for keep in (0..content.len()).step_by(1 + content.len() / 97) {
            let mut cut = entries.clone();
            cut[which].2.truncate(keep);
            let bytes = write(chunked(), &cut);
            match source(&bytes) {
                // What follows the matrix of a calibration does not matter.
                Ok(mut source) => {
                    let found = frames(&mut source).len();
                    assert_eq!(found, if which == 1 { 5 } else { 6 }, "message {which}, {keep} bytes");
                }
                Err(error) => assert!(which == 0 && error.kind == ErrorKind::Refused, "{error}"),
            }
        }
    }
}

#[test]
fn sizes_are_refused_before_memory_is_taken() {
    let huge = |width: u32, height: u32| {
        let mut entries = plain();
        entries[0].2 = messages::write_calibration(Timestamp(START), &Lens { width, height, ..lens() });
        source(&write(chunked(), &entries)).err().unwrap().to_string()
    };
    for (width, height) in [(u32::MAX, u32::MAX), (16_384, 16_384), (16_385, 1), (0, 5)] {
        let error = huge(width, height);
        assert!(
            error.contains("/camera/calibration, message 1") && error.contains("width x height"),
            "{error}"
        );
    }
    // A PNG whose head says 22000 x 22000, gray, and which holds a few bytes.
    let mut png = encoded(&picture(0), image::ImageFormat::Png);
    png[16..24].copy_from_slice(&[0, 0, 0x55, 0xf0, 0, 0, 0x55, 0xf0]);
    let crc = !png[12..29].iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    });
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    let mut entries = plain();
    entries[2].2 = packed_message(START, &png, "png");
    let bytes = write(chunked(), &entries);
    let error = source(&bytes).unwrap().next(Timestamp(i64::MAX)).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Refused);
    assert!(error.to_string().contains("22000 x 22000, must be 48 x 32"), "{error}");
}

/// Frames of a file: their times and pixels.
fn frames_of(path: &std::path::Path) -> (Vec<RawFrame>, u64) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut source = ReplaySource::new("replay:case", file).unwrap();
    let found = frames(&mut source);
    (found, source.damage().messages)
}

#[test]
fn the_handed_cases_give_what_is_right() {
    let Some(shared) = support::shared("foreign recordings") else { return };
    let cases = shared.join("cases");
    if !cases.is_dir() {
        return support::skipped("foreign recordings: no cases in the shared data");
    }
    let case = |name: &str| frames_of(&cases.join(name));
    for (name, count, refused) in [
        ("jpeg-cut-in-recording/input.mcap", 4, 2),
        ("mcap-clock-steps-back/input.mcap", 6, 0),
        ("mcap-protobuf-calibration/input.mcap", 6, 0),
        ("mcap-ros-format-string/input.mcap", 6, 0),
    ] {
        let (found, bad) = case(name);
        assert_eq!((found.len(), bad), (count, refused), "{name}");
        assert!(found.windows(2).all(|w| w[0].t_mid < w[1].t_mid), "{name}");
    }
    for (name, same) in [
        ("mcap-without-chunks/input.mcap", "mcap-without-chunks/same-with-chunks.mcap"),
        ("mjpeg-without-huffman-tables/input.mcap", "mjpeg-without-huffman-tables/same-with-tables.mcap"),
    ] {
        let ((a, _), (b, _)) = (case(name), case(same));
        assert_eq!(a.len(), 6, "{name}");
        assert!(a.iter().zip(&b).all(|(a, b)| (a.t_mid, &a.pixels) == (b.t_mid, &b.pixels)), "{name}");
    }
    for (name, why) in
        [("m_cal_wmax.mcap", "4294967295 x 4294967295"), ("m_pngbomb22k.mcap", "22000 x 22000")]
    {
        let file = std::io::BufReader::new(std::fs::File::open(shared.join("bombs").join(name)).unwrap());
        let error = ReplaySource::new("replay:bomb", file)
            .and_then(|mut source| source.next(Timestamp(i64::MAX)).map(|_| ()))
            .unwrap_err();
        assert!(error.kind == ErrorKind::Refused && error.to_string().contains(why), "{name}: {error}");
    }
}
