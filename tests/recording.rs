//! Recordings: what goes in comes out; damaged files give what is whole, or a clear error, and never a panic.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::{DQuat, DVec3};
use halflight::device::recording::{PictureCoding, RecordingReader, RecordingWriter, Setup, Topic, Written};
use halflight::device::replay::{ReplayImu, ReplaySource};
use halflight::device::{DeviceError, ErrorKind, FrameSource, ImuSource, ImuTruth, Truth};
use halflight::math::lens::{Distortion, Lens};
use halflight::math::pose::Pose;
use halflight::model::estimate::{PoseEstimate, Provenance};
use halflight::model::frame::{Exposure, RawFrame};
use halflight::model::image::Rgb8Image;
use halflight::model::imu::ImuSample;
use halflight::model::light::RadianceSh;
use halflight::model::response::Response;
use halflight::model::rig::{MirrorBall, Rig, TagPlacement};
use halflight::model::time::Timestamp;
use proptest::prelude::*;
use std::io::Cursor;
use std::sync::{Arc, OnceLock};

const SIZE: (usize, usize) = (32, 24);
const NEVER: Timestamp = Timestamp(i64::MAX);

fn rig() -> Rig {
    let (w, h) = SIZE;
    Rig {
        lens: Lens {
            distortion: Distortion::RadialTangential([0.1, -0.02, 1e-3, -2e-3, 0.003, 0.01, 0.0, 0.0]),
            ..Lens::pinhole(w as u32, h as u32, 40.3, 40.7, 16.21, 11.93)
        },
        tags: vec![TagPlacement {
            id: 7,
            side_m: 0.0871,
            world_from_tag: Pose::new(DQuat::from_xyzw(0.9, 0.1, -0.3, 0.2), DVec3::new(0.1, 0.2, 1.0 / 3.0)),
        }],
        ball: Some(MirrorBall {
            surface_radius_m: None,
            centre_world: DVec3::new(-0.2, 0.04, 0.06),
            radius_m: 0.06,
            reflectance_rgb: [0.9, 0.89, 0.87],
        }),
    }
}

fn setup() -> Setup {
    let imu_truth = ImuTruth {
        gyro_bias_rad_s: [0.01, -0.02, 0.1 / 3.0],
        accel_bias_m_s2: [0.1, 0.2, -0.7],
        time_offset_s: 0.004,
        gyro_noise_rad_s: 0.003,
        accel_noise_m_s2: 0.03,
    };
    Setup {
        rig: Some(rig()),
        response: Some(Response::srgb()),
        imu_truth: Some(imu_truth),
        ..Setup::default()
    }
}

fn frame(i: u64) -> RawFrame {
    let pixels = (0..SIZE.0 * SIZE.1)
        .map(|p| std::array::from_fn(|c| (((p * 7 + c * 31) as u64 * (i + 3) * 2_654_435_761) >> 13) as u8))
        .collect();
    RawFrame {
        sequence: i,
        t_mid: Timestamp(1_000_000_000 + i as i64 * 33_333_333),
        exposure: Exposure { time_s: [1.0 / 3840.0, 1.0 / 480.0, 1.0 / 60.0][i as usize % 3], gain: 1.5 },
        pixels: Arc::new(Rgb8Image::from_pixels(SIZE.0, SIZE.1, pixels).unwrap()),
        sensor: None,
        row_time_s: 0.0,
        response: None,
    }
}

fn truth(i: u64) -> Truth {
    let mut light = RadianceSh::zero(6);
    for (k, row) in light.rgb.iter_mut().enumerate() {
        *row = [k as f32 / 3.0, (i as f32 + 0.1) / 7.0, -(k as f32).sqrt()];
    }
    let rotation = DQuat::from_xyzw(0.1 * i as f64, 0.7, -0.2, 0.3);
    Truth {
        pose: PoseEstimate {
            t: frame(i).t_mid,
            world_from_camera: Pose::new(rotation, DVec3::new(0.1, 1.0 / 3.0, i as f64 / 7.0)),
            provenance: Provenance::Measured,
            sigma_position_m: 0.0,
            sigma_rotation_rad: 0.0,
        },
        light,
        to_light_world: [0.1, 0.2, 0.97],
    }
}

fn sample(i: u64) -> ImuSample {
    let x = i as f64 / 3.0;
    ImuSample {
        t: Timestamp(1_000_000_000 + i as i64 * 5_000_000),
        gyro_rad_s: [x, -x, 0.1],
        accel_m_s2: [0.1 * x, 9.81, x.sin()],
    }
}

