//! Questions and orders of the guest's steps: a line each, answered by a line that begins with `ok` or `fail`.

use crate::camera::{Camera, Delay, Pictures, locked};
use crate::guest::{Door, Guest};
use crate::host::Host;
use crate::serial::{Line, Talk};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

type Answer = Result<String, String>;

/// Everything that a step can ask for.
pub struct Control {
    pub camera: Arc<Mutex<Camera>>,
    pub line: Line,
    pub host: Host,
    camera_socket: PathBuf,
    serial_socket: PathBuf,
}

/// The number after `key=` in words such as `lag=2`.
fn number<T: std::str::FromStr<Err: std::fmt::Display>>(
    words: &[&str],
    key: &str,
) -> Result<Option<T>, String> {
    let Some(text) = words.iter().find_map(|word| word.strip_prefix(key)?.strip_prefix('=')) else {
        return Ok(None);
    };
    text.parse().map(Some).map_err(|e| format!("{key}={text}: {e}"))
}

impl Control {
    pub fn new(camera: Arc<Mutex<Camera>>, guest: &Guest, host: Host) -> Self {
        let (camera_socket, serial_socket) = (guest.socket(Door::Camera), guest.socket(Door::Serial));
        Self { camera, line: Line::default(), host, camera_socket, serial_socket }
    }

    /// Answers until the guest ends.
    pub fn serve(&mut self, stream: UnixStream) -> std::io::Result<()> {
        let mut out = stream.try_clone()?;
        for line in BufReader::new(stream).lines() {
            let line = line?;
            let words: Vec<&str> = line.split_whitespace().collect();
            let answer = match self.answer(&words) {
                Ok(text) => format!("ok {text}\n"),
                Err(text) => format!("fail {}\n", text.replace('\n', " ")),
            };
            out.write_all(answer.as_bytes())?;
        }
        Ok(())
    }

    fn answer(&mut self, words: &[&str]) -> Answer {
        match words {
            ["camera", rest @ ..] => self.camera(rest),
            ["serial", "cut"] => {
                self.line.cut();
                Ok(String::new())
            }
            ["serial", rest @ ..] => self.serial(rest),
            ["host", "replay", file, frames] => self.host.replay(file, frames),
            ["host", "pictures", file] => self.host.pictures(file),
            ["host", "alike", one, other] => self.host.alike(one, other),
            ["host", "forces", file] => self.host.forces(file),
            ["host", "attributions", file] => self.host.attributions(file, &locked(&self.camera)),
            _ => Err(format!("nobody knows \"{}\"", words.join(" "))),
        }
    }

    fn camera(&mut self, words: &[&str]) -> Answer {
        match words {
            ["plug"] => {
                Camera::plug(&self.camera, &self.camera_socket).map_err(|e| e.to_string())?;
                Ok(String::new())
            }
            ["unplug"] => {
                locked(&self.camera).unplug();
                Ok(String::new())
            }
            ["set", rest @ ..] => self.set(rest),
            ["fault", rest @ ..] => self.fault(rest),
            ["made"] => Ok(locked(&self.camera).made().len().to_string()),
            ["check", file] => self.host.check(file, &locked(&self.camera)),
            _ => Err(format!("a camera cannot \"{}\"", words.join(" "))),
        }
    }

    fn set(&mut self, words: &[&str]) -> Answer {
        let mut camera = locked(&self.camera);
        let lag = number(words, "lag")?.unwrap_or(camera.delay.lag);
        let jitter = number(words, "jitter")?.unwrap_or(0);
        camera.delay = Delay { lag, jitter };
        camera.pacing.ahead = number(words, "ahead")?.unwrap_or(1);
        match words.iter().find_map(|word| word.strip_prefix("pictures=")) {
            Some("pattern") => camera.pictures = Pictures::Pattern,
            Some(recording) => {
                let file = self.host.recording(recording);
                camera.pictures = Pictures::of_recording(&file.to_string_lossy())?;
            }
            None => {}
        }
        Ok(String::new())
    }

    fn fault(&mut self, words: &[&str]) -> Answer {
        let faults = &mut locked(&self.camera).faults;
        faults.unplug_after = number(words, "unplug")?;
        faults.silent_after = number(words, "silent")?;
        faults.short = number(words, "short")?;
        faults.drop = number(words, "drop")?;
        Ok(String::new())
    }

    fn serial(&mut self, words: &[&str]) -> Answer {
        let talk = match words {
            ["echo"] => Talk::Echo,
            ["rvc"] => Talk::Rvc,
            ["samples", rest @ ..] => Talk::Samples {
                first: number(rest, "first")?.unwrap_or(0),
                count: number(rest, "count")?.unwrap_or(100),
            },
            _ => return Err(format!("a serial device cannot \"{}\"", words.join(" "))),
        };
        self.line.plug(&self.serial_socket, talk).map_err(|e| e.to_string())?;
        Ok(String::new())
    }
}
