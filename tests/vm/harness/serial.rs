//! The device at the other end of the guest's USB serial line: sends back what comes, or samples of an inertial sensor.

use halflight_vm::Sample;
use std::io::{Read, Result, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;

/// What the device does.
#[derive(Clone, Copy)]
pub enum Talk {
    Echo,
    /// So many samples, beginning with this one, as soon as the guest sends a byte: opening a line drops what waits in it.
    Samples {
        first: u32,
        count: u32,
    },
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
        }
    }
}
