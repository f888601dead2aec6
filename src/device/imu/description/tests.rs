use super::*;

/// A table of a frame with an index, a checksum and the six numbers of a raw sensor.
pub(crate) const TEXT: &str = r#"
[imu]
protocol = "described"
baud = 460800
rate_hz = 200
axes = ["-y", "-z", "x"]
[imu.frame]
header = [0xA5, 0x5A]
length = 17
checksum = "crc16"
sum_from = 0
sum_at = 15
counter = { offset = 2, type = "u8" }
[[imu.field]]
offset = 3
type = "i16le"
scale = 0.001
to = "gyro.x"
[[imu.field]]
offset = 5
type = "i16le"
scale = 0.001
to = "gyro.y"
[[imu.field]]
offset = 7
type = "i16le"
scale = 0.001
to = "gyro.z"
[[imu.field]]
offset = 9
type = "i16le"
scale = 0.005
to = "accel.x"
[[imu.field]]
offset = 11
type = "i16le"
scale = 0.005
to = "accel.y"
[[imu.field]]
offset = 13
type = "i16le"
scale = 0.005
to = "accel.z"
"#;

#[test]
fn a_table_is_read() {
    let imu = ImuDescription::from_toml(TEXT).unwrap().unwrap();
    assert_eq!((imu.baud, imu.rate_hz), (Some(460_800), Some(200.0)));
    let frame = imu.frame.as_ref().unwrap();
    assert_eq!((frame.length, frame.fields.len(), frame.counter), (17, 6, Some((2, NumberType::U8))));
    // The samples' x is the sensor's -y.
    assert!((imu.imu_from_sensor * DVec3::NEG_Y).abs_diff_eq(DVec3::X, 1e-12));
    assert!((imu.imu_from_sensor * DVec3::X).abs_diff_eq(DVec3::Z, 1e-12));
    assert!(matches!(imu.serial_protocol(None), Ok(Protocol::Described(_))));
    assert_eq!(ImuDescription::from_toml("[camera]\nx = 1\n").unwrap(), None);
}

#[test]
fn mistakes_name_key_value_and_what_is_allowed() {
    let error = |from: &str, to: &str| {
        assert!(TEXT.contains(from), "{from}");
        ImuDescription::from_toml(&TEXT.replacen(from, to, 1)).unwrap_err().to_string()
    };
    for (from, to, said) in [
        ("baud = 460800", "baud = 5", "imu.baud = 5: must be within 1200..=4000000"),
        ("rate_hz = 200", "rate_hz = nan", "imu.rate_hz = NaN: must be within 1.0..=4000.0 Hz"),
        ("\"-y\", \"-z\", \"x\"", "\"y\", \"-z\", \"x\"", "right-handed"),
        ("\"-y\", \"-z\", \"x\"", "\"y\", \"y\", \"x\"", "each axis once"),
        ("\"-y\", \"-z\", \"x\"", "\"q\", \"y\", \"x\"", "three of x, y, z"),
        ("length = 17", "length = 300", "imu.frame.length = 300: must be within 2..=255 bytes"),
        ("sum_at = 15", "sum_at = 16", "imu.frame.sum_at = 16"),
        ("offset = 13", "offset = 16", "imu.field[5].offset = 16: I16le must end within 17 bytes"),
        ("scale = 0.005", "scale = 0", "imu.field[3].scale = 0"),
        ("accel.z", "accel.y", "is given twice"),
        ("accel.z", "quat.w", "1 of quat"),
        ("accel.z", "acel.z", "unknown variant `acel.z`"),
        ("checksum = \"crc16\"", "chekcsum = \"crc16\"", "unknown field `chekcsum`"),
        ("type = \"u8\"", "type = \"i8\"", "must be u8, u16le"),
    ] {
        let error = error(from, to);
        assert!(error.contains(said), "{to}: {error}");
    }
    let long = "#".repeat(LONGEST_TEXT + 1);
    assert!(ImuDescription::from_toml(&long).unwrap_err().to_string().contains("at most 65536"));
}

#[test]
fn protocols_are_known_by_name() {
    let imu = ImuDescription::default();
    assert!(matches!(imu.serial_protocol(Some("rvc")), Ok(Protocol::Rvc)));
    let error = imu.serial_protocol(Some("wittmotion")).unwrap_err().to_string();
    assert!(error.contains("did you mean \"witmotion\"?"), "{error}");
    assert!(imu.serial_protocol(Some("described")).unwrap_err().to_string().contains("[imu.frame]"));
    assert!(imu.serial_protocol(None).unwrap_err().to_string().contains("must be one of rvc"));
}

proptest::proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in ".{0,400}") {
        let _ = ImuDescription::from_toml(&format!("[imu]\n{text}"));
    }
}
