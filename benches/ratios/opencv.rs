//! OpenCV's MergeDebevec on the same pictures in the same run, through a small script.

use halflight::model::image::Rgb8Image;
use std::{path::Path, process::Command};

/// What the script measured.
pub struct OpenCv {
    /// Milliseconds.
    pub best_ms: f64,
    /// Milliseconds.
    pub median_ms: f64,
    /// Threads that OpenCV chose, and its version.
    pub what: String,
}

/// Times it; an error says why it could not be done.
pub fn merge_debevec(pictures: &[&Rgb8Image], times_s: &[f32]) -> Result<OpenCv, String> {
    let folder = std::env::temp_dir().join(format!("halflight-bench-{}", std::process::id()));
    let measured = measure(&folder, pictures, times_s);
    // What is left behind in the system's temporary folder does no harm.
    let _ = std::fs::remove_dir_all(&folder);
    measured
}

fn measure(folder: &Path, pictures: &[&Rgb8Image], times_s: &[f32]) -> Result<OpenCv, String> {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/ratios/opencv_merge.py");
    // The system's own Python, which has the system's packages.
    let system = Path::new("/usr/bin/python3");
    let mut command = Command::new(if system.is_file() { system } else { Path::new("python3") });
    command.arg(script);
    for (k, (picture, time_s)) in pictures.iter().zip(times_s).enumerate() {
        let file = folder.join(format!("{k}.png"));
        let (width, height) = (picture.width() as u32, picture.height() as u32);
        image::save_buffer(
            &file,
            picture.pixels().as_flattened(),
            width,
            height,
            image::ExtendedColorType::Rgb8,
        )
        .map_err(|e| format!("{}: {e}", file.display()))?;
        command.arg(time_s.to_string()).arg(file);
    }
    let output = command.output().map_err(|e| format!("python3 does not start: {e}"))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let words: Vec<&str> = text.split_whitespace().collect();
    match words[..] {
        [best, median, threads, version] => {
            let number = |text: &str| text.parse::<f64>().map_err(|e| format!("\"{text}\": {e}"));
            let what = format!("OpenCV {version}, {threads} threads");
            Ok(OpenCv { best_ms: number(best)?, median_ms: number(median)?, what })
        }
        ["missing"] => Err("OpenCV is not installed: apt-get install python3-opencv".into()),
        _ => Err(format!("opencv_merge.py: {text}{}", String::from_utf8_lossy(&output.stderr))),
    }
}
