//! What goes wrong, as a person is told it.

use crate::assets::error::AssetError;
use crate::config::ConfigErrors;
use crate::device::error::DeviceError;
use crate::engine::EngineError;
use crate::lab::error::LabError;
use crate::light::unwrap_ball::UnwrapError;
use crate::pipeline::PipelineError;
use crate::reference::TraceError;
use crate::track::tag::TagError;

/// An error for people: what was tried, on what, with which value, and what is allowed. Exit status 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct CliError(pub String);

impl CliError {
    /// Joins what was tried and why it failed.
    pub fn on(what: impl std::fmt::Display, why: impl std::fmt::Display) -> Self {
        Self(format!("{what}: {why}"))
    }
}

/// Errors that say by themselves on what they happened.
macro_rules! told_as_they_are {
    ($($error:ty),+) => { $(
        impl From<$error> for CliError {
            fn from(error: $error) -> Self {
                Self(error.to_string())
            }
        }
    )+ };
}

told_as_they_are!(
    AssetError,
    ConfigErrors,
    DeviceError,
    EngineError,
    LabError,
    PipelineError,
    TraceError,
    TagError,
    UnwrapError,
    serde_json::Error
);
