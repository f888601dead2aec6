//! A serial line: what goes out comes back, samples come in, and a cut is seen.

use halflight_vm::{REPORT_BYTES, Sample};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};

type Outcome = Result<String, String>;

fn open(path: &str) -> Result<File, String> {
    OpenOptions::new().read(true).write(true).open(path).map_err(|e| format!("{path}: {e}"))
}

/// Every byte value there and back.
pub fn echo(path: &str) -> Outcome {
    let mut file = open(path)?;
    let sent: Vec<u8> = (0..=255).collect();
    file.write_all(&sent).map_err(|e| format!("{path}: {e}"))?;
    let mut came = vec![0; sent.len()];
    file.read_exact(&mut came).map_err(|e| format!("{path}: {e}"))?;
    if came == sent { Ok("256 bytes there and back".to_owned()) } else { Err(format!("{came:?} came back")) }
}

/// Samples from `first` on, then the end of the line.
pub fn samples(path: &str, first: u32, count: u32) -> Outcome {
    let mut file = open(path)?;
    // The device begins when it hears something.
    file.write_all(b"s").map_err(|e| format!("{path}: {e}"))?;
    for counter in first..first + count {
        let mut report = [0; REPORT_BYTES];
        file.read_exact(&mut report).map_err(|e| format!("{path}: sample {counter}: {e}"))?;
        if Sample::of_report(&report) != Some(Sample::by_rule(counter)) {
            return Err(format!("sample {counter} is {report:?}"));
        }
    }
    crate::ask("serial cut")?;
    match file.read(&mut [0; 64]) {
        Ok(0) => {}
        Err(error) if error.kind() != ErrorKind::WouldBlock => {}
        other => return Err(format!("{path}: the line was cut and nobody says so: {other:?}")),
    }
    Ok(format!("{count} samples, none lost, and the cut was seen"))
}
