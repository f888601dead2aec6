//! The wire logs under `tests/recordings/wire`: made by rule, with what must come out of them. Each is read by the parser and,
//! where it is a serial line's, comes through a pseudo-terminal too. `UPDATE_EXPECT=1` makes them anew.

use super::made::{KINDS, RATE_HZ, description, frame, protocol};
use crate::imu::hid::ReportProtocol;
use crate::imu::sample::WireSample;
use crate::imu::wire::Wire;
use crate::imu::wire_log;
use crate::math::dice::Dice;
use crate::model::time::Timestamp;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Longest log, bytes.
const LONGEST: usize = 8 * 1024;
/// Frames of a log.
const FRAMES: usize = 36;
/// What a log of a serial line has gone through; the first five are sound.
const FAULTS: [&str; 11] =
    ["whole", "lumps", "bytes", "late", "fast", "garbage", "cuts", "sums", "jumps", "baud", "lost"];
/// What a log of a HID device has gone through; the first is sound.
const REPORT_FAULTS: [&str; 3] = ["whole", "lost", "short"];
const REPORT_KINDS: [&str; 2] = ["rift", "psvr"];

type Reads = Vec<(Timestamp, Vec<u8>)>;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/recordings/wire")
}

/// What a sensor sends, with a fault; the time of each read and its bytes.
fn reads(kind: &str, fault: &str) -> Reads {
    let mut dice =
        Dice::new(kind.bytes().chain(fault.bytes()).fold(7, |seed, b| seed.wrapping_mul(31) ^ u64::from(b)));
    let mut reads: Reads = Vec::new();
    for k in 0..FRAMES {
        let mut bytes = frame(kind, k, 5);
        let mut t = 1_000_000_000 + k as i64 * 10_000_000 + (dice.unit() * 1e6) as i64;
        match fault {
            "late" if k % 9 == 4 => t += 9_000_000,
            "fast" => t -= k as i64 * 5_000_000,
            "garbage" if k % 6 == 3 => {
                let at = (dice.bits() as usize) % bytes.len();
                let garbage: Vec<u8> = (0..1 + dice.bits() % 30).map(|_| dice.bits() as u8).collect();
                bytes.splice(at..at, garbage);
            }
            "cuts" if k % 6 == 3 => {
                let at = (dice.bits() as usize) % bytes.len();
                bytes.drain(at..(at + 1 + dice.bits() as usize % 8).min(bytes.len()));
            }
            "sums" if k % 6 == 3 => {
                let at = 3 + dice.bits() as usize % (bytes.len() - 5);
                bytes[at] ^= 1 << (dice.bits() % 7);
            }
            // The sensor is put down elsewhere, or begins anew.
            "jumps" if k >= 18 => bytes = frame(kind, k + 700, 9),
            // Nine bits are taken where eight were sent: nothing fits.
            "baud" => bytes = bytes.iter().map(|b| b.rotate_left(3) ^ 0x91).collect(),
            "lost" if (12..16).contains(&k) => continue,
            _ => {}
        }
        reads.push((Timestamp(t), bytes));
    }
    match fault {
        "lumps" => lumps(&reads),
        "bytes" => {
            reads.iter().flat_map(|(t, bytes)| bytes.chunks(5).map(|part| (*t, part.to_vec()))).collect()
        }
        _ => reads,
    }
}

/// Reads of three samples together, as a chip with a timer of 16 ms and more hands them on.
fn lumps(reads: &Reads) -> Reads {
    let whole = |group: &[(Timestamp, Vec<u8>)]| {
        let t = group.last().map_or(Timestamp(0), |read| read.0);
        (t, group.iter().flat_map(|read| read.1.clone()).collect())
    };
    reads.chunks(3).map(whole).collect()
}

/// Reports of a headset that turns slowly.
fn reports(kind: &str, fault: &str) -> Reads {
    let mut reads: Reads = Vec::new();
    for k in 0..40u32 {
        let mut report = vec![0u8; 64];
        let clock = (2000 * k).wrapping_add(4_294_960_000);
        if kind == "rift" {
            (report[0], report[3]) = (11, 2);
            report[8..12].copy_from_slice(&clock.to_le_bytes());
            for (at, values) in [
                (12, [100, 98_066, i64::from(k)]),
                (20, [2000, -300, 40]),
                (28, [90, 98_000, 7]),
                (36, [2010, -310, 50]),
            ] {
                let bits = values.iter().fold(0u64, |all, v| all << 21 | (v.cast_unsigned() & 0x1F_FFFF));
                report[at..at + 8].copy_from_slice(&(bits << 1).to_be_bytes());
            }
        } else {
            for (at, later) in [(16, 0), (32, 500)] {
                report[at..at + 4].copy_from_slice(&clock.wrapping_add(later).to_le_bytes());
                for (i, value) in [30i16, -7, 12, 16_384, 100, k as i16].iter().enumerate() {
                    report[at + 4 + 2 * i..at + 6 + 2 * i].copy_from_slice(&value.to_le_bytes());
                }
            }
        }
        match fault {
            "lost" if k % 8 > 5 => continue,
            "short" if k % 8 == 5 => report.truncate(30),
            _ => {}
        }
        reads.push((Timestamp(1_000_000_000 + i64::from(k) * 2_000_000), report));
    }
    reads
}

fn log_text(device: &str, reads: &Reads) -> String {
    let mut text = format!("{}\n# device {device}\n", wire_log::HEAD);
    for (t, bytes) in reads {
        let _ = write!(text, "{}.{:09} ", t.0 / 1_000_000_000, t.0 % 1_000_000_000);
        bytes.iter().for_each(|byte| {
            let _ = write!(text, "{byte:02x}");
        });
        text.push('\n');
    }
    text
}

