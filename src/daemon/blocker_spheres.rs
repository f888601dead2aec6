//! Gives the bodies of a scene the spheres that stand for them, with a progress bar where somebody looks.

use super::cache_folder::cache_folder;
use crate::assets::spheres;
use crate::model::scene::Scene;
use indicatif::{ProgressBar, ProgressStyle};

/// Fits `count` spheres (0: as many as it asks for) to every figure that has none, or takes them from the user's
/// cache folder.
pub fn fit(scene: &mut Scene, count: usize) {
    if scene.figures.iter().all(|figure| !figure.spheres.is_empty()) {
        return;
    }
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of the blocker spheres, {eta} left")
    {
        bar.set_style(style);
    }
    let mut progress = |share: f32| bar.set_position((share * 100.0) as u64);
    let asked: Vec<usize> = scene.figures.iter().map(|figure| figure.sphere_count).collect();
    if count > 0 {
        scene.figures.iter_mut().for_each(|figure| figure.sphere_count = count.clamp(4, 64));
    }
    spheres::fit_scene(scene, cache_folder().as_deref(), &mut progress);
    for (figure, asked) in scene.figures.iter_mut().zip(asked) {
        figure.sphere_count = asked;
    }
    bar.finish_and_clear();
}
