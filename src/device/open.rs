//! The one place where a name becomes a device.

use super::{DeviceError, ErrorKind, FrameSource, ImuSource, parameters::nearest, replay, synthetic};

/// An opened camera, with its inertial sensor where it has one.
pub struct Opened {
    /// The camera.
    pub frames: Box<dyn FrameSource>,
    /// The inertial sensor.
    pub imu: Option<Box<dyn ImuSource>>,
}

/// What stands before the colon of a device name.
pub const SCHEMES: [&str; 2] = ["synthetic", "replay"];

/// Opens `synthetic:key=value,..` (see `synthetic::Options`), `replay:FILE` or a path that ends in `.mcap`.
/// `Refused` for anything else, with what is known and what comes nearest.
pub fn open(name: &str) -> Result<Opened, DeviceError> {
    let (scheme, rest) = match name.split_once(':') {
        Some((scheme, rest)) if !name.ends_with(".mcap") || SCHEMES.contains(&scheme) => (scheme, rest),
        _ if name.ends_with(".mcap") => ("replay", name),
        _ => (name, ""),
    };
    match scheme {
        "synthetic" => {
            let (frames, imu) = synthetic::open(&synthetic::Options::parse(rest)?);
            Ok(Opened { frames: Box::new(frames), imu: Some(Box::new(imu)) })
        }
        "replay" => {
            let (frames, imu) = replay::open(&replay::ReplayOptions::parse(rest)?)?;
            Ok(Opened { frames: Box::new(frames), imu: imu.map(|imu| Box::new(imu) as Box<dyn ImuSource>) })
        }
        _ => {
            let hint =
                nearest(scheme, &SCHEMES).map(|s| format!("did you mean \"{s}:\"? ")).unwrap_or_default();
            let action = format!(
                "unknown kind of device \"{scheme}\": {hint}Known: synthetic:key=value,.. | replay:FILE | FILE.mcap"
            );
            Err(DeviceError::new(name, action, ErrorKind::Refused))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(name: &str) -> String {
        let error = open(name).err().unwrap();
        assert_eq!(error.kind, ErrorKind::Refused);
        error.to_string()
    }

    #[test]
    fn unknown_names_are_refused_with_what_is_known() {
        assert!(refusal("synthetik:frames=3").contains("did you mean \"synthetic:\"?"));
        assert!(refusal("/dev/video0").contains("Known: synthetic:"));
        assert!(refusal("").contains("Known: synthetic:"));
        assert!(refusal("no/such/file.mcap").contains("replay:no/such/file.mcap: open the file"));
        assert!(refusal("synthetic:frame=3").contains("did you mean \"frames\"?"));
    }
}
