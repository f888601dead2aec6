//! What can be wrong with a file.

use std::{
    error::Error,
    fmt::{self, Display, Formatter},
    path::Path,
};

/// A place in a text file, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextPosition {
    /// Lines before it, and one.
    pub line: u32,
    /// The character in it.
    pub column: u32,
}

impl TextPosition {
    /// Of a byte of a text; one beyond its end or within a character counts as the character before.
    pub fn of(text: &str, byte: usize) -> Self {
        let before = &text[..text.floor_char_boundary(byte)];
        let line = before.rsplit_once('\n').map_or(before, |(_, line)| line);
        Self { line: before.matches('\n').count() as u32 + 1, column: line.chars().count() as u32 + 1 }
    }
}

/// A file could not be read or written, or says something that is not allowed.
///
/// Printed as `FILE:LINE:COLUMN: WHAT = VALUE: must be ALLOWED (CAUSE)`, leaving out what is unknown. The cause is part of
/// that one line and is therefore not given again by `Error::source`. Where several things are wrong with one
/// file, `others` holds the rest, each printed on a line of its own.
#[derive(Debug)]
pub struct AssetError {
    /// The file, as it was named to us.
    pub file: Box<Path>,
    /// Where in the file, where that is known.
    pub position: Option<TextPosition>,
    /// The key, or what was tried: `camera.fx`, `header`, `decode PNG`.
    pub what: Box<str>,
    /// The value found, where there is one.
    pub value: Option<Box<str>>,
    /// What is allowed, so that it reads well after "must be".
    pub allowed: Option<Box<str>>,
    /// The error underneath.
    pub cause: Option<Box<dyn Error + Send + Sync>>,
    /// More mistakes of the same file.
    pub others: Vec<AssetError>,
}

impl AssetError {
    /// An error about `what` in `file`; the builders below add to it.
    pub fn new(file: &Path, what: impl Into<Box<str>>) -> Self {
        Self {
            file: file.into(),
            position: None,
            what: what.into(),
            value: None,
            allowed: None,
            cause: None,
            others: Vec::new(),
        }
    }

    /// Adds the place in the file.
    #[must_use]
    pub fn at(mut self, position: TextPosition) -> Self {
        self.position = Some(position);
        self
    }

    /// Adds the value that was found.
    #[must_use]
    pub fn value(mut self, value: impl Display) -> Self {
        self.value = Some(value.to_string().into());
        self
    }

    /// Adds what is allowed; it is printed after "must be".
    #[must_use]
    pub fn allowed(mut self, allowed: impl Into<Box<str>>) -> Self {
        self.allowed = Some(allowed.into());
        self
    }

    /// Adds the error underneath.
    #[must_use]
    pub fn cause(mut self, cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        self.cause = Some(cause.into());
        self
    }

    /// Says in which part of the file it is: `meshes[0].primitives[1], NORMAL`.
    #[must_use]
    pub fn inside(mut self, part: impl Display) -> Self {
        self.what = format!("{part}, {}", self.what).into();
        self
    }

    /// Several errors as one: the first, with the rest in `others`. `None` where there are none.
    pub fn together(errors: impl IntoIterator<Item = Self>) -> Option<Self> {
        let mut errors = errors.into_iter();
        let mut first = errors.next()?;
        first.others.extend(errors);
        Some(first)
    }
}

impl Display for AssetError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(TextPosition { line, column }) = self.position {
            write!(f, ":{line}:{column}")?;
        }
        write!(f, ": {}", self.what)?;
        if let Some(value) = &self.value {
            write!(f, " = {value}")?;
        }
        if let Some(allowed) = &self.allowed {
            write!(f, ": must be {allowed}")?;
        }
        if let Some(cause) = &self.cause {
            write!(f, " ({cause})")?;
        }
        for other in &self.others {
            write!(f, "\n{other}")?;
        }
        Ok(())
    }
}

impl Error for AssetError {}

/// Largest file that is read into memory.
pub const MAX_FILE_BYTES: u64 = 512 << 20;

/// Reads a whole file; refuses one that is missing, unreadable or larger than `MAX_FILE_BYTES`.
pub fn read_file(file: &Path) -> Result<Vec<u8>, AssetError> {
    let meta = std::fs::metadata(file).map_err(|e| AssetError::new(file, "cannot be opened").cause(e))?;
    if !meta.is_file() {
        return Err(AssetError::new(file, "cannot be read").allowed("a regular file"));
    }
    if meta.len() > MAX_FILE_BYTES {
        return Err(AssetError::new(file, "size in bytes")
            .value(meta.len())
            .allowed(format!("at most {MAX_FILE_BYTES}")));
    }
    std::fs::read(file).map_err(|e| AssetError::new(file, "cannot be read").cause(e))
}

/// Reads a whole text file in UTF-8.
pub fn read_text(file: &Path) -> Result<String, AssetError> {
    String::from_utf8(read_file(file)?)
        .map_err(|e| AssetError::new(file, "text encoding").allowed("UTF-8").cause(e.utf8_error()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_file_key_value_and_what_is_allowed() {
        let e = AssetError::new(Path::new("a.toml"), "camera.fx").value(-3.0).allowed("positive");
        assert_eq!(e.to_string(), "a.toml: camera.fx = -3: must be positive");
        let e = e.at(TextPosition { line: 3, column: 6 });
        assert_eq!(e.to_string(), "a.toml:3:6: camera.fx = -3: must be positive");
        let f = AssetError::new(Path::new("a.toml"), "cannot be read").cause("gone");
        assert_eq!(f.to_string(), "a.toml: cannot be read (gone)");
        let both = AssetError::together([e, f]).unwrap();
        assert_eq!(both.to_string().lines().count(), 2);
        assert!(AssetError::together([]).is_none());
    }

    #[test]
    fn places_are_counted_in_lines_and_characters() {
        let text = "a = 1\r\nü = 2\nend";
        let place = |byte| {
            let TextPosition { line, column } = TextPosition::of(text, byte);
            (line, column)
        };
        assert_eq!((place(0), place(4), place(7)), ((1, 1), (1, 5), (2, 1)));
        // The umlaut has two bytes.
        assert_eq!((place(8), place(9), place(12), place(14)), ((2, 1), (2, 2), (2, 5), (3, 1)));
        assert_eq!((place(17), place(99)), ((3, 4), (3, 4)));
    }

    #[test]
    fn a_missing_file_and_a_folder_are_errors() {
        assert!(read_file(Path::new("/no/such/file")).unwrap_err().to_string().contains("/no/such/file"));
        assert!(read_file(Path::new("/")).unwrap_err().to_string().contains("regular file"));
    }
}
