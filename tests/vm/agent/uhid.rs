//! A HID device made by this program: /dev/uhid. A thread answers what the kernel asks of it.

use std::fs::{File, OpenOptions};
use std::io::{Read, Result, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

const DESTROY: u32 = 1;
const STOP: u32 = 3;
const OPEN: u32 = 4;
const CLOSE: u32 = 5;
const GET_REPORT: u32 = 9;
const GET_REPORT_REPLY: u32 = 10;
const CREATE: u32 = 11;
const INPUT: u32 = 12;
const SET_REPORT: u32 = 13;
const SET_REPORT_REPLY: u32 = 14;
/// Bytes of any event.
const EVENT: usize = 4380;
const BUS_USB: u16 = 3;
const VENDOR: u32 = 0x1d6b;
/// Bytes of a feature report of ours: a number, a word, two bytes.
const FEATURE: u16 = 7;

/// The device; it is pulled out when this is dropped.
pub struct Device {
    file: File,
    is_open: Arc<AtomicBool>,
}

impl Device {
    /// Plugs in a device with this report descriptor.
    pub fn plug(name: &str, product: u32, descriptor: &[u8]) -> Result<Self> {
        let mut file = OpenOptions::new().read(true).write(true).open("/dev/uhid")?;
        let mut event = vec![0; EVENT];
        event[0..4].copy_from_slice(&CREATE.to_le_bytes());
        event[4..4 + name.len()].copy_from_slice(name.as_bytes());
        event[260..262].copy_from_slice(&(descriptor.len() as u16).to_le_bytes());
        event[262..264].copy_from_slice(&BUS_USB.to_le_bytes());
        event[264..268].copy_from_slice(&VENDOR.to_le_bytes());
        event[268..272].copy_from_slice(&product.to_le_bytes());
        event[280..280 + descriptor.len()].copy_from_slice(descriptor);
        file.write_all(&event)?;
        let is_open = Arc::new(AtomicBool::new(false));
        let (answering, flag) = (file.try_clone()?, Arc::clone(&is_open));
        thread::spawn(move || {
            // The end of the device ends it.
            let _ = answer(answering, &flag);
        });
        Ok(Self { file, is_open })
    }

    /// Returns whether anybody reads.
    pub fn is_open(&self) -> bool {
        self.is_open.load(Ordering::SeqCst)
    }

    /// Sends one report.
    pub fn send(&mut self, report: &[u8]) -> Result<()> {
        let mut event = Vec::with_capacity(6 + report.len());
        event.extend(INPUT.to_le_bytes());
        event.extend((report.len() as u16).to_le_bytes());
        event.extend(report);
        self.file.write_all(&event)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // It is gone in any case when the file is closed.
        let _ = self.file.write_all(&DESTROY.to_le_bytes());
    }
}

fn answer(mut file: File, is_open: &AtomicBool) -> Result<()> {
    let mut event = vec![0; EVENT];
    loop {
        if file.read(&mut event)? < 4 {
            return Ok(());
        }
        let mut reply = Vec::new();
        match u32::from_le_bytes([event[0], event[1], event[2], event[3]]) {
            OPEN => is_open.store(true, Ordering::SeqCst),
            CLOSE => is_open.store(false, Ordering::SeqCst),
            STOP => return Ok(()),
            GET_REPORT => {
                reply.extend(GET_REPORT_REPLY.to_le_bytes());
                reply.extend(&event[4..8]);
                reply.extend([0, 0]);
                reply.extend(FEATURE.to_le_bytes());
                reply.extend([event[8], 0, 0, 0, 0, 1, 1]);
            }
            SET_REPORT => {
                reply.extend(SET_REPORT_REPLY.to_le_bytes());
                reply.extend(&event[4..8]);
                reply.extend([0, 0]);
            }
            _ => {}
        }
        if !reply.is_empty() {
            file.write_all(&reply)?;
        }
    }
}
