//! What goes wrong, as a person or a program is told it.

use crate::assets::error::{AssetError, TextPosition};
use crate::config::ConfigErrors;
use crate::daemon::exit;
use crate::device::{ErrorKind, error::DeviceError};
use crate::engine::EngineError;
use crate::lab::error::LabError;
use crate::light::unwrap_ball::UnwrapError;
use crate::pipeline::PipelineError;
use crate::reference::TraceError;
use crate::track::tag::TagError;
use serde_json::{Value, json};

/// An error: what was tried, on what, with which value, and what is allowed; and the exit status it leads to.
#[derive(Debug)]
pub struct CliError {
    /// For people.
    pub text: String,
    /// As of [`exit`].
    pub status: u8,
    /// What is wrong with a file, one by one.
    pub mistakes: Vec<Mistake>,
}

/// One thing that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// As it was named.
    pub file: String,
    /// Line and column, from 1, where they are known.
    pub place: Option<[usize; 2]>,
    /// What is wrong: the key, its value and what is allowed.
    pub text: String,
}

impl Mistake {
    /// From `FILE:LINE:COLUMN: TEXT` or `FILE: TEXT` about a known file.
    fn of_line(file: &str, line: &str) -> Self {
        let rest = line.strip_prefix(file).unwrap_or(line);
        let mut parts = rest.trim_start_matches(':').splitn(3, ':');
        let number = |part: Option<&str>| part.and_then(|text| text.parse().ok());
        let place = number(parts.next()).zip(number(parts.next())).map(|(line, column)| [line, column]);
        let text = match place {
            Some(_) => parts.next().unwrap_or_default(),
            None => rest.trim_start_matches(':'),
        };
        Self { file: file.to_owned(), place, text: text.trim().to_owned() }
    }

    fn json(&self) -> Value {
        let [line, column] = self.place.map_or([None; 2], |place| place.map(Some));
        json!({ "file": self.file, "line": line, "column": column, "message": self.text })
    }
}

impl std::fmt::Display for CliError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for CliError {}

/// A mistake of whoever asked.
#[allow(non_snake_case, reason = "it stands where the error was made from its text alone")]
pub fn CliError(text: String) -> CliError {
    CliError { text, status: exit::INPUT, mistakes: Vec::new() }
}

impl CliError {
    /// Joins what was tried and why it failed.
    pub fn on(what: impl std::fmt::Display, why: impl std::fmt::Display) -> Self {
        CliError(format!("{what}: {why}"))
    }

    /// All that is wrong with one file: each on a line that begins with its name.
    pub fn in_file(file: &str, text: String) -> Self {
        let mistakes = text.lines().map(|line| Mistake::of_line(file, line)).collect();
        Self { text, status: exit::INPUT, mistakes }
    }

    /// With another exit status.
    #[must_use]
    pub fn with_status(mut self, status: u8) -> Self {
        self.status = status;
        self
    }

    /// For machines.
    pub fn json(&self) -> Value {
        let mistakes: Vec<Value> = self.mistakes.iter().map(Mistake::json).collect();
        json!({
            "format": super::JSON_FORMAT,
            "error": { "message": self.text, "exit_status": self.status, "mistakes": mistakes },
        })
    }
}

/// Errors that say by themselves on what they happened, all of them mistakes of whoever asked.
macro_rules! told_as_they_are {
    ($($error:ty),+) => { $(
        impl From<$error> for CliError {
            fn from(error: $error) -> Self {
                CliError(error.to_string())
            }
        }
    )+ };
}

told_as_they_are!(ConfigErrors, TraceError, TagError, UnwrapError, serde_json::Error);

impl From<AssetError> for CliError {
    fn from(error: AssetError) -> Self {
        let one = |e: &AssetError| {
            let value = e.value.as_ref().map_or_else(String::new, |v| format!(" = {v}"));
            let allowed = e.allowed.as_ref().map_or_else(String::new, |a| format!(": must be {a}"));
            let cause = e.cause.as_ref().map_or_else(String::new, |c| format!(" ({c})"));
            Mistake {
                file: e.file.display().to_string(),
                place: e.position.map(|TextPosition { line, column }| [line as usize, column as usize]),
                text: format!("{}{value}{allowed}{cause}", e.what),
            }
        };
        let mistakes = std::iter::once(&error).chain(&error.others).map(one).collect();
        Self { mistakes, ..CliError(error.to_string()) }
    }
}

impl From<DeviceError> for CliError {
    fn from(error: DeviceError) -> Self {
        let status = if error.kind == ErrorKind::Refused { exit::INPUT } else { exit::DEVICE };
        CliError(error.to_string()).with_status(status)
    }
}

impl From<EngineError> for CliError {
    fn from(error: EngineError) -> Self {
        let status = if matches!(error, EngineError::Input(_)) { exit::INPUT } else { exit::DEVICE };
        CliError(error.to_string()).with_status(status)
    }
}

impl From<PipelineError> for CliError {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Engine(error) => error.into(),
            // The tool's results are what was asked for.
            PipelineError::Output(text) => CliError(text),
            other => CliError(other.to_string()).with_status(exit::status_of(&other)),
        }
    }
}

impl From<LabError> for CliError {
    fn from(error: LabError) -> Self {
        match error {
            LabError::Asset(error) => error.into(),
            LabError::Engine(error) => error.into(),
            LabError::Pipeline(error) => error.into(),
            other => CliError(other.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn lines_of_files_become_places() {
        let of = |line| Mistake::of_line("a:b.toml", line);
        let placed = of("a:b.toml:3:14: light.order = 9: must be an integer within 2..=6");
        assert_eq!(placed.place, Some([3, 14]));
        assert_eq!(placed.text, "light.order = 9: must be an integer within 2..=6");
        let bare = of("a:b.toml: cannot be read: gone");
        assert_eq!((bare.place, bare.text.as_str()), (None, "cannot be read: gone"));
    }

    #[test]
    fn machines_are_told_every_mistake_and_the_status() {
        let error = AssetError::new(Path::new("s.toml"), "camera.fx").value(-3).allowed("positive");
        let error = AssetError::together([
            error.at(TextPosition { line: 3, column: 6 }),
            AssetError::new(Path::new("s.toml"), "gone"),
        ]);
        let told = CliError::from(error.unwrap()).json();
        assert_eq!(told["error"]["mistakes"][0]["line"], 3);
        assert_eq!(told["error"]["mistakes"][0]["message"], "camera.fx = -3: must be positive");
        assert_eq!(
            (&told["error"]["mistakes"][1]["line"], &told["error"]["exit_status"]),
            (&Value::Null, &json!(2))
        );
        let no_gpu = CliError::from(EngineError::NoAdapter("none".into()));
        assert_eq!(no_gpu.status, exit::DEVICE);
    }
}
