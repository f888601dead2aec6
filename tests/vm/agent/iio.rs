//! The sensor hub's IIO devices: buffered records with the kernel's time. The hub is read, pulled out, made again, and read
//! again.

use crate::hidraw::wait_for;
use crate::hub::{self, SENSORS, Sensor};
use crate::uhid::Device;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

type Outcome = Result<String, String>;

const PERIOD: Duration = Duration::from_millis(5);
/// Counters begin anew after this.
const MOST: i16 = 10_000;

/// The folder in sysfs of a sensor's device, when it is there.
fn folder(sensor: &Sensor) -> Option<PathBuf> {
    let entries = fs::read_dir("/sys/bus/iio/devices").ok()?;
    entries
        .flatten()
        .map(|entry| entry.path())
        .find(|path| fs::read_to_string(path.join("name")).is_ok_and(|name| name.trim() == sensor.name))
}

fn set(path: &Path, value: &str) -> Result<(), String> {
    fs::write(path, value).map_err(|e| format!("{}: {e}", path.display()))
}

/// Chooses all channels and the time, and starts the buffer.
fn start(folder: &Path) -> Result<File, String> {
    let elements = fs::read_dir(folder.join("scan_elements")).map_err(|e| e.to_string())?;
    for element in elements.flatten().map(|entry| entry.path()) {
        if element.to_string_lossy().ends_with("_en") {
            set(&element, "1")?;
        }
    }
    set(&folder.join("buffer/length"), "256")?;
    set(&folder.join("buffer/enable"), "1")?;
    let node = Path::new("/dev").join(folder.file_name().unwrap_or_default());
    Ok(wait_for(|| File::open(&node).ok()))
}

/// Reads records; each must be what the rule says of its counter, and counters and times must rise.
fn read(sensor: &Sensor, file: &mut File, count: u32) -> Result<u32, String> {
    // Each value takes 4 bytes, the time the last 8. A record is a multiple of its largest part, and four values of one field
    // are one part.
    let values = 4 * sensor.values();
    let largest = if sensor.is_one_field() { values } else { 8 };
    let mut record = vec![0; (values.next_multiple_of(8) + 8).next_multiple_of(largest)];
    let (mut last, mut lost) = (None, 0);
    for place in 0..count {
        file.read_exact(&mut record).map_err(|e| format!("{}: record {place}: {e}", sensor.name))?;
        let word = |at: usize| i32::from_le_bytes([0, 1, 2, 3].map(|k| record[at + k]));
        let found: Vec<i16> = (0..sensor.values()).map(|k| word(4 * k) as i16).collect();
        if found != sensor.by_rule(found[0]) {
            return Err(format!("{}: record {place} is {record:?}", sensor.name));
        }
        let time = record[record.len() - 8..].try_into().map(i64::from_le_bytes).unwrap_or_default();
        if let Some((counter, before)) = last {
            if found[0] <= counter || time <= before {
                return Err(format!("{}: {} at {time} after {last:?}", sensor.name, found[0]));
            }
            lost += (found[0] - counter - 1) as u32;
        }
        last = Some((found[0], time));
    }
    Ok(lost)
}

/// One life of the hub.
fn life(count: u32) -> Result<u32, String> {
    let mut device = Device::plug("Simulated sensor hub", hub::PRODUCT, &hub::descriptor())
        .map_err(|e| format!("uhid: {e}"))?;
    let folders: Vec<PathBuf> = SENSORS.iter().map(|sensor| wait_for(|| folder(sensor))).collect();
    let done = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&done);
    let feeder = thread::spawn(move || {
        let mut counter = 0;
        while !flag.load(Ordering::SeqCst) {
            counter = (counter + 1) % MOST;
            for sensor in &SENSORS {
                device.send(&sensor.bytes(counter)).expect("the hub takes reports");
            }
            thread::sleep(PERIOD);
        }
    });
    let mut lost = 0;
    let mut files = Vec::new();
    for (sensor, folder) in SENSORS.iter().zip(&folders) {
        let mut file = start(folder)?;
        lost += read(sensor, &mut file, count)?;
        files.push(file);
    }
    done.store(true, Ordering::SeqCst);
    feeder.join().map_err(|panic| format!("the hub was refused: {panic:?}"))?;
    for (sensor, file) in SENSORS.iter().zip(&mut files) {
        wait_for(|| folder(sensor).is_none().then_some(()));
        // poll says nothing of a device that is gone, for ever: a read does. What is left in the buffer comes first.
        let mut rest = [0; 64];
        while file.read(&mut rest).is_ok_and(|length| length > 0) {}
    }
    Ok(lost)
}

/// A hub at rest that gives reports until a file is there, then is pulled out.
pub fn feed_until(stop: &str) -> Outcome {
    let mut device = Device::plug("Simulated sensor hub", hub::PRODUCT, &hub::descriptor())
        .map_err(|e| format!("uhid: {e}"))?;
    let mut count = 0;
    while !Path::new(stop).exists() {
        for sensor in &SENSORS {
            device.send(&sensor.at_rest(count)).map_err(|e| format!("uhid: {e}"))?;
        }
        count += 1;
        thread::sleep(PERIOD);
    }
    Ok(format!("{count} reports of each sensor"))
}

/// `times` hubs one after another, with `count` records of each sensor.
pub fn run(count: u32, times: u32) -> Outcome {
    let mut lost = 0;
    for _ in 0..times {
        lost += life(count)?;
    }
    Ok(format!("{times} times {count} records of {} sensors, {lost} lost", SENSORS.len()))
}
