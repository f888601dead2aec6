//! Results on standard output and in files.

use super::{CliError, printing};
use crate::assets::whole;
use crate::model::path_text;
use std::{ffi::OsStr, path::Path};

/// Prints a text and a line end. A reader that has gone away (`| head`) is no error.
///
/// # Errors
/// Standard output cannot be written.
pub fn say(text: &str) -> Result<(), CliError> {
    println!("{text}");
    printing::finish()
}

/// Prints the digest; JSON on standard output stays alone there.
///
/// # Errors
/// Standard output cannot be written.
pub fn say_digest(hex: &str, is_json: bool) -> Result<(), CliError> {
    let line = format!("digest {hex}");
    if is_json {
        eprintln!("{line}");
        return Ok(());
    }
    say(&line)
}

/// Makes a folder with all above it where it is missing.
///
/// # Errors
/// It cannot be made.
pub fn make_folder(folder: &Path) -> Result<(), CliError> {
    std::fs::create_dir_all(folder)
        .map_err(|e| CliError::on(folder.display(), format!("cannot be made: {e}")))
}

/// Writes a file.
///
/// # Errors
/// It cannot be written.
pub fn write_file(file: &Path, contents: impl AsRef<[u8]>) -> Result<(), CliError> {
    Ok(whole::write(file, contents)?)
}

/// A path as JSON and messages show it; bytes that are no UTF-8 are replaced.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// What `device.camera` is for a name on the command line: a recording's file, or any device name.
pub fn camera_of(name: &OsStr) -> String {
    let (file, text) = (Path::new(name), path_text::to_text(Path::new(name)));
    if text.contains(':') && !file.is_file() { text } else { format!("replay:{text}") }
}

/// Refuses a frame beyond a recording's end, before anything is drawn. A device that does not know its end has none.
///
/// # Errors
/// The recording cannot be opened, or is shorter.
pub fn need_frame(camera: &str, frame: u64) -> Result<(), CliError> {
    match crate::device::open::open(camera)?.frames.frames_left() {
        Some(frames) if frame >= frames => Err(CliError(format!(
            "--frame = {frame}: {camera} has {frames} frames, numbered 0 to {}",
            frames.saturating_sub(1)
        ))),
        _ => Ok(()),
    }
}

/// What the ending of a picture's name asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputFormat {
    /// OpenEXR, 32-bit float.
    Exr,
    /// Radiance.
    Hdr,
    /// 8 bits.
    Png,
}

impl OutputFormat {
    /// By the name's ending, if it is one of those allowed.
    ///
    /// # Errors
    /// It is not; the message names those that are.
    pub fn of(out: &Path, allowed: &[Self]) -> Result<Self, CliError> {
        let ending = out.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let format = match ending.as_deref() {
            Some("exr") => Some(Self::Exr),
            Some("hdr" | "pic") => Some(Self::Hdr),
            Some("png") => Some(Self::Png),
            _ => None,
        };
        format.filter(|format| allowed.contains(format)).ok_or_else(|| {
            let names: Vec<&str> = allowed.iter().map(|format| format.ending()).collect();
            let (last, others) = names.split_last().map_or(("", &[][..]), |(last, others)| (*last, others));
            CliError(format!("--out = {}: must end in {} or {last}", out.display(), others.join(", ")))
        })
    }

    const fn ending(self) -> &'static str {
        match self {
            Self::Exr => ".exr",
            Self::Hdr => ".hdr",
            Self::Png => ".png",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_name_formats() {
        let all = [OutputFormat::Exr, OutputFormat::Hdr, OutputFormat::Png];
        assert_eq!(OutputFormat::of(Path::new("a.EXR"), &all).unwrap(), OutputFormat::Exr);
        assert_eq!(OutputFormat::of(Path::new("a.pic"), &all).unwrap(), OutputFormat::Hdr);
        let refused = OutputFormat::of(Path::new("a.jpg"), &all).unwrap_err().to_string();
        assert_eq!(refused, "--out = a.jpg: must end in .exr, .hdr or .png");
        assert!(OutputFormat::of(Path::new("a.hdr"), &[OutputFormat::Exr, OutputFormat::Png]).is_err());
    }
}
