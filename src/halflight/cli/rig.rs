//! `halflight rig`: a first rig file from the devices at hand.

use super::output::{shown, write_file};
use super::run_folder::{need_folder_of, refuse_existing};
use super::sensor_devices::ListedSensors;
use super::video_devices::{CameraFacts, ListedCameras};
use super::{CliError, GlobalOptions};
use crate::assets::rig::{self, FactSource, RigFact};
use crate::assets::{calibration, response};
use crate::device::at_hand::{PluggedMachine, inertial::ListedSensor};
use std::path::{Path, PathBuf};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Make a first rig file from the devices at hand.\n\n\
The best camera and the best inertial sensor are described: what their drivers state, what was measured (name the \
files and the delay), and guesses, each marked as what it is. device.rig names the file; every key is explained in \
config/rig-example.toml.\n\n\
Examples:\n\n\
  halflight rig\n\
  halflight rig --response response.json --calibration lens.yml --latency-frames 2 --out rig.toml";

/// Arguments of `halflight rig`.
#[derive(clap::Args, Debug)]
pub struct RigArguments {
    /// The rig file to write (default: standard output).
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// What `halflight calibrate response` wrote.
    #[arg(long, value_name = "FILE.json")]
    response: Option<PathBuf>,
    /// What `halflight calibrate camera` wrote.
    #[arg(long, value_name = "FILE.yml")]
    calibration: Option<PathBuf>,
    /// What `halflight calibrate latency` told.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=9))]
    latency_frames: Option<u32>,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
}

/// Runs `halflight rig`.
pub fn run(a: RigArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if let Some(out) = &a.out {
        need_folder_of(out)?;
        refuse_existing(out, a.force)?;
    }
    if let Some(file) = &a.response {
        response::load(file)?;
    }
    if let Some(file) = &a.calibration {
        calibration::load(file)?;
    }
    let machine = PluggedMachine::default();
    let (camera, sensors) = (ListedCameras::look(&machine).best_facts(), ListedSensors::look(&machine));
    let mut facts = camera_facts(camera.as_ref(), &a)?;
    facts.extend(sensor_facts(sensors.best()));
    let text = rig::to_toml(&facts);
    if let Some(out) = &a.out {
        write_file(out, &text)?;
    }
    if camera.is_none() {
        eprintln!("warning: no camera is at hand: the rig says nothing of one (halflight devices)");
    }
    if global.json {
        println!(
            "{}",
            serde_json::json!({
                "format": super::JSON_FORMAT, "file": a.out.as_deref().map(shown), "camera": camera.map(|c| c.name),
                "imu": sensors.best().map(|s| &s.name), "rig": text,
            })
        );
    } else if let Some(out) = &a.out {
        println!("{}: {} facts; device.rig = \"{}\" uses it", out.display(), facts.len(), out.display());
    } else {
        print!("{text}");
    }
    Ok(())
}

fn fact(name: &'static str, value: impl ToString, source: FactSource, remark: impl Into<String>) -> RigFact {
    RigFact { section: "camera", name, value: value.to_string(), source, remark: remark.into() }
}

/// A file as the rig names it: beside itself.
fn beside(file: &Path, out: Option<&Path>) -> Result<String, CliError> {
    let folder = |path: &Path| path.parent().unwrap_or(Path::new("")).to_owned();
    if let Some(out) = out.filter(|out| folder(out) == folder(file)) {
        let name = file.file_name().filter(|_| out != file).unwrap_or_default();
        return Ok(RigFact::text(&name.to_string_lossy()));
    }
    let whole = std::path::absolute(file).map_err(|e| CliError::on(file.display(), e))?;
    Ok(RigFact::text(&whole.to_string_lossy()))
}

fn camera_facts(camera: Option<&CameraFacts>, a: &RigArguments) -> Result<Vec<RigFact>, CliError> {
    use FactSource::{Guess, Measured, Missing, Stated};
    let mut facts = Vec::new();
    if let Some(c) = camera {
        facts.push(fact("name", RigFact::text(&c.name), Stated, c.card.as_str()));
        facts.push(fact("size_px", format!("[{}, {}]", c.width, c.height), Stated, "the best offer"));
        match c.frames_per_s {
            Some(rate) => facts.push(fact("frames_per_s", format!("{rate:?}"), Stated, "")),
            None => facts.push(fact("frames_per_s", "30.0", Guess, "the driver lists no rate")),
        }
        if let Some([least, most, step]) = c.exposure_s {
            facts.push(fact("exposure_s", format!("[{least:?}, {most:?}]"), Stated, ""));
            facts.push(fact("exposure_step_s", format!("{step:?}"), Stated, ""));
        }
        if let Some([least, most]) = c.gain {
            let remark = "taken to be in proportion to the driver's number";
            facts.push(fact("gain", format!("[{least:?}, {most:?}]"), Guess, remark));
        }
    }
    let device = camera.map_or("DEVICE", |c| c.name.as_str());
    let out = a.out.as_deref();
    facts.push(match a.latency_frames {
        Some(frames) => fact("latency_frames", frames, Measured, "halflight calibrate latency"),
        None => fact("latency_frames", 2, Missing, format!("halflight calibrate latency {device}")),
    });
    facts.push(match &a.response {
        Some(file) => fact("response", beside(file, out)?, Measured, "halflight calibrate response"),
        None => {
            let how = format!("halflight calibrate response {device} --out response.json");
            fact("response", "\"response.json\"", Missing, how)
        }
    });
    facts.push(match &a.calibration {
        Some(file) => fact("calibration", beside(file, out)?, Measured, "halflight calibrate camera"),
        None => {
            let how = "halflight calibrate camera PICTURES.. --board .. --out lens.yml";
            fact("calibration", "\"lens.yml\"", Missing, how)
        }
    });
    Ok(facts)
}

