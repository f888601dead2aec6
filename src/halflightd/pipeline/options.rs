//! The settings of a running pipeline, and how they change.

use crate::model::{frame::Exposure, picture::PictureView, quality::Quality, scene::Scene};
use crate::plan::governor::Governor;
use std::sync::Arc;

/// What the settings mean for the pipeline.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Accuracy settings of every frame.
    pub quality: Quality,
    /// Anisotropy below which no direction dominates.
    pub light_threshold: f32,
    /// Gray by Rec. 709 weights in place of 0.3, 0.59, 0.11.
    pub rec709: bool,
    /// Time constant of the light's filter, seconds; 0 = none.
    pub filter_tau_s: f64,
    /// Whether the ball stands on the surface z = 0.
    pub ball_on_surface: bool,
    /// The longest exposure that the camera goes through.
    pub longest_exposure: Exposure,
    /// Different exposures that the camera goes through.
    pub exposures_in_cycle: usize,
    /// Exposure of the shown picture; `None`: the one of the cycle that exposes the place best.
    pub shown_exposure: Option<Exposure>,
    /// What is shown of a frame.
    pub view: PictureView,
    /// Whether text is laid over the picture.
    pub hud: bool,
    /// Tags are searched in a picture reduced by this.
    pub decimate: f32,
    /// Blur before tags are searched, pixels.
    pub quad_sigma_px: f32,
}

impl Default for Options {
    /// One exposure of 1/60 s, and usual settings.
    fn default() -> Self {
        Self {
            quality: Quality::default(),
            light_threshold: 1e-3,
            rec709: false,
            filter_tau_s: 0.2,
            ball_on_surface: true,
            longest_exposure: Exposure { time_s: 1.0 / 60.0, gain: 1.0 },
            exposures_in_cycle: 1,
            shown_exposure: None,
            view: PictureView::Final,
            hud: false,
            decimate: 2.0,
            quad_sigma_px: 0.8,
        }
    }
}

/// Settings that have changed while the pipeline runs, with everything that they need made ready.
#[derive(Clone, Debug)]
pub struct Change {
    /// All of them; those of the tracker and of the exposures are not looked at.
    pub options: Options,
    /// The same scene, whose bodies carry with them (spheres, transfer) what the settings ask for; `None`: that has not
    /// changed.
    pub scene: Option<Arc<Scene>>,
    /// The governor from now on.
    pub governor: GovernorChange,
}

/// What becomes of the governor.
#[derive(Clone, Debug, Default)]
pub enum GovernorChange {
    /// It stays.
    #[default]
    Keep,
    /// This one takes its place.
    Replace(Box<Governor>),
    /// The settings govern themselves.
    Remove,
}

impl Change {
    /// Other settings that ask for nothing else.
    pub fn of(options: Options) -> Self {
        Self { options, scene: None, governor: GovernorChange::Keep }
    }

    /// This change after an earlier one that has not been taken yet.
    pub(super) fn after(mut self, earlier: Self) -> Self {
        self.scene = self.scene.or(earlier.scene);
        if matches!(self.governor, GovernorChange::Keep) {
            self.governor = earlier.governor;
        }
        self
    }
}
