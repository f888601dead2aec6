//! Devices behind hidraw, through `hidapi`. Thin. The kernel keeps 64 reports of a device that is not read and loses the oldest
//! silently: the stamps in the reports show it.

use super::ReportProtocol;
use super::descriptor::{self, LONGEST};
use super::source::{HidImu, Reports, check};
use crate::clock::Clock;
use crate::imu::assemble::Assembler;
use crate::imu::description::ImuDescription;
use crate::imu::names::{ImuName, Which};
use crate::imu::wire_log::WireLogWriter;
use crate::{DeviceError, ErrorKind};
use hidapi::{DeviceInfo, HidApi, HidDevice};
use std::sync::Arc;

/// An open node.
pub struct Hidraw(HidDevice);

impl Reports for Hidraw {
    fn read(&mut self, report: &mut [u8], wait_ms: u16) -> Result<usize, String> {
        self.0.read_timeout(report, i32::from(wait_ms)).map_err(|e| e.to_string())
    }

    fn send_feature(&mut self, report: &[u8]) -> Result<(), String> {
        self.0.send_feature_report(report).map_err(|e| e.to_string())
    }
}

/// Finds and opens a device. `Refused` where the name or the rig is wrong or the device cannot send what the protocol needs;
/// `Reopen` where it is not there or may not be opened (yet).
pub fn open(
    text: &str,
    name: &ImuName,
    description: &ImuDescription,
    clock: Arc<dyn Clock>,
    log: Option<WireLogWriter>,
) -> Result<HidImu<Hidraw>, DeviceError> {
    let lost = |action: &str| DeviceError::new(text, action, ErrorKind::Reopen);
    let refuse = |action: &str| DeviceError::new(text, action, ErrorKind::Refused);
    // What cannot be is refused also while the device is not there.
    if name.protocol.is_some() {
        ReportProtocol::choose(name.protocol.as_deref(), description, (0, 0))
            .map_err(|e| refuse("read what is said of it").because(e))?;
    }
    let api = HidApi::new().map_err(|e| lost("list HID devices").because(e.to_string()))?;
    let (mut closed, mut unfit) = (None, None);
    for info in api.device_list().filter(|info| is_wanted(info, &name.which)) {
        let ids = (info.vendor_id(), info.product_id());
        let protocol = ReportProtocol::choose(name.protocol.as_deref(), description, ids)
            .map_err(|e| refuse("read what is said of it").because(e))?;
        let device = match info.open_device(&api) {
            Ok(device) => device,
            Err(e) => {
                let path = info.path().to_string_lossy();
                let action = format!("open {path} (a udev rule must give the user access to hidraw)");
                closed = Some(lost(&action).because(e.to_string()));
                continue;
            }
        };
        let mut bytes = [0u8; LONGEST];
        let count = device
            .get_report_descriptor(&mut bytes)
            .map_err(|e| lost("read its descriptor").because(e.to_string()))?;
        let found = descriptor::read(bytes.get(..count).unwrap_or_default())
            .map_err(|e| refuse("read its descriptor").because(e))?;
        // A headset has several interfaces of the same numbers; one of them sends the samples.
        if let Err(cause) = check(&found, &protocol) {
            unfit = Some(refuse(&cause));
            continue;
        }
        let rate_hz = name.rate(description, protocol.usual_rate_hz());
        tracing::info!("{text}: opened {}, {rate_hz} Hz", info.path().to_string_lossy());
        let assembler = Assembler::new(rate_hz, protocol.imu_from_sensor(description));
        return Ok(HidImu::new(text, Hidraw(device), protocol, assembler, clock, log));
    }
    // The one that could not be opened yet may be the right one.
    Err(closed.or(unfit).unwrap_or_else(|| lost("not there")))
}

fn is_wanted(info: &DeviceInfo, which: &Which) -> bool {
    match which {
        // A link that udev made is as good as the node.
        Which::Path(path) => {
            let node = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
            info.path().to_bytes() == node.as_os_str().as_encoded_bytes()
        }
        Which::Ids(vendor, product) => (info.vendor_id(), info.product_id()) == (*vendor, *product),
        Which::Name(name) => info.product_string().is_some_and(|product| product.contains(name.as_str())),
    }
}
