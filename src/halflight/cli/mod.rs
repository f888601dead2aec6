//! The tool for people: one file for each verb of `halflight`.

#[macro_use]
pub mod printing;

pub mod calibrate;
mod capture_steps;
pub mod check;
pub mod devices;
mod effect_times;
pub mod error;
pub mod explain;
pub mod figures;
pub mod global_options;
pub mod hdr;
pub mod help;
#[cfg(feature = "libcamera")]
mod library_cameras;
pub mod light;
mod output;
mod progress;
pub mod quality_flags;
pub mod record;
pub mod render;
pub mod replay;
pub mod reproduce;
pub mod rig;
pub mod room;
mod run_folder;
mod sensor_devices;
pub mod spheres;
pub mod stress;
pub mod synth;
pub mod tags;
pub mod trace;
pub mod tradeoff;
#[cfg(feature = "v4l2")]
mod video_devices;
mod wire_file;

pub use error::CliError;
pub use global_options::GlobalOptions;

use crate::daemon::version;
use std::process::ExitCode;

/// Form of the JSON that `--json` prints: another number where a field changes its name, its place or its meaning.
pub const JSON_FORMAT: u32 = 1;

const AFTER_HELP: &str = "\
Exit status: 0 done, 1 a bound or a comparison failed, 2 usage or input, 3 a device or an engine, 130 interrupted
(docs/exit-codes.md). HALFLIGHT_LOG=LEVEL or MODULE=LEVEL,.. chooses the lines of the log on standard error (error,
warn, info, debug, trace); -v and -q win.";

/// `halflight`: measures the light of a real place and draws virtual objects into the camera picture.
#[derive(clap::Parser, Debug)]
#[command(name = "halflight", version = version::SHORT, long_version = version::LONG, about, long_about = None,
          max_term_width = 110, after_help = AFTER_HELP)]
pub struct CommandLine {
    /// Options that verbs share.
    #[command(flatten)]
    pub global: GlobalOptions,
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What the tool can do.
#[derive(clap::Subcommand, Debug)]
pub enum Verb {
    /// Run a recording through the daemon's own pipeline. Leaves pictures, a film and a report.
    Replay(replay::ReplayArguments),
    /// Draw one still of a scene file or of a reference case.
    Render(render::RenderArguments),
    /// Tell which effects a frame has, and why.
    Explain(explain::ExplainArguments),
    /// Trace a still: ground truth with and without the objects, and its noise.
    Trace(trace::TraceArguments),
    /// Show how pictures come about, part by part.
    Figures(figures::FiguresArguments),
    /// Measure the light in a picture of a mirror ball or in an environment picture.
    Light(light::LightArguments),
    /// Merge exposures into one HDR picture.
    Hdr(hdr::HdrArguments),
    /// Find AprilTags and their poses.
    Tags(tags::TagsArguments),
    /// Record a device to an MCAP file.
    Record(record::RecordArguments),
    /// Measure a camera: its lens, its response, the delay of its exposure control.
    Calibrate(calibrate::CalibrateArguments),
    /// Fit spheres to a model, for its soft shadow.
    Spheres(spheres::SpheresArguments),
    /// Make a first rig file from the devices at hand.
    Rig(rig::RigArguments),
    /// Show a known room: what its surfaces send out and reflect, and what a probe saw of it.
    Room(room::RoomArguments),
    /// Make a recording of the synthetic room, with its truth.
    Synth(synth::SynthArguments),
    /// Do an experiment of the papers again: table and plot.
    Reproduce(reproduce::ReproduceArguments),
    /// Measure what accuracy costs in time: plots, a page, and the measured front.
    Tradeoff(tradeoff::TradeoffArguments),
    /// Run the hard cases: the textbook, this program, and the bound.
    Stress(stress::StressArguments),
    /// Check a settings file. Prints all mistakes at once.
    Check(check::CheckArguments),
    /// List the devices and engines at hand.
    Devices(devices::DevicesArguments),
}

impl Verb {
    /// Whether a first signal ends its work as a limit would, so that what it has is closed and kept.
    pub fn closes_what_it_writes(&self) -> bool {
        match self {
            Self::Record(_) | Self::Synth(_) => true,
            Self::Calibrate(a) => a.measures_a_device(),
            _ => false,
        }
    }
}

/// Runs one verb. Returns the program's exit status: 0, or 1 where a check that was asked for fails.
///
/// # Errors
/// What a person did wrong, or what failed, with the exit status.
pub fn run(line: CommandLine) -> Result<ExitCode, CliError> {
    let global = &line.global;
    let done = match line.verb {
        Verb::Stress(a) => return stress::run(a, global),
        Verb::Replay(a) => replay::run(a, global),
        Verb::Render(a) => render::run(a, global),
        Verb::Explain(a) => explain::run(a, global),
        Verb::Trace(a) => trace::run(a, global),
        Verb::Figures(a) => figures::run(a, global),
        Verb::Light(a) => light::run(a, global),
        Verb::Hdr(a) => hdr::run(a, global),
        Verb::Tags(a) => tags::run(a, global),
        Verb::Record(a) => record::run(a, global),
        Verb::Calibrate(a) => calibrate::run(a, global),
        Verb::Spheres(a) => spheres::run(a, global),
        Verb::Rig(a) => rig::run(a, global),
        Verb::Room(a) => room::run(a, global),
        Verb::Synth(a) => synth::run(a, global),
        Verb::Reproduce(a) => reproduce::run(a, global),
        Verb::Tradeoff(a) => tradeoff::run(a, global),
        Verb::Check(a) => check::run(a, global),
        Verb::Devices(a) => devices::run(a, global),
    };
    done.map(|()| ExitCode::SUCCESS)
}
