//! A lens from the numbers of a calibration message, whatever its encoding.

use crate::math::lens::{Distortion, Lens};
use crate::model::limits::{MAX_LENS_PX, MIN_FOCAL_PX, check_camera_size};
use serde::Deserialize;

/// The fields that Foxglove's `CameraCalibration` and ROS's `CameraInfo` share.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub(super) struct CalibrationFields {
    pub(super) width: u32,
    pub(super) height: u32,
    #[serde(default)]
    pub(super) distortion_model: String,
    #[serde(default, rename = "D")]
    pub(super) d: Vec<f64>,
    #[serde(rename = "K")]
    pub(super) k: Vec<f64>,
}

/// Centres of pixels are at whole numbers there, at +0.5 in a `Lens`.
pub(super) const CENTRE_PX: f64 = 0.5;

impl CalibrationFields {
    /// The lens. Errors name the field, its value and what is allowed.
    pub(super) fn lens(&self) -> Result<Lens, String> {
        let &[fx, skew, cx, _, fy, cy, ..] = self.k.as_slice() else {
            return Err(format!("K has {} numbers: must be 9", self.k.len()));
        };
        if self.k.len() != 9 {
            return Err(format!("K has {} numbers: must be 9", self.k.len()));
        }
        check_camera_size(self.width as usize, self.height as usize).map_err(|allowed| {
            format!("width x height = {} x {}: must be {allowed}", self.width, self.height)
        })?;
        for (key, focal) in [("K[0] (fx)", fx), ("K[4] (fy)", fy)] {
            if !(MIN_FOCAL_PX..=MAX_LENS_PX).contains(&focal) {
                return Err(format!("{key} = {focal}: must be {MIN_FOCAL_PX} to {MAX_LENS_PX} pixels"));
            }
        }
        for (key, centre) in [("K[2] (cx)", cx), ("K[5] (cy)", cy)] {
            if !(-MAX_LENS_PX..=MAX_LENS_PX).contains(&centre) {
                return Err(format!("{key} = {centre}: must be within {MAX_LENS_PX} pixels of 0"));
            }
        }
        if !(skew.abs() <= 1e-4 * fx) {
            return Err(format!("K[1] (skew) = {skew}: must be 0"));
        }
        let distortion = self.distortion()?;
        Ok(Lens {
            width: self.width,
            height: self.height,
            fx,
            fy,
            cx: cx + CENTRE_PX,
            cy: cy + CENTRE_PX,
            distortion,
        })
    }

    fn distortion(&self) -> Result<Distortion, String> {
        if let Some(bad) = self.d.iter().find(|k| !k.is_finite()) {
            return Err(format!("D holds {bad}: must be finite numbers"));
        }
        let is_none = self.d.iter().all(|k| *k == 0.0);
        match self.distortion_model.as_str() {
            "" if is_none => Ok(Distortion::None),
            "plumb_bob" if is_none => Ok(Distortion::None),
            "plumb_bob" | "rational_polynomial" | "" => Ok(Distortion::RadialTangential(self.first()?)),
            "kannala_brandt" | "equidistant" | "fisheye" => Ok(Distortion::Equidistant(self.first()?)),
            other => {
                let known = "plumb_bob, rational_polynomial, kannala_brandt, equidistant";
                Err(format!("distortion_model = \"{other}\": must be one of {known}"))
            }
        }
    }

    /// The first coefficients, 0 for those that are not given. OpenCV writes 12 or 14, of which the ninth and later ones are those
    /// of thin prisms and of a tilted sensor.
    fn first<const N: usize>(&self) -> Result<[f64; N], String> {
        if self.d.len() > 14 {
            return Err(format!("D has {} numbers: must be at most 14", self.d.len()));
        }
        let mut first = [0.0; N];
        for (k, given) in self.d.iter().enumerate() {
            match first.get_mut(k) {
                Some(slot) => *slot = *given,
                None if *given == 0.0 => {}
                None => {
                    return Err(format!(
                        "D[{k}] = {given}: must be 0 from the {}th number on for distortion_model \"{}\" (such lenses are not modelled)",
                        N + 1,
                        self.distortion_model
                    ));
                }
            }
        }
        Ok(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(model: &str, d: &[f64]) -> CalibrationFields {
        CalibrationFields {
            width: 64,
            height: 48,
            distortion_model: model.into(),
            d: d.to_vec(),
            k: vec![50.0, 0.0, 31.5, 0.0, 51.0, 23.5, 0.0, 0.0, 1.0],
        }
    }

    #[test]
    fn tails_of_zeros_are_read_and_others_refused() {
        let eight = [0.1, -0.2, 0.001, 0.002, 0.03, 0.01, 0.02, 0.03];
        for length in [8, 12, 14] {
            let mut d = eight.to_vec();
            d.resize(length, 0.0);
            let lens = fields("rational_polynomial", &d).lens().unwrap();
            assert_eq!(lens.distortion, Distortion::RadialTangential(eight));
            if length > 8 {
                d[length - 1] = 1e-4;
                let error = fields("rational_polynomial", &d).lens().unwrap_err();
                assert!(error.contains(&format!("D[{}] = 0.0001", length - 1)), "{error}");
            }
        }
        assert!(fields("plumb_bob", &[0.1; 15]).lens().unwrap_err().contains("at most 14"));
        let fisheye = fields("equidistant", &[0.1, 0.2, 0.3, 0.4, 0.0]).lens().unwrap();
        assert_eq!(fisheye.distortion, Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]));
        assert_eq!(fields("", &[]).lens().unwrap().distortion, Distortion::None);
    }

    #[test]
    fn numbers_of_no_lens_are_named() {
        let said = |change: fn(&mut CalibrationFields), want: &str| {
            let mut fields = fields("plumb_bob", &[0.0; 5]);
            change(&mut fields);
            let error = fields.lens().unwrap_err();
            assert!(error.contains(want), "{error}");
        };
        said(|f| f.width = u32::MAX, "width x height = 4294967295 x 48");
        said(|f| (f.width, f.height) = (16384, 16384), "at most 33554432 in all");
        said(|f| f.height = 0, "64 x 0");
        said(|f| f.k[0] = 0.0, "K[0] (fx) = 0");
        said(|f| f.k[0] = 1e300, "K[0] (fx) = 1");
        said(|f| f.k[4] = f64::NAN, "K[4] (fy) = NaN");
        said(|f| f.k[2] = f64::INFINITY, "K[2] (cx) = inf");
        said(|f| f.k[1] = 3.0, "K[1] (skew) = 3");
        said(|f| f.k.truncate(4), "K has 4 numbers");
        said(|f| f.d = vec![f64::NAN], "D holds NaN");
        said(|f| f.distortion_model = "fov".into(), "distortion_model = \"fov\"");
    }
}