/// `frames` frames, with the inertial samples up to each one.
fn record(frames: u64, coding: PictureCoding, setup: Setup) -> (Written, Vec<u8>) {
    let mut writer = RecordingWriter::new("test", Cursor::new(Vec::new()), coding, setup).unwrap();
    let mut next = 0;
    for i in 0..frames {
        writer.write_frame(&frame(i), Some(&truth(i))).unwrap();
        while sample(next).t <= frame(i).t_mid {
            writer.write_imu(&[sample(next)]).unwrap();
            next += 1;
        }
    }
    let (written, target) = writer.finish().unwrap();
    (written, target.into_inner())
}

/// 75 frames in three chunks of a second each.
fn three_chunks() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let (written, bytes) = record(75, PictureCoding::Raw, setup());
        assert_eq!((written.frames, written.chunks), (75, 3));
        bytes
    })
}

fn open(bytes: &[u8]) -> Result<ReplaySource<Cursor<&[u8]>>, DeviceError> {
    ReplaySource::new("replay:test", Cursor::new(bytes))
}

/// All frames until the end, and how it ended.
fn drain(source: &mut impl FrameSource) -> (Vec<RawFrame>, DeviceError) {
    let mut frames = Vec::new();
    loop {
        match source.next(NEVER) {
            Ok(frame) => frames.push(frame),
            Err(error) => return (frames, error),
        }
    }
}

fn assert_same(a: &RawFrame, b: &RawFrame) {
    assert_eq!((a.sequence, a.t_mid, a.exposure), (b.sequence, b.t_mid, b.exposure));
    assert_eq!(a.pixels, b.pixels);
}

#[test]
fn what_is_recorded_comes_back_bit_for_bit() {
    for coding in [PictureCoding::Raw, PictureCoding::Png] {
        let (_, bytes) = record(40, coding, setup());
        let mut source = open(&bytes).unwrap();
        assert_eq!(source.rig(), Some(rig()));
        assert_eq!(source.response(), Some(Response::srgb()));
        assert_eq!(source.frames_left(), Some(40));
        assert_eq!(source.set_exposures(&[]).unwrap().len(), 3);
        for i in 0..40 {
            assert_same(&source.next(NEVER).unwrap(), &frame(i));
            assert_eq!(source.truth(), Some(truth(i)));
        }
        assert_eq!(source.next(NEVER).unwrap_err().kind, ErrorKind::Ended);
        assert_eq!(source.damage().warnings(), 0);
    }
}

#[test]
fn inertial_samples_come_back_up_to_the_time_asked_for() {
    let mut imu = ReplayImu::new("replay:test", Cursor::new(three_chunks())).unwrap();
    assert_eq!(imu.imu_truth(), setup().imu_truth);
    let mut out = Vec::new();
    imu.samples_until(sample(10).t, &mut out).unwrap();
    assert_eq!(out, (0..=10).map(sample).collect::<Vec<_>>());
    imu.samples_until(NEVER, &mut out).unwrap();
    let all = (0..).map(sample).take_while(|s| s.t <= frame(74).t_mid).count();
    assert_eq!(out.len(), all);
    assert_eq!(out, (0..all as u64).map(sample).collect::<Vec<_>>());
}

#[test]
fn jpeg_is_close_and_much_smaller() {
    let smooth = |i: u64| {
        let pixels = (0..SIZE.0 * SIZE.1)
            .map(|p| [(p % SIZE.0 * 6) as u8, (p / SIZE.0 * 9) as u8, 40 + i as u8])
            .collect();
        RawFrame { pixels: Arc::new(Rgb8Image::from_pixels(SIZE.0, SIZE.1, pixels).unwrap()), ..frame(i) }
    };
    let target = Cursor::new(Vec::new());
    let mut writer = RecordingWriter::new("test", target, PictureCoding::Jpeg(95), setup()).unwrap();
    writer.write_frame(&smooth(0), None).unwrap();
    let bytes = writer.finish().unwrap().1.into_inner();
    let mut source = open(&bytes).unwrap();
    let back = source.next(NEVER).unwrap();
    assert_eq!(source.truth(), None);
    let original = smooth(0);
    let largest = back.pixels.pixels().iter().flatten().zip(original.pixels.pixels().iter().flatten());
    // A smooth gradient at quality 95 with colour at full resolution.
    assert!(largest.map(|(a, b)| a.abs_diff(*b)).max().unwrap() <= 6);
}

#[test]
fn equal_input_gives_equal_files() {
    assert_eq!(record(5, PictureCoding::Png, setup()).1, record(5, PictureCoding::Png, setup()).1);
}

