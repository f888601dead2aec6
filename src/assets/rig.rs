//! Rig files: what is measured of a camera and of its inertial sensor (TOML). One table of keys makes the manual
//! (`config/rig-example.toml`) and the order in which a rig is written.

use super::error::{AssetError, read_text};
use serde::Deserialize;
use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// One key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RigKey {
    /// Its table.
    pub section: &'static str,
    /// What stands before the equals sign in its table.
    pub name: &'static str,
    /// Unit, or empty.
    pub unit: &'static str,
    /// As the manual shows it.
    pub example: &'static str,
    /// What it is.
    pub effect: &'static str,
}

macro_rules! rows {
    ($($section:literal $name:literal $unit:literal $example:literal, $effect:literal;)+) => {
        &[$(RigKey { section: $section, name: $name, unit: $unit, example: $example, effect: $effect }),+]
    };
}

/// Every key, in its order.
pub const KEYS: &[RigKey] = rows! {
    "camera" "name" "" "\"v4l2:card=HD Webcam\"", "The camera, as device.camera names it. Used where that is auto.";
    "camera" "size_px" "px" "[640, 480]", "Columns and rows that it was measured at, each 16 to 16384.";
    "camera" "frames_per_s" "1/s" "30.0", "Its rate, 0.1 to 1000.";
    "camera" "exposure_s" "s" "[0.0001, 0.0333]", "Least and most exposure time that its control takes, 1e-6 to 10.";
    "camera" "exposure_step_s" "s" "0.0001", "Step of that control, 0 to 1.";
    "camera" "gain" "" "[1.0, 8.0]", "Least and most gain, 1 = the driver's own choice, 0.001 to 1000.";
    "camera" "latency_frames" "frames" "2", "A written exposure is in force so many frames later than at once, 0 to 9: halflight calibrate latency.";
    "camera" "response" "" "\"response.json\"", "What its values mean: halflight calibrate response. Used where camera.response is device. Beside this file.";
    "camera" "calibration" "" "\"lens.yml\"", "Its lens: halflight calibrate camera. Used where camera.calibration is empty. Beside this file.";
    "imu" "name" "" "\"iio:name=gyro_3d\"", "The inertial sensor, as device.imu names it. Used where that is empty.";
    "imu" "protocol" "" "\"rvc\"", "How its bytes are read: rvc, witmotion, ypr, rift, psvr or described (with [imu.frame] and [[imu.field]]: docs/imu.md).";
    "imu" "baud" "1/s" "115200", "Of a serial port, 1200 to 4000000.";
    "imu" "rate_hz" "Hz" "100.0", "Samples a second, 1 to 4000.";
    "imu" "axes" "" "[\"x\", \"-y\", \"-z\"]", "The samples' x (right), y (down), z (ahead) are these axes of the sensor; or rotation_q_wxyz.";
    "imu" "camera_from_imu_q_wxyz" "" "[1.0, 0.0, 0.0, 0.0]", "The samples' axes to the camera's.";
};

/// Where a fact comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FactSource {
    /// Somebody measured it.
    Measured,
    /// The device's driver says so.
    Stated,
    /// Nobody knows: it is what is usual.
    Guess,
    /// It is not known, and the line is a remark.
    Missing,
}

/// A line of a rig that is written.
#[derive(Clone, Debug, PartialEq)]
pub struct RigFact {
    /// Its table.
    pub section: &'static str,
    /// Its key.
    pub name: &'static str,
    /// As TOML has it.
    pub value: String,
    /// Where it comes from.
    pub source: FactSource,
    /// What else there is to say.
    pub remark: String,
}

impl RigFact {
    /// A text as TOML has it.
    pub fn text(text: &str) -> String {
        toml::Value::String(text.to_owned()).to_string()
    }

    fn line(&self, key: &RigKey) -> String {
        let source = match self.source {
            FactSource::Measured => "measured",
            FactSource::Stated => "stated by the driver",
            FactSource::Guess => "guess",
            FactSource::Missing => "not measured",
        };
        let said = [key.unit, source, &self.remark].into_iter().filter(|part| !part.is_empty());
        let said = said.collect::<Vec<_>>().join("; ").replace(['\n', '\r'], " ");
        let mark = if self.source == FactSource::Missing { "# " } else { "" };
        format!("{mark}{} = {}   # {said}", self.name, self.value)
    }
}

/// A rig of these facts, in the order of [`KEYS`]; what has no key is left out.
pub fn to_toml(facts: &[RigFact]) -> String {
    let mut text = String::from("# A rig. What each key is: config/rig-example.toml\n");
    let mut section = "";
    for key in KEYS {
        let is_this = |fact: &&RigFact| (fact.section, fact.name) == (key.section, key.name);
        let Some(fact) = facts.iter().find(is_this) else { continue };
        if key.section != section {
            section = key.section;
            let _ = write!(text, "\n[{section}]\n");
        }
        text += &fact.line(key);
        text.push('\n');
    }
    text
}

/// Every key with its unit, range and default, as `config/rig-example.toml` has them.
pub fn manual() -> String {
    let mut text = String::from(
        "# Every key of a rig file. Made from the table in src/assets/rig.rs; `halflight rig` makes a first one from the\n\
         # devices at hand, and device.rig names it. Every key may be left out.\n",
    );
    let mut section = "";
    for key in KEYS {
        if key.section != section {
            section = key.section;
            let _ = write!(text, "\n[{section}]\n");
        }
        let unit = if key.unit.is_empty() { String::new() } else { format!(" [{}]", key.unit) };
        let _ = write!(text, "# {}{unit}\n{} = {}\n", key.effect, key.name, key.example);
    }
    text
}

