//! `halflight`, the tool for people.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("HALFLIGHT_LOG").unwrap_or_else(|_| "warn".into()),
        )
        .with_writer(std::io::stderr)
        .with_target(false)
        .init();
    match halflight::cli::run(halflight::cli::CommandLine::parse()) {
        Ok(status) => status,
        Err(error) => {
            eprintln!("halflight: {error}");
            ExitCode::from(2)
        }
    }
}
