//! What the host finds out about files that the guest left: the same programs run here, and the camera's own log.

use crate::camera::{Camera, Fate, Made};
use crate::serial::rvc_force;
use halflight_core::model::time::Timestamp;
use halflight_device::{
    ErrorKind, FrameSource, ImuSource,
    replay::{self, ReplayOptions},
};
use halflight_vm::{STRIP_ROWS, Strip};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

type Answer = Result<String, String>;

/// The host's side of the shared folder.
pub struct Host {
    pub share: PathBuf,
    pub tool: PathBuf,
}

/// The camera's log of the frame with this number in its strip: the newest, should the count have gone round.
fn made(camera: &Camera, number: u16) -> Option<&Made> {
    camera.made().iter().rev().find(|made| made.number as u16 == number)
}

impl Host {
    /// A bundled recording by its name.
    pub fn recording(&self, name: &str) -> PathBuf {
        self.share.join("recordings").join(format!("{name}.mcap"))
    }

    /// Runs the tool here; gives the digest that it prints.
    fn digest(&self, arguments: &[&str]) -> Answer {
        let run = Command::new(&self.tool)
            .args(arguments)
            .args(["--digest", "--quiet"])
            .output()
            .map_err(|e| format!("{}: {e}", self.tool.display()))?;
        let text = String::from_utf8_lossy(&run.stdout).into_owned();
        let digest = text.lines().find_map(|line| line.strip_prefix("digest "));
        match digest {
            Some(digest) if run.status.success() => Ok(digest.to_owned()),
            _ => Err(format!("no digest on the host: {}", String::from_utf8_lossy(&run.stderr))),
        }
    }

    /// Digest of a replay of a shared file.
    pub fn replay(&self, file: &str, frames: &str) -> Answer {
        let path = self.share.join(file);
        self.digest(&["replay", &path.to_string_lossy(), "--frames", frames])
    }

    /// Digest of the pictures of a shared recording, as they lie in it.
    pub fn pictures(&self, file: &str) -> Answer {
        let path = self.share.join(file);
        let again = path.with_extension("again.mcap");
        let device = format!("replay:{}", path.display());
        self.digest(&["record", &device, "--raw", "--force", "--out", &again.to_string_lossy()])
    }

    /// Holds a list of frames (`frame SEQUENCE NUMBER EXPOSURE DIGEST`) against the camera's log. Every line must be true, and
    /// the numbers must rise.
    pub fn check(&self, file: &str, camera: &Camera) -> Answer {
        let text = fs::read_to_string(self.share.join(file)).map_err(|e| format!("{file}: {e}"))?;
        let mut count = 0;
        let mut last = None;
        for line in text.lines().filter(|line| line.starts_with("frame ")) {
            let words: Vec<&str> = line.split(' ').collect();
            let [_, _, number, exposure, digest] = words[..] else { return Err(format!("\"{line}\"")) };
            let number: u16 = number.parse().map_err(|e| format!("\"{line}\": {e}"))?;
            let made = made(camera, number).ok_or(format!("frame {number} was never made"))?;
            if made.fate != Fate::Sent || Some(made.number) <= last {
                return Err(format!("frame {number} came, which was {:?}, after {last:?}", made.fate));
            }
            if exposure != made.settings.exposure.to_string() || digest != format!("{:016x}", made.digest) {
                return Err(format!("\"{line}\", but the camera sent {made:?}"));
            }
            last = Some(made.number);
            count += 1;
        }
        if count == 0 { Err(format!("{file} lists no frame")) } else { Ok(count.to_string()) }
    }

