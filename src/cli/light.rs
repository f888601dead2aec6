//! `halflight light`

use super::{CliError, Common};

/// Arguments of `halflight light`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight light`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("light", "this build lacks the verb"))
}
