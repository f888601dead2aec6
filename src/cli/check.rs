//! `halflight check`

use super::{CliError, Common};

/// Arguments of `halflight check`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight check`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("check", "this build lacks the verb"))
}
