//! `halflight hdr`

use super::{CliError, Common};

/// Arguments of `halflight hdr`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Runs `halflight hdr`.
pub fn run(_arguments: Arguments, _common: &Common) -> Result<(), CliError> {
    Err(CliError::on("hdr", "this build lacks the verb"))
}
