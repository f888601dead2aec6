//! Recordings that other programs write: without chunks or checksums, messages in another order, clocks that are set, Foxglove's
//! schemas in JSON and protobuf, pictures in many formats. Made here by rule; the handed cases as well.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/foreign.rs"]
mod foreign;
mod support;

use foreign::*;
use halflight::device::recording::messages;
use halflight::device::recording::schema::Topic;
use halflight::device::recording::wire::WireWriter;
use halflight::device::replay::{ReplayImu, ReplayOptions, ReplaySource};
use halflight::device::{ErrorKind, FrameSource, ImuSource};
use halflight::math::lens::{Distortion, Lens};
use halflight::model::frame::{Exposure, RawFrame};
use halflight::model::imu::ImuSample;
use halflight::model::time::Timestamp;
use std::io::Cursor;

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
    let json = serde_json::json!({
        "timestamp": json_time(START), "frame_id": "camera", "width": l.width, "height": l.height,
        "distortion_model": "rational_polynomial", "D": d, "K": k,
    });
    let line = Line("/camera/calibration", "foxglove.CameraCalibration", "json");
    entries[0] = (line, START, json.to_string().into_bytes());
    assert_plain(&write(chunked(), &entries), "calibration in JSON");

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
