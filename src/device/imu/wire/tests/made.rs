//! Streams made by rule: a head that turns, as each protocol states it.

use crate::imu::description::ImuDescription;
use crate::imu::wire::resync::sum8;
use crate::imu::wire::{Protocol, described::crc16};
use crate::math::dice::Dice;
use std::io::Write as _;

/// The protocols that streams are made for.
pub const KINDS: [&str; 4] = ["rvc", "witmotion", "ypr", "described"];

/// Samples a second of the streams.
pub const RATE_HZ: f64 = 100.0;

/// The table of the described protocol.
pub const TABLE: &str = "[imu]\nprotocol = \"described\"\naxes = [\"x\", \"-y\", \"-z\"]\n[imu.frame]\nheader = [0xA5, 0x5A]\nlength = 17\n\
checksum = \"crc16\"\nsum_at = 15\ncounter = { offset = 2, type = \"u8\" }\n\
[[imu.field]]\noffset = 3\ntype = \"i16le\"\nscale = 0.001\nto = \"gyro.x\"\n[[imu.field]]\noffset = 5\ntype = \"i16le\"\nscale = 0.001\nto = \"gyro.y\"\n\
[[imu.field]]\noffset = 7\ntype = \"i16le\"\nscale = 0.001\nto = \"gyro.z\"\n[[imu.field]]\noffset = 9\ntype = \"i16le\"\nscale = 0.005\nto = \"accel.x\"\n\
[[imu.field]]\noffset = 11\ntype = \"i16le\"\nscale = 0.005\nto = \"accel.y\"\n[[imu.field]]\noffset = 13\ntype = \"i16le\"\nscale = 0.005\nto = \"accel.z\"\n";

/// What the rig says of the described protocol.
pub fn description() -> ImuDescription {
    ImuDescription::from_toml(TABLE).unwrap().unwrap()
}

/// The protocol by its name.
pub fn protocol(kind: &str) -> Protocol {
    description().serial_protocol(Some(kind)).unwrap()
}

/// Angles in degrees, rates in rad/s, forces in g of a moment; with the noise of a good sensor.
struct SensorMoment {
    yaw_pitch_roll: [f64; 3],
    gyro: [f64; 3],
    accel_g: [f64; 3],
}

fn moment(k: usize, dice: &mut Dice) -> SensorMoment {
    let t = k as f64 / RATE_HZ;
    let wave = |size: f64, hz: f64, phase: f64| size * (std::f64::consts::TAU * hz * t + phase).sin();
    let mut noisy = |value: f64, sigma: f64| value + sigma * dice.normal();
    SensorMoment {
        yaw_pitch_roll: [
            noisy(wave(40.0, 0.31, 0.4), 0.02),
            noisy(wave(20.0, 0.47, 1.0), 0.02),
            noisy(wave(9.0, 0.23, 2.0), 0.02),
        ],
        gyro: [noisy(wave(0.6, 0.4, 0.1), 0.003), noisy(wave(1.0, 0.3, 0.9), 0.003), noisy(0.1, 0.003)],
        accel_g: [noisy(wave(0.2, 0.5, 0.3), 0.005), noisy(wave(0.1, 0.8, 0.0), 0.005), noisy(0.98, 0.005)],
    }
}

fn put(frame: &mut Vec<u8>, value: f64) {
    frame.extend((value.round() as i16).to_le_bytes());
}

fn wit(kind: u8, values: [f64; 4]) -> Vec<u8> {
    let mut frame = vec![0x55, kind];
    values.iter().for_each(|value| put(&mut frame, value * 32_768.0));
    frame.push(sum8(&frame));
    frame
}

/// The bytes of sample `k` of a stream. Equal `k` and seed give equal bytes.
pub fn frame(kind: &str, k: usize, seed: u64) -> Vec<u8> {
    let m = moment(k, &mut Dice::new(seed ^ (k as u64).wrapping_mul(0x9E37_79B9)));
    let [yaw, pitch, roll] = m.yaw_pitch_roll;
    let mut frame = Vec::new();
    match kind {
        "rvc" => {
            frame.extend([0xAA, 0xAA, (k % 256) as u8]);
            [yaw, pitch, roll].iter().for_each(|angle| put(&mut frame, angle * 100.0));
            m.accel_g.iter().for_each(|g| put(&mut frame, g * 1000.0));
            frame.extend([0, 0, 0]);
            frame.push(sum8(&frame[2..]));
        }
        "witmotion" => {
            let [x, y, z] = m.accel_g.map(|g| g / 16.0);
            frame.extend(wit(0x51, [x, y, z, 0.1]));
            let [x, y, z] = m.gyro.map(|rate| rate.to_degrees() / 2000.0);
            frame.extend(wit(0x52, [x, y, z, 0.1]));
            frame.extend(wit(0x53, [roll / 180.0, pitch / 180.0, yaw / 180.0, 0.1]));
        }
        "ypr" => write!(frame, "#YPR={yaw:.2},{pitch:.2},{roll:.2}\r\n").unwrap(),
        _ => {
            frame.extend([0xA5, 0x5A, (k % 256) as u8]);
            m.gyro.iter().for_each(|rate| put(&mut frame, rate / 0.001));
            m.accel_g.iter().for_each(|g| put(&mut frame, g * 9.80665 / 0.005));
            frame.extend(crc16(&frame).to_le_bytes());
        }
    }
    frame
}
