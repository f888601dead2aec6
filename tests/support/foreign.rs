//! Recordings as other programs write them, made by rule: six frames with their exposures, in a file of any kind.
#![allow(dead_code)]

use halflight::device::recording::schema::{Topic, schema};
use halflight::device::recording::wire::WireWriter;
use halflight::device::recording::{PictureCoding, messages, pictures};
use halflight::device::replay::ReplaySource;
use halflight::device::{DeviceError, ErrorKind, FrameSource};
use halflight::math::lens::{Distortion, Lens};
use halflight::model::frame::{Exposure, RawFrame};
use halflight::model::image::Rgb8Image;
use halflight::model::time::Timestamp;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

pub const SIZE: (usize, usize) = (48, 32);
pub const S: i64 = 1_000_000_000;
pub const START: i64 = 1_700_000_000 * S;
pub const STEP: i64 = S / 30;

pub fn lens() -> Lens {
    Lens {
        distortion: Distortion::RadialTangential([0.1, -0.02, 1e-3, -2e-3, 0.003, 0.0, 0.0, 0.0]),
        ..Lens::pinhole(SIZE.0 as u32, SIZE.1 as u32, 40.3, 40.7, 24.25, 16.5)
    }
}

pub fn picture(i: i64) -> Rgb8Image {
    let pixel = |p: usize| [(p % SIZE.0 * 5) as u8, (p / SIZE.0 * 7) as u8, (17 * i) as u8];
    Rgb8Image::from_pixels(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).map(pixel).collect()).unwrap()
}

pub fn frame(i: i64) -> RawFrame {
    let exposure = Exposure { time_s: [0.01, 0.02][i as usize % 2], gain: 1.5 };
    RawFrame {
        sequence: i as u64,
        t_mid: Timestamp(START + i * STEP),
        exposure,
        sensor: None,
        row_time_s: 0.0,
        response: None,
        pixels: Arc::new(picture(i)),
    }
}

/// A channel: topic, schema, its encoding, the messages' encoding.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Line(pub &'static str, pub &'static str, pub &'static str);

/// A message of a channel at a time of the log.
pub type Entry = (Line, i64, Vec<u8>);

pub fn own(topic: Topic) -> Line {
    let (name, encoding, _) = schema(topic, false);
    Line(topic.name(), name, if encoding == "jsonschema" { "json" } else { "protobuf" })
}

pub fn write(options: mcap::WriteOptions, entries: &[Entry]) -> Vec<u8> {
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

pub fn chunked() -> mcap::WriteOptions {
    mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)).compression_threads(0)
}

pub fn calibration() -> Entry {
    (own(Topic::Calibration), START, messages::write_calibration(Timestamp(START), &lens()))
}

/// A picture of ours as PNG.
pub fn image(i: i64) -> Entry {
    let t = START + i * STEP;
    (own(Topic::Image), t, pictures::write_image(Timestamp(t), &picture(i), PictureCoding::Png).unwrap())
}

pub fn exposure(i: i64) -> Entry {
    (own(Topic::Exposure), START + i * STEP, messages::write_exposure(&frame(i)))
}

/// As our own recordings are: six frames.
pub fn plain() -> Vec<Entry> {
    let mut all = vec![calibration()];
    (0..6).for_each(|i| all.extend([exposure(i), image(i)]));
    all
}

pub fn source(bytes: &[u8]) -> Result<ReplaySource<Cursor<&[u8]>>, DeviceError> {
    ReplaySource::new("replay:test", Cursor::new(bytes))
}

pub fn frames(source: &mut impl FrameSource) -> Vec<RawFrame> {
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
pub fn assert_plain(bytes: &[u8], what: &str) {
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

pub fn encoded(image: &Rgb8Image, format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let samples = image.pixels().as_flattened().to_vec();
    let buffer = image::RgbImage::from_raw(image.width() as u32, image.height() as u32, samples).unwrap();
    buffer.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub fn jpeg_of(i: i64) -> Vec<u8> {
    encoded(&picture(i), image::ImageFormat::Jpeg)
}

/// `foxglove.CompressedImage` in protobuf.
pub fn packed_message(t: i64, data: &[u8], format: &str) -> Vec<u8> {
    let mut w = WireWriter::new();
    w.message(1, |w| {
        w.varint(1, (t / S) as u64).varint(2, (t % S) as u64);
    });
    w.bytes(4, b"camera").bytes(2, data).bytes(3, format.as_bytes());
    w.finish()
}

pub fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = three.iter().fold(0u32, |n, b| n << 8 | u32::from(*b)) << (8 * (3 - three.len()));
        (0..=three.len()).for_each(|k| text.push(LETTERS[(bits >> (18 - 6 * k)) as usize & 63] as char));
        (three.len()..3).for_each(|_| text.push('='));
    }
    text
}
