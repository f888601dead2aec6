//! `halflightd`, the daemon.

use clap::Parser;
use halflightd::config::{Settings, file, resolve};
use halflightd::daemon::cache_folder::cache_folder;
use halflightd::daemon::run::{FollowedFile, run_daemon, tell_ended};
use halflightd::daemon::{environment, exit, log, version};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const AFTER_HELP: &str = "\
Without arguments it looks for a camera until there is one, and says where its newest picture is; a virtual room instead:
--set 'device.camera=\"synthetic:\"'.
Signals: INT and TERM end it after the picture it is at; HUP reads the settings file again.
Exit status: 0 ended, 2 bad settings or usage, 3 a device or an engine failed.
HALFLIGHT_LOG=LEVEL or MODULE=LEVEL,.. chooses the lines of its log (error, warn, info, debug, trace); -v and -q win.";

/// The daemon: captures, measures the light, draws virtual objects into the picture.
///
/// Every setting is explained in config/default.toml (`halflight check --manual`); `halflight check FILE` checks a file.
#[derive(Parser)]
#[command(name = "halflightd", version = version::SHORT, long_version = version::LONG, max_term_width = 110,
          after_help = AFTER_HELP)]
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
    #[command(flatten)]
    loudness: log::Loudness,
}

/// What ended the daemon: its exit status, and what it says.
struct Ended {
    status: u8,
    says: String,
}

impl From<String> for Ended {
    fn from(says: String) -> Self {
        Self { status: exit::INPUT, says }
    }
}

fn main() -> ExitCode {
    environment::without_needless_lines();
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(told) => {
            let is_help = told.exit_code() == 0;
            if is_help {
                // A reader that has gone away needs no help.
                let _ = write!(std::io::stdout().lock(), "{}", told.render());
            } else {
                log::tell(told.render().to_string().trim_end());
            }
            return ExitCode::from(if is_help { exit::DONE } else { exit::INPUT });
        }
    };
    log::to_stderr(tracing::Level::INFO, arguments.loudness);
    match run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Ended { status, says }) => {
            log::tell(format_args!("halflightd: {says}"));
            ExitCode::from(status)
        }
    }
}

fn run(arguments: Arguments) -> Result<(), Ended> {
    let content = arguments.config.as_deref().map(file::text).transpose()?;
    let started = settings(&arguments, content.as_deref())?;
    let is_bare = arguments.config.is_none() && arguments.set.is_empty();
    let newest = if is_bare && started.pictures_folder.is_empty() { first_look(&started) } else { None };
    let followed = arguments.config.clone().zip(content).map(|(path, content)| FollowedFile {
        path,
        content,
        read: Box::new(move |content| settings(&arguments, Some(content))),
    });
    let ran = run_daemon(&started, followed, newest);
    let counts = ran.map_err(|e| Ended { status: exit::status_of(&e), says: e.to_string() })?;
    tell_ended(&counts);
    Ok(())
}

/// Where somebody who starts it without settings finds a picture; says so, and what else there is to know.
fn first_look(settings: &Settings) -> Option<PathBuf> {
    let folder = cache_folder()?;
    let file = folder.join("picture.png");
    let place = match std::fs::create_dir_all(&folder) {
        Ok(()) => format!("the newest picture is in {}, twice a second", file.display()),
        Err(why) => format!("there is no picture: {} cannot be made: {why}", folder.display()),
    };
    log::tell(format_args!(
        "halflightd: no settings are named (--config FILE, --set KEY=VALUE; --help)\n\
         halflightd: it looks for a camera (device.camera = \"{}\": all of /dev/video*) and waits until there is one: {place}\n\
         halflightd: Ctrl-C (SIGINT) or SIGTERM ends it; no camera at hand: --set 'device.camera=\"synthetic:\"'",
        settings.camera
    ));
    Some(file)
}

/// All settings: a file's content over the defaults, the command line over both.
fn settings(arguments: &Arguments, content: Option<&str>) -> Result<Settings, String> {
    let mut settings = Settings::default();
    if let (Some(path), Some(content)) = (&arguments.config, content) {
        settings = from_file(path, content, &settings)?;
    }
    for line in &arguments.set {
        settings = halflightd::config::over(line, &settings)?;
    }
    settings.hud |= arguments.hud;
    halflightd::config::rig::over_settings(settings)
}

fn from_file(path: &Path, content: &str, base: &Settings) -> Result<Settings, String> {
    let name = path.display().to_string();
    let typed = file::parse(content).map_err(|e| format!("{name}: {e}"))?;
    resolve(&name, &typed, base).map_err(|e| e.to_string())
}
