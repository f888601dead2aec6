//! A display that is a folder: every shown picture as PNG.

use crate::assets::pictures;
use crate::device::Truth;
use crate::model::{frame::RawFrame, picture::Picture};
use crate::pipeline::{PipelineError, event::FrameSink, frame::FrameOutcome};
use std::path::PathBuf;

/// Writes `frame_000123.png` for every shown picture; without a folder, nothing.
pub struct PictureFolder {
    folder: Option<PathBuf>,
}

impl PictureFolder {
    /// Makes the folder; an empty name means none.
    pub fn new(name: &str) -> Result<Self, PipelineError> {
        if name.is_empty() {
            return Ok(Self { folder: None });
        }
        let folder = PathBuf::from(name);
        std::fs::create_dir_all(&folder).map_err(|e| {
            PipelineError::Output(format!("output.pictures = \"{name}\": cannot be made: {e}"))
        })?;
        Ok(Self { folder: Some(folder) })
    }
}

impl FrameSink for PictureFolder {
    fn accept(
        &mut self,
        raw: &RawFrame,
        _truth: Option<&Truth>,
        outcome: &FrameOutcome,
        picture: &Picture,
    ) -> Result<bool, PipelineError> {
        tracing::debug!(sequence = raw.sequence, shown = ?outcome.shown, "frame");
        if let Some(folder) = &self.folder {
            let path = folder.join(format!("frame_{:06}.png", raw.sequence));
            pictures::save_png(&path, &picture.display).map_err(|e| PipelineError::Output(e.to_string()))?;
        }
        Ok(true)
    }
}
