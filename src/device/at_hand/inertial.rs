//! Inertial sensors that can be known without opening them: headsets behind hidraw by their numbers and their report
//! descriptor, standard sensors by the channels of their IIO device. A sensor on a serial port shows only the chip of its cable.

use super::PluggedMachine;
use super::rights::{MissingRight, RightOf};
use crate::imu::hid::{self, descriptor, source};

const HIDRAW: &str = "/sys/class/hidraw";
const IIO: &str = "/sys/bus/iio/devices";
/// Where the forces are taken from, beside rates without forces of their own.
const FORCES_BESIDE: &str = "accel_3d";

/// What a sensor gives, the best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Gives {
    /// Rates and forces of a headset, a thousand times a second.
    Headset,
    /// An orientation that the sensor makes itself.
    Orientation,
    /// Turning rates and forces, which are fused here.
    RatesAndForces,
    /// Too little by itself.
    Part,
}

impl Gives {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Headset => "rates and forces of a headset",
            Self::Orientation => "an orientation that the sensor makes itself",
            Self::RatesAndForces => "rates and forces",
            Self::Part => "too little by itself",
        }
    }
}

/// An inertial sensor that the kernel lists, whether or not it may be opened.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedSensor {
    /// What `device.imu` would say.
    pub name: String,
    /// What it calls itself.
    pub product: String,
    /// Its node below `/dev`.
    pub node: String,
    /// How its reports are read; `None` for IIO.
    pub protocol: Option<&'static str>,
    /// What it gives.
    pub gives: Gives,
    /// Samples a second, as far as they are known.
    pub rate_hz: Option<f64>,
    /// What is missing to use it.
    pub missing: Option<MissingRight>,
}

impl PluggedMachine {
    /// All sensors that are known for what they are, the best first.
    pub fn sensors(&self) -> Vec<ListedSensor> {
        let mut sensors = self.headsets();
        sensors.extend(self.standard_sensors());
        // Of equals the lower number: the sort keeps their order.
        sensors.sort_by_key(|sensor| sensor.gives);
        sensors
    }

    fn headsets(&self) -> Vec<ListedSensor> {
        self.names(HIDRAW, "hidraw").iter().filter_map(|node| self.headset(node)).collect()
    }

    fn headset(&self, node: &str) -> Option<ListedSensor> {
        let folder = format!("{HIDRAW}/{node}/device");
        let uevent = self.text(format!("{folder}/uevent"))?;
        let value = |key: &str| uevent.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
        let (vendor, product) = ids(value("HID_ID")?)?;
        let protocol = hid::built_in((vendor, product))?;
        // A headset has several interfaces of the same numbers; one of them sends the samples.
        let told = descriptor::read(&self.bytes(format!("{folder}/report_descriptor"))?).ok()?;
        source::check(&told, &protocol).ok()?;
        let path = format!("/dev/{node}");
        Some(ListedSensor {
            name: format!("hid:{vendor:04x}:{product:04x}"),
            product: value("HID_NAME").unwrap_or_default().to_owned(),
            protocol: Some(protocol.name()),
            gives: Gives::Headset,
            rate_hz: Some(protocol.usual_rate_hz()),
            missing: self.missing(&path, RightOf::Rules),
            node: path,
        })
    }

    fn standard_sensors(&self) -> Vec<ListedSensor> {
        let names = self.names(IIO, "iio:device");
        let called = |folder: &String| self.text(format!("{IIO}/{folder}/name"));
        let all: Vec<(String, String)> =
            names.into_iter().filter_map(|folder| Some((called(&folder)?, folder))).collect();
        let has_forces_beside = all.iter().any(|(name, _)| name == FORCES_BESIDE);
        let listed = all.iter().filter_map(|(name, folder)| {
            let has = |channel: &str| self.has(format!("{IIO}/{folder}/scan_elements/{channel}_type"));
            let (rates, forces) = (has("in_anglvel_x"), has("in_accel_x"));
            let gives = match (has("in_rot_quaternion"), rates, forces || has_forces_beside) {
                (true, ..) => Gives::Orientation,
                (_, true, true) => Gives::RatesAndForces,
                _ if rates || forces => Gives::Part,
                // A light sensor or a thermometer.
                _ => return None,
            };
            let node = format!("/dev/{folder}");
            let is_one = all.iter().filter(|(other, _)| other == name).count() == 1;
            let rate = |file: &str| self.text(format!("{IIO}/{folder}/{file}"))?.parse().ok();
            // Its buffer is set up by files of sysfs, then its node is read.
            let buffer = format!("{IIO}/{folder}/buffer/enable");
            Some(ListedSensor {
                name: if is_one { format!("iio:name={name}") } else { format!("iio:{node}") },
                product: name.clone(),
                protocol: None,
                gives,
                rate_hz: rate("sampling_frequency").or_else(|| rate("in_anglvel_sampling_frequency")),
                missing: self.missing(&node, RightOf::Rules).or_else(|| self.missing(buffer, RightOf::Rules)),
                node,
            })
        });
        listed.collect()
    }
}

/// Maker and product of `HID_ID`: bus, maker, product in hex.
fn ids(text: &str) -> Option<(u16, u16)> {
    let mut numbers = text.split(':').skip(1).map(|number| u32::from_str_radix(number, 16).ok());
    let mut next = || u16::try_from(numbers.next()??).ok();
    Some((next()?, next()?))
}
