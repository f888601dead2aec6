//! Camera calibrations: OpenCV's YAML (`%YAML:1.0`, `!!opencv-matrix`), ROS `camera_info` YAML, and plain lists
//! `K: [nine numbers]`.
//!
//! All three put pixel *centres* at whole numbers; ours are at +0.5. So 0.5 is added to cx and cy, and a lens as
//! loaded projects into our continuous pixels.

mod write;

use super::error::{AssetError, read_file};
use super::pictures::MAX_PIXELS;
use crate::math::lens::{Distortion, Lens};
use crate::model::limits::{MAX_LENS_PX, MAX_SIDE, MIN_FOCAL_PX};
use std::path::{Path, PathBuf};
pub use write::to_yaml;
use yaml_rust2::{Event, ScanError, Yaml, YamlLoader, parser::Parser};

/// What turns an index of pixel centres into a continuous coordinate.
const CENTRE_PX: f64 = 0.5;
/// No calibration is larger; a larger file is something else.
const MAX_BYTES: usize = 1 << 20;
/// Deepest nesting, so that a hostile file cannot exhaust the stack.
const MAX_DEPTH: usize = 32;

/// Key of a camera matrix, and keys under which its distortion may stand.
const PAIRS: [(&str, &[&str]); 16] = [
    ("camera_matrix", &["distortion_coefficients", "dist_coeffs", "dist_coeff", "distCoeffs"]),
    ("cameraMatrix", &["distCoeffs", "distortion_coefficients", "dist_coeffs"]),
    ("Camera_Matrix", &["Distortion_Coefficients"]),
    ("cameraMatrix1", &["distCoeffs1"]),
    ("cameraMatrix2", &["distCoeffs2"]),
    ("M1", &["D1"]),
    ("M2", &["D2"]),
    ("K1", &["D1"]),
    ("K2", &["D2"]),
    ("M", &["D"]),
    ("K", &["D", "distortion_coefficients", "dist_coeffs"]),
    ("k", &["d"]),
    ("mtx", &["dist"]),
    ("intrinsic_matrix", &["distortion_coefficients"]),
    ("camera_matrix_left", &["distortion_coefficients_left"]),
    ("camera_matrix_right", &["distortion_coefficients_right"]),
];
const ALLOWED_KEYS: &str =
    "a mapping with camera_matrix, cameraMatrix, M1, K1 or K, at the top or one level below it";

/// Loads a lens. `path` may end in `#NAME`, where NAME is a camera matrix's key (`stereo.yml#M2`) or the section
/// that holds one (`info.yaml#left`); without it the first camera of the file is taken.
/// Width and height are 0 where the file does not state them: see `for_picture`.
/// Fails on what cannot be read, is no YAML, or lacks a usable camera matrix, naming file, key and value.
pub fn load(path: &Path) -> Result<Lens, AssetError> {
    let (file, name) = split_name(path);
    let bytes = read_file(&file)?;
    parse(&bytes, name.as_deref(), path)
}

/// The lens for a picture of width x height: takes its size if the calibration states none; fails if it states
/// another, since a picture that was scaled or cut has another camera matrix.
pub fn for_picture(lens: Lens, width: usize, height: usize, path: &Path) -> Result<Lens, AssetError> {
    let wanted = (u32::try_from(width).unwrap_or(u32::MAX), u32::try_from(height).unwrap_or(u32::MAX));
    if (lens.width, lens.height) != (0, 0) && (lens.width, lens.height) != wanted {
        return Err(AssetError::new(path, "image_width x image_height")
            .value(format!("{} x {}", lens.width, lens.height))
            .allowed(format!("the picture's own size, {width} x {height}")));
    }
    Ok(Lens { width: wanted.0, height: wanted.1, ..lens })
}

/// File and camera name of `FILE#NAME`; a file that exists under the whole name wins.
fn split_name(path: &Path) -> (PathBuf, Option<String>) {
    if let Some((file, name)) = path.to_str().and_then(|text| text.rsplit_once('#'))
        && !path.exists()
        && !name.is_empty()
        && !name.contains('/')
    {
        return (PathBuf::from(file), Some(name.to_owned()));
    }
    (path.to_owned(), None)
}

