//! `halflightd`, the daemon.

use clap::Parser;
use halflightd::config::{Settings, file, resolve};
use halflightd::daemon::{live_settings::LiveSettings, run::run_daemon};
use halflightd::pipeline::event::RunCounts;
use std::path::PathBuf;
use std::process::ExitCode;

/// The daemon: captures, measures the light, draws virtual objects into the picture.
///
/// Every setting is explained in config/default.toml; `halflight check FILE` checks a file.
#[derive(Parser)]
#[command(name = "halflightd", version, max_term_width = 110)]
struct Arguments {
    /// Settings file (TOML); keys that are left out keep their defaults. Keys that the manual calls live may be changed
    /// there while the daemon runs.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// One setting over the file, e.g. --set 'device.camera="replay:desk.mcap"' (repeatable).
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Lay text over every picture: what each effect of it is, and why; the same as --set present.hud=true.
    #[arg(long)]
    hud: bool,
}

fn main() -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("HALFLIGHT_LOG").unwrap_or_else(|_| "info".into()),
        )
        .with_writer(std::io::stderr)
        .with_target(false)
        .init();
    match run(Arguments::parse()) {
        Ok(counts) => {
            tracing::info!(
                frames = counts.frames,
                lost_by_source = counts.lost_by_source,
                passed_over = counts.passed_over,
                passed_through = counts.passed_through,
                "ended"
            );
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("halflightd: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: Arguments) -> Result<RunCounts, String> {
    let started = settings(&arguments)?;
    let file = arguments.config.clone();
    let mut live = file.map(|file| LiveSettings::new(file, move || settings(&arguments), &started));
    run_daemon(&started, live.as_mut()).map_err(|e| e.to_string())
}

fn settings(arguments: &Arguments) -> Result<Settings, String> {
    let mut settings = Settings::default();
    if let Some(path) = &arguments.config {
        let typed = file::read(path)?;
        settings = resolve(&path.display().to_string(), &typed, &settings).map_err(|e| e.to_string())?;
    }
    for line in &arguments.set {
        let typed = file::parse(line).map_err(|e| format!("--set {line}: {e}"))?;
        settings = resolve("--set", &typed, &settings).map_err(|e| e.to_string())?;
    }
    settings.hud |= arguments.hud;
    Ok(settings)
}
