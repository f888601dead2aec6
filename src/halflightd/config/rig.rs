//! What a rig file says, over the settings that leave it to the devices.

use super::Settings;
use super::file;
use crate::assets::rig;
use crate::device::imu::description::ImuDescription;
use crate::model::path_text;

/// Takes over from the file that `device.rig` names what the settings themselves leave open.
///
/// # Errors
/// The file cannot be read or is no rig, with its name.
pub fn over_settings(mut settings: Settings) -> Result<Settings, String> {
    if settings.rig.is_empty() {
        return Ok(settings);
    }
    let path = path_text::to_path(&settings.rig);
    let text = file::text(&path)?;
    let read = rig::parse(&path, &text).map_err(|e| e.to_string())?;
    let described = ImuDescription::from_toml(&text).map_err(|e| format!("{}: {e}", settings.rig))?;
    let usual = Settings::default();
    if let Some(name) = read.camera.name.filter(|_| settings.camera == usual.camera) {
        settings.camera = name;
    }
    if let Some(file) = read.camera.response.filter(|_| settings.response == usual.response) {
        settings.response = path_text::to_text(&file);
    }
    if let Some(file) = read.camera.calibration.filter(|_| settings.calibration.is_empty()) {
        settings.calibration = path_text::to_text(&file);
    }
    if let Some(described) = described {
        if settings.imu_file.is_empty() {
            settings.imu_file.clone_from(&settings.rig);
        }
        if let Some(name) = described.name.filter(|_| settings.imu.is_empty()) {
            settings.imu = name;
        }
    }
    Ok(settings)
}
