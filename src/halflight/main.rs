//! `halflight`, the tool for people.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    halflightd::daemon::log::to_stderr(tracing::Level::WARN);
    match halflight::cli::run(halflight::cli::CommandLine::parse()) {
        Ok(status) => status,
        Err(error) => {
            eprintln!("halflight: {error}");
            ExitCode::from(2)
        }
    }
}
