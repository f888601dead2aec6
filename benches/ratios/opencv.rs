//! OpenCV on the same pictures in the same run, through small scripts.

use halflight::model::image::Rgb8Image;
use std::{ffi::OsString, path::Path, process::Command};

/// What the script measured.
pub struct OpenCv {
    /// Milliseconds.
    pub best_ms: f64,
    /// Milliseconds.
    pub median_ms: f64,
    /// Threads that OpenCV chose, and its version.
    pub what: String,
}

/// Times MergeDebevec; an error says why it could not be done.
pub fn merge_debevec(pictures: &[&Rgb8Image], times_s: &[f32]) -> Result<OpenCv, String> {
    in_folder(|folder| {
        let mut arguments = Vec::new();
        for (k, (picture, time_s)) in pictures.iter().zip(times_s).enumerate() {
            let file = folder.join(format!("{k}.png"));
            let (width, height) = (picture.width() as u32, picture.height() as u32);
            let rgb = picture.pixels().as_flattened();
            image::save_buffer(&file, rgb, width, height, image::ExtendedColorType::Rgb8)
                .map_err(|e| format!("{}: {e}", file.display()))?;
            arguments.extend([time_s.to_string().into(), file.into_os_string()]);
        }
        measured_by("opencv_merge.py", &arguments)
    })
}

/// Times the conversion of a camera's bytes to linear light; `form` is a name that the script knows.
pub fn convert(form: &str, width: usize, height: usize, bytes: &[u8]) -> Result<OpenCv, String> {
    in_folder(|folder| {
        let file = folder.join("bytes");
        std::fs::write(&file, bytes).map_err(|e| format!("{}: {e}", file.display()))?;
        let arguments =
            [form.into(), width.to_string().into(), height.to_string().into(), file.into_os_string()];
        measured_by("opencv_convert.py", &arguments)
    })
}

fn in_folder(work: impl FnOnce(&Path) -> Result<OpenCv, String>) -> Result<OpenCv, String> {
    let folder = std::env::temp_dir().join(format!("halflight-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let measured = work(&folder);
    // What is left behind in the system's temporary folder does no harm.
    let _ = std::fs::remove_dir_all(&folder);
    measured
}

fn measured_by(script: &str, arguments: &[OsString]) -> Result<OpenCv, String> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/ratios").join(script);
    // The system's own Python, which has the system's packages.
    let system = Path::new("/usr/bin/python3");
    let mut command = Command::new(if system.is_file() { system } else { Path::new("python3") });
    let output =
        command.arg(file).args(arguments).output().map_err(|e| format!("python3 does not start: {e}"))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let words: Vec<&str> = text.split_whitespace().collect();
    match words[..] {
        [best, median, threads, version] => {
            let number = |text: &str| text.parse::<f64>().map_err(|e| format!("\"{text}\": {e}"));
            let what = format!("OpenCV {version}, {threads} threads");
            Ok(OpenCv { best_ms: number(best)?, median_ms: number(median)?, what })
        }
        ["missing"] => Err("OpenCV is not installed: apt-get install python3-opencv".into()),
        _ => Err(format!("{script}: {text}{}", String::from_utf8_lossy(&output.stderr))),
    }
}
