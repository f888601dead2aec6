//! A calibration as OpenCV's YAML, as [`load`](super::load) reads it.

use super::CENTRE_PX;
use crate::math::lens::{Distortion, Lens};
use std::fmt::Write as _;

/// The lens as text, with a remark.
pub fn to_yaml(lens: &Lens, remark: &str) -> String {
    let (model, coefficients) = match lens.distortion {
        Distortion::None => ("plumb_bob", vec![0.0; 5]),
        Distortion::RadialTangential(k) if k[5..] == [0.0; 3] => ("plumb_bob", k[..5].to_vec()),
        Distortion::RadialTangential(k) => ("rational_polynomial", k.to_vec()),
        Distortion::Equidistant(k) => ("equidistant", k.to_vec()),
    };
    let (cx, cy) = (lens.cx - CENTRE_PX, lens.cy - CENTRE_PX);
    let mut text = format!("%YAML:1.0\n---\n# {}\n", remark.replace(['\n', '\r'], " "));
    let _ = writeln!(text, "image_width: {}\nimage_height: {}", lens.width, lens.height);
    matrix(&mut text, "camera_matrix", (3, 3), &[lens.fx, 0.0, cx, 0.0, lens.fy, cy, 0.0, 0.0, 1.0]);
    let _ = writeln!(text, "distortion_model: {model}");
    matrix(&mut text, "distortion_coefficients", (1, coefficients.len()), &coefficients);
    text
}

fn matrix(text: &mut String, key: &str, (rows, columns): (usize, usize), numbers: &[f64]) {
    let numbers: Vec<String> = numbers.iter().map(|number| format!("{number:?}")).collect();
    let _ = writeln!(
        text,
        "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {} ]",
        numbers.join(", ")
    );
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;
    use std::path::Path;

    #[test]
    fn what_is_written_is_read() {
        for distortion in [
            Distortion::None,
            Distortion::RadialTangential([-0.28, 1.0 / 3.0, 1e-9, -5e-4, -0.01, 0.0, 0.0, 0.0]),
            Distortion::RadialTangential([0.9, 0.2, 0.0, 0.0, 0.01, 1.2, 0.4, 0.05]),
            Distortion::Equidistant([0.02, -0.012, 0.004, -0.001]),
        ] {
            let lens = Lens { distortion, ..Lens::pinhole(640, 480, 452.3, 455.1, 320.5, 240.25) };
            let text = to_yaml(&lens, "two\nlines: {");
            let read = parse(text.as_bytes(), None, Path::new("a.yml")).unwrap();
            assert_eq!(read, lens, "{text}");
        }
    }
}