/// What a rig file says of its camera.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRig {
    /// As `device.camera` names it.
    pub name: Option<String>,
    /// Columns and rows.
    pub size_px: Option<[u32; 2]>,
    /// Frames a second.
    pub frames_per_s: Option<f64>,
    /// Least and most exposure time, seconds.
    pub exposure_s: Option<[f64; 2]>,
    /// Step of the control, seconds.
    pub exposure_step_s: Option<f64>,
    /// Least and most gain.
    pub gain: Option<[f64; 2]>,
    /// Frames later than at once.
    pub latency_frames: Option<u32>,
    /// File of its response.
    pub response: Option<PathBuf>,
    /// File of its lens.
    pub calibration: Option<PathBuf>,
}

/// A rig file; its `[imu]` table is read by the device's own reader.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigDescription {
    /// `[camera]`
    #[serde(default)]
    pub camera: CameraRig,
    /// `[imu]`, as typed.
    pub imu: Option<toml::Table>,
}

/// Reads a rig file.
///
/// # Errors
/// It cannot be read, is no TOML, or has a key or a value that is none.
pub fn load(file: &Path) -> Result<RigDescription, AssetError> {
    parse(file, &read_text(file)?)
}

/// Parses a rig file; names of files in it are taken to be beside it.
///
/// # Errors
/// As [`load`].
pub fn parse(file: &Path, text: &str) -> Result<RigDescription, AssetError> {
    let mut rig: RigDescription = toml::from_str(text)
        .map_err(|e| AssetError::new(file, "is no rig").cause(e.to_string().trim_end().to_owned()))?;
    let camera = &mut rig.camera;
    let check = |name: &str, values: &[f64], allowed: RangeInclusive<f64>| match values
        .iter()
        .find(|value| !allowed.contains(value))
    {
        Some(value) => Err(AssetError::new(file, format!("camera.{name}"))
            .value(*value)
            .allowed(format!("within {allowed:?}"))),
        None => Ok(()),
    };
    check("size_px", &camera.size_px.unwrap_or([16; 2]).map(f64::from), 16.0..=16384.0)?;
    check("frames_per_s", &[camera.frames_per_s.unwrap_or(1.0)], 0.1..=1000.0)?;
    check("exposure_s", &camera.exposure_s.unwrap_or([1.0; 2]), 1e-6..=10.0)?;
    check("exposure_step_s", &[camera.exposure_step_s.unwrap_or(0.0)], 0.0..=1.0)?;
    check("gain", &camera.gain.unwrap_or([1.0; 2]), 1e-3..=1000.0)?;
    check("latency_frames", &[f64::from(camera.latency_frames.unwrap_or(0))], 0.0..=9.0)?;
    for (name, pair) in [("exposure_s", camera.exposure_s), ("gain", camera.gain)] {
        if let Some([least, most]) = pair.filter(|[least, most]| least > most) {
            let error = AssetError::new(file, format!("camera.{name}"));
            return Err(error.value(format!("[{least}, {most}]")).allowed("the lesser first"));
        }
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    for named in [&mut camera.response, &mut camera.calibration].into_iter().flatten() {
        *named = folder.join(&*named);
    }
    Ok(rig)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_manual_is_a_rig_with_every_key() {
        let rig = parse(Path::new("rigs/a.toml"), &manual()).unwrap();
        assert_eq!(rig.camera.latency_frames, Some(2));
        assert_eq!(rig.camera.response.as_deref(), Some(Path::new("rigs/response.json")));
        let typed: toml::Table = manual().parse().unwrap();
        for key in KEYS {
            assert!(typed[key.section].as_table().unwrap().contains_key(key.name), "{}", key.name);
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let fact = |section, name, value: &str, source| RigFact {
            section,
            name,
            value: value.to_owned(),
            source,
            remark: "a\nremark".to_owned(),
        };
        let text = to_toml(&[
            fact("imu", "rate_hz", "200.0", FactSource::Guess),
            fact("camera", "name", &RigFact::text("v4l2:card=\"odd\" \\ name"), FactSource::Stated),
            fact("camera", "exposure_s", "[0.0001, 0.033]", FactSource::Stated),
            fact("camera", "latency_frames", "2", FactSource::Measured),
            fact("camera", "response", "\"r.json\"", FactSource::Missing),
        ]);
        let rig = parse(Path::new("a.toml"), &text).unwrap();
        assert_eq!(rig.camera.name.as_deref(), Some("v4l2:card=\"odd\" \\ name"));
        assert_eq!((rig.camera.exposure_s, rig.camera.response), (Some([0.0001, 0.033]), None));
        assert_eq!(rig.imu.unwrap()["rate_hz"].as_float(), Some(200.0));
        for said in ["# s; stated by the driver", "# frames; measured", "# Hz; guess", "# response ="] {
            assert!(text.contains(said), "{said}: {text}");
        }
    }

    #[test]
    fn mistakes_name_the_key_and_what_is_allowed() {
        let error = |text: &str| parse(Path::new("a.toml"), text).unwrap_err().to_string();
        assert!(error("[camera]\nexposure_s = [0.1, 0.01]").contains("the lesser first"));
        assert!(error("[camera]\nlatency_frames = 10").contains("camera.latency_frames = 10"));
        assert!(error("[camera]\nlatency = 1").contains("latency_frames"));
        assert!(error("[light]\n").contains("light"));
        assert!(error("[camera]\ngain = [nan, 1.0]").contains("camera.gain"));
    }

    proptest! {
        #[test]
        fn any_text_is_judged(text in "\\PC{0,80}") {
            let _ = parse(Path::new("any.toml"), &text);
            let _ = parse(Path::new("any.toml"), &format!("[camera]\n{text}"));
        }
    }
}
