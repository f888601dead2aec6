//! Pictures in: one linear picture, or 8-bit exposures merged.

use crate::cli::{CliError, hdr::exposure_time_s};
use crate::lab::{open_exr::load_radiance, still::bracket::LoadedBracket};
use crate::{
    assets::pictures,
    engine::Engine,
    hdr::{
        merge_bracket::MAX_PICTURES,
        response::{ResponseOrigin, SolveOptions, solve},
    },
    model::{image::HdrImage, response::Response},
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
        return Ok(load_radiance(file)?.hdr);
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
    let pictures = files.iter().map(|file| pictures::load_rgb8(file)).collect::<Result<Vec<_>, _>>()?;
    let mut bracket = LoadedBracket::new(pictures, &times_s);
    let first = choose_response(response, &bracket, &mut Vec::new())?;
    notes.extend(bracket.steady(&first));
    let response = choose_response(response, &bracket, notes)?;
    Ok(bracket.merge(&response, engine)?)
}

fn choose_response(
    asked: Option<&str>,
    bracket: &LoadedBracket,
    notes: &mut Vec<String>,
) -> Result<Response, CliError> {
    Ok(match asked.unwrap_or("srgb") {
        "srgb" => Response::srgb(),
        "solve" => {
            let recovered = solve(&bracket.refs(), &bracket.exposures, &SolveOptions::default());
            match recovered.origin {
                ResponseOrigin::Solved { residual_rms } => {
                    notes.push(format!(
                        "response solved from the bracket, rms {residual_rms:.3} in ln exposure"
                    ));
                }
                ResponseOrigin::Fallback { why } => {
                    notes.push(format!("warning: response not solved ({why}); sRGB stands in"));
                }
            }
            recovered.response
        }
        file => load_response(Path::new(file))?,
    })
}

fn is_8_bit(file: &Path) -> bool {
    let ending = file.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    ["png", "jpg", "jpeg"].contains(&ending.as_str())
}

fn seconds(text: &str) -> Result<f64, CliError> {
    exposure_time_s(text)
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
            assert!(seconds(wrong).unwrap_err().text.contains("--times"), "{wrong}");
        }
    }
}
