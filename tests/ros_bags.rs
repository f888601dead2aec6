//! ROS 2's bags (MCAP, CDR): pictures, calibration and inertial samples, found by their schemas.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/foreign.rs"]
mod foreign;

use foreign::*;
use halflight::device::replay::ReplayImu;
use halflight::device::{ErrorKind, FrameSource, ImuSource};
use halflight::math::lens::Distortion;
use halflight::model::time::Timestamp;
use std::io::Cursor;

const ROS_IMAGE: Line = Line("/cam/image_raw", "sensor_msgs/msg/Image", "cdr");
const ROS_PACKED: Line = Line("/cam/image_raw/compressed", "sensor_msgs/msg/CompressedImage", "cdr");
const ROS_INFO: Line = Line("/cam/camera_info", "sensor_msgs/msg/CameraInfo", "cdr");
const ROS_IMU: Line = Line("/imu/data", "sensor_msgs/msg/Imu", "cdr");

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
        while !(self.bytes.len() - 4).is_multiple_of(N) {
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
