//! `halflight devices`

use super::{CliError, Common};

/// Arguments of `halflight devices`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight devices`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("devices", "this build lacks the verb"))
}