#[test]
fn a_file_cut_anywhere_gives_its_whole_chunks() {
    let bytes = three_chunks();
    // Ends of the chunks, found by reading all cuts with a coarse step and noting where more frames appear.
    let frames_at = |cut: usize| match open(&bytes[..cut]) {
        Ok(mut source) => {
            let (frames, error) = drain(&mut source);
            assert_eq!(error.kind, ErrorKind::Ended);
            for (i, got) in frames.iter().enumerate() {
                assert_same(got, &frame(i as u64));
            }
            let damage = source.damage();
            assert_eq!((damage.chunks, damage.gaps, damage.messages), (0, 0, 0), "cut at {cut}");
            (frames.len(), damage.cut)
        }
        Err(error) => {
            assert_eq!(error.kind, ErrorKind::Refused);
            let text = error.to_string();
            let clear = text.contains("/camera/calibration") || text.contains("does not begin as an MCAP");
            assert!(clear, "cut at {cut}: {text}");
            (0, true)
        }
    };
    let mut last = 0;
    let mut steps = vec![0];
    let cuts = (0..bytes.len()).step_by(601).chain(bytes.len() - 40..=bytes.len());
    for cut in cuts {
        let (frames, cut_noticed) = frames_at(cut);
        assert!(frames >= last, "cut at {cut}: {frames} frames, earlier {last}");
        // Only the end mark may be missing without being noticed.
        assert_eq!(cut_noticed, cut < bytes.len() - 8, "cut at {cut}");
        if frames > last {
            steps.push(frames);
            last = frames;
        }
    }
    // Whole chunks only: a second holds 31 frames at 30 a second.
    assert_eq!(steps, vec![0, 31, 62, 75]);
}

#[test]
fn a_damaged_chunk_is_skipped_and_counted() {
    let mut bytes = three_chunks().to_vec();
    let at = bytes.len() / 2;
    bytes[at] ^= 0x10;
    let mut source = open(&bytes).unwrap();
    let (frames, error) = drain(&mut source);
    assert_eq!(error.kind, ErrorKind::Ended);
    assert_eq!(source.damage().chunks, 1);
    // The middle chunk holds frames 31 to 61.
    assert_eq!(
        frames.iter().map(|f| f.sequence).collect::<Vec<_>>(),
        (0..31).chain(62..75).collect::<Vec<_>>()
    );
}

#[test]
fn without_the_first_chunk_the_summary_and_the_other_chunks_suffice() {
    let mut bytes = three_chunks().to_vec();
    bytes[5000] ^= 1;
    let mut source = open(&bytes).unwrap();
    assert_eq!(source.rig(), Some(rig()));
    let (frames, _) = drain(&mut source);
    assert_eq!(frames.len(), 44);
    assert_eq!(source.damage().chunks, 1);
}

#[test]
fn a_wrong_length_leads_on_to_the_next_chunk() {
    // The length of the second chunk's record: chunks begin with opcode 6 and their own consistent lengths.
    let bytes = three_chunks();
    let is_chunk = |i: &usize| {
        bytes[*i] == 6 && bytes[i + 41..].starts_with(b"zstd") && bytes[i + 37..i + 41] == [4, 0, 0, 0]
    };
    let starts: Vec<usize> = (0..bytes.len() - 60).filter(is_chunk).collect();
    assert_eq!(starts.len(), 3);
    let mut bytes = bytes.to_vec();
    bytes[starts[1] + 2] ^= 0x40;
    let mut source = open(&bytes).unwrap();
    let (frames, _) = drain(&mut source);
    assert_eq!((frames.len(), source.damage().gaps), (44, 1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]
    #[test]
    fn flipped_bits_never_panic_and_never_change_a_frame(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0u8..8), 1..6),
    ) {
        let mut bytes = three_chunks().to_vec();
        for (index, bit) in &flips {
            let at = index.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        match open(&bytes) {
            Err(error) => prop_assert_eq!(error.kind, ErrorKind::Refused),
            Ok(mut source) => {
                let (frames, error) = drain(&mut source);
                prop_assert_eq!(error.kind, ErrorKind::Ended);
                prop_assert!(frames.windows(2).all(|w| w[0].sequence < w[1].sequence));
                for got in &frames {
                    assert_same(got, &frame(got.sequence));
                }
                // Whatever is missing has been noticed.
                prop_assert!(frames.len() == 75 || source.damage().warnings() > 0);
            }
        }
        if let Ok(mut imu) = ReplayImu::new("replay:test", Cursor::new(bytes.as_slice())) {
            let mut out = Vec::new();
            prop_assert!(imu.samples_until(NEVER, &mut out).is_ok());
            prop_assert!(out.windows(2).all(|w| w[0].t < w[1].t));
        }
    }

    #[test]
    fn any_bytes_are_refused_or_read(mut bytes in prop::collection::vec(any::<u8>(), 0..400), magic: bool) {
        if magic && bytes.len() >= 8 {
            bytes[..8].copy_from_slice(&three_chunks()[..8]);
        }
        prop_assert_eq!(open(&bytes).err().map(|e| e.kind), Some(ErrorKind::Refused));
    }
}

