//! `halflight tags`

use super::{CliError, Common};

/// Arguments of `halflight tags`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight tags`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("tags", "this build lacks the verb"))
}
