//! What to show when something is missing: never black, never a crash.

use crate::model::estimate::{PoseEstimate, Provenance};

/// A pose that was not measured for longer than this is no longer drawn with: the objects would float.
pub const LONGEST_POSE_AGE_S: f64 = 0.5;

/// Whether virtual objects can be drawn; if not, why.
pub fn obstacle(pose: Option<&PoseEstimate>, light_is_known: bool) -> Option<&'static str> {
    match pose {
        None => Some("no tag found yet"),
        Some(pose) if age_s(&pose.provenance) > LONGEST_POSE_AGE_S => Some("tag lost"),
        Some(_) if !light_is_known => Some("light not measured yet"),
        Some(_) => None,
    }
}

/// Seconds since the measurement behind an estimate.
pub fn age_s(provenance: &Provenance) -> f64 {
    match provenance {
        Provenance::Measured | Provenance::Interpolated => 0.0,
        Provenance::Predicted { age_s } | Provenance::Held { age_s } => *age_s,
    }
}
