//! The log of both programs: lines on standard error, filtered by `-v`, `-q` or `HALFLIGHT_LOG`. What cannot be written
//! there is lost, and nothing else.

use std::io::{self, Write};
use tracing::Level;
use tracing_subscriber::{filter::Targets, layer::SubscriberExt, util::SubscriberInitExt};

/// How much is told.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct Loudness {
    /// Tell more on standard error; twice: still more. HALFLIGHT_LOG says it by module (docs/exit-codes.md).
    #[arg(short = 'v', long, global = true, action = clap::ArgAction::Count, conflicts_with = "quiet",
          help_heading = "Shared options", display_order = 910)]
    pub verbose: u8,
    /// Tell errors only.
    #[arg(short = 'q', long, global = true, help_heading = "Shared options", display_order = 911)]
    pub quiet: bool,
}

impl Loudness {
    /// The level that is asked for; `None` where nothing is.
    fn level(self, default: Level) -> Option<Level> {
        let louder = |level: Level| match level {
            Level::ERROR => Level::WARN,
            Level::WARN => Level::INFO,
            Level::INFO => Level::DEBUG,
            _ => Level::TRACE,
        };
        match (self.quiet, self.verbose) {
            (true, _) => Some(Level::ERROR),
            (false, 0) => None,
            (false, times) => Some((0..times.min(4)).fold(default, |level, _| louder(level))),
        }
    }
}

/// Standard error. Nobody is left to be told that it is gone.
pub struct StandardError;

impl Write for StandardError {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _ = io::stderr().lock().write_all(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Says a line on standard error.
pub fn tell(line: impl std::fmt::Display) {
    // One piece, so that lines of others do not stand in it; `StandardError` does not fail.
    let _ = StandardError.write_all(format!("{line}\n").as_bytes());
}

/// Writes log lines to standard error, as `-v` and `-q` say. Without them `HALFLIGHT_LOG` chooses which: a level (`warn`), or
/// levels by module (`info,halflightd::pipeline=debug`). Without it, or where it says something else, `default` holds.
pub fn to_stderr(default: Level, loudness: Loudness) {
    let typed = std::env::var("HALFLIGHT_LOG").ok();
    let parsed = typed.as_deref().map(str::parse::<Targets>);
    let filter = match (loudness.level(default), &parsed) {
        (Some(level), _) => Targets::new().with_default(level),
        (None, Some(Ok(targets))) => targets.clone(),
        _ => Targets::new().with_default(default),
    };
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| StandardError)
        // Lines go into files and journals as often as onto screens.
        .with_ansi(false)
        .with_target(false)
        .log_internal_errors(false);
    tracing_subscriber::registry().with(lines).with(filter).init();
    if let (Some(Err(error)), Some(text)) = (&parsed, &typed) {
        tracing::warn!(
            "HALFLIGHT_LOG = \"{text}\": must be a level (error, warn, info, debug, trace), or MODULE=LEVEL, with commas between ({error})"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_turn_the_level_up_and_down() {
        let level = |verbose, quiet| Loudness { verbose, quiet }.level(Level::WARN);
        assert_eq!(level(0, false), None);
        assert_eq!(level(1, false), Some(Level::INFO));
        assert_eq!(level(2, false), Some(Level::DEBUG));
        assert_eq!(level(200, false), Some(Level::TRACE));
        assert_eq!(level(0, true), Some(Level::ERROR));
    }
}
