//! `halflight render`

use super::{CliError, Common};

/// Arguments of `halflight render`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight render`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("render", "this build lacks the verb"))
}
