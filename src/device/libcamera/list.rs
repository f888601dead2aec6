//! The cameras of libcamera for people and programs: which there are, and what each offers.

use super::format::{self, RoleChoice, RoleOffer};
use super::sys;
use crate::v4l2::format::FormatWish;
use crate::v4l2::node::Offer;
use crate::{DeviceError, ErrorKind};

/// A camera that libcamera lists.
#[derive(Clone, Debug, PartialEq)]
pub struct LibcameraSensor {
    /// libcamera's name: its place in the machine.
    pub id: String,
    /// What it is; the name where it does not say.
    pub model: String,
    /// What it gives; empty where it cannot be asked.
    pub offers: Vec<RoleOffer>,
}

impl LibcameraSensor {
    /// The name that `device.camera` takes.
    pub fn name(&self) -> String {
        format!("libcamera:{}", self.id)
    }

    /// Formats that are read, in V4L2's terms, one for each size.
    pub fn formats(&self) -> Vec<Offer> {
        let mut formats: Vec<Offer> = Vec::new();
        for offer in self.offers.iter().flat_map(|offer| offer.sized(&FormatWish::default())) {
            if !formats.contains(&offer) {
                formats.push(offer);
            }
        }
        formats
    }

    /// What is taken where nobody asks for more.
    pub fn chosen(&self) -> Option<RoleChoice> {
        format::choose(&self.offers, &FormatWish::default())
    }
}

/// All cameras that libcamera lists. An error where the library cannot be started.
pub fn sensors() -> Result<Vec<LibcameraSensor>, DeviceError> {
    sys::sensors()
        .map_err(|e| DeviceError::new("libcamera:", "ask for its cameras", ErrorKind::Reopen).because(e))
}

/// The camera that a text means: its name, else the first that has the text in its name or its model. The first of all for none.
pub fn named<'a>(sensors: &'a [LibcameraSensor], text: &str) -> Option<&'a LibcameraSensor> {
    let exact = sensors.iter().find(|sensor| sensor.id == text);
    exact.or_else(|| sensors.iter().find(|sensor| sensor.id.contains(text) || sensor.model.contains(text)))
}
