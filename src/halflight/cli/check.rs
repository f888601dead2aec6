//! `halflight check`: is a settings file sound?

use super::{CliError, GlobalOptions};
use crate::config::{Settings, file, keys, manual, resolve};
use std::path::PathBuf;

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Check a settings file. Prints all mistakes at once.\n\n\
Examples:\n\
halflight check my.toml\n\
halflight check --manual";

/// Arguments of `halflight check`.
#[derive(clap::Args, Debug)]
pub struct CheckArguments {
    /// Settings file.
    #[arg(required_unless_present = "manual")]
    config: Option<PathBuf>,
    /// Print every key with unit, range, effect and default.
    #[arg(long)]
    manual: bool,
}

/// Runs `halflight check`.
pub fn run(arguments: CheckArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if arguments.manual {
        print!("{}", manual::manual());
    }
    let Some(path) = arguments.config else { return Ok(()) };
    let read = file::read(&path).map_err(CliError)?;
    let typed = read.keys.len();
    resolve(&path.display().to_string(), &read, &Settings::default())?;
    if global.json {
        println!(
            "{}",
            serde_json::json!({ "file": path.display().to_string(), "keys": typed, "sound": true })
        );
    } else {
        println!("{}: sound, {typed} of {} keys set", path.display(), keys::KEYS.len());
    }
    Ok(())
}
