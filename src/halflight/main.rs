//! `halflight`, the tool for people.

use clap::FromArgMatches;
use halflight::cli::{self, CliError, CommandLine, help, printing};
use halflight::daemon::{environment, exit, log, stop_signals};
use std::process::ExitCode;

fn main() -> ExitCode {
    environment::without_needless_lines();
    let matches = help::command().try_get_matches();
    let line = match matches.and_then(|matches| CommandLine::from_arg_matches(&matches)) {
        Ok(line) => line,
        Err(told) => return usage(&told),
    };
    log::to_stderr(tracing::Level::WARN, line.global.loudness);
    let is_json = line.global.json;
    if !line.verb.closes_what_it_writes()
        && let Err(why) = stop_signals::end_cleanly()
    {
        return failed(&CliError::on("signals", why), is_json);
    }
    let done = cli::run(line).and_then(|status| printing::finish().map(|()| status));
    done.unwrap_or_else(|error| failed(&error, is_json))
}

/// Says what is wrong, to people and, where that was asked for, to machines.
fn failed(error: &CliError, is_json: bool) -> ExitCode {
    if is_json {
        printing::put(format_args!("{}\n", error.json()));
        // Whether or not it arrives, the status tells.
        let _ = printing::finish();
    }
    printing::tell(format_args!("halflight: {error}"));
    ExitCode::from(error.status)
}

/// Help, the version, or what is wrong with the command line.
fn usage(told: &clap::Error) -> ExitCode {
    let text = told.render().to_string();
    if told.exit_code() == 0 {
        printing::put(format_args!("{text}"));
        return match printing::finish() {
            Ok(()) => ExitCode::from(exit::DONE),
            Err(error) => failed(&error, false),
        };
    }
    if std::env::args_os().any(|word| word == "--json") {
        let error = CliError::on("usage", text.trim_end());
        printing::put(format_args!("{}\n", error.json()));
        let _ = printing::finish();
    }
    printing::tell(format_args!("{}", text.trim_end()));
    ExitCode::from(exit::INPUT)
}
