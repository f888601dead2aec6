//! `halflightd`, the daemon.

use clap::Parser;
use halflightd::config::{Settings, file, resolve};
use halflightd::daemon::run::{FollowedFile, run_daemon};
use halflightd::pipeline::turns::RunCounts;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The daemon: captures, measures the light, draws virtual objects into the picture.
///
/// Every setting is explained in config/default.toml; `halflight check FILE` checks a file. SIGINT and SIGTERM end it.
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
    halflightd::daemon::log::to_stderr(tracing::Level::INFO);
    match run(Arguments::parse()) {
        Ok(counts) => {
            tracing::info!(
                frames = counts.frames,
                lost_by_source = counts.lost_by_source,
                passed_over = counts.passed_over,
                passed_through = counts.passed_through,
                held = counts.held,
                devices_lost = counts.devices_lost,
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
    let content = arguments.config.as_deref().map(file::text).transpose()?;
    let started = settings(&arguments, content.as_deref())?;
    let followed = arguments.config.clone().zip(content).map(|(path, content)| FollowedFile {
        path,
        content,
        read: Box::new(move |content| settings(&arguments, Some(content))),
    });
    run_daemon(&started, followed).map_err(|e| e.to_string())
}

/// All settings: a file's content over the defaults, the command line over both.
fn settings(arguments: &Arguments, content: Option<&str>) -> Result<Settings, String> {
    let mut settings = Settings::default();
    if let (Some(path), Some(content)) = (&arguments.config, content) {
        settings = from_file(path, content, &settings)?;
    }
    for line in &arguments.set {
        let typed = file::parse(line).map_err(|e| format!("--set {line}: {e}"))?;
        settings = resolve("--set", &typed, &settings).map_err(|e| e.to_string())?;
    }
    settings.hud |= arguments.hud;
    Ok(settings)
}

fn from_file(path: &Path, content: &str, base: &Settings) -> Result<Settings, String> {
    let name = path.display().to_string();
    let typed = file::parse(content).map_err(|e| format!("{name}: {e}"))?;
    resolve(&name, &typed, base).map_err(|e| e.to_string())
}
