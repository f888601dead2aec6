//! `halflight devices`: what is at hand?

#[cfg(feature = "libcamera")]
use super::library_cameras::LibraryCameras;
use super::sensor_devices::{ListedSensors, default_camera};
use super::video_devices::ListedCameras;
use super::{CliError, GlobalOptions};
use crate::daemon::engines::gpu;
use crate::device::at_hand::PluggedMachine;
use crate::engine::{Engine, cpu::CpuEngine, gpu::Backend};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
List the devices and engines at hand.\n\n\
Cameras, inertial sensors and serial ports, what would be used by default and why, and which right is missing \
with the command that mends it. Video nodes are opened for a moment; of all others only the kernel's files are \
read.\n\n\
Examples:\n\n\
  halflight devices\n\
  halflight devices --set device.imu=iio:name=dev_rotation --json";

/// Arguments of `halflight devices`.
#[derive(clap::Args, Debug)]
pub struct DevicesArguments {}

/// Runs `halflight devices`.
pub fn run(_arguments: DevicesArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let cpu = CpuEngine::new(global.threads()?)?;
    let mut engines = vec![("cpu", Ok(cpu.description()))];
    for (name, backend) in [("gpu, vulkan", Backend::Vulkan), ("gpu, gl", Backend::Gl)] {
        engines.push((name, gpu(Some(backend)).map(|e| e.description()).map_err(|e| e.to_string())));
    }
    let machine = PluggedMachine::default();
    let cameras = ListedCameras::look(&machine);
    #[cfg(feature = "libcamera")]
    let library = LibraryCameras::look();
    let sensors = ListedSensors::look(&machine);
    let settings = global.settings(None)?;
    let (camera, imu) = (default_camera(&settings, &cameras), sensors.default_imu(&settings));
    if global.json {
        let engines: Vec<_> = engines
            .iter()
            .map(|(name, found)| match found {
                Ok(description) => {
                    serde_json::json!({ "engine": name, "usable": true, "description": description })
                }
                Err(why) => serde_json::json!({ "engine": name, "usable": false, "why": why }),
            })
            .collect();
        #[cfg(feature = "libcamera")]
        let library = library.json();
        #[cfg(not(feature = "libcamera"))]
        let library: [serde_json::Value; 0] = [];
        println!(
            "{}",
            serde_json::json!({
                "format": super::JSON_FORMAT, "cameras": CAMERAS.map(|c| c.0), "video": cameras.json(), "libcamera": library,
                "inertial": sensors.json(), "serial_ports": sensors.ports_json(),
                "defaults": { "camera": camera.json(), "imu": imu.json() }, "engines": engines,
            })
        );
        return Ok(());
    }
    println!("cameras");
    for (name, effect) in CAMERAS {
        println!("  {name:<24}{effect}");
    }
    println!("cameras of the kernel (V4L2)");
    cameras.print();
    println!("cameras behind libcamera");
    #[cfg(feature = "libcamera")]
    library.print();
    #[cfg(not(feature = "libcamera"))]
    println!("  this program was built without it (feature libcamera)");
    println!("inertial sensors");
    sensors.print();
    println!("serial ports");
    sensors.print_ports();
    println!("used by default");
    camera.print("camera");
    imu.print("inertial sensor");
    println!("engines");
    for (name, found) in engines {
        match found {
            Ok(description) => println!("  {name:<24}{description}"),
            Err(why) => println!("  {name:<24}not usable: {why}"),
        }
    }
    Ok(())
}

/// What `device.camera` may name.
const CAMERAS: [(&str, &str); 5] = [
    ("auto", "the best camera of those below: the default"),
    ("v4l2:/dev/video0", "a camera of the kernel; also v4l2:card=TEXT; with size=640x480,fps=30,format=YUYV"),
    (
        "libcamera:ID",
        "a sensor behind libcamera, by its name or a part of it, where the program was built with it",
    ),
    ("synthetic:OPTIONS", "a virtual room with known truth, e.g. synthetic:frames=90,seed=1,size=640x480"),
    ("replay:FILE.mcap", "a recording made by `halflight record` or `halflight synth`"),
];
