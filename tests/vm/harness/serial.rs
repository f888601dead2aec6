//! The device at the other end of the guest's USB serial line: sends back what comes, or samples of an inertial sensor.

use halflight_vm::Sample;
use std::io::{Read, Result, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;
use std::time::Duration;

/// What the device does.
#[derive(Clone, Copy)]
pub enum Talk {
    Echo,
    /// So many samples, beginning with this one, as soon as the guest sends a byte: opening a line drops what waits in it.
    Samples {
        first: u32,
        count: u32,
    },
    /// Frames of a BNO08x in UART-RVC mode, 100 a second, until the line is cut.
    Rvc,
}

/// Time from frame to frame.
const RVC_PERIOD: Duration = Duration::from_millis(10);

/// Force along x of a frame by rule, 0.001 g: up to 100 and down again, one with each frame.
pub fn rvc_force(counter: u32) -> i16 {
    let place = (counter % 200) as i16;
    if place < 100 { place } else { 200 - place }
}

/// The frame with this counter: the sensor turns about z, and leans nowhere.
fn rvc_frame(counter: u32) -> [u8; 19] {
    let yaw = (i64::from(counter) * 20 % 36_000 - 18_000) as i16;
    let mut frame = [0; 19];
    frame[..2].copy_from_slice(&[0xAA, 0xAA]);
    frame[2] = counter as u8;
    for (at, value) in [(3, yaw), (5, 0), (7, 0), (9, rvc_force(counter)), (11, 0), (13, 1000)] {
        frame[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
    frame[18] = frame[2..18].iter().fold(0, |sum, byte| sum.wrapping_add(*byte));
    frame
}

/// The line, cut while nothing is plugged in.
#[derive(Default)]
pub struct Line {
    stream: Option<UnixStream>,
}

impl Line {
    /// Plugs the device in.
    pub fn plug(&mut self, socket: &Path, talk: Talk) -> Result<()> {
        self.cut();
        let stream = UnixStream::connect(socket)?;
        self.stream = Some(stream.try_clone()?);
        thread::spawn(move || {
            // Cutting the line ends the thread with an error.
            let _ = speak(stream, talk);
        });
        Ok(())
    }

    /// Pulls it out.
    pub fn cut(&mut self) {
        if let Some(stream) = self.stream.take() {
            // It may be closed already.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

fn speak(mut stream: UnixStream, talk: Talk) -> Result<()> {
    if let Talk::Rvc = talk {
        for counter in 0.. {
            stream.write_all(&rvc_frame(counter))?;
            thread::sleep(RVC_PERIOD);
        }
    }
    let mut bytes = [0; 4096];
    loop {
        let length = stream.read(&mut bytes)?;
        if length == 0 {
            return Ok(());
        }
        match talk {
            Talk::Echo => stream.write_all(&bytes[..length])?,
            Talk::Samples { first, count } => {
                for counter in first..first.saturating_add(count) {
                    stream.write_all(&Sample::by_rule(counter).report())?;
                }
            }
            Talk::Rvc => {}
        }
    }
}
