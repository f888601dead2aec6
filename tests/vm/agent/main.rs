//! In the guest of `make test-vm`: a client of the camera, inertial sensors through uhid, and the door to the harness.
//! Each command prints a line and ends with status 1 where something is not as it must be.

mod capture;
mod hidraw;
mod hub;
mod iio;
mod options;
mod serial;
mod sys;
mod uhid;
mod video;

use options::Options;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::process::ExitCode;

/// Lines of the harness, and what programs do with buffers; `run` has set both up.
const CONTROL: &str = "/dev/ttyS1";
const PACING: &str = "/dev/ttyS2";
const TRACING: &str = "/sys/kernel/tracing";

type Outcome = Result<String, String>;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match run(&words) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(text) => {
            println!("{text}");
            ExitCode::FAILURE
        }
    }
}

fn run(words: &[String]) -> Outcome {
    let number = |at: usize| -> Result<u32, String> {
        words.get(at).and_then(|word| word.parse().ok()).ok_or(format!("word {at} must be a number"))
    };
    match words.first().map(String::as_str) {
        Some("ask") => ask(&words[1..].join(" ")),
        Some("pace") => pace().map_err(|e| e.to_string()),
        Some("capture") => capture::run(&Options::parse(&words[1..])?),
        Some("nodes") => capture::nodes("/dev/video0", "/dev/video1"),
        Some("hidraw") => hidraw::run(number(1)?, number(2)?),
        Some("hidraw-feed") => hidraw::feed_until(&words[1]),
        Some("iio-feed") => iio::feed_until(&words[1]),
        Some("iio") => iio::run(number(1)?, number(2)?),
        Some("serial-echo") => serial::echo(&words[1]),
        Some("serial-samples") => serial::samples(&words[1], number(2)?, number(3)?),
        _ => Err("ask | pace | capture | nodes | hidraw | hidraw-feed | iio | iio-feed | serial-echo | serial-samples".to_owned()),
    }
}

/// Asks the harness; what it cannot do is an error.
fn ask(question: &str) -> Outcome {
    let told = |e: std::io::Error| format!("{CONTROL}: {e}");
    let mut port = OpenOptions::new().read(true).write(true).open(CONTROL).map_err(told)?;
    port.write_all(format!("{question}\n").as_bytes()).map_err(told)?;
    let mut answer = String::new();
    BufReader::new(port).read_line(&mut answer).map_err(told)?;
    match answer.trim().strip_prefix("ok") {
        Some(text) => Ok(text.trim().to_owned()),
        None => Err(format!("{question}: {}", answer.trim())),
    }
}

/// Tells the camera of every buffer that any program queues or takes, as the kernel's trace has it.
fn pace() -> std::io::Result<String> {
    for event in ["v4l2_qbuf", "v4l2_dqbuf"] {
        fs::write(format!("{TRACING}/events/v4l2/{event}/enable"), "1")?;
    }
    let mut port = OpenOptions::new().write(true).open(PACING)?;
    for line in BufReader::new(File::open(format!("{TRACING}/trace_pipe"))?).lines() {
        let line = line?;
        let Some((event, rest)) = line.split_once(": minor = ") else { continue };
        let index = rest.split_once("index = ").and_then(|(_, rest)| rest.split(',').next()).unwrap_or("0");
        let kind = if event.ends_with("v4l2_qbuf") { 'q' } else { 'd' };
        port.write_all(format!("{kind}{index}\n").as_bytes())?;
    }
    Ok("the trace has ended".to_owned())
}
