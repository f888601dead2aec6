//! Gives the bodies of a scene the spheres that stand for them, with a progress bar where somebody looks.

use super::cache_folder::cache_folder;
use crate::assets::spheres;
use crate::model::scene::Scene;
use indicatif::{ProgressBar, ProgressStyle};

/// Fits spheres to every figure that has none, or takes them from the user's cache folder.
pub fn fit(scene: &mut Scene) {
    if scene.figures.iter().all(|figure| !figure.spheres.is_empty()) {
        return;
    }
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of the blocker spheres, {eta} left")
    {
        bar.set_style(style);
    }
    let mut progress = |share: f32| bar.set_position((share * 100.0) as u64);
    spheres::fit_scene(scene, cache_folder().as_deref(), &mut progress);
    bar.finish_and_clear();
}