fn refusal(bytes: &[u8]) -> String {
    let error = open(bytes).err().unwrap();
    assert_eq!(error.kind, ErrorKind::Refused);
    error.to_string()
}

#[test]
fn empty_and_foreign_files_are_refused() {
    assert!(refusal(&[]).contains("(0 bytes) does not begin as an MCAP recording"));
    assert!(refusal(b"RIFF....AVI LIST").contains("does not begin as an MCAP recording"));
    let (_, empty) = record(0, PictureCoding::Raw, setup());
    assert!(refusal(&empty).contains("/camera/calibration"));
}

#[test]
fn a_missing_calibration_is_named() {
    let (_, bytes) = record(3, PictureCoding::Raw, Setup::default());
    assert!(refusal(&bytes).contains("no camera calibration (topic /camera/calibration"));
}

#[test]
fn a_picture_of_another_size_is_refused_with_both_sizes() {
    let mut other = setup();
    if let Some(rig) = &mut other.rig {
        rig.lens.width = 64;
    }
    let (_, bytes) = record(1, PictureCoding::Png, other);
    let mut source = open(&bytes).unwrap();
    let error = source.next(NEVER).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Refused);
    assert!(error.to_string().contains("32 x 24, must be 64 x 24"), "{error}");
}

#[test]
fn a_calibration_that_makes_no_sense_is_refused() {
    let mut other = setup();
    if let Some(rig) = &mut other.rig {
        rig.lens.fx = f64::NAN;
    }
    let (_, bytes) = record(1, PictureCoding::Png, other);
    assert!(refusal(&bytes).contains("/camera/calibration"));
}

#[test]
fn all_topics_are_defined_with_their_schemas() {
    let mut reader = RecordingReader::open("test", Cursor::new(three_chunks())).unwrap();
    let mut seen: Vec<(Topic, String)> = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        if !seen.iter().any(|(t, _)| *t == message.topic) {
            seen.push((message.topic, message.schema.to_string()));
        }
    }
    seen.sort();
    let expected = [
        (Topic::Image, "foxglove.RawImage"),
        (Topic::Calibration, "foxglove.CameraCalibration"),
        (Topic::Exposure, "halflight.Exposure"),
        (Topic::Imu, "halflight.Imu"),
        (Topic::Rig, "halflight.Rig"),
        (Topic::TruthPose, "foxglove.PoseInFrame"),
        (Topic::TruthLight, "halflight.Truth"),
        (Topic::TruthImu, "halflight.ImuTruth"),
    ];
    assert_eq!(seen, expected.map(|(t, s)| (t, s.to_owned())).to_vec());
    assert_eq!(reader.count(Topic::Image), 75);
}

#[test]
fn the_file_is_a_sound_mcap_file_to_another_reader() {
    // The crate's own readers: summary, statistics and all messages.
    let bytes = three_chunks();
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    assert_eq!(summary.chunk_indexes.len(), 3);
    let images = mcap::MessageStream::new(bytes)
        .unwrap()
        .filter(|m| m.as_ref().is_ok_and(|m| m.channel.topic == "/camera/image"))
        .count();
    assert_eq!(images, 75);
}

#[test]
fn the_bundled_recording_is_whole() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/recordings/desk.mcap");
    // At most 10 MB go into the repository.
    assert!(std::fs::metadata(path).unwrap().len() <= 10_000_000);
    let opened = halflight::device::open::open(path).unwrap();
    let (mut frames, mut imu) = (opened.frames, opened.imu.unwrap());
    assert_eq!(frames.frames_left(), Some(90));
    let rig = frames.rig().unwrap();
    assert_eq!((rig.lens.width, rig.lens.height, rig.tags.len()), (640, 480, 1));
    assert!(rig.ball.is_some() && frames.response().is_some());
    let cycle = frames.set_exposures(&[]).unwrap();
    assert_eq!(cycle.len(), 3);
    let mut light = None;
    for i in 0..90u64 {
        let frame = frames.next(NEVER).unwrap();
        assert_eq!((frame.sequence, frame.exposure), (i, cycle[i as usize % 3]));
        let truth = frames.truth().unwrap();
        assert_eq!(truth.pose.t, frame.t_mid);
        assert_eq!(*light.get_or_insert(truth.light), truth.light);
    }
    assert_eq!(frames.next(NEVER).unwrap_err().kind, ErrorKind::Ended);
    let mut samples = Vec::new();
    imu.samples_until(NEVER, &mut samples).unwrap();
    // 200 a second over 3 s and a little before.
    assert!((600..700).contains(&samples.len()) && imu.imu_truth().is_some());
}
