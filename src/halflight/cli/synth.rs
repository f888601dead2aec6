//! `halflight synth`

use super::output::write_file;
use super::record::Coding;
use super::run_folder::{need_folder_of, refuse_existing};
use super::{CliError, GlobalOptions, record};
use crate::assets::{gltf::write_room::encode_room, pictures};
use crate::device::record::{ImuRecorder, Recorder};
use crate::device::recording::Setup;
use crate::device::synthetic::{self, options};
use crate::device::{FrameSource, ImuSource};
use glam::DVec3;
use std::path::PathBuf;

/// Rows of a probe's picture.
const PROBE_ROWS: usize = 256;

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Make a recording of the synthetic room, with its truth.\n\n\
The room has a table with a tag36h11 tag (number 0, black square 0.10 m) at the origin and a mirror ball \
beside it, a lamp, a window and furniture. The recording also holds inertial samples, and the exact pose and \
light of every frame. Equal arguments give equal files.\n\n\
Example: halflight synth --out desk.mcap --frames 90 --size 640x480 --jpeg 93";

/// Arguments of `halflight synth`.
#[derive(clap::Args, Debug)]
pub struct SynthArguments {
    /// The recording to write (MCAP).
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    /// Number of frames.
    #[arg(long, default_value_t = 90, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    frames: u64,
    /// Width and height in pixels, each 16 to 4096.
    #[arg(long, default_value = "640x480", value_name = "WxH")]
    size: String,
    /// Exposure times in seconds, used in turn: 1 to 9, divided by commas or colons.
    #[arg(long, default_value = "1/4500,1/500,1/60", value_name = "T,..")]
    exposures: String,
    /// Frames a second.
    #[arg(long, default_value_t = 30.0)]
    fps: f64,
    /// Chooses noise and movement.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Strength of all noise: 0 for none, 1 as of a small sensor.
    #[arg(long, default_value_t = 1.0)]
    noise: f64,
    /// Strength of the camera's movement: 0 for a tripod, 1 as held by hand.
    #[arg(long, default_value_t = 1.0)]
    motion: f64,
    /// What the camera looks at: `desk` (the table's top), or `room` (the table, and the floor before and under it, with a
    /// larger tag on a board that stands on the table).
    #[arg(long, default_value = "desk", value_name = "desk|room")]
    view: String,
    /// Also writes the room's rough geometry (glTF): walls, furniture, window and lamp, for `[room]` of a scene.
    #[arg(long, value_name = "FILE.glb")]
    geometry: Option<PathBuf>,
    /// Also writes what a probe in the room sees (equirectangular, Radiance HDR), for `[room]` of a scene.
    #[arg(long, value_name = "FILE.hdr")]
    probe: Option<PathBuf>,
    /// Where the probe is: x,y,z in metres, world frame.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,-0.6,0.1", allow_hyphen_values = true, value_parser = point)]
    probe_position: DVec3,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
    /// How pictures are stored (default: --jpeg 93).
    #[command(flatten)]
    coding: Coding,
}

fn point(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|v| v.abs() <= 100.0) => Ok(DVec3::new(x, y, z)),
        _ => Err("must be three numbers within -100 to 100, divided by commas".into()),
    }
}

/// Runs `halflight synth`.
pub fn run(arguments: SynthArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let (a, stop) = (&arguments, record::stop_of_signals()?);
    let exposures = a.exposures.replace(',', ":");
    let name = format!(
        "frames={},size={},exposures={exposures},fps={},seed={},noise={},motion={},view={}",
        a.frames, a.size, a.fps, a.seed, a.noise, a.motion, a.view
    );
    let options = options::SyntheticOptions::parse(&name).map_err(|e| CliError::on("synth", e))?;
    let coding = a.coding.chosen()?;
    for file in [Some(&a.out), a.geometry.as_ref(), a.probe.as_ref()].into_iter().flatten() {
        need_folder_of(file)?;
        refuse_existing(file, a.force)?;
    }
    if let Some(threads) = global.threads()? {
        // Only the first choice in a process counts; the pixels are the same for any number.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    }
    let (frames, imu) = synthetic::open(&options);
    if let Some(file) = &a.geometry {
        let room = synthetic::rough_room(options.view);
        let note = serde_json::json!({"made_by": "halflight synth", "view": a.view});
        write_file(file, encode_room(&room, note))?;
    }
    if let Some(file) = &a.probe {
        let map = frames.probe(a.probe_position, PROBE_ROWS);
        pictures::save_hdr(file, &map.radiance)?;
    }
    let origin = record::origin("synth", "synthetic", name, &frames);
    let (rig, response, imu_truth) = (frames.rig(), frames.response(), imu.imu_truth());
    let setup = Setup { rig, response, imu_truth, origin };
    let tape = record::tape(&a.out, coding, setup)?;
    let mut imu = ImuRecorder::new(imu, tape.clone());
    let mut frames = Recorder::new(frames, tape.clone());
    let limit = record::Limit { stop, frames: Some(options.frames), seconds: None };
    let seen = record::pump(&mut frames, Some(&mut imu), &limit, options.frames)?;
    record::report("synth", &a.out, &tape, seen, coding, global)
}
