//! `halflight synth`

use super::record::Coding;
use super::{CliError, Common, record};
use crate::device::record::{ImuRecorder, Recorder, Tape};
use crate::device::recording::{RecordingWriter, Setup};
use crate::device::synthetic::{self, options};
use crate::device::{FrameSource, ImuSource};
use std::path::PathBuf;

/// Arguments of `halflight synth`.
///
/// The room holds a table with a tag36h11 tag (number 0, black square 0.10 m) at the origin and a mirror ball
/// beside it, a lamp, a window and furniture. The recording also holds inertial samples and the exact pose and
/// light of every frame. Equal arguments give equal files.
///
/// Example: halflight synth --out desk.mcap --frames 90 --size 640x480 --jpeg 93
#[derive(clap::Args, Debug)]
pub struct Arguments {
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
    /// How pictures are stored (default: --jpeg 93).
    #[command(flatten)]
    coding: Coding,
}

/// Runs `halflight synth`.
pub fn run(arguments: Arguments, common: &Common) -> Result<(), CliError> {
    let a = &arguments;
    let exposures = a.exposures.replace(',', ":");
    let name = format!(
        "frames={},size={},exposures={exposures},fps={},seed={},noise={},motion={}",
        a.frames, a.size, a.fps, a.seed, a.noise, a.motion
    );
    let options = options::Options::parse(&name).map_err(|e| CliError::on("synth", e))?;
    let coding = a.coding.chosen()?;
    if let Some(threads) = common.threads {
        // Only the first choice in a process counts; the pixels are the same for any number.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    }
    let (frames, imu) = synthetic::open(&options);
    let setup = Setup { rig: frames.rig(), response: frames.response(), imu_truth: imu.imu_truth() };
    let writer =
        RecordingWriter::create(&a.out, coding, setup).map_err(|e| CliError::on(a.out.display(), e))?;
    let tape = Tape::new(writer);
    let mut imu = ImuRecorder::new(imu, tape.clone());
    let mut frames = Recorder::new(frames, tape.clone());
    let limit = record::Limit { frames: Some(options.frames), seconds: None };
    let seen = record::pump(&mut frames, Some(&mut imu), &limit, options.frames)?;
    record::report("synth", &a.out, &tape, seen, coding, common)
}
