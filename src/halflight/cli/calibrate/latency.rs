//! `halflight calibrate latency`.

use super::interrupted;
use crate::cli::progress::Bar;
use crate::cli::record::{exposures_of, stop_of_signals};
use crate::cli::{CliError, GlobalOptions, JSON_FORMAT};
use crate::daemon::prepare::camera_options;
use crate::device::bracket::Report;
use crate::device::bracketed::FoundResponse;
use crate::device::clock::MonotonicClock;
use crate::device::measured::{Patience, latency_of};
use crate::device::open::open_with;
use crate::model::path_text;
use serde_json::json;
use std::ffi::OsString;
use std::path::Path;

/// Arguments of `halflight calibrate latency`.
#[derive(clap::Args, Debug)]
pub struct LatencyArguments {
    /// The camera, e.g. v4l2:/dev/video0 or auto.
    device: OsString,
    /// Frames of known exposure that are looked at.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u64).range(24..=1_000_000))]
    frames: u64,
    /// Exposure times that the camera goes through, seconds, two or more (default: camera.exposures_s).
    #[arg(long, value_name = "S,S,..", value_delimiter = ',')]
    exposures_s: Vec<f64>,
}

/// Runs `halflight calibrate latency`.
pub fn run(a: LatencyArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let stop = stop_of_signals()?;
    let device = path_text::to_text(Path::new(&a.device));
    let mut settings = global.settings(None)?;
    settings.camera.clone_from(&device);
    let cycle = exposures_of(&a.exposures_s, global)?;
    settings.replan = false;
    let mut opened = open_with(&device, camera_options(&settings, &FoundResponse::default())?)?;
    let bar = Bar::of_count(Some(a.frames), "frames");
    let patience = Patience { device: &device, clock: &MonotonicClock::new(), stop: &stop };
    let report = latency_of(opened.frames.as_mut(), &cycle, a.frames, &patience, || bar.add_one())?
        .ok_or_else(interrupted)?;
    drop(bar);
    if global.json {
        println!("{}", json_of(&device, &report));
    } else {
        print(&device, &report);
    }
    Ok(())
}

/// The delay that most writes have, and its share.
pub fn usual_delay(report: &Report) -> Option<(usize, f64)> {
    let shares = report.delays.iter().copied().enumerate();
    shares.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, share)| *share > 0.0)
}

fn json_of(device: &str, r: &Report) -> serde_json::Value {
    json!({
        "format": JSON_FORMAT, "what": "latency", "device": device, "frames": r.settled, "sure": r.sure,
        "delay_frames": usual_delay(r).map(|(delay, _)| delay), "delays": r.delays, "writes": r.delays_from,
        "altered_writes": r.altered_writes, "worst_offset_ln": r.worst_offset, "lost": r.lost,
        "duplicates": r.duplicates, "late": r.late, "not_explained": r.not_explained, "unrest_ln": r.unrest,
    })
}

fn print(device: &str, r: &Report) {
    println!("{device}: {} of {} frames are of known exposure", r.sure, r.settled);
    println!("a written exposure is in force so many frames later than at once:");
    for (frames, share) in r.delays.iter().enumerate().filter(|(_, share)| **share >= 0.001) {
        println!("  {frames}   {:>5.1} %  {}", 100.0 * share, "#".repeat((40.0 * share) as usize));
    }
    println!("  (from {:.0} writes, the older the less they weigh)", r.delays_from);
    println!("writes that the camera altered: {}", r.altered_writes);
    println!(
        "the worst exposure differs from what it says by {:.1} %",
        100.0 * r.worst_offset.abs().exp_m1()
    );
    println!(
        "frames lost {}, twice {}, after a newer one {}, not explained {}",
        r.lost, r.duplicates, r.late, r.not_explained
    );
}
