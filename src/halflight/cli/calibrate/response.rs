//! `halflight calibrate response`.

use super::interrupted;
use crate::assets::response::to_json;
use crate::cli::output::{shown, write_file};
use crate::cli::record::{exposures_of, stop_of_signals};
use crate::cli::run_folder::{need_folder_of, refuse_existing};
use crate::cli::{CliError, GlobalOptions, JSON_FORMAT};
use crate::device::clock::MonotonicClock;
use crate::device::measured::{MeasuredResponse, Patience, response_of};
use crate::device::open::{CameraOptions, open_with};
use crate::model::{path_text, response::Response};
use serde_json::json;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Arguments of `halflight calibrate response`.
#[derive(clap::Args, Debug)]
pub struct ResponseArguments {
    /// The camera, e.g. v4l2:/dev/video0 or auto. It looks at a place at rest with bright and dark parts.
    device: OsString,
    /// The response to write (JSON), for camera.response.
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
    /// Exposure times that the camera goes through, seconds, two or more (default: camera.exposures_s).
    #[arg(long, value_name = "S,S,..", value_delimiter = ',')]
    exposures_s: Vec<f64>,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
}

/// Runs `halflight calibrate response`.
pub fn run(a: ResponseArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let stop = stop_of_signals()?;
    let device = path_text::to_text(Path::new(&a.device));
    need_folder_of(&a.out)?;
    refuse_existing(&a.out, a.force)?;
    let cycle = exposures_of(&a.exposures_s, global)?;
    let mut opened = open_with(&device, CameraOptions::default())?;
    let patience = Patience { device: &device, clock: &MonotonicClock::new(), stop: &stop };
    let found = response_of(opened.frames.as_mut(), &cycle, &patience)?.ok_or_else(interrupted)?;
    drop(opened);
    write_file(&a.out, to_json(&found.response))?;
    if global.json {
        let exposures: Vec<_> = (found.checked.iter())
            .map(|c| {
                json!({
                    "time_s": c.exposure.time_s, "gain": c.exposure.gain, "error_ln": c.error(),
                })
            })
            .collect();
        println!(
            "{}",
            json!({
                "format": JSON_FORMAT, "what": "response", "device": device, "file": shown(&a.out),
                "frames": found.frames, "worst_error_ln": found.worst(), "exposures": exposures,
            })
        );
        return Ok(());
    }
    print(&found, &a.out);
    Ok(())
}

fn print(found: &MeasuredResponse, out: &Path) {
    println!("{}: found and checked within {} frames; for camera.response", out.display(), found.frames);
    println!("value   ln exposure of red, green, blue; sRGB's");
    let (g, srgb) = (found.response.log_exposure(), Response::srgb());
    for value in (0..256).step_by(16).chain([255]) {
        let [red, green, blue] = [0, 1, 2].map(|channel| g[channel][value]);
        let usual = srgb.log_exposure()[1][value];
        println!("{value:>5}   {red:>8.3} {green:>8.3} {blue:>8.3}   {usual:>8.3}  {}", bar(green));
    }
    for c in &found.checked {
        let told = c.error().map_or("shares too little with the others to tell".to_owned(), |error| {
            format!("told from pictures within {:.1} %", 100.0 * error.exp_m1())
        });
        println!("exposure {:.5} s: {told}", c.exposure.time_s);
    }
    if let Some(worst) = found.worst() {
        println!("accuracy: exposures are told within {:.1} %", 100.0 * worst.exp_m1());
    }
}

/// A mark at ln exposure, six columns for each factor of e, from e^-8 on.
fn bar(log_exposure: f32) -> String {
    let column = ((log_exposure + 8.0) * 6.0).clamp(0.0, 60.0) as usize;
    format!("{}*", " ".repeat(column))
}
