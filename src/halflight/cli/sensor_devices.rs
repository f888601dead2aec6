//! Inertial sensors and serial ports, and what would be used by default, as `halflight devices` shows them.

use super::video_devices::ListedCameras;
use crate::config::Settings;
#[cfg(feature = "serial")]
use crate::device::at_hand::serial_ports::{self, ListedPort};
use crate::device::at_hand::{
    PluggedMachine,
    inertial::{Gives, ListedSensor},
    rights::MissingRight,
};
use serde_json::{Value, json};

/// What was found beside cameras.
pub struct ListedSensors {
    sensors: Vec<ListedSensor>,
    #[cfg(feature = "serial")]
    ports: Vec<ListedPort>,
}

/// What would be used, and why.
pub struct DefaultDevice {
    name: Option<String>,
    why: String,
}

impl DefaultDevice {
    /// For programs.
    pub fn json(&self) -> Value {
        json!({ "name": self.name, "why": self.why })
    }

    /// For people.
    pub fn print(&self, what: &str) {
        println!("  {what:<24}{}: {}", self.name.as_deref().unwrap_or("none"), self.why);
    }
}

/// The camera that `device.camera` means.
pub fn default_camera(settings: &Settings, cameras: &ListedCameras) -> DefaultDevice {
    if settings.camera != "auto" {
        let why = "device.camera names it".to_owned();
        return DefaultDevice { name: Some(settings.camera.clone()), why };
    }
    #[cfg(feature = "libcamera")]
    if let Some((name, why)) = super::library_cameras::LibraryCameras::best() {
        return DefaultDevice { name: Some(name), why };
    }
    match cameras.best() {
        Some((name, offer, points)) => {
            let why = format!("device.camera = auto takes the best offer: {offer}, score {points:.1}");
            DefaultDevice { name: Some(name), why }
        }
        None => {
            let why = "device.camera = auto finds no camera that can be read; the daemon goes on looking";
            DefaultDevice { name: None, why: why.to_owned() }
        }
    }
}

impl ListedSensors {
    /// Looks at what is there, and opens nothing.
    pub fn look(machine: &PluggedMachine) -> Self {
        Self {
            sensors: machine.sensors(),
            #[cfg(feature = "serial")]
            ports: machine.ports(serial_ports::of_the_system()),
        }
    }

    /// The sensor that could be named: the best that gives enough and may be used, else the best that gives enough.
    pub fn best(&self) -> Option<&ListedSensor> {
        let mut whole = self.sensors.iter().filter(|sensor| sensor.gives != Gives::Part);
        whole.clone().find(|sensor| sensor.missing.is_none()).or_else(|| whole.next())
    }

    /// The inertial sensor that `device.imu` means.
    pub fn default_imu(&self, settings: &Settings) -> DefaultDevice {
        if !settings.imu.is_empty() {
            let why = "device.imu names it".to_owned();
            return DefaultDevice { name: Some(settings.imu.clone()), why };
        }
        let mut why = "device.imu is empty".to_owned();
        if let Some(best) = self.best() {
            why += &format!(
                "; device.imu = \"{}\" would use {}: {}",
                best.name,
                best.product,
                best.gives.text()
            );
        }
        DefaultDevice { name: None, why }
    }

    /// Inertial sensors for programs.
    pub fn json(&self) -> Vec<Value> {
        let sensor = |s: &ListedSensor| {
            json!({
                "name": s.name, "product": s.product, "node": s.node, "protocol": s.protocol, "gives": s.gives.text(),
                "rate_hz": s.rate_hz, "usable": s.missing.is_none() && s.gives != Gives::Part,
                "missing": missing_json(s.missing.as_ref()),
            })
        };
        self.sensors.iter().map(sensor).collect()
    }

    /// Inertial sensors for people.
    pub fn print(&self) {
        if self.sensors.is_empty() {
            println!("  none: no headset that is known (hidraw), no standard sensor (IIO)");
        }
        for s in &self.sensors {
            let rate = s.rate_hz.map_or(String::new(), |rate| format!(", {rate:.0} Hz"));
            println!("  {:<24}{} at {}: {}{rate}", s.name, s.product, s.node, s.gives.text());
            print_missing(s.missing.as_ref());
        }
    }

    /// Serial ports for programs.
    #[cfg(feature = "serial")]
    pub fn ports_json(&self) -> Vec<Value> {
        let port = |p: &ListedPort| {
            let usb = p.usb.as_ref().map(|usb| {
                json!({
                    "vendor": format!("{:04x}", usb.vendor), "product": format!("{:04x}", usb.product),
                    "name": usb.name,
                })
            });
            json!({
                "path": p.path, "usb": usb, "modem": p.modem, "missing": missing_json(p.missing.as_ref()),
            })
        };
        self.ports.iter().map(port).collect()
    }

    /// Without serial ports there are none to list.
    #[cfg(not(feature = "serial"))]
    pub fn ports_json(&self) -> Vec<Value> {
        Vec::new()
    }

    /// Serial ports for people.
    #[cfg(feature = "serial")]
    pub fn print_ports(&self) {
        if self.ports.is_empty() {
            println!("  none");
        }
        for p in &self.ports {
            let usb = p.usb.as_ref().map_or("not on USB".to_owned(), |usb| {
                format!("{:04x}:{:04x} {}", usb.vendor, usb.product, usb.name)
            });
            let what = match &p.modem {
                Some(why) => format!("a modem: {why}"),
                None => format!("with a sensor: serial:{},protocol=..", p.path),
            };
            println!("  {:<24}{usb}; {what}", p.path);
            print_missing(p.missing.as_ref());
        }
    }

    /// This program reads none.
    #[cfg(not(feature = "serial"))]
    pub fn print_ports(&self) {
        println!("  this program was built without serial ports (feature serial)");
    }
}

/// A missing right for programs.
pub fn missing_json(missing: Option<&MissingRight>) -> Value {
    missing.map_or(
        Value::Null,
        |m| json!({ "path": m.path.display().to_string(), "group": m.group, "mend": m.mend }),
    )
}

/// A missing right for people.
pub fn print_missing(missing: Option<&MissingRight>) {
    if let Some(missing) = missing {
        println!("    may not be used: {} (group {}); mend it:", missing.path.display(), missing.group);
        println!("    {}", missing.mend);
    }
}
