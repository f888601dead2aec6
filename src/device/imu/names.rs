//! Names of inertial sensors: `serial:PATH,..`, `hid:PATH|VENDOR:PRODUCT|name=TEXT,..`, `iio:PATH|name=TEXT`.

use super::description::{BAUD, ImuDescription, RATE_HZ};
use crate::parameters::Parameters;
use crate::{DeviceError, ErrorKind};

/// What stands before the colon.
pub const SCHEMES: [&str; 3] = ["serial", "hid", "iio"];
/// What names look like, for messages.
pub const KNOWN: &str = "serial:/dev/ttyUSB0,protocol=rvc,baud=115200 | hid:/dev/hidraw0 | hid:2833:0021 | hid:name=TEXT | \
     iio:/dev/iio:device0 | iio:name=dev_rotation";
/// The longest name, bytes.
const LONGEST: usize = 512;

/// How a device is found, each time it is opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Which {
    /// By its node.
    Path(String),
    /// By the numbers of its maker and product.
    Ids(u16, u16),
    /// By what it calls itself; a part of it is enough.
    Name(String),
}

/// A sensor's name, taken apart.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuName {
    /// `serial`, `hid` or `iio`.
    pub scheme: &'static str,
    /// How it is found.
    pub which: Which,
    /// `protocol=`.
    pub protocol: Option<String>,
    /// `baud=`.
    pub baud: Option<u32>,
    /// `rate=`, Hz.
    pub rate_hz: Option<f64>,
}

impl ImuName {
    /// Takes a name apart. `Refused` where it is none, `None` where the scheme is unknown.
    pub fn parse(name: &str) -> Result<Option<Self>, DeviceError> {
        let refuse = |why: String| DeviceError::new(name, why, ErrorKind::Refused);
        let (scheme, rest) = name.split_once(':').unwrap_or((name, ""));
        let Some(scheme) = SCHEMES.into_iter().find(|known| *known == scheme) else { return Ok(None) };
        let (place, text) = rest.split_once(',').unwrap_or((rest, ""));
        if place.trim().is_empty() || name.len() > LONGEST {
            return Err(refuse(format!("must name a device in at most {LONGEST} bytes. Known: {KNOWN}")));
        }
        let keys: &[&str] = match scheme {
            "serial" => &["protocol", "baud", "rate"],
            "hid" => &["protocol", "rate"],
            _ => &["rate"],
        };
        let parameters = Parameters::parse(name, text, keys)?;
        let which = match place.split_once('=') {
            Some(("name", text)) if scheme != "serial" && !text.is_empty() => Which::Name(text.to_owned()),
            _ if place.starts_with('/') => Which::Path(place.to_owned()),
            _ if scheme == "hid" => ids(place).ok_or_else(|| {
                refuse(format!(
                    "\"{place}\": must be /dev/hidrawN, VENDOR:PRODUCT in hex (2833:0021) or name=TEXT"
                ))
            })?,
            _ => return Err(refuse(format!("\"{place}\": must be an absolute path. Known: {KNOWN}"))),
        };
        let number = |key: &str, low: f64, high: f64, unit: &str| {
            let given = parameters.text(key).is_some();
            parameters.number(key, low, low, high, unit).map(|number| given.then_some(number))
        };
        let baud = number("baud", f64::from(*BAUD.start()), f64::from(*BAUD.end()), "")?;
        Ok(Some(Self {
            scheme,
            which,
            protocol: parameters.text("protocol").map(str::to_owned),
            baud: baud.map(|baud| baud as u32),
            rate_hz: number("rate", *RATE_HZ.start(), *RATE_HZ.end(), " Hz")?,
        }))
    }

    /// The rate in Hz: from the name, else from the rig, else what is usual.
    pub fn rate(&self, description: &ImuDescription, usual: f64) -> f64 {
        self.rate_hz.or(description.rate_hz).unwrap_or(usual)
    }
}

fn ids(text: &str) -> Option<Which> {
    let (vendor, product) = text.split_once(':')?;
    let hex = |text: &str| (text.len() == 4).then(|| u16::from_str_radix(text, 16).ok()).flatten();
    Some(Which::Ids(hex(vendor)?, hex(product)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_taken_apart() {
        let name = ImuName::parse("serial:/dev/ttyUSB0,protocol=rvc,baud=115200").unwrap().unwrap();
        assert_eq!(name.which, Which::Path("/dev/ttyUSB0".into()));
        assert_eq!((name.protocol.as_deref(), name.baud), (Some("rvc"), Some(115_200)));
        let which = |name: &str| ImuName::parse(name).unwrap().unwrap().which;
        assert_eq!(which("hid:2833:0021"), Which::Ids(0x2833, 0x21));
        assert_eq!(which("hid:name=Tracker,rate=500"), Which::Name("Tracker".into()));
        assert_eq!(which("iio:/dev/iio:device0"), Which::Path("/dev/iio:device0".into()));
        assert_eq!(which("iio:name=dev_rotation"), Which::Name("dev_rotation".into()));
        assert!(ImuName::parse("replay:x").unwrap().is_none());
    }

    #[test]
    fn mistakes_name_what_is_allowed() {
        let error = |name: &str| ImuName::parse(name).unwrap_err().to_string();
        assert!(error("serial:ttyUSB0").contains("absolute path"));
        assert!(error("serial:").contains("must name a device"));
        assert!(error("serial:/dev/a,bauds=1").contains("did you mean \"baud\"?"));
        assert!(error("serial:/dev/a,baud=7").contains("within 1200..=4000000"));
        assert!(error("hid:2833").contains("2833:0021"));
        assert!(error("hid:/dev/hidraw0,baud=9600").contains("unknown parameter"));
        assert!(error("iio:name=").contains("absolute path"));
    }
}
