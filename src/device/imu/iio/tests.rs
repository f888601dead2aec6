use super::*;
use crate::clock::MonotonicClock;
use crate::model::imu::FusedBy;
use std::fs;
use std::io::Write;
use std::path::Path;

/// A folder like sysfs and one like /dev, which goes away at the end.
struct Tree(PathBuf);

impl Drop for Tree {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl Tree {
    fn new(test: &str) -> Self {
        let root = std::env::temp_dir().join(format!("halflight-iio-{test}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&root);
        fs::create_dir_all(root.join("dev")).unwrap();
        fs::create_dir_all(root.join("sys")).unwrap();
        Self(root)
    }

    fn places(&self) -> Places {
        Places { sys: self.0.join("sys"), dev: self.0.join("dev") }
    }

    fn put(&self, file: &str, text: &str) {
        let path = self.0.join("sys").join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn get(&self, file: &str) -> String {
        fs::read_to_string(self.0.join("sys").join(file)).unwrap()
    }

    /// A device with channels of one type, a trigger and a pipe as its node.
    fn device(&self, node: &str, name: &str, channels: &[&str], form: &str) -> PathBuf {
        self.put(&format!("{node}/name"), &format!("{name}\n"));
        for (k, channel) in channels.iter().chain(&["in_timestamp"]).enumerate() {
            let form = if *channel == "in_timestamp" { "le:s64/64>>0\n" } else { form };
            self.put(&format!("{node}/scan_elements/{channel}_type"), form);
            self.put(&format!("{node}/scan_elements/{channel}_index"), &format!("{k}\n"));
        }
        self.put(&format!("{node}/buffer/enable"), "0");
        self.put(&format!("{node}/trigger/current_trigger"), "\n");
        self.put(&format!("{node}/sampling_frequency"), "100.0\n");
        self.put(&format!("trigger{}/name", &node[node.len() - 1..]), &format!("{name}-dev0\n"));
        let path = self.0.join("dev").join(node);
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        path
    }

    fn open(&self, text: &str) -> Result<IioImu, DeviceError> {
        let name = ImuName::parse(text).unwrap().unwrap();
        let clock = Arc::new(MonotonicClock::new());
        IioImu::open(text, &name, &ImuDescription::default(), clock, &self.places())
    }
}

/// The writing end of a pipe whose reading end is open.
fn writer(path: &Path) -> File {
    fs::OpenOptions::new().write(true).open(path).unwrap()
}

fn soon(imu: &IioImu) -> Timestamp {
    imu.clock.now().plus_seconds(1.0)
}

#[test]
fn a_rotation_sensor_is_taken_as_it_is() {
    let tree = Tree::new("rotation");
    let node = tree.device("iio:device0", "dev_rotation", &["in_rot_quaternion"], "le:s32/32X4>>0\n");
    tree.put("iio:device0/current_timestamp_clock", "realtime\n");
    let mut imu = tree.open("iio:name=dev_rotation").unwrap();
    assert_eq!(imu.clocks().collect::<Vec<_>>(), ["monotonic"]);
    assert_eq!(tree.get("iio:device0/trigger/current_trigger"), "dev_rotation-dev0");
    assert_eq!(tree.get("iio:device0/buffer/enable"), "1");
    let mut out = writer(&node);
    for k in 0..30i64 {
        let angle = 0.01 * k as f64;
        let mut record: Vec<u8> = Vec::new();
        for value in [0.0, 0.0, angle.sin(), angle.cos()] {
            record.extend(((value * 1e6) as i32).to_le_bytes());
        }
        record.extend((k * 10_000_000 + 5_000_000_000).to_le_bytes());
        record.extend([0; 8]);
        // A record may come in two reads.
        out.write_all(&record[..7]).unwrap();
        out.write_all(&record[7..]).unwrap();
    }
    let mut last: Option<ImuSample> = None;
    for _ in 0..27 {
        last = Some(imu.next(soon(&imu)).unwrap());
    }
    // Half the quaternion's angle is stated: 0.02 rad in 10 ms.
    assert!((last.unwrap().gyro_rad_s[2] - 2.0).abs() < 0.2, "{last:?}");
    assert_eq!(imu.orientation().unwrap().fused_by, FusedBy::Sensor);
    drop(out);
    let error = loop {
        match imu.next(soon(&imu)) {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    assert_eq!(error.kind, ErrorKind::Reopen, "{error}");
}

#[test]
fn a_gyroscope_is_read_with_the_forces_beside_it() {
    let tree = Tree::new("gyro");
    let gyro = tree.device("iio:device1", "gyro_3d", &sysfs::GYRO, "le:s16/16>>0");
    let accel = tree.device("iio:device2", "accel_3d", &sysfs::ACCEL, "le:s16/16>>0");
    tree.put("iio:device1/in_anglvel_scale", "0.001\n");
    tree.put("iio:device2/in_accel_scale", "0.01\n");
    let mut imu = tree.open("iio:/dev/iio:device1").unwrap();
    assert_eq!(imu.next(imu.clock.now().plus_seconds(0.01)).err().unwrap().kind, ErrorKind::Again);
    let (mut gyro, mut accel) = (writer(&gyro), writer(&accel));
    let record = |values: [i16; 3], k: i64| {
        let mut record: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        record.extend([0, 0]);
        record.extend((k * 10_000_000).to_le_bytes());
        record
    };
    accel.write_all(&record([0, 0, 981], 0)).unwrap();
    gyro.write_all(&record([500, 0, -500], 1)).unwrap();
    let sample = imu.next(soon(&imu)).unwrap();
    assert!((sample.accel_m_s2[2] - 9.81).abs() < 1e-9 && (sample.gyro_rad_s[0] - 0.5).abs() < 1e-9);
}

#[test]
fn what_is_not_there_or_not_enough_is_told() {
    let tree = Tree::new("missing");
    tree.device("iio:device0", "accel_3d", &sysfs::ACCEL, "le:s16/16>>0");
    let error = |text: &str| tree.open(text).err().unwrap();
    let missing = error("iio:name=dev_rotation");
    assert_eq!(missing.kind, ErrorKind::Reopen);
    assert!(
        missing.to_string().contains("iio:name=dev_rotation")
            && missing.to_string().contains("there are: accel_3d")
    );
    let accel = error("iio:name=accel_3d");
    assert!(
        accel.kind == ErrorKind::Refused && accel.to_string().contains("name dev_rotation or gyro_3d"),
        "{accel}"
    );
    assert_eq!(error("iio:/dev/iio:device7").kind, ErrorKind::Reopen);
    tree.put("iio:device0/scan_elements/in_accel_x_type", "le:s99/16>>0");
    assert!(error("iio:name=accel_3d").to_string().contains("in_accel_x: type \"le:s99/16>>0\""));
}
