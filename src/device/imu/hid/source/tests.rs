use super::*;
use crate::clock::ManualClock;
use crate::imu::description::ImuDescription;
use crate::imu::hid::{PROTOCOLS, descriptor, headset_rift};
use crate::model::imu::FusedBy;
use glam::{DQuat, DVec3};

/// Reports by script; the clock goes on by a millisecond with each, or by the wait where there is none.
struct Scripted {
    reports: Vec<Vec<u8>>,
    clock: ManualClock,
    features: usize,
    is_gone_after: bool,
}

impl Reports for Scripted {
    fn read(&mut self, report: &mut [u8], wait_ms: u16) -> Result<usize, String> {
        if self.reports.is_empty() {
            if self.is_gone_after {
                return Err("input/output error".into());
            }
            self.clock.wait_until(self.clock.now().plus_seconds(f64::from(wait_ms) * 1e-3));
            return Ok(0);
        }
        let next = self.reports.remove(0);
        self.clock.wait_until(self.clock.now().plus_seconds(0.002));
        report[..next.len()].copy_from_slice(&next);
        Ok(next.len())
    }

    fn send_feature(&mut self, report: &[u8]) -> Result<(), String> {
        assert_eq!(report, headset_rift::KEEP_ALIVE);
        self.features += 1;
        Ok(())
    }
}

fn rift_report(k: u32) -> Vec<u8> {
    let mut report = vec![0u8; 64];
    (report[0], report[3]) = (11, 2);
    report[8..12].copy_from_slice(&(2000 * k + 1000).to_le_bytes());
    let up = ((98_066u64 << 21) << 1).to_be_bytes();
    report[12..20].copy_from_slice(&up);
    report[28..36].copy_from_slice(&up);
    report
}

fn imu(reports: Vec<Vec<u8>>, is_gone_after: bool) -> (HidImu<Scripted>, ManualClock) {
    let clock = ManualClock::default();
    let scripted = Scripted { reports, clock: clock.clone(), features: 0, is_gone_after };
    let protocol = ReportProtocol::Rift;
    let assembler = Assembler::new(1000.0, protocol.imu_from_sensor(&ImuDescription::default()));
    (HidImu::new("hid:2833:0021", scripted, protocol, assembler, Arc::new(clock.clone()), None), clock)
}

#[test]
fn a_headset_s_reports_become_samples_and_an_orientation() {
    let (mut imu, clock) = imu((0..200).map(rift_report).collect(), true);
    let mut last: Option<ImuSample> = None;
    let mut count = 0;
    let error = loop {
        match imu.next(clock.now().plus_seconds(0.1)) {
            Ok(sample) => {
                assert!(last.is_none_or(|last| sample.t > last.t));
                (last, count) = (Some(sample), count + 1);
            }
            Err(error) => break error,
        }
    };
    assert!(count >= 395, "{count}");
    assert_eq!(error.kind, ErrorKind::Reopen);
    assert!(error.to_string().contains("hid:2833:0021"), "{error}");
    // Up is -y for the samples.
    let accel = DVec3::from(last.unwrap().accel_m_s2);
    assert!(accel.abs_diff_eq(DVec3::new(0.0, -9.8066, 0.0), 1e-3), "{accel}");
    let orientation = imu.orientation().unwrap();
    assert_eq!(orientation.fused_by, FusedBy::Host);
    assert!((orientation.level_from_imu * DVec3::NEG_Y).abs_diff_eq(DVec3::Z, 1e-2));
    assert_eq!(imu.reports.features, 1);
}

#[test]
fn silence_is_again_then_reopen_and_foreign_reports_are_counted() {
    let (mut imu, clock) = imu(vec![vec![1, 2, 3]; 5], false);
    assert_eq!(imu.next(clock.now().plus_seconds(0.5)).err().unwrap().kind, ErrorKind::Again);
    assert_eq!(imu.foreign(), 5);
    let error = imu.next(clock.now().plus_seconds(60.0)).err().unwrap();
    assert!(error.kind == ErrorKind::Reopen && error.to_string().contains("5 other reports"), "{error}");
}

#[test]
fn a_descriptor_that_does_not_fit_is_told() {
    let standard = [0x05, 0x20, 0x09, 0x8A, 0xA1, 0x01, 0x75, 0x08, 0x95, 0x08, 0x81, 0x02, 0xC0];
    let found = descriptor::read(&standard).unwrap();
    let why = check(&found, &ReportProtocol::Rift).unwrap_err();
    assert!(
        why.contains("no report 11 of 64 bytes, but report 0 of 8 bytes") && why.contains("iio:name="),
        "{why}"
    );
}

#[test]
fn protocols_are_chosen_by_name_then_rig_then_numbers() {
    let rig = ImuDescription::default();
    assert_eq!(ReportProtocol::choose(None, &rig, (0x2833, 0x21)).unwrap(), ReportProtocol::Rift);
    assert_eq!(ReportProtocol::choose(Some("psvr"), &rig, (1, 2)).unwrap(), ReportProtocol::Psvr);
    let error = ReportProtocol::choose(Some("rifd"), &rig, (1, 2)).unwrap_err().to_string();
    assert!(error.contains("did you mean \"rift\"?") && error.contains(&PROTOCOLS.join(", ")), "{error}");
    let error = ReportProtocol::choose(None, &rig, (0x1234, 0x5678)).unwrap_err().to_string();
    assert!(error.contains("1234:5678 is not built in"), "{error}");
    assert!(ReportProtocol::choose(Some("described"), &rig, (1, 2)).is_err());
    assert_eq!(ReportProtocol::Rift.imu_from_sensor(&rig), DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0));
}

/// A table that reads rates and forces of a numbered report.
const TABLE: &str = "[imu]\nprotocol = \"described\"\n[imu.frame]\nheader = [3]\nlength = 16\ncounter = { offset = 1, type = \"u8\" }\n";

#[test]
fn a_described_report_is_read() {
    let fields: String = ["gyro.x", "gyro.y", "gyro.z", "accel.x", "accel.y", "accel.z"]
        .iter()
        .enumerate()
        .map(|(k, to)| {
            format!("[[imu.field]]\noffset = {}\ntype = \"i16be\"\nscale = 0.01\nto = \"{to}\"\n", 2 + 2 * k)
        })
        .collect();
    let rig = ImuDescription::from_toml(&format!("{TABLE}{fields}")).unwrap().unwrap();
    let protocol = ReportProtocol::choose(None, &rig, (1, 2)).unwrap();
    assert_eq!(protocol.report(), (3, 16));
    let mut report = [0u8; 16];
    (report[0], report[1], report[3], report[12], report[13]) = (3, 9, 100, 0x03, 0xD5);
    let mut samples = Vec::new();
    assert!(protocol.read(&report, Timestamp(4), &mut |sample| samples.push(sample)));
    assert_eq!(samples[0].gyro_rad_s, Some([1.0, 0.0, 0.0]));
    assert_eq!(samples[0].accel_m_s2.unwrap()[2], 9.81);
    report[0] = 4;
    assert!(!protocol.read(&report, Timestamp(4), &mut |_| panic!("another report")));
}

proptest::proptest! {
    #[test]
    fn any_reports_are_read_or_left(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..100), is_rift: bool) {
        let mut report = bytes;
        if is_rift && !report.is_empty() {
            report.resize(64, 0);
            report[0] = headset_rift::REPORT;
        }
        for protocol in [ReportProtocol::Rift, ReportProtocol::Psvr] {
            let mut count = 0;
            protocol.read(&report, Timestamp(0), &mut |_| count += 1);
            assert!(count <= 2);
        }
    }
}