/// The same from the file's bytes; `path` is only for messages. Never panics, whatever the bytes.
pub fn parse(bytes: &[u8], name: Option<&str>, path: &Path) -> Result<Lens, AssetError> {
    if bytes.len() > MAX_BYTES {
        return Err(AssetError::new(path, "size").value(bytes.len()).allowed("at most 1 MiB"));
    }
    let text = std::str::from_utf8(bytes)
        .map_err(|error| AssetError::new(path, "text").allowed("UTF-8").cause(error))?;
    // OpenCV's `%YAML:1.0` is no directive that YAML knows.
    let text = text.trim_start_matches('\u{feff}');
    let (text, lines_before) = match text.strip_prefix("%YAML") {
        Some(rest) => (rest.split_once('\n').map_or("", |(_, body)| body), 1),
        None => (text, 0),
    };
    check_shape(text, lines_before, path)?;
    let documents = YamlLoader::load_from_str(text)
        .map_err(|error| AssetError::new(path, "YAML").cause(error.to_string()))?;
    let cameras = documents.first().map(cameras_of).unwrap_or_default();
    let named = |camera: &&CameraEntry<'_>| {
        name.is_none_or(|name| camera.key == name || camera.section.is_some_and(|s| s == name))
    };
    let Some(camera) = cameras.iter().find(named) else {
        let error = AssetError::new(path, "camera");
        let known: Vec<&str> = cameras.iter().map(|c| c.section.unwrap_or(c.key)).collect();
        return Err(match (name, known.is_empty()) {
            (Some(name), false) => {
                error.value(name).allowed(format!("one of the file's: {}", known.join(", ")))
            }
            _ => AssetError::new(path, "camera matrix").value("none").allowed(ALLOWED_KEYS),
        });
    };
    camera.lens(path)
}

/// Refuses what could exhaust stack or memory: deep nesting, and anchors and aliases (which multiply). The text goes through the
/// parser's own events, so that quotes and comments are what the parser takes them for; events nest in no recursion.
fn check_shape(text: &str, lines_before: usize, path: &Path) -> Result<(), AssetError> {
    let failed = |e: ScanError| AssetError::new(path, "YAML").cause(e.to_string());
    let mut parser = Parser::new_from_str(text);
    let mut depth = 0usize;
    loop {
        let (event, mark) = parser.next_token().map_err(failed)?;
        let has_anchor = match event {
            Event::StreamEnd => return Ok(()),
            Event::Alias(_) => true,
            Event::SequenceStart(anchor, _) | Event::MappingStart(anchor, _) => {
                depth += 1;
                anchor > 0
            }
            Event::Scalar(_, _, anchor, _) => anchor > 0,
            Event::SequenceEnd | Event::MappingEnd => {
                depth = depth.saturating_sub(1);
                false
            }
            _ => false,
        };
        let place = || format!("YAML, line {}", mark.line() + lines_before);
        if has_anchor {
            return Err(AssetError::new(path, place()).value("an anchor or alias").allowed("written out"));
        }
        if depth > MAX_DEPTH {
            return Err(AssetError::new(path, place()).value("nesting").allowed("at most 32 levels deep"));
        }
    }
}

/// One camera of a file.
struct CameraEntry<'a> {
    /// The mapping that holds it.
    holder: &'a Yaml,
    /// The key that holds that mapping, where it is not the top.
    section: Option<&'a str>,
    /// The key of its matrix.
    key: &'static str,
    distortion_keys: &'static [&'static str],
}

/// All cameras, in the order of the file at the top, then one level down.
fn cameras_of(document: &Yaml) -> Vec<CameraEntry<'_>> {
    let mut cameras = Vec::new();
    let mut add = |holder, section| {
        for (key, distortion_keys) in PAIRS {
            if get(holder, key).is_some() {
                cameras.push(CameraEntry { holder, section, key, distortion_keys });
            }
        }
    };
    add(document, None);
    if let Yaml::Hash(sections) = document {
        for (section, holder) in sections {
            if let Some(section) = section.as_str() {
                add(holder, Some(section));
            }
        }
    }
    cameras
}

fn get<'a>(holder: &'a Yaml, key: &str) -> Option<&'a Yaml> {
    let Yaml::Hash(entries) = holder else { return None };
    entries.iter().find(|(k, _)| k.as_str() == Some(key)).map(|(_, v)| v)
}

