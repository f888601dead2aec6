//! The tool for people: one file for each verb of `halflight`.

mod bracket;
pub mod check;
pub mod common;
pub mod devices;
pub mod explain;
pub mod figures;
pub mod hdr;
pub mod light;
mod moment;
mod progress;
pub mod quality_flags;
pub mod record;
pub mod render;
pub mod replay;
pub mod reproduce;
pub mod room;
pub mod spheres;
pub mod stress;
pub mod synth;
pub mod tags;
pub mod trace;
pub mod tradeoff;

pub use common::{CliError, Common};
use std::process::ExitCode;

/// `halflight`: measures the light of a real place and draws virtual objects into the camera picture.
#[derive(clap::Parser, Debug)]
#[command(name = "halflight", version, about, long_about = None, max_term_width = 110)]
pub struct Arguments {
    /// Options of every verb.
    #[command(flatten)]
    pub common: Common,
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What the tool can do.
#[derive(clap::Subcommand, Debug)]
pub enum Verb {
    /// Run a recording through the daemon's own pipeline; leaves pictures, a film and a report.
    Replay(replay::Arguments),
    /// Draw one still of a scene file or of a reference case.
    Render(render::Arguments),
    /// Tell which effects a frame has and which it does without, and why.
    Explain(explain::Arguments),
    /// Trace a still: ground truth with and without the objects, with its own noise.
    Trace(trace::Arguments),
    /// Show how pictures come about, part by part.
    Figures(figures::Arguments),
    /// Measure the light in a picture of a mirror ball or in an environment picture.
    Light(light::Arguments),
    /// Merge exposures into one HDR picture.
    Hdr(hdr::Arguments),
    /// Find AprilTags and their poses.
    Tags(tags::Arguments),
    /// Record a device to an MCAP file.
    Record(record::Arguments),
    /// Fit spheres to a model, for its soft shadow.
    Spheres(spheres::Arguments),
    /// Show a known room: what its patches send out and reflect, and what a probe saw of it.
    Room(room::Arguments),
    /// Make a recording of the synthetic room, with its truth.
    Synth(synth::Arguments),
    /// Do an experiment of the papers again: table and plot.
    Reproduce(reproduce::Arguments),
    /// Measure what accuracy costs in time: plots, a page, and the front that presets are points of.
    Tradeoff(tradeoff::Arguments),
    /// Run the hard cases: what the textbook's formulas give, what this program gives, and the bound.
    Stress(stress::Arguments),
    /// Check a configuration file; prints all mistakes at once.
    Check(check::Arguments),
    /// List the devices and engines at hand.
    Devices(devices::Arguments),
}

/// Runs one verb. The program's exit status where it is not an error's: 0, or 1 where a check that was asked for fails.
pub fn run(arguments: Arguments) -> Result<ExitCode, CliError> {
    let common = &arguments.common;
    let done = match arguments.verb {
        Verb::Stress(a) => return stress::run(a, common),
        Verb::Replay(a) => replay::run(a, common),
        Verb::Render(a) => render::run(a, common),
        Verb::Explain(a) => explain::run(a, common),
        Verb::Trace(a) => trace::run(a, common),
        Verb::Figures(a) => figures::run(a, common),
        Verb::Light(a) => light::run(a, common),
        Verb::Hdr(a) => hdr::run(a, common),
        Verb::Tags(a) => tags::run(a, common),
        Verb::Record(a) => record::run(a, common),
        Verb::Spheres(a) => spheres::run(a, common),
        Verb::Room(a) => room::run(a, common),
        Verb::Synth(a) => synth::run(a, common),
        Verb::Reproduce(a) => reproduce::run(a, common),
        Verb::Tradeoff(a) => tradeoff::run(a, common),
        Verb::Check(a) => check::run(a, common),
        Verb::Devices(a) => devices::run(a, common),
    };
    done.map(|()| ExitCode::SUCCESS)
}
