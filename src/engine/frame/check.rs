//! Whether what a caller asks for fits together.

use crate::light::maps;
use crate::math::sh::MAX_ORDER;
use crate::model::quality::Quality;
use crate::{EngineError, LightJob, RelightInput};

/// Whether light can be read from a job.
pub fn check_light(job: &LightJob<'_>, quality: &Quality) -> Result<(), EngineError> {
    if !(1..=MAX_ORDER).contains(&quality.sh_order) {
        return Err(EngineError::Input(format!(
            "quality.sh_order = {}: must be within 1..={MAX_ORDER}",
            quality.sh_order
        )));
    }
    match job {
        LightJob::Map(map) if !maps::fits(map) => Err(EngineError::Input(format!(
            "environment picture of {} x {} texels does not fit its layout, {:?}",
            map.radiance.width(),
            map.radiance.height(),
            map.layout
        ))),
        _ => Ok(()),
    }
}

/// Whether the parts of a frame fit together.
pub fn check_frame(quality: &Quality, input: &RelightInput<'_>) -> Result<(), EngineError> {
    let refuse = |what: String| Err(EngineError::Input(what));
    let (lens, background) = (input.lens, &input.background.radiance);
    if (lens.width as usize, lens.height as usize) != (background.width(), background.height()) {
        return refuse(format!(
            "relight: the lens is for {} x {} pixels, the picture has {} x {}",
            lens.width,
            lens.height,
            background.width(),
            background.height()
        ));
    }
    let pose = input.world_from_camera;
    if !(pose.translation.is_finite() && pose.rotation.is_finite()) {
        return refuse(format!("relight: the camera's pose is not finite: {pose:?}"));
    }
    let exposure_s = input.shown_exposure.effective_s();
    if !(exposure_s.is_finite() && exposure_s > 0.0) {
        return refuse(format!("relight: shown exposure = {exposure_s} s: must be above 0"));
    }
    if !(64..=4096).contains(&quality.shadow_map_texels) {
        return refuse(format!(
            "quality.shadow_map_texels = {}: must be within 64..=4096",
            quality.shadow_map_texels
        ));
    }
    if !(1..=8).contains(&quality.pcf_taps) {
        return refuse(format!("quality.pcf_taps = {}: must be within 1..=8", quality.pcf_taps));
    }
    if ![1, 2, 4].contains(&quality.soft_step_px) {
        return refuse(format!("quality.soft_step_px = {}: must be 1, 2 or 4", quality.soft_step_px));
    }
    if ![1, 4].contains(&quality.coverage_samples) {
        return refuse(format!("quality.coverage_samples = {}: must be 1 or 4", quality.coverage_samples));
    }
    Ok(())
}