fn sensor_facts(sensor: Option<&ListedSensor>) -> Vec<RigFact> {
    let Some(sensor) = sensor else { return Vec::new() };
    let fact =
        |name, value, source, remark: &str| RigFact { section: "imu", ..fact(name, value, source, remark) };
    let name = RigFact::text(&sensor.name);
    let mut facts = vec![fact("name", name, FactSource::Stated, sensor.product.as_str())];
    if let Some(protocol) = sensor.protocol {
        let remark = "by maker and product";
        facts.push(fact("protocol", RigFact::text(protocol), FactSource::Stated, remark));
    }
    if let Some(rate) = sensor.rate_hz.filter(|rate| (1.0..=4000.0).contains(rate)) {
        // What a headset's makers set is nothing that its driver says.
        let source = if sensor.protocol.is_some() { FactSource::Guess } else { FactSource::Stated };
        facts.push(fact("rate_hz", format!("{rate:?}"), source, ""));
    }
    let mounting = "the sensor is taken to be mounted as the camera is";
    facts.push(fact("camera_from_imu_q_wxyz", "[1.0, 0.0, 0.0, 0.0]".into(), FactSource::Guess, mounting));
    facts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::at_hand::inertial::Gives;
    use crate::device::imu::description::ImuDescription;

    fn camera() -> CameraFacts {
        CameraFacts {
            name: "v4l2:card=HD \"Webcam\"".into(),
            card: "HD \"Webcam\"".into(),
            width: 640,
            height: 480,
            frames_per_s: Some(30.0),
            exposure_s: Some([1e-4, 0.5, 1e-4]),
            gain: Some([1.0, 4.0]),
        }
    }

    fn sensor() -> ListedSensor {
        ListedSensor {
            name: "hid:2833:0021".into(),
            product: "Rift DK2".into(),
            node: "/dev/hidraw3".into(),
            protocol: Some("rift"),
            gives: Gives::Headset,
            rate_hz: Some(1000.0),
            missing: None,
        }
    }

    fn arguments() -> RigArguments {
        RigArguments { out: None, response: None, calibration: None, latency_frames: None, force: false }
    }

    #[test]
    fn a_first_rig_is_read_again_and_marks_what_nobody_measured() {
        let mut facts = camera_facts(Some(&camera()), &arguments()).unwrap();
        facts.extend(sensor_facts(Some(&sensor())));
        let text = rig::to_toml(&facts);
        let read = rig::parse(Path::new("rig.toml"), &text).unwrap();
        assert_eq!(read.camera.name.as_deref(), Some("v4l2:card=HD \"Webcam\""));
        assert_eq!((read.camera.exposure_s, read.camera.latency_frames), (Some([1e-4, 0.5]), None));
        let imu = ImuDescription::from_toml(&text).unwrap().unwrap();
        assert_eq!((imu.name.as_deref(), imu.protocol.as_deref()), (Some("hid:2833:0021"), Some("rift")));
        assert_eq!(imu.rate_hz, Some(1000.0));
        assert!(
            text.contains("guess") && text.contains("not measured; halflight calibrate latency"),
            "{text}"
        );
    }

    #[test]
    fn what_was_measured_is_named_beside_the_rig() {
        let measured = RigArguments {
            out: Some("rigs/rig.toml".into()),
            response: Some("rigs/response.json".into()),
            calibration: Some("/lenses/a.yml".into()),
            latency_frames: Some(3),
            ..arguments()
        };
        let text = rig::to_toml(&camera_facts(None, &measured).unwrap());
        let read = rig::parse(Path::new("rigs/rig.toml"), &text).unwrap().camera;
        assert_eq!(read.latency_frames, Some(3));
        assert_eq!(read.response.as_deref(), Some(Path::new("rigs/response.json")));
        assert_eq!(read.calibration.as_deref(), Some(Path::new("/lenses/a.yml")));
    }

    #[test]
    fn without_devices_the_rig_says_what_to_measure() {
        let text = rig::to_toml(&camera_facts(None, &arguments()).unwrap());
        assert!(
            text.contains("# response = ") && text.contains("halflight calibrate response DEVICE"),
            "{text}"
        );
        assert_eq!(rig::parse(Path::new("rig.toml"), &text).unwrap(), rig::RigDescription::default());
    }
}