    /// How far the first pictures of two shared recordings differ in the mean, 8-bit values, in their lowest fifth: the kernel's
    /// test camera writes text above. Where the other is gray, the gray of the first counts (ITU-R BT.709, as that camera has it).
    pub fn alike(&self, one: &str, other: &str) -> Answer {
        let first = |file: &str| -> Result<_, String> {
            let options =
                ReplayOptions::parse(&self.share.join(file).to_string_lossy()).map_err(|e| e.to_string())?;
            let (mut source, _) = replay::open(&options).map_err(|e| e.to_string())?;
            Ok(source.next(Timestamp::NEVER).map_err(|e| format!("{file}: {e}"))?.pixels)
        };
        let (one, other) = (first(one)?, first(other)?);
        if (one.width(), one.height()) != (other.width(), other.height()) {
            return Err(format!("{}x{} and {}x{}", one.width(), one.height(), other.width(), other.height()));
        }
        let lowest = one.height() - one.height() / 5;
        let [one, other] = [&one, &other].map(|picture| &picture.pixels()[picture.width() * lowest..]);
        let is_gray = other.iter().all(|[r, g, b]| r == g && g == b);
        let gray = |[r, g, b]: [u8; 3]| {
            [(0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)).round() as u8; 3]
        };
        let seen = one.iter().map(|pixel| if is_gray { gray(*pixel) } else { *pixel });
        let differences =
            seen.zip(other).flat_map(|(a, b)| (0..3).map(move |c| u64::from(a[c].abs_diff(b[c]))));
        Ok(format!("{}", differences.sum::<u64>() / (3 * one.len()).max(1) as u64))
    }

    /// Holds the inertial samples of a recording against what the sensor on the serial line sent: each follows the one before.
    pub fn forces(&self, file: &str) -> Answer {
        let options =
            ReplayOptions::parse(&self.share.join(file).to_string_lossy()).map_err(|e| e.to_string())?;
        let (_, imu) = replay::open(&options).map_err(|e| e.to_string())?;
        let mut samples = Vec::new();
        imu.ok_or(format!("{file} holds no inertial sample"))?
            .samples_until(Timestamp::NEVER, &mut samples)
            .map_err(|e| e.to_string())?;
        let sent: Vec<i64> = samples.iter().map(|s| (s.accel_m_s2[0] / 9.806_65e-3).round() as i64).collect();
        let place_of = |force: i64, next: i64| {
            (0..200).find(|k| i64::from(rvc_force(*k)) == force && i64::from(rvc_force(*k + 1)) == next)
        };
        for (at, two) in sent.windows(2).enumerate() {
            if place_of(two[0], two[1]).is_none() {
                return Err(format!("sample {at} is {two:?}, which never followed one another"));
            }
        }
        Ok(samples.len().to_string())
    }

    /// Holds the exposures of a recording against the camera's log.
    pub fn attributions(&self, file: &str, camera: &Camera) -> Answer {
        let path = self.share.join(file);
        let frames = strips(&path)?;
        for (strip, exposure) in &frames {
            let made = made(camera, strip.number).ok_or(format!("frame {} was never made", strip.number))?;
            if *exposure != f64::from(made.settings.exposure) {
                return Err(format!("exposure {exposure} (100 us) is stated, the camera had {made:?}"));
            }
        }
        if frames.is_empty() { Err(format!("{file} holds no frame")) } else { Ok(frames.len().to_string()) }
    }
}

/// The strip of every picture of a recording, with the exposure that the recording states (100 us).
fn strips(path: &Path) -> Result<Vec<(Strip, f64)>, String> {
    let options = ReplayOptions::parse(&path.to_string_lossy()).map_err(|e| e.to_string())?;
    let (mut source, _) = replay::open(&options).map_err(|e| e.to_string())?;
    let mut found = Vec::new();
    loop {
        match source.next(Timestamp::NEVER) {
            Ok(frame) => {
                let row = frame.pixels.row(STRIP_ROWS / 2);
                let strip = Strip::read(|x| row.get(x).is_some_and(|pixel| pixel[1] >= 128))
                    .ok_or(format!("picture {} has no strip", found.len()))?;
                found.push((strip, (frame.exposure.time_s * 1e4).round()));
            }
            Err(error) if error.kind == ErrorKind::Ended => return Ok(found),
            Err(error) => return Err(error.to_string()),
        }
    }
}
