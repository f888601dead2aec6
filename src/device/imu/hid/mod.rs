//! Inertial sensors over HID with a protocol of their maker's: reports of two headsets by their public layout, others by a
//! table, and what a device's report descriptor says of its reports. Standard sensors (usage page 0x20) get no hidraw node from
//! the kernel: they are IIO devices, see [`super::iio`].

pub mod descriptor;
pub mod headset_psvr;
pub mod headset_rift;
#[cfg(feature = "hid")]
pub mod hidraw;
pub mod source;

use super::description::{DescriptionError, FrameTable, ImuDescription};
use super::sample::WireSample;
use super::wire::described;
use crate::model::time::Timestamp;
use crate::parameters::nearest;
use glam::DQuat;

/// Names of the report protocols, in the order of [`ReportProtocol`].
pub const PROTOCOLS: [&str; 3] = ["rift", "psvr", "described"];

/// What the reports of a device are.
#[derive(Clone, Debug, PartialEq)]
pub enum ReportProtocol {
    /// Oculus Rift DK2 and CV1.
    Rift,
    /// Sony PlayStation VR, first generation.
    Psvr,
    /// What a table describes; its header is the report's number.
    Described(FrameTable),
}

/// Makers' and products' numbers of what is built in.
const BUILT_IN: [(u16, u16, ReportProtocol); 3] = [
    (0x2833, 0x0021, ReportProtocol::Rift),
    (0x2833, 0x0031, ReportProtocol::Rift),
    (0x054C, 0x09AF, ReportProtocol::Psvr),
];

/// Makers' and products' numbers of what is built in.
pub fn known_ids() -> impl Iterator<Item = (u16, u16)> {
    BUILT_IN.into_iter().map(|(vendor, product, _)| (vendor, product))
}

/// The protocol of a device whose numbers are built in.
pub fn built_in(ids: (u16, u16)) -> Option<ReportProtocol> {
    BUILT_IN
        .into_iter()
        .find(|(vendor, product, _)| (*vendor, *product) == ids)
        .map(|(_, _, protocol)| protocol)
}

impl ReportProtocol {
    /// Its name, as in [`PROTOCOLS`].
    pub fn name(&self) -> &'static str {
        match self {
            Self::Rift => "rift",
            Self::Psvr => "psvr",
            Self::Described(_) => "described",
        }
    }

    /// The protocol: what the device's name says, else the rig, else what is built in for the maker's and product's numbers.
    pub fn choose(
        named: Option<&str>,
        description: &ImuDescription,
        ids: (u16, u16),
    ) -> Result<Self, DescriptionError> {
        let wrong = |value: &str, allowed: String| DescriptionError {
            key: "protocol".into(),
            value: value.into(),
            allowed,
        };
        let Some(name) = named.or(description.protocol.as_deref()) else {
            return built_in(ids).ok_or_else(|| {
                let allowed = format!(
                    "{:04x}:{:04x} is not built in; say one of {}",
                    ids.0,
                    ids.1,
                    PROTOCOLS.join(", ")
                );
                wrong("nothing", allowed)
            });
        };
        match name {
            "rift" => Ok(Self::Rift),
            "psvr" => Ok(Self::Psvr),
            "described" => description
                .frame
                .clone()
                .map(Self::Described)
                .ok_or_else(|| wrong(name, "a described protocol needs a table [imu.frame]".into())),
            _ => {
                let hint = nearest(name, &PROTOCOLS).map(|p| format!("did you mean \"{p}\"? "));
                Err(wrong(name, format!("{}Known: {}", hint.unwrap_or_default(), PROTOCOLS.join(", "))))
            }
        }
    }

    /// Samples a second.
    pub fn usual_rate_hz(&self) -> f64 {
        match self {
            Self::Rift => headset_rift::RATE_HZ,
            Self::Psvr => headset_psvr::RATE_HZ,
            Self::Described(_) => 100.0,
        }
    }

    /// The headset's axes (x right, y up, z back) to those of the samples (x right, y down, z ahead).
    pub fn imu_from_sensor(&self, description: &ImuDescription) -> DQuat {
        let is_stated = description.imu_from_sensor != DQuat::IDENTITY;
        match self {
            Self::Rift | Self::Psvr if !is_stated => DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
            _ => description.imu_from_sensor,
        }
    }

    /// The number and length of the report that has the samples; number 0: reports are not numbered.
    pub fn report(&self) -> (u8, usize) {
        match self {
            Self::Rift => (headset_rift::REPORT, headset_rift::LENGTH),
            Self::Psvr => (0, headset_psvr::LENGTH),
            Self::Described(table) => (table.header.first().copied().unwrap_or(0), table.length),
        }
    }

    /// What must be sent again and again so that samples come: a feature report, and the seconds between two.
    pub fn keep_alive(&self) -> Option<(&'static [u8], f64)> {
        match self {
            Self::Rift => Some((&headset_rift::KEEP_ALIVE, headset_rift::KEEP_ALIVE_S)),
            Self::Psvr | Self::Described(_) => None,
        }
    }

    /// Gives the samples of one report; returns whether it was one of this protocol.
    pub fn read(&self, report: &[u8], arrival: Timestamp, out: &mut impl FnMut(WireSample)) -> bool {
        match self {
            Self::Rift => headset_rift::read(report, arrival, out),
            Self::Psvr => headset_psvr::read(report, arrival, out),
            Self::Described(table) => {
                let looked = described::look(table, report, arrival);
                if let super::wire::resync::WireLook::Sample(_, sample) = looked {
                    out(sample);
                    return true;
                }
                false
            }
        }
    }
}
