//! Pictures to an MP4, through ffmpeg where it is installed.

use crate::model::image::Rgb8Image;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A film that is being written.
pub struct Film {
    encoder: Child,
    size: (usize, usize),
}

impl Film {
    /// Starts ffmpeg. `Err` says why there will be no film.
    pub fn start(path: &Path, width: usize, height: usize, frames_per_s: f64) -> Result<Self, String> {
        let encoder = Command::new("ffmpeg")
            .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &format!("{frames_per_s}"), "-i", "-"])
            // yuv420p and even sizes are what every player shows.
            .args([
                "-vf",
                "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv",
                "-c:v",
                "libx264",
                "-pix_fmt",
                "yuv420p",
                "-crf",
                "20",
            ])
            // The file says what its colours mean; a player that has to guess takes small films for BT.601.
            .args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"])
            .args(["-color_range", "tv", "-movflags", "+faststart"])
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .map_err(|e| format!("no film: ffmpeg cannot be started ({e}); install the package ffmpeg"))?;
        Ok(Self { encoder, size: (width, height) })
    }

    /// Adds a picture; one of another size is refused.
    pub fn add(&mut self, picture: &Rgb8Image) -> Result<(), String> {
        if (picture.width(), picture.height()) != self.size {
            return Err(format!(
                "film is {:?}, picture is {}x{}",
                self.size,
                picture.width(),
                picture.height()
            ));
        }
        let Some(pipe) = self.encoder.stdin.as_mut() else { return Err("the film is closed".into()) };
        pipe.write_all(bytemuck::cast_slice(picture.pixels()))
            .map_err(|e| format!("ffmpeg took no more pictures: {e}"))
    }

    /// Closes the film.
    pub fn finish(mut self) -> Result<(), String> {
        drop(self.encoder.stdin.take());
        match self.encoder.wait() {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => Err(format!("ffmpeg ended with {status}")),
            Err(e) => Err(format!("ffmpeg: {e}")),
        }
    }
}
