//! `halflight synth`

use super::{CliError, Common};

/// Arguments of `halflight synth`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight synth`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("synth", "this build lacks the verb"))
}
