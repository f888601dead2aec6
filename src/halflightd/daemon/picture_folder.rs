//! Where the daemon's pictures go: a display, a folder with every shown picture, or one file with the newest.

use crate::assets::{error::AssetError, pictures};
use crate::model::image::Rgb8Image;
use crate::model::{path_text, picture::Picture};
use crate::pipeline::{
    PipelineError,
    schedule::Rhythm,
    screen::Screen,
    turns::{FinishedFrame, FrameSink},
};
use crate::plan::FramePlan;
use crate::present::hud::Hud;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The newest picture is written so often at most.
const NEWEST_EVERY: Duration = Duration::from_millis(500);
/// Columns and rows of a picture that only says something.
const SAID_SIZE: [usize; 2] = [640, 480];

/// Writes `frame_000123.png` for every shown picture; without a folder, nothing. A folder that goes away or a disk that is
/// full does not stop anything: what cannot be written is left out, which is said once.
pub struct PictureFolder {
    folder: Option<PathBuf>,
    /// The newest picture, replaced as pictures come.
    newest: Option<(PathBuf, Option<Instant>)>,
    /// Pictures in a row that could not be written.
    failures: u64,
}

impl PictureFolder {
    /// Makes the folder; an empty name means none.
    pub fn new(name: &str) -> Result<Self, PipelineError> {
        if name.is_empty() {
            return Ok(Self { folder: None, newest: None, failures: 0 });
        }
        let folder = path_text::to_path(name);
        std::fs::create_dir_all(&folder).map_err(|e| {
            PipelineError::Setup(format!("output.pictures = \"{name}\": cannot be made: {e}"))
        })?;
        Ok(Self { folder: Some(folder), newest: None, failures: 0 })
    }

    /// One file with the newest picture.
    pub fn newest(file: PathBuf) -> Self {
        Self { folder: None, newest: Some((file, None)), failures: 0 }
    }

    /// Where one file has the newest picture: a dark one with these lines, until there is a real one.
    pub fn say(&mut self, lines: &[String]) {
        let Some((file, _)) = &self.newest else { return };
        let mut hud = Hud::default();
        lines.iter().for_each(|line| hud.note(format_args!("{line}")));
        let mut picture = Rgb8Image::filled(SAID_SIZE[0], SAID_SIZE[1], [40; 3]);
        hud.draw(&FramePlan::default(), &mut picture);
        let written = pictures::save_png(file, &picture);
        self.note(written);
    }

    fn note(&mut self, written: Result<(), AssetError>) {
        match written {
            Ok(()) if self.failures > 0 => {
                tracing::info!("pictures are written again; {} were left out", self.failures);
                self.failures = 0;
            }
            Ok(()) => {}
            Err(error) => {
                if self.failures == 0 {
                    tracing::warn!("pictures are left out until they can be written: {error}");
                }
                self.failures += 1;
            }
        }
    }
}

impl FrameSink for PictureFolder {
    fn accept(&mut self, finished: &FinishedFrame<'_>) -> Result<bool, PipelineError> {
        let sequence = finished.raw.sequence;
        tracing::debug!(sequence, shown = ?finished.outcome.shown, "frame");
        if let Some(folder) = &self.folder {
            let path = folder.join(format!("frame_{sequence:06}.png"));
            self.note(pictures::save_png(&path, &finished.picture.display));
        }
        if let Some((file, last)) = &mut self.newest
            && last.is_none_or(|last| last.elapsed() >= NEWEST_EVERY)
        {
            *last = Some(Instant::now());
            let written = pictures::save_png(file, &finished.picture.display);
            self.note(written);
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
