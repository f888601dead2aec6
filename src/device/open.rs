//! The one place where a name becomes a device.

use super::{
    Clock, CommandLink, DeviceError, Display, ErrorKind, FrameSource, ImuSource,
    bracketed::{CameraResponse, Replan},
    imu::{self, description::ImuDescription, names::ImuName, wire_log::WireLogWriter},
    null_display::NullDisplay,
    parameters::nearest,
    replay,
    stdio_link::LineLink,
    synthetic,
};
#[cfg(feature = "v4l2")]
use super::{
    bracketed::{BracketedCamera, ExposureControl},
    clock::MonotonicClock,
    developed::{CaptureSource, DevelopedCamera},
};
#[cfg(feature = "v4l2")]
use crate::hdr::develop::SensorOptions;
use std::sync::Arc;

/// An opened camera, with its inertial sensor where it has one.
pub struct OpenedDevices {
    /// The camera.
    pub frames: Box<dyn FrameSource>,
    /// The inertial sensor.
    pub imu: Option<Box<dyn ImuSource>>,
}

/// What stands before the colon of a camera's name.
pub const SCHEMES: [&str; 5] = ["auto", "synthetic", "replay", "v4l2", "libcamera"];
/// What stands before the colon of a display's name.
pub const DISPLAYS: [&str; 1] = ["null"];
/// Names of command links.
pub const LINKS: [&str; 1] = ["stdio"];

/// Opens `auto` (the best camera there is), `synthetic:key=value,..` (see `synthetic::SyntheticOptions`), `replay:FILE` or a path that ends in `.mcap`,
/// `v4l2:/dev/video0,..` (see `v4l2::V4l2Options`) or a path that begins with `/dev/video` or `/dev/v4l`, `libcamera:ID,..` (see
/// `libcamera::LibcameraOptions`).
/// `Refused` for anything else, with what is known and what comes nearest.
pub fn open(name: &str) -> Result<OpenedDevices, DeviceError> {
    open_with(name, CameraOptions::default())
}

/// What else is known of a camera when it is opened.
#[derive(Clone, Debug, Default)]
pub struct CameraOptions {
    /// Its response, for cameras that do not state it themselves.
    pub response: CameraResponse,
    /// How exposures are fitted to the scene; `None`: they stay.
    pub replan: Option<Replan>,
}

/// As [`open`], with what else is known.
pub fn open_with(name: &str, options: CameraOptions) -> Result<OpenedDevices, DeviceError> {
    let (scheme, rest) = match name.split_once(':') {
        Some((scheme, rest)) if !name.ends_with(".mcap") || SCHEMES.contains(&scheme) => (scheme, rest),
        _ if name.ends_with(".mcap") => ("replay", name),
        _ if name.starts_with("/dev/video") || name.starts_with("/dev/v4l") => ("v4l2", name),
        _ => (name, ""),
    };
    match scheme {
        "synthetic" => {
            let (frames, imu) = synthetic::open(&synthetic::SyntheticOptions::parse(rest)?);
            Ok(OpenedDevices { frames: Box::new(frames), imu: Some(Box::new(imu)) })
        }
        "replay" => {
            let (frames, imu) = replay::open(&replay::ReplayOptions::parse(rest)?)?;
            Ok(OpenedDevices {
                frames: Box::new(frames),
                imu: imu.map(|imu| Box::new(imu) as Box<dyn ImuSource>),
            })
        }
        #[cfg(feature = "v4l2")]
        "v4l2" => open_v4l2(rest, options),
        #[cfg(feature = "v4l2")]
        "auto" if rest.is_empty() => open_best(options),
        #[cfg(not(feature = "v4l2"))]
        "v4l2" | "auto" => {
            let action = "this program was built without V4L2 (feature v4l2)";
            drop(options);
            Err(DeviceError::new(name, action, ErrorKind::Refused))
        }
        #[cfg(feature = "libcamera")]
        "libcamera" => open_libcamera(rest, options),
        #[cfg(not(feature = "libcamera"))]
        "libcamera" => {
            let action = "this program was built without libcamera (feature libcamera; make switches it on where libcamera-dev is)";
            Err(DeviceError::new(name, action, ErrorKind::Refused))
        }
        _ => {
            let known =
                "auto | v4l2:/dev/video0 | libcamera:ID | synthetic:key=value,.. | replay:FILE | FILE.mcap";
            Err(unknown(name, scheme, &SCHEMES, known))
        }
    }
}

/// A camera of the kernel, with its exposures in turn.
#[cfg(feature = "v4l2")]
fn open_v4l2(rest: &str, options: CameraOptions) -> Result<OpenedDevices, DeviceError> {
    let camera = super::v4l2::open(rest, Arc::new(MonotonicClock::default()))?;
    with_exposures(format!("v4l2:{rest}"), camera, options)
}

/// A camera behind libcamera. One whose metadata states each frame's exposure passes through the bracketing untouched.
#[cfg(feature = "libcamera")]
fn open_libcamera(rest: &str, options: CameraOptions) -> Result<OpenedDevices, DeviceError> {
    let camera = super::libcamera::open(rest, Arc::new(MonotonicClock::default()))?;
    with_exposures(format!("libcamera:{rest}"), camera, options)
}

/// The best camera there is.
#[cfg(feature = "v4l2")]
fn open_best(options: CameraOptions) -> Result<OpenedDevices, DeviceError> {
    #[cfg(feature = "libcamera")]
    if let Some(id) = super::libcamera::best() {
        return open_libcamera(&id, options);
    }
    open_v4l2("", options)
}

