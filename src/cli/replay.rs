//! `halflight replay`

use super::{CliError, Common};

/// Arguments of `halflight replay`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight replay`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("replay", "this build lacks the verb"))
}