fn line(sample: &WireSample) -> String {
    let mut text = format!("{}", sample.arrival.0 / 1000);
    let mut put = |name: &str, values: &[f64]| {
        let _ = write!(text, " {name}");
        // No minus before a zero.
        values.iter().for_each(|v| {
            let _ = write!(text, " {:.4}", v + 0.0);
        });
    };
    if let Some(q) = sample.orientation {
        put("q", &[q.w, q.x, q.y, q.z]);
    }
    if let Some(gyro) = sample.gyro_rad_s {
        put("w", &gyro);
    }
    if let Some(accel) = sample.accel_m_s2 {
        put("a", &accel);
    }
    text + "\n"
}

fn parsed(kind: &str, reads: &Reads) -> (String, u64) {
    let mut text = String::from("# arrival in us, q = w x y z, w = rad/s, a = m/s^2\n");
    let mut count = 0;
    if REPORT_KINDS.contains(&kind) {
        let rig = description_without_protocol();
        let protocol = ReportProtocol::choose(Some(kind), &rig, (0, 0)).unwrap();
        let mut foreign = 0;
        for (t, report) in reads {
            let is_own = protocol.read(report, *t, &mut |sample| {
                text.push_str(&line(&sample));
                count += 1;
            });
            foreign += u32::from(!is_own);
        }
        let _ = writeln!(text, "# {count} samples, {foreign} other reports");
    } else {
        let mut wire = Wire::new(&protocol(kind), RATE_HZ);
        for (t, bytes) in reads {
            wire.feed(bytes, *t, |sample| text.push_str(&line(&sample)));
        }
        count = wire.counts().samples;
        let _ = writeln!(text, "# {:?}", wire.counts());
    }
    (text, count)
}

fn description_without_protocol() -> crate::imu::description::ImuDescription {
    crate::imu::description::ImuDescription::default()
}

/// Kind, fault, and what was sent.
fn all() -> Vec<(&'static str, &'static str, Reads)> {
    let lines =
        KINDS.iter().flat_map(|kind| FAULTS.iter().map(move |fault| (*kind, *fault, reads(kind, fault))));
    let headsets = REPORT_KINDS
        .iter()
        .flat_map(|kind| REPORT_FAULTS.iter().map(move |fault| (*kind, *fault, reports(kind, fault))));
    lines.chain(headsets).collect()
}

#[test]
fn logs_are_as_they_were_made_and_read_as_expected() {
    let is_update = std::env::var_os("UPDATE_EXPECT").is_some_and(|value| value == "1");
    let mut bad = Vec::new();
    for (kind, fault, reads) in all() {
        let (log, expected) =
            (folder().join(format!("{kind}_{fault}.log")), folder().join(format!("{kind}_{fault}.txt")));
        let text = log_text(&format!("{kind}, {fault}"), &reads);
        assert!(text.len() < LONGEST, "{kind}_{fault}: {}", text.len());
        if is_update {
            std::fs::create_dir_all(folder()).unwrap();
            std::fs::write(&log, &text).unwrap();
        }
        let kept = std::fs::read_to_string(&log).unwrap_or_default().replace("\r\n", "\n");
        if kept != text {
            bad.push(format!("{}: is not what the rule makes", log.display()));
            continue;
        }
        let (got, count) = parsed(kind, &wire_log::read(&kept).unwrap());
        let is_sound = FAULTS[..5].contains(&fault);
        assert!(fault != "baud" || count == 0, "{kind}: {count} samples at another baud rate");
        assert!(!is_sound || count as usize >= FRAMES - 4, "{kind}_{fault}: {count}");
        if is_update {
            std::fs::write(&expected, &got).unwrap();
        }
        if std::fs::read_to_string(&expected).unwrap_or_default().replace("\r\n", "\n") != got {
            bad.push(format!(
                "{}: the parser says otherwise (UPDATE_EXPECT=1 writes it)",
                expected.display()
            ));
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(all().len() >= 40);
}

#[cfg(feature = "serial")]
#[test]
fn logs_come_through_a_terminal_as_through_the_parser() {
    use crate::clock::{Clock, MonotonicClock};
    use crate::imu::serial::tests::pair;
    use crate::open::{ImuOptions, open_imu};
    use std::io::Write as _;
    let clock: std::sync::Arc<dyn Clock> = std::sync::Arc::new(MonotonicClock::new());
    for (kind, fault, reads) in all().into_iter().filter(|(kind, ..)| KINDS.contains(kind)) {
        // Groups, gates and the framing do not look at times as long as no silence is long; so counts are equal.
        let (_, want) = parsed(kind, &reads);
        let (mut master, path) = pair();
        let name = format!("serial:{path},protocol={kind},rate={RATE_HZ}");
        let options = ImuOptions { description: description(), ..ImuOptions::default() };
        let mut imu = open_imu(&name, std::sync::Arc::clone(&clock), options).unwrap();
        let mut got = 0;
        for (_, bytes) in &reads {
            master.write_all(bytes).unwrap();
            while imu.next(clock.now().plus_seconds(0.001)).is_ok() {
                got += 1;
            }
        }
        while imu.next(clock.now().plus_seconds(0.05)).is_ok() {
            got += 1;
        }
        // Rates of fusing sensors begin with the second sample; times of a loaded machine may cost one.
        let lost = i64::try_from(want).unwrap() - got;
        assert!((0..=4).contains(&lost), "{kind}_{fault}: {got} of {want}");
    }
}