#[cfg(feature = "v4l2")]
fn with_exposures<S>(name: String, camera: S, options: CameraOptions) -> Result<OpenedDevices, DeviceError>
where
    S: CaptureSource + ExposureControl + 'static,
{
    let CameraOptions { response, replan } = options;
    let developed = DevelopedCamera::new(&name, camera, response.at_first(), SensorOptions::default())?;
    let frames = Box::new(BracketedCamera::new(name, developed, response).replanning(replan));
    Ok(OpenedDevices { frames, imu: None })
}

/// Opens the display `null:hz=60`. `Refused` for anything else, with what is known and what comes nearest.
pub fn open_display(name: &str, clock: Arc<dyn Clock>) -> Result<Box<dyn Display>, DeviceError> {
    let (scheme, rest) = name.split_once(':').unwrap_or((name, ""));
    match scheme {
        "null" => Ok(Box::new(NullDisplay::open(name, rest, clock)?)),
        _ => Err(unknown(name, scheme, &DISPLAYS, "null:hz=60")),
    }
}

/// Opens the command link `stdio`. `Refused` for anything else, with what is known and what comes nearest.
pub fn open_link(name: &str, clock: Arc<dyn Clock>) -> Result<Box<dyn CommandLink>, DeviceError> {
    match name {
        "stdio" => Ok(Box::new(LineLink::new(std::io::stdin(), std::io::stdout(), clock)?)),
        _ => Err(unknown(name, name, &LINKS, "stdio")),
    }
}

/// What else is known of an inertial sensor when it is opened.
#[derive(Default)]
pub struct ImuOptions {
    /// The rig's `[imu]` table.
    pub description: ImuDescription,
    /// Where everything goes that comes over the wire.
    pub raw: Option<WireLogWriter>,
}

/// Opens an inertial sensor: `serial:/dev/ttyUSB0,protocol=rvc,baud=115200`, `hid:/dev/hidraw0`, `hid:2833:0021`, `hid:name=TEXT`,
/// `iio:/dev/iio:device0` or `iio:name=dev_rotation`. `Reopen` where it is not there or may not be opened (yet), `Refused` where
/// the name or the rig is wrong, with what is known and what comes nearest.
pub fn open_imu(
    name: &str,
    clock: Arc<dyn Clock>,
    options: ImuOptions,
) -> Result<Box<dyn ImuSource>, DeviceError> {
    let Some(parsed) = ImuName::parse(name)? else {
        let scheme = name.split(':').next().unwrap_or_default();
        return Err(unknown(name, scheme, &imu::names::SCHEMES, imu::names::KNOWN));
    };
    let ImuOptions { description, raw } = options;
    match parsed.scheme {
        #[cfg(feature = "serial")]
        "serial" => Ok(Box::new(imu::serial::SerialImu::open(name, &parsed, &description, clock, raw)?)),
        #[cfg(feature = "hid")]
        "hid" => Ok(Box::new(imu::hid::hidraw::open(name, &parsed, &description, clock, raw)?)),
        "iio" => {
            let places = imu::iio::Places::default();
            Ok(Box::new(imu::iio::IioImu::open(name, &parsed, &description, clock, &places)?))
        }
        scheme => {
            let action = format!("this program was built without the feature \"{scheme}\"");
            let _ = (clock, description, raw);
            Err(DeviceError::new(name, action, ErrorKind::Refused))
        }
    }
}

fn unknown(name: &str, scheme: &str, schemes: &[&str], known: &str) -> DeviceError {
    let hint = nearest(scheme, schemes).map(|s| format!("did you mean \"{s}\"? ")).unwrap_or_default();
    let action = format!("unknown kind of device \"{scheme}\": {hint}Known: {known}");
    DeviceError::new(name, action, ErrorKind::Refused)
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
        assert!(refusal("synthetik:frames=3").contains("did you mean \"synthetic\"?"));
        assert!(refusal("/def/video0").contains("Known: auto"));
        assert!(refusal("").contains("Known: auto"));
        assert!(refusal("no/such/file.mcap").contains("replay:no/such/file.mcap: open the file"));
        assert!(refusal("synthetic:frame=3").contains("did you mean \"frames\"?"));
    }

    #[test]
    fn displays_and_links_are_known_by_name() {
        let clock: Arc<dyn Clock> = Arc::new(crate::clock::ManualClock::default());
        assert!(open_display("null:hz=75", Arc::clone(&clock)).is_ok());
        let refusal = open_display("nul:hz=75", Arc::clone(&clock)).err().unwrap();
        assert_eq!(refusal.kind, ErrorKind::Refused);
        assert!(refusal.to_string().contains("did you mean \"null\"? Known: null:hz=60"));
        assert!(open_link("/dev/ttyS1", clock).err().unwrap().to_string().contains("Known: stdio"));
    }

    #[test]
    fn inertial_sensors_are_known_by_name() {
        let error = |name: &str| {
            let clock: Arc<dyn Clock> = Arc::new(crate::clock::ManualClock::default());
            open_imu(name, clock, ImuOptions::default()).err().unwrap()
        };
        let unknown = error("seriel:/dev/ttyUSB0");
        assert_eq!(unknown.kind, ErrorKind::Refused);
        assert!(
            unknown.to_string().contains("did you mean \"serial\"? Known: serial:/dev/ttyUSB0,protocol=rvc")
        );
        assert!(error("synthetic:").to_string().contains("Known: serial:"));
        // What is not there may come yet.
        #[cfg(feature = "serial")]
        assert_eq!(error("serial:/no/such/port,protocol=rvc").kind, ErrorKind::Reopen);
        #[cfg(feature = "hid")]
        assert_eq!(error("hid:2833:0021").kind, ErrorKind::Reopen);
        #[cfg(feature = "hid")]
        assert!(error("hid:2833:0021,protocol=rifd").to_string().contains("did you mean \"rift\"?"));
    }
}
