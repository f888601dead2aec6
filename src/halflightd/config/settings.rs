//! Settings as meant.

use crate::device::bracket::plan::Mains;
use crate::model::{picture::PictureView, quality::Quality};

/// All settings of the daemon. Built by `resolve`; every field lies within the range that `keys` states.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// `device.camera`
    pub camera: String,
    /// `device.mode`
    pub mode: RunMode,
    /// `device.frames`; 0 = until the source ends.
    pub frames: u64,
    /// `device.display`; empty = none.
    pub display: String,
    /// `device.see_through`
    pub is_see_through: bool,
    /// `device.imu`; empty = the camera's own, where it has one.
    pub imu: String,
    /// `device.imu_file`; empty = none.
    pub imu_file: String,
    /// `device.rig`; empty = none.
    pub rig: String,
    /// `device.link`; empty = none.
    pub link: String,
    /// `camera.exposures_s`
    pub exposures_s: Vec<f64>,
    /// `camera.gain`
    pub gain: f64,
    /// `camera.replan`
    pub replan: bool,
    /// `camera.mains`
    pub mains: Option<Mains>,
    /// `camera.response`
    pub response: String,
    /// `camera.calibration`; empty = what the camera states.
    pub calibration: String,
    /// `engine.kind`
    pub engine: EngineKind,
    /// `engine.backend`
    pub backend: BackendKind,
    /// `engine.threads`; 0 = one for each core.
    pub threads: usize,
    /// `engine.cpu_kernels`
    pub cpu_kernels: Vec<String>,
    /// `track.decimate`
    pub decimate: u32,
    /// `track.quad_sigma_px`
    pub quad_sigma_px: f64,
    /// `track.search_ahead`
    pub search_ahead: bool,
    /// `light.threshold`
    pub light_threshold: f64,
    /// `light.gray`
    pub gray: GrayWeights,
    /// `light.filter_tau_s`
    pub filter_tau_s: f64,
    /// `light.ball_on_surface`
    pub ball_on_surface: bool,
    /// `present.exposure_s`; 0 = the best exposed one of the cycle.
    pub shown_exposure_s: f64,
    /// `present.view`
    pub view: PictureView,
    /// `present.hud`
    pub hud: bool,
    /// `scene.file`; empty = no virtual objects.
    pub scene_file: String,
    /// `output.pictures`; empty = none.
    pub pictures_folder: String,
    /// `cache.max_mib`
    pub cache_max_mib: u64,
    /// `quality.preset`; what it sets is in `quality` already.
    pub preset: String,
    /// `quality.front`
    pub front: String,
    /// `quality.budget_ms`
    pub budget_ms: Option<f64>,
    /// `quality.target_fps`
    pub target_fps: Option<f64>,
    /// `quality.max_error`
    pub max_error: Option<f64>,
    /// The other keys of `quality.*`, `light.order`, `light.split`, `light.lights` and `light.dering`.
    pub quality: Quality,
}

/// How frames are fed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunMode {
    /// Every frame, one after the other, time from the frames.
    Lockstep,
    /// As time passes; the newest frame wins.
    Realtime,
}

/// Which engine computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineKind {
    /// The CPU twins.
    Cpu,
    /// wgpu.
    Gpu,
}

/// Which GPU interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BackendKind {
    /// Vulkan, else GL.
    Auto,
    /// The first choice where there is a driver.
    Vulkan,
    /// OpenGL (ES) 3.1 or later.
    Gl,
}

/// Weights from RGB to gray for the light's direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrayWeights {
    /// 0.3, 0.59, 0.11: Eq. 10 of [Now11].
    Rec601,
    /// 0.2126, 0.7152, 0.0722.
    Rec709,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            camera: "auto".into(),
            mode: RunMode::Realtime,
            frames: 0,
            display: String::new(),
            is_see_through: false,
            imu: String::new(),
            imu_file: String::new(),
            rig: String::new(),
            link: String::new(),
            exposures_s: vec![0.000_25, 0.002, 0.016],
            gain: 1.0,
            replan: true,
            mains: None,
            response: "device".into(),
            calibration: String::new(),
            engine: EngineKind::Cpu,
            backend: BackendKind::Auto,
            threads: 0,
            cpu_kernels: Vec::new(),
            decimate: 2,
            quad_sigma_px: 0.8,
            search_ahead: true,
            light_threshold: 1e-3,
            gray: GrayWeights::Rec601,
            filter_tau_s: 0.2,
            ball_on_surface: true,
            shown_exposure_s: 0.0,
            view: PictureView::Final,
            hud: false,
            scene_file: String::new(),
            pictures_folder: String::new(),
            cache_max_mib: 2048,
            preset: "none".into(),
            front: "bundled".into(),
            budget_ms: None,
            target_fps: None,
            max_error: None,
            quality: Quality::default(),
        }
    }
}
