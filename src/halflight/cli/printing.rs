//! Standard output and standard error, which may be closed, full, or a pipe that nobody reads.
//!
//! The macros take the place of std's, which end the program where a line cannot be written. A reader that has gone away
//! (`| head`) is no error; any other failure is kept, and told at the end by [`finish`].

use super::CliError;
use std::fmt::Arguments;
use std::io::{ErrorKind, Write};
use std::sync::{Mutex, PoisonError};

/// The first failure of standard output.
static FAILED: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// Writes to standard output.
pub fn put(text: Arguments<'_>) {
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    if failed.is_none() {
        // One piece: std's own buffer ends at lines, and would write each by itself.
        *failed = std::io::stdout().lock().write_all(text.to_string().as_bytes()).err();
    }
}

/// Writes to standard error; what cannot be written there is lost.
pub fn tell(text: Arguments<'_>) {
    crate::daemon::log::tell(text);
}

/// Empties the buffer of standard output, and tells whether all that was put there has arrived.
///
/// # Errors
/// Some of it could not be written, for another reason than that its reader has gone away.
pub fn finish() -> Result<(), CliError> {
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    let first = failed.take().or_else(|| std::io::stdout().flush().err());
    match first.filter(|error| error.kind() != ErrorKind::BrokenPipe) {
        Some(error) => Err(CliError::on("standard output cannot be written", error)),
        None => Ok(()),
    }
}

/// As std's, and a failure is kept for the end.
macro_rules! println {
    () => { $crate::cli::printing::put(format_args!("\n")) };
    ($($text:tt)*) => {{
        $crate::cli::printing::put(format_args!("{}\n", format_args!($($text)*)))
    }};
}

/// As std's, and a failure is kept for the end.
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::printing::put(format_args!($($text)*)) };
}

/// As std's, and what cannot be written is lost.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::cli::printing::tell(format_args!($($text)*)) };
}
