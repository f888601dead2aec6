//! Pictures in: one linear picture, or 8-bit exposures merged.

use crate::cli::{CliError, bracket::steady};
use crate::{
    assets::pictures,
    engine::{Bracket, Engine},
    hdr::{
        merge_bracket::MAX_PICTURES,
        response::{Origin, SolveOptions, solve},
    },
    model::{
        frame::Exposure,
        image::{HdrImage, Rgb8Image},
        response::Response,
    },
};
use std::path::{Path, PathBuf};

/// One linear picture from a linear file, or from 8-bit exposures through their response.
pub fn merged(
    files: &[PathBuf],
    times: &[String],
    response: Option<&str>,
    engine: &mut dyn Engine,
    notes: &mut Vec<String>,
) -> Result<HdrImage, CliError> {
    if files.is_empty() || files.len() > MAX_PICTURES {
        return Err(CliError(format!("{} pictures: must be 1 to {MAX_PICTURES} (IMAGE..)", files.len())));
    }
    let linear = files.iter().find(|file| !is_8_bit(file));
    if let (Some(linear), true) = (linear, files.len() > 1 || !times.is_empty() || response.is_some()) {
        return Err(CliError(format!(
            "{}: is linear already: must be given alone, without --times and --response (those are for PNG and JPEG)",
            linear.display()
        )));
    }
    if let Some(file) = linear {
        return Ok(pictures::load_radiance(file).map_err(|e| CliError(e.to_string()))?.hdr);
    }
    let times_s: Vec<f64> = match (times, files) {
        // One exposure tells radiance only up to a scale: 1 s.
        ([], [_]) => vec![1.0],
        _ => times.iter().map(|text| seconds(text)).collect::<Result<_, _>>()?,
    };
    if times_s.len() != files.len() {
        return Err(CliError(format!(
            "--times: {} times for {} pictures: must be one for each picture",
            times_s.len(),
            files.len()
        )));
    }
    let mut loaded = files
        .iter()
        .map(|file| pictures::load_rgb8(file).map_err(|e| CliError(e.to_string())))
        .collect::<Result<Vec<_>, _>>()?;
    let exposures: Vec<Exposure> = times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect();
    let first = choose_response(response, &loaded, &exposures, &mut Vec::new())?;
    notes.extend(steady(&mut loaded, &exposures, &first));
    let response = choose_response(response, &loaded, &exposures, notes)?;
    merge(&loaded.iter().collect::<Vec<_>>(), &exposures, &response, engine)
}

fn choose_response(
    asked: Option<&str>,
    pictures: &[Rgb8Image],
    exposures: &[Exposure],
    notes: &mut Vec<String>,
) -> Result<Response, CliError> {
    Ok(match asked.unwrap_or("srgb") {
        "srgb" => Response::srgb(),
        "solve" => {
            let pictures: Vec<&Rgb8Image> = pictures.iter().collect();
            let recovered = solve(&pictures, exposures, &SolveOptions::default());
            match recovered.origin {
                Origin::Solved { residual_rms } => {
                    notes.push(format!(
                        "response solved from the bracket, rms {residual_rms:.3} in ln exposure"
                    ));
                }
                Origin::Fallback { why } => {
                    notes.push(format!("warning: response not solved ({why}); sRGB stands in"));
                }
            }
            recovered.response
        }
        file => load_response(Path::new(file))?,
    })
}

/// Merges on the engine asked for.
pub fn merge(
    pictures: &[&Rgb8Image],
    exposures: &[Exposure],
    response: &Response,
    engine: &mut dyn Engine,
) -> Result<HdrImage, CliError> {
    let mut picture = HdrImage::default();
    engine
        .merge_bracket(&Bracket { pictures, exposures }, response, &mut picture)
        .map_err(|e| CliError(e.to_string()))?;
    Ok(picture)
}

fn is_8_bit(file: &Path) -> bool {
    let ending = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    ["png", "jpg", "jpeg"].contains(&ending.as_str())
}

/// Seconds from `0.025` or `1/40`.
fn seconds(text: &str) -> Result<f64, CliError> {
    let number = |part: &str| part.trim().parse::<f64>().ok();
    let time_s = match text.split_once('/') {
        Some((top, bottom)) => number(top).zip(number(bottom)).map(|(top, bottom)| top / bottom),
        None => number(text),
    };
    time_s
        .filter(|t| t.is_finite() && *t > 0.0)
        .ok_or_else(|| CliError(format!("--times {text}: must be seconds above 0, such as 0.025 or 1/40")))
}

fn load_response(file: &Path) -> Result<Response, CliError> {
    crate::assets::response::load(file).map_err(|e| {
        CliError(format!("--response {}: must be srgb, solve or a JSON file ({e})", file.display()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_as_people_write_them() {
        assert_eq!(seconds("0.025").unwrap(), 0.025);
        assert_eq!(seconds("1/40").unwrap(), 0.025);
        for wrong in ["", "0", "-1", "1/0", "nan", "1/x", "inf", "0/5"] {
            assert!(seconds(wrong).unwrap_err().0.contains("--times"), "{wrong}");
        }
    }
}
