//! What is done to frames before anything is drawn, and why: a part of `halflight explain`.

use crate::daemon::prepare::Prepared;
use crate::math::lens::Distortion;
use crate::model::pixels::{BayerDepth, PixelFormat};
use serde_json::{Value, json};

/// A step between the camera's bytes and the light and the pose.
pub struct CaptureStep {
    /// What it is called.
    pub name: &'static str,
    /// Whether it runs.
    pub is_on: bool,
    /// Why, or why not.
    pub reason: String,
}

impl CaptureStep {
    /// As effects say it.
    pub fn verdict(&self) -> &'static str {
        if self.is_on { "on" } else { "off" }
    }

    /// For programs.
    pub fn json(&self) -> Value {
        json!({ "step": self.name, "verdict": self.verdict(), "reason": self.reason })
    }
}

/// What a frame of an opened source goes through; `is_first`: no frame comes before it.
pub fn steps_of(prepared: &Prepared, is_first: bool) -> Vec<CaptureStep> {
    let distortion = prepared.source.rig().map(|rig| rig.lens.distortion);
    let format = prepared.source.pixel_format();
    vec![
        conversion(format),
        demosaic(format),
        undistortion(distortion),
        warp(prepared.cycle.len(), is_first),
        integration(prepared.imu.is_some()),
    ]
}

fn conversion(format: Option<PixelFormat>) -> CaptureStep {
    let (is_on, reason) = match format {
        None | Some(PixelFormat::Rgb24) => (false, "frames come as 8-bit RGB"),
        Some(PixelFormat::Yuyv | PixelFormat::Uyvy | PixelFormat::Nv12) => {
            (true, "the camera gives Y, Cb, Cr by its own matrix and range")
        }
        Some(PixelFormat::Grey) => (true, "the camera gives gray"),
        Some(PixelFormat::Mjpeg) => (true, "the camera gives JPEG files; each is decoded"),
        Some(PixelFormat::Bayer(..)) => (false, "the demosaic gives RGB"),
    };
    CaptureStep { name: "conversion", is_on, reason: reason.to_owned() }
}

fn demosaic(format: Option<PixelFormat>) -> CaptureStep {
    let (is_on, reason) = match format {
        Some(PixelFormat::Bayer(_, depth)) => {
            let bits = 32 - u32::from(depth.white()).leading_zeros();
            let kept = match depth {
                BayerDepth::Bits8 => "",
                _ => "; the merge takes all of them",
            };
            (true, format!("the sensor gives Bayer values of {bits} bits{kept}"))
        }
        _ => (false, "no raw sensor: every pixel has its three channels".to_owned()),
    };
    CaptureStep { name: "demosaic", is_on, reason }
}

/// Pictures are never resampled: what is drawn goes through the lens instead.
fn undistortion(distortion: Option<Distortion>) -> CaptureStep {
    let reason = match distortion {
        None => "the lens is not known before the first frame",
        Some(Distortion::None) => "the lens has no distortion",
        Some(_) => {
            "objects are drawn through the lens, and rays of tags and ball go through it; pictures stay as they are"
        }
    };
    CaptureStep { name: "undistort", is_on: false, reason: reason.to_owned() }
}

fn warp(exposures: usize, is_first: bool) -> CaptureStep {
    let reason = match exposures {
        _ if is_first => "no frame comes before it".to_owned(),
        0 | 1 => "one exposure: there is nothing to bring together".to_owned(),
        n => format!(
            "{n} exposures in turn: each older one is brought into the newest frame's view before the merge"
        ),
    };
    CaptureStep { name: "warp of older", is_on: exposures > 1 && !is_first, reason }
}

fn integration(has_imu: bool) -> CaptureStep {
    let reason = match has_imu {
        true => "the gyroscope turns the pose where no tag is found, for 1 s at most; then it is held",
        false => {
            "no inertial sensor: where no tag is found the last motion goes on for 0.25 s; then the pose is held"
        }
    };
    CaptureStep { name: "IMU integration", is_on: has_imu, reason: reason.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::pixels::BayerOrder;

    #[test]
    fn each_format_is_converted_or_demosaiced_or_neither() {
        let raw = PixelFormat::Bayer(BayerOrder::Rggb, BayerDepth::Bits10Packed);
        assert!(demosaic(Some(raw)).reason.contains("10 bits"));
        for (format, on) in [
            (None, [false, false]),
            (Some(PixelFormat::Rgb24), [false, false]),
            (Some(PixelFormat::Nv12), [true, false]),
            (Some(PixelFormat::Mjpeg), [true, false]),
            (Some(raw), [false, true]),
        ] {
            assert_eq!([conversion(format).is_on, demosaic(format).is_on], on, "{format:?}");
        }
    }

    #[test]
    fn one_exposure_and_a_first_frame_are_not_warped() {
        assert!(!warp(1, false).is_on && warp(3, false).is_on && !warp(3, true).is_on);
        assert!(warp(3, false).reason.starts_with("3 exposures"));
    }
}