fn get_any<'a, 'k>(holder: &'a Yaml, keys: &[&'k str]) -> Option<(&'k str, &'a Yaml)> {
    keys.iter().find_map(|key| get(holder, key).map(|v| (*key, v)))
}

/// A value as it stands in the file, short.
fn shown(value: &Yaml) -> String {
    match value {
        Yaml::Real(s) | Yaml::String(s) => s.chars().take(40).collect(),
        Yaml::Integer(i) => i.to_string(),
        Yaml::Boolean(b) => b.to_string(),
        Yaml::Array(items) => format!("a list of {}", items.len()),
        Yaml::Hash(entries) => format!("a mapping of {}", entries.len()),
        _ => "nothing".to_owned(),
    }
}

fn number(value: &Yaml) -> Option<f64> {
    match value {
        Yaml::Integer(i) => Some(*i as f64),
        other => other.as_f64(),
    }
    .filter(|x| x.is_finite())
}

impl CameraEntry<'_> {
    /// The key as a path, for messages.
    fn path_of(&self, key: &str) -> String {
        self.section.map_or_else(|| key.to_owned(), |section| format!("{section}.{key}"))
    }

    fn lens(&self, path: &Path) -> Result<Lens, AssetError> {
        let error = |key: &str| AssetError::new(path, self.path_of(key));
        let matrix = self.numbers(self.key, get(self.holder, self.key).unwrap_or(&Yaml::Null), path)?;
        let Ok(k) = <[f64; 9]>::try_from(matrix) else {
            return Err(error(self.key).value("not nine numbers").allowed("a 3x3 matrix, row by row"));
        };
        let [fx, skew, cx, zero_a, fy, cy, zero_b, zero_c, one] = k;
        for (what, focal) in [("[0][0] (fx)", fx), ("[1][1] (fy)", fy)] {
            if !(MIN_FOCAL_PX..=MAX_LENS_PX).contains(&focal) {
                return Err(error(&format!("{}{what}", self.key))
                    .value(focal)
                    .allowed(format!("{MIN_FOCAL_PX} to {MAX_LENS_PX} pixels")));
            }
        }
        for (what, centre) in [("[0][2] (cx)", cx), ("[1][2] (cy)", cy)] {
            if centre.abs() > MAX_LENS_PX {
                return Err(error(&format!("{}{what}", self.key))
                    .value(centre)
                    .allowed(format!("within {MAX_LENS_PX} pixels of 0")));
            }
        }
        if skew.abs() > 1e-4 * fx {
            return Err(error(&format!("{}[0][1] (skew)", self.key)).value(skew).allowed("0"));
        }
        if (zero_a, zero_b, zero_c, one) != (0.0, 0.0, 0.0, 1.0) {
            return Err(error(self.key)
                .value(format!("last row {zero_b} {zero_c} {one}, first of the second {zero_a}"))
                .allowed("fx 0 cx, 0 fy cy, 0 0 1"));
        }
        let (width, height) = self.size(path)?;
        let distortion = self.distortion(path)?;
        Ok(Lens { width, height, fx, fy, cx: cx + CENTRE_PX, cy: cy + CENTRE_PX, distortion })
    }

    /// The numbers of a matrix, given as `{rows, cols, data}`, as a list, or as a list of rows.
    fn numbers(&self, key: &str, value: &Yaml, path: &Path) -> Result<Vec<f64>, AssetError> {
        let error = |what: String| AssetError::new(path, self.path_of(&what));
        let (list_key, list) = match get(value, "data") {
            Some(data) => (format!("{key}.data"), data),
            None => (key.to_owned(), value),
        };
        let Yaml::Array(items) = list else {
            return Err(error(list_key).value(shown(list)).allowed("a list of numbers"));
        };
        let mut numbers = Vec::with_capacity(items.len());
        for (i, item) in items.iter().enumerate() {
            let row = if let Yaml::Array(row) = item { row.as_slice() } else { std::slice::from_ref(item) };
            for x in row {
                let Some(x) = number(x) else {
                    return Err(error(format!("{list_key}[{i}]")).value(shown(x)).allowed("a finite number"));
                };
                numbers.push(x);
            }
        }
        if let (Some(rows), Some(cols)) = (get(value, "rows"), get(value, "cols")) {
            let stated = rows.as_i64().zip(cols.as_i64()).and_then(|(r, c)| r.checked_mul(c));
            if stated != Some(numbers.len() as i64) {
                return Err(error(list_key).value(format!("{} numbers", numbers.len())).allowed(format!(
                    "rows x cols = {} x {} of them",
                    shown(rows),
                    shown(cols)
                )));
            }
        }
        Ok(numbers)
    }

    /// Width and height; both 0 where neither is stated, at the camera or at the top.
    fn size(&self, path: &Path) -> Result<(u32, u32), AssetError> {
        let mut sides = [0u32; 2];
        for (side, keys) in sides.iter_mut().zip([["image_width", "width"], ["image_height", "height"]]) {
            if let Some((key, value)) = get_any(self.holder, &keys) {
                *side = number(value)
                    .filter(|x| x.fract() == 0.0 && (1.0..=MAX_SIDE as f64).contains(x))
                    .ok_or_else(|| {
                        AssetError::new(path, self.path_of(key))
                            .value(shown(value))
                            .allowed(format!("a whole number of pixels within 1..={MAX_SIDE}"))
                    })? as u32;
            }
        }
        match sides {
            [0, 0] => Ok((0, 0)),
            [0, _] | [_, 0] => Err(AssetError::new(path, self.path_of("image_width, image_height"))
                .value("only one of them")
                .allowed("both or neither")),
            // That of pictures, which may be larger than what is drawn.
            [width, height] if width as usize * height as usize > MAX_PIXELS => {
                Err(AssetError::new(path, self.path_of("image_width x image_height"))
                    .value(format!("{width} x {height}"))
                    .allowed(format!("at most {MAX_PIXELS} pixels")))
            }
            [width, height] => Ok((width, height)),
        }
    }

    fn distortion(&self, path: &Path) -> Result<Distortion, AssetError> {
        let Some((key, value)) = get_any(self.holder, self.distortion_keys) else {
            return Ok(Distortion::None);
        };
        let coefficients = self.numbers(key, value, path)?;
        let model = match get(self.holder, "distortion_model") {
            Some(Yaml::String(model)) => model.as_str(),
            Some(Yaml::Null) | None => "",
            Some(other) => {
                return Err(AssetError::new(path, self.path_of("distortion_model"))
                    .value(shown(other))
                    .allowed(MODELS));
            }
        };
        let fisheye = get(self.holder, "fisheye_model").and_then(Yaml::as_i64).is_some_and(|f| f != 0);
        if coefficients.iter().all(|c| *c == 0.0) && !(fisheye || is_equidistant(model)) {
            return Ok(Distortion::None);
        }
        let count = |allowed: &str| {
            AssetError::new(path, self.path_of(key))
                .value(format!("{} coefficients", coefficients.len()))
                .allowed(allowed.to_owned())
        };
        if fisheye || is_equidistant(model) {
            let four = <[f64; 4]>::try_from(coefficients.as_slice());
            return four
                .map(Distortion::Equidistant)
                .map_err(|_not_four| count("k1 k2 k3 k4 for an equidistant fisheye"));
        }
        if !["", "plumb_bob", "rational_polynomial", "radtan"].contains(&model) {
            return Err(AssetError::new(path, self.path_of("distortion_model")).value(model).allowed(MODELS));
        }
        if !matches!(coefficients.len(), 4 | 5 | 8 | 12 | 14) {
            return Err(count("k1 k2 p1 p2 [k3 [k4 k5 k6 [s1..s4 [tx ty]]]]: 4, 5, 8, 12 or 14 of them"));
        }
        if let Some(extra) = coefficients.iter().skip(8).find(|c| **c != 0.0) {
            return Err(AssetError::new(path, self.path_of(key))
                .value(format!("a thin prism or tilt coefficient of {extra}"))
                .allowed("0 from the ninth coefficient on (such lenses are not modelled)"));
        }
        let mut k = [0.0; 8];
        for (k, c) in k.iter_mut().zip(&coefficients) {
            *k = *c;
        }
        Ok(Distortion::RadialTangential(k))
    }
}

const MODELS: &str = "plumb_bob, rational_polynomial or equidistant";

fn is_equidistant(model: &str) -> bool {
    ["equidistant", "fisheye", "kannala_brandt"].contains(&model)
}

#[cfg(test)]
mod tests;
