//! Serial ports: what stands behind each, as far as its cable or its driver tells, and which are modems.

use super::PluggedMachine;
use super::rights::{MissingRight, RightOf};
use serialport::{SerialPortInfo, SerialPortType};
use std::path::Path;

const TTY: &str = "/sys/class/tty";
/// Drivers of ports that belong to modems alone.
const MODEM_DRIVERS: [&str; 5] = ["option", "qcserial", "sierra", "hso", "ipw"];
/// Drivers of the network beside a modem's ports.
const MODEM_NETWORKS: [&str; 4] = ["qmi_wwan", "cdc_mbim", "huawei_cdc_ncm", "sierra_net"];

/// A serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedPort {
    /// Its node below `/dev`.
    pub path: String,
    /// Maker and product, by number and by name, of a USB device.
    pub usb: Option<UsbNames>,
    /// Why it is taken for a modem, where it is.
    pub modem: Option<String>,
    /// What is missing to use it.
    pub missing: Option<MissingRight>,
}

/// Who a USB device says it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UsbNames {
    /// The maker's number.
    pub vendor: u16,
    /// The product's number.
    pub product: u16,
    /// The maker's name and the product's, as far as it states them.
    pub name: String,
}

/// The ports that the system lists.
pub fn of_the_system() -> Vec<SerialPortInfo> {
    // The list panics on a system without this folder.
    if !Path::new(TTY).is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_else(|error| {
        tracing::warn!("serial ports cannot be listed: {error}");
        Vec::new()
    })
}

impl PluggedMachine {
    /// What can be said of each port.
    pub fn ports(&self, ports: Vec<SerialPortInfo>) -> Vec<ListedPort> {
        let mut listed: Vec<ListedPort> = ports.into_iter().map(|port| self.port(port)).collect();
        listed.sort_by(|a, b| (a.path.len(), &a.path).cmp(&(b.path.len(), &b.path)));
        listed
    }

    fn port(&self, port: SerialPortInfo) -> ListedPort {
        let usb = match port.port_type {
            SerialPortType::UsbPort(usb) => {
                let named = [usb.manufacturer, usb.product].into_iter().flatten();
                let name = named.collect::<Vec<_>>().join(" ");
                Some(UsbNames { vendor: usb.vid, product: usb.pid, name })
            }
            _ => None,
        };
        let path = port.port_name;
        let calls_itself_modem = usb.as_ref().is_some_and(|u| u.name.to_lowercase().contains("modem"));
        let modem = match self.modem_driver(path.rsplit('/').next().unwrap_or_default()) {
            Some(driver) => Some(format!("its driver is {driver}")),
            None => calls_itself_modem.then(|| "it calls itself so".to_owned()),
        };
        ListedPort { missing: self.missing(&path, RightOf::Serial), path, usb, modem }
    }

    /// The driver that makes a port a modem's: its own, or that of the network beside it on the same USB device.
    fn modem_driver(&self, node: &str) -> Option<String> {
        let interface = format!("{TTY}/{node}/device");
        let driver_of = |folder: &Path| {
            let link = std::fs::read_link(folder.join("driver")).ok()?;
            Some(link.file_name()?.to_string_lossy().into_owned())
        };
        let own = self.at(interface).canonicalize().ok()?;
        // A port of a USB-serial chip lies below its interface, one of the class CDC is it.
        let above =
            own.ancestors().take(3).filter_map(driver_of).find(|d| MODEM_DRIVERS.contains(&d.as_str()));
        above.or_else(|| {
            let beside = own.ancestors().skip(1).take(2).filter(|above| above.join("idVendor").is_file());
            let interfaces = beside.filter_map(|device| std::fs::read_dir(device).ok()).flatten().flatten();
            interfaces
                .filter_map(|interface| driver_of(&interface.path()))
                .find(|driver| MODEM_NETWORKS.contains(&driver.as_str()))
        })
    }
}
