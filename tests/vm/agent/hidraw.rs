//! An inertial sensor with a protocol of its own: a vendor's usage page, so that the kernel gives it a hidraw node. It is
//! read, cut, made again, and read again.

use crate::{sys, uhid::Device};
use halflight_vm::{REPORT_BYTES, Sample};
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

type Outcome = Result<String, String>;

const PRODUCT: u32 = 0x0201;
/// Reports that the kernel may hold for a reader: fewer than fit, so that none is lost.
const WINDOW: u32 = 32;
const PERIOD: Duration = Duration::from_millis(5);

/// Vendor's page, one report of bytes, no number.
fn descriptor() -> Vec<u8> {
    let mut bytes = vec![0x06, 0x00, 0xff, 0x09, 0x01, 0xa1, 0x01, 0x09, 0x02, 0x15, 0x00, 0x26, 0xff, 0x00];
    bytes.extend([0x75, 0x08, 0x95, REPORT_BYTES as u8, 0x81, 0x02, 0xc0]);
    bytes
}

/// The node of our device, when it is there.
fn node() -> Option<String> {
    let wanted = format!("0003:00001D6B:{PRODUCT:08X}");
    fs::read_dir("/sys/class/hidraw").ok()?.flatten().find_map(|entry| {
        let told = fs::read_to_string(entry.path().join("device/uevent")).ok()?;
        told.contains(&wanted).then(|| format!("/dev/{}", entry.file_name().to_string_lossy()))
    })
}

/// Waits for a thing that must come; it takes as long as it takes, and the step's own limit ends it.
pub fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> T {
    loop {
        match look() {
            Some(found) => return found,
            None => thread::sleep(Duration::from_millis(10)),
        }
    }
}

/// Feeds a device with `count` samples from `first` on, then pulls it out.
fn feed(mut device: Device, first: u32, count: u32, read: Arc<AtomicU32>) -> JoinHandle<()> {
    thread::spawn(move || {
        wait_for(|| device.is_open().then_some(()));
        for counter in first..first + count {
            wait_for(|| (counter < read.load(Ordering::SeqCst) + WINDOW).then_some(()));
            device.send(&Sample::by_rule(counter).report()).expect("the device takes reports");
            thread::sleep(PERIOD);
        }
        wait_for(|| (read.load(Ordering::SeqCst) == first + count).then_some(()));
    })
}

/// A device that gives samples until a file is there, then is pulled out.
pub fn feed_until(stop: &str) -> Outcome {
    let mut device =
        Device::plug("Simulated IMU", PRODUCT, &descriptor()).map_err(|e| format!("uhid: {e}"))?;
    let mut counter = 0;
    while !Path::new(stop).exists() {
        if device.is_open() {
            device.send(&Sample::by_rule(counter).report()).map_err(|e| format!("uhid: {e}"))?;
            counter += 1;
        }
        thread::sleep(PERIOD);
    }
    Ok(format!("{counter} samples"))
}

/// `times` devices one after another, with `count` samples each.
pub fn run(count: u32, times: u32) -> Outcome {
    for time in 0..times {
        let first = time * count;
        let device =
            Device::plug("Simulated IMU", PRODUCT, &descriptor()).map_err(|e| format!("uhid: {e}"))?;
        let path = wait_for(node);
        let mut file = wait_for(|| File::open(&path).ok());
        let read = Arc::new(AtomicU32::new(first));
        let feeder = feed(device, first, count, Arc::clone(&read));
        for counter in first..first + count {
            let mut report = [0; REPORT_BYTES + 1];
            let length = file.read(&mut report).map_err(|e| format!("{path}: sample {counter}: {e}"))?;
            match Sample::of_report(&report[..length]) {
                Some(sample) if sample.counter == counter => read.store(counter + 1, Ordering::SeqCst),
                other => return Err(format!("sample {counter} is {other:?} ({length} bytes)")),
            }
        }
        feeder.join().map_err(|panic| format!("the device was refused: {panic:?}"))?;
        let found = sys::ready(&file, -1).map_err(|e| format!("{path}: {e}"))?;
        if found & sys::POLL_GONE == 0 || file.read(&mut [0; 64]).is_ok() {
            return Err(format!("{path}: the device was pulled out and nobody says so ({found:#x})"));
        }
    }
    Ok(format!("{times} times {count} samples, none lost"))
}
