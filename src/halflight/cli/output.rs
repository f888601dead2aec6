//! Results on standard output and in files.

use super::CliError;
use std::{io::Write, path::Path};

/// Prints a text and a line end. A reader that has gone away (`| head`) is no error.
///
/// # Errors
/// Standard output cannot be written.
pub fn say(text: &str) -> Result<(), CliError> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(CliError::on("writing to standard output", error))
        }
        _ => Ok(()),
    }
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
    std::fs::write(file, contents)
        .map_err(|e| CliError::on(file.display(), format!("cannot be written: {e}")))
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
