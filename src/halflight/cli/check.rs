//! `halflight check`: is a settings file sound?

use super::{CliError, Common};
use crate::config::{Settings, file, keys, manual, resolve};
use std::path::PathBuf;

/// Check a settings file (or a scene file) and print every mistake at once.
///
/// Example: halflight check my.toml
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Settings file.
    #[arg(required_unless_present = "manual")]
    config: Option<PathBuf>,
    /// Print every key with unit, range, effect and default.
    #[arg(long)]
    manual: bool,
}

/// Runs `halflight check`.
pub fn run(arguments: Arguments, common: &Common) -> Result<(), CliError> {
    if arguments.manual {
        print!("{}", manual::manual());
    }
    let Some(path) = arguments.config else { return Ok(()) };
    let read = file::read(&path).map_err(CliError)?;
    let typed = read.keys.len();
    resolve(&path.display().to_string(), &read, &Settings::default()).map_err(|e| CliError(e.to_string()))?;
    if common.json {
        println!(
            "{}",
            serde_json::json!({ "file": path.display().to_string(), "keys": typed, "sound": true })
        );
    } else {
        println!("{}: sound, {typed} of {} keys set", path.display(), keys::KEYS.len());
    }
    Ok(())
}
