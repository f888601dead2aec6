//! `halflight record`

use super::{CliError, Common};

/// Arguments of `halflight record`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight record`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("record", "this build lacks the verb"))
}
