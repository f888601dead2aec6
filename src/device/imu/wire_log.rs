//! Logs of what came over a wire: text, one line for each read, so that a fault can be looked at and played again.
//!
//! ```text
//! # halflight wire log 1
//! # device serial:/dev/ttyUSB0,protocol=rvc
//! 12.345678901 aaaa00e803..
//! ```
//! The first number is the time of arrival in seconds on the program's clock, nine decimals; then the bytes in hex. Of a HID
//! device each line is one report. Other lines that begin with `#` are remarks.

use crate::model::time::Timestamp;
use std::fmt::Write as _;
use std::io::Write;

/// How every log begins.
pub const HEAD: &str = "# halflight wire log 1";
/// The longest log that is read, bytes.
pub const LONGEST: usize = 64 << 20;
/// The most bytes of one line.
pub const LONGEST_READ: usize = 4096;

/// Writes a log as bytes come.
pub struct WireLogWriter {
    out: Box<dyn Write + Send>,
    line: String,
    is_whole: bool,
}

impl WireLogWriter {
    /// Begins a log; the caller opens what it goes to.
    pub fn new(mut out: Box<dyn Write + Send>, device: &str) -> std::io::Result<Self> {
        writeln!(out, "{HEAD}\n# device {}", device.replace(['\n', '\r'], " "))?;
        Ok(Self { out, line: String::with_capacity(2 * LONGEST_READ + 32), is_whole: true })
    }

    /// Adds what one read gave. A log that cannot be written is said once and ends; the sensor goes on.
    pub fn write(&mut self, arrival: Timestamp, bytes: &[u8]) {
        for part in bytes.chunks(LONGEST_READ) {
            self.line.clear();
            let t = arrival.0.max(0);
            let _ = write!(self.line, "{}.{:09} ", t / 1_000_000_000, t % 1_000_000_000);
            for byte in part {
                let _ = write!(self.line, "{byte:02x}");
            }
            self.line.push('\n');
            if self.is_whole
                && let Err(error) = self.out.write_all(self.line.as_bytes())
            {
                tracing::error!("the wire log ends here, it cannot be written: {error}");
                self.is_whole = false;
            }
        }
    }

    /// Writes what is still held back; an error also where an earlier line was lost.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.out.flush()?;
        if self.is_whole { Ok(()) } else { Err(std::io::Error::other("lines were lost")) }
    }
}

/// A mistake in a log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("wire log, line {line}: {why}")]
pub struct WireLogError {
    /// From 1.
    pub line: usize,
    /// What is wrong.
    pub why: String,
}

/// Reads a log: times of arrival that never fall, and bytes.
pub fn read(text: &str) -> Result<Vec<(Timestamp, Vec<u8>)>, WireLogError> {
    let wrong = |line: usize, why: &str| WireLogError { line, why: why.to_owned() };
    if text.len() > LONGEST {
        return Err(wrong(1, "the log has more than 64 MiB"));
    }
    if text.lines().next() != Some(HEAD) {
        return Err(wrong(1, &format!("must be \"{HEAD}\"")));
    }
    let mut reads: Vec<(Timestamp, Vec<u8>)> = Vec::new();
    for (k, line) in text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let (time, hex) = line.split_once(' ').ok_or_else(|| wrong(k + 1, "must be SECONDS HEX"))?;
        let arrival = seconds(time).ok_or_else(|| wrong(k + 1, "the time must have nine decimals"))?;
        if reads.last().is_some_and(|(before, _)| *before > arrival) {
            return Err(wrong(k + 1, "the time falls"));
        }
        if hex.len() > 2 * LONGEST_READ {
            return Err(wrong(k + 1, "more than 4096 bytes"));
        }
        let bytes = bytes(hex).ok_or_else(|| wrong(k + 1, "the bytes must be pairs of hex digits"))?;
        reads.push((arrival, bytes));
    }
    Ok(reads)
}

fn seconds(text: &str) -> Option<Timestamp> {
    let (whole, fraction) = text.split_once('.').filter(|(_, fraction)| fraction.len() == 9)?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    if !is_number(whole) || !is_number(fraction) {
        return None;
    }
    let whole: i64 = whole.parse().ok()?;
    Some(Timestamp(whole.checked_mul(1_000_000_000)?.checked_add(fraction.parse().ok()?)?))
}

fn bytes(hex: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| char::from(byte).to_digit(16).map(|digit| digit as u8);
    let (pairs, rest) = hex.as_bytes().as_chunks::<2>();
    let all = pairs.iter().map(|[high, low]| Some(digit(*high)? << 4 | digit(*low)?)).collect();
    if rest.is_empty() { all } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct SharedBytes(Arc<Mutex<Vec<u8>>>);

    impl Write for SharedBytes {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    proptest! {
        #[test]
        fn a_log_reads_back(reads in prop::collection::vec((0i64..1 << 40, prop::collection::vec(any::<u8>(), 1..300)), 0..20)) {
            let mut reads = reads;
            reads.sort_by_key(|read| read.0);
            let shared = SharedBytes::default();
            let mut log = WireLogWriter::new(Box::new(shared.clone()), "serial:/dev/x\ny").unwrap();
            for (t, bytes) in &reads {
                log.write(Timestamp(*t), bytes);
            }
            log.finish().unwrap();
            let text = String::from_utf8(shared.0.lock().unwrap().clone()).unwrap();
            let want: Vec<_> = reads.into_iter().map(|(t, bytes)| (Timestamp(t), bytes)).collect();
            prop_assert_eq!(read(&text).unwrap(), want);
        }

        #[test]
        fn any_text_is_read_or_refused(text in ".{0,300}") {
            let _ = read(&format!("{HEAD}\n{text}"));
        }
    }

    #[test]
    fn mistakes_name_the_line() {
        let error = |text: &str| read(&format!("{HEAD}\n{text}")).unwrap_err().to_string();
        assert!(error("1.000000000 abc").contains("line 2: the bytes"));
        assert!(error("1.0 ab").contains("nine decimals"));
        assert!(error("2.000000000 ab\n1.000000000 ab").contains("line 3: the time falls"));
        assert!(read("x").unwrap_err().to_string().contains("line 1"));
    }
}
