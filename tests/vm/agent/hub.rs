//! A HID sensor hub: acceleration, turning rate, orientation. The kernel makes IIO devices of it.

use std::ops::Range;

pub const PRODUCT: u32 = 0x0202;

/// One sensor of the hub.
pub struct Sensor {
    /// What its IIO device is called.
    pub name: &'static str,
    /// Number of its report.
    pub report: u8,
    /// Usages on the page of sensors: of the sensor, and of its fields.
    usage: u16,
    fields: Range<u16>,
    /// Values in a field.
    per_field: u8,
}

impl Sensor {
    /// Values in a report.
    pub fn values(&self) -> usize {
        self.fields.len() * usize::from(self.per_field)
    }

    pub fn is_one_field(&self) -> bool {
        self.fields.len() == 1
    }

    /// The values with this counter: the first is the counter.
    pub fn by_rule(&self, counter: i16) -> Vec<i16> {
        (0..self.values() as i16)
            .map(|place| if place == 0 { counter } else { -counter / (place + 1) + place })
            .collect()
    }

    /// A report of a hub at rest: the quaternion's w is large, all others tremble.
    pub fn at_rest(&self, counter: u32) -> Vec<u8> {
        let value = |place: usize| match self.is_one_field() && place + 1 == self.values() {
            true => 16_000,
            false => ((counter as usize + place) % 3) as i16,
        };
        [self.report]
            .into_iter()
            .chain((0..self.values()).flat_map(|place| value(place).to_le_bytes()))
            .collect()
    }

    /// The report with this counter.
    pub fn bytes(&self, counter: i16) -> Vec<u8> {
        let values = self.by_rule(counter);
        [self.report].into_iter().chain(values.into_iter().flat_map(i16::to_le_bytes)).collect()
    }
}

pub const SENSORS: [Sensor; 3] = [
    Sensor { name: "accel_3d", report: 1, usage: 0x73, fields: 0x453..0x456, per_field: 1 },
    Sensor { name: "gyro_3d", report: 2, usage: 0x76, fields: 0x457..0x45a, per_field: 1 },
    Sensor { name: "dev_rotation", report: 3, usage: 0x8a, fields: 0x483..0x484, per_field: 4 },
];

fn usage(bytes: &mut Vec<u8>, usage: u16) {
    bytes.push(0x0a);
    bytes.extend(usage.to_le_bytes());
}

/// A collection for each sensor: its features (interval, state of reports, state of power; the drivers refuse a sensor without
/// the last), then its values of 16 bits.
pub fn descriptor() -> Vec<u8> {
    let mut bytes = vec![0x05, 0x20, 0x09, 0x01, 0xa1, 0x01];
    for sensor in &SENSORS {
        usage(&mut bytes, sensor.usage);
        bytes.extend([0xa1, 0x00, 0x85, sensor.report]);
        usage(&mut bytes, 0x030e);
        bytes.extend([0x15, 0x00, 0x27, 0xff, 0xff, 0xff, 0x7f, 0x75, 0x20, 0x95, 0x01, 0xb1, 0x02]);
        bytes.extend([0x25, 0x05, 0x75, 0x08]);
        for state in [0x0316, 0x0319] {
            usage(&mut bytes, state);
            bytes.extend([0xb1, 0x02]);
        }
        bytes.extend([0x16, 0x00, 0x80, 0x26, 0xff, 0x7f, 0x75, 0x10, 0x95, sensor.per_field]);
        for field in sensor.fields.clone() {
            usage(&mut bytes, field);
            bytes.extend([0x81, 0x02]);
        }
        bytes.push(0xc0);
    }
    bytes.push(0xc0);
    bytes
}
