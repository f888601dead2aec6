//! A camera's response as JSON: `{"log_exposure_rgb": [[256 numbers], [..], [..]]}`, g(z) for red, green and blue.

use super::error::{AssetError, read_text};
use crate::model::response::Response;
use std::path::Path;

/// Reads a response; refused unless there are 3 x 256 finite numbers that never decrease within a channel.
pub fn load(file: &Path) -> Result<Response, AssetError> {
    parse(file, &read_text(file)?)
}

/// Parses a response; `file` is for messages.
pub fn parse(file: &Path, text: &str) -> Result<Response, AssetError> {
    let allowed = "three lists (red, green, blue) of 256 finite numbers that never decrease";
    let root: serde_json::Value =
        serde_json::from_str(text).map_err(|e| AssetError::new(file, "is not valid JSON").cause(e))?;
    let refuse = || AssetError::new(file, "log_exposure_rgb").allowed(allowed);
    let rows: Vec<Vec<f32>> = root
        .get("log_exposure_rgb")
        .and_then(|value| serde_json::from_value(value.clone()).ok())
        .ok_or_else(refuse)?;
    let mut tables = [[0.0f32; 256]; 3];
    if rows.len() != 3 || rows.iter().any(|row| row.len() != 256) {
        return Err(refuse());
    }
    for (table, row) in tables.iter_mut().zip(&rows) {
        table.copy_from_slice(row);
    }
    Response::checked(tables).map_err(|bad| {
        AssetError::new(file, format!("log_exposure_rgb[{}][{}]", bad.channel, bad.value))
            .value(bad.found)
            .allowed(match bad.found.is_finite() {
                true => format!("at least {}, the number before it: a response never falls", bad.before),
                false => "a finite number".to_owned(),
            })
    })
}

/// As JSON; `parse` gives the same response back.
pub fn to_json(response: &Response) -> String {
    let rows: Vec<&[f32]> = response.log_exposure().iter().map(|g| &g[..]).collect();
    format!("{}\n", serde_json::json!({ "log_exposure_rgb": rows }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_written_is_read() {
        let response = Response::srgb();
        assert_eq!(parse(Path::new("r.json"), &to_json(&response)).unwrap(), response);
    }

    #[test]
    fn a_falling_table_is_refused_by_name() {
        let text = to_json(&Response::srgb()).replacen("0.0,", "-9.0,", 1).replacen("0.0]", "-99.0]", 1);
        let error = parse(Path::new("r.json"), &text).unwrap_err().to_string();
        assert!(error.contains("r.json") && error.contains("log_exposure_rgb"), "{error}");
        let mut tables = *Response::srgb().log_exposure();
        tables[2][77] = -3.5;
        let text = serde_json::json!({ "log_exposure_rgb": tables.map(|g| g.to_vec()) }).to_string();
        let error = parse(Path::new("r.json"), &text).unwrap_err().to_string();
        assert!(error.contains("log_exposure_rgb[2][77] = -3.5: must be at least"), "{error}");
    }

    proptest! {
        #[test]
        fn any_text_is_judged(text in "\\PC{0,80}") {
            let _ = parse(Path::new("any.json"), &text);
            let _ = parse(Path::new("any.json"), &format!("{{\"log_exposure_rgb\":{text}}}"));
        }
    }
}
