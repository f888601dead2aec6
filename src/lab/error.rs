//! What can go wrong in the laboratory.

use crate::{assets::error::AssetError, engine::EngineError, pipeline::PipelineError, reference::TraceError};

/// Why something could not be drawn, traced or measured; each says on what, and what is allowed.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// A file.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// What the engine refused.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The pipeline that a recording went through.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The ray tracer.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// What was asked for cannot be had of this input.
    #[error("{0}")]
    Asked(String),
}

impl LabError {
    /// Joins what was tried and why it failed.
    pub fn on(what: impl std::fmt::Display, why: impl std::fmt::Display) -> Self {
        Self::Asked(format!("{what}: {why}"))
    }
}
