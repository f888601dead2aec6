//! What a run was like: medians, 95th percentiles, errors against the truth.

use crate::device::Truth;
use crate::light::split::{SplitOptions, split};
use crate::math::color::gray;
use crate::model::{estimate::Provenance, light::RadianceSh};
use crate::pipeline::frame::{FrameOutcome, Stage};
use crate::plan::governor::Choice;
use glam::DVec3;
use serde_json::{Value, json};

/// Frames before the light is expected to hold: one exposure cycle and the filter's settling.
pub const WARM_UP_FRAMES: usize = 9;

/// One frame in numbers; `None` where there was nothing to measure or no truth to hold it against.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameNumbers {
    /// Angle between the measured and the true dominant direction, degrees.
    pub direction_error_deg: Option<f64>,
    /// Distance between the measured and the true camera position, millimetres.
    pub position_error_mm: Option<f64>,
    /// Angle between the measured and the true camera rotation, degrees.
    pub rotation_error_deg: Option<f64>,
    /// Whether the pose was measured on this frame.
    pub pose_measured: bool,
    /// Relative error of the gray E_d.
    pub irradiance_error: Option<f64>,
    /// Relative errors of E_d in red, green and blue.
    pub irradiance_error_rgb: Option<[f64; 3]>,
    /// Milliseconds of each stage.
    pub stage_ms: [f32; Stage::ALL.len()],
    /// What the governor has chosen after it.
    pub choice: Option<Choice>,
}

impl FrameNumbers {
    /// Measures one frame.
    pub fn of(outcome: &FrameOutcome, truth: Option<&Truth>) -> Self {
        let mut numbers = Self { stage_ms: outcome.stage_ms, choice: outcome.choice, ..Self::default() };
        if let Some(pose) = &outcome.pose {
            numbers.pose_measured = pose.provenance == Provenance::Measured;
            if let Some(truth) = truth {
                let exact = &truth.pose.world_from_camera;
                let found = &pose.world_from_camera;
                numbers.position_error_mm = Some(found.translation.distance(exact.translation) * 1e3);
                numbers.rotation_error_deg = Some(found.angle_to(exact).to_degrees());
            }
        }
        if let (Some(light), Some(truth)) = (&outcome.light, truth)
            && let Some(direct) = &light.split.direct
        {
            let found = DVec3::from(direct.to_light_world.map(f64::from));
            let exact = DVec3::from(truth.to_light_world.map(f64::from));
            numbers.direction_error_deg = Some(angle_deg(found, exact));
            let exact_rgb = true_irradiance_rgb(truth, light.total.order);
            let found_rgb = direct.irradiance_rgb.map(f64::from);
            if gray(exact_rgb) > 0.0 {
                numbers.irradiance_error = Some(gray(found_rgb) / gray(exact_rgb) - 1.0);
            }
            if exact_rgb.iter().all(|exact| *exact > 0.0) {
                let error = std::array::from_fn(|c| found_rgb[c] / exact_rgb[c] - 1.0);
                numbers.irradiance_error_rgb = Some(error);
            }
        }
        numbers
    }
}

/// E_d of the truth, split as the measured light is.
fn true_irradiance_rgb(truth: &Truth, order: usize) -> [f64; 3] {
    let mut light = RadianceSh::zero(order.min(truth.light.order));
    let rows = light.order * light.order;
    light.rgb[..rows].copy_from_slice(&truth.light.rgb[..rows]);
    let halves = split(&light, &SplitOptions::default());
    halves.direct.map_or([0.0; 3], |d| d.irradiance_rgb.map(f64::from))
}

fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Median and 95th percentile and largest of a list; `None` where it is empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Half lie below.
    pub median: f64,
    /// 95 of 100 lie below.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Sorts and picks; not-finite values count as largest.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let at = |share: f64| sorted[((last as f64) * share).round() as usize];
        Some(Self { median: at(0.5), p95: at(0.95), max: sorted[last] })
    }

    /// As JSON with the unit in the names: `median_deg`.
    pub fn json(&self, unit: &str) -> Value {
        json!({ format!("median_{unit}"): self.median, format!("p95_{unit}"): self.p95, format!("max_{unit}"): self.max })
    }
}

/// Spread of one number over frames after the warm-up.
pub fn after_warm_up(frames: &[FrameNumbers], pick: impl Fn(&FrameNumbers) -> Option<f64>) -> Option<Spread> {
    Spread::of(frames.iter().skip(WARM_UP_FRAMES).filter_map(pick))
}

/// Spread of one stage's milliseconds.
pub fn stage(frames: &[FrameNumbers], index: usize) -> Option<Spread> {
    Spread::of(frames.iter().map(|f| f64::from(f.stage_ms[index])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_picks_ranks() {
        let spread = Spread::of((1..=101).rev().map(f64::from)).unwrap();
        assert_eq!(spread, Spread { median: 51.0, p95: 96.0, max: 101.0 });
        assert_eq!(Spread::of(std::iter::empty()), None);
    }

    #[test]
    fn angles_are_stable_at_both_ends() {
        assert!(angle_deg(DVec3::Z, DVec3::Z).abs() < 1e-12);
        assert!((angle_deg(DVec3::Z, -DVec3::Z) - 180.0).abs() < 1e-9);
        assert!(
            (angle_deg(DVec3::Z, DVec3::new(1e-4, 0.0, 1.0).normalize()) - 1e-4_f64.to_degrees()).abs()
                < 1e-9
        );
    }
}
