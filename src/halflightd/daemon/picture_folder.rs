//! Where the daemon's pictures go: a display, and a folder that takes every shown picture as PNG.

use crate::assets::pictures;
use crate::model::picture::Picture;
use crate::pipeline::{
    PipelineError,
    schedule::Rhythm,
    screen::Screen,
    turns::{FinishedFrame, FrameSink},
};
use std::path::PathBuf;

/// Writes `frame_000123.png` for every shown picture; without a folder, nothing.
pub struct PictureFolder {
    folder: Option<PathBuf>,
    /// Pictures in a row that could not be written.
    failures: u64,
}

impl PictureFolder {
    /// Makes the folder; an empty name means none.
    pub fn new(name: &str) -> Result<Self, PipelineError> {
        if name.is_empty() {
            return Ok(Self { folder: None, failures: 0 });
        }
        let folder = PathBuf::from(name);
        std::fs::create_dir_all(&folder).map_err(|e| {
            PipelineError::Output(format!("output.pictures = \"{name}\": cannot be made: {e}"))
        })?;
        Ok(Self { folder: Some(folder), failures: 0 })
    }
}

impl FrameSink for PictureFolder {
    /// A disk that is full may have room again: what cannot be written is left out.
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        let sequence = finished.raw.sequence;
        tracing::debug!(sequence, shown = ?finished.outcome.shown, "frame");
        if let Some(folder) = &self.folder {
            let path = folder.join(format!("frame_{sequence:06}.png"));
            match pictures::save_png(&path, &finished.picture.display) {
                Ok(()) => self.failures = 0,
                Err(error) => {
                    if self.failures.is_multiple_of(100) {
                        tracing::warn!("left out: {error}");
                    }
                    self.failures += 1;
                }
            }
        }
        Ok(true)
    }

    fn hold(&mut self, says: &str, _picture: &Picture) -> Result<bool, PipelineError> {
        tracing::debug!(says, "the last picture is shown on");
        Ok(true)
    }
}

/// A folder and a display, each where there is one.
pub struct DaemonSink {
    /// Takes pictures as files.
    pub folder: PictureFolder,
    /// Shows them.
    pub screen: Option<Screen>,
    /// The display is looked through: objects are posed for the moment at which they are seen.
    pub is_see_through: bool,
}

impl FrameSink for DaemonSink {
    /// The display first: somebody waits for it.
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        if let Some(screen) = &self.screen {
            screen.offer(&finished.picture.display);
        }
        self.folder.accept(finished)
    }

    fn hold(&mut self, says: &str, picture: &Picture) -> Result<bool, PipelineError> {
        if let Some(screen) = &self.screen {
            screen.offer(&picture.display);
        }
        self.folder.hold(says, picture)
    }

    fn rhythm(&self) -> Option<Rhythm> {
        self.screen.as_ref().filter(|_| self.is_see_through)?.rhythm()
    }
}
