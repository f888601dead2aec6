//! Gives the bodies of a scene the spheres that stand for them, showing progress where somebody looks.

use super::{
    cache_folder::{self, cache_folder},
    host::Progress,
};
use crate::assets::spheres;
use crate::model::scene::Scene;

/// Fits `count` spheres (0: as many as it asks for) to every figure that has none, or takes them from the user's
/// cache folder.
pub fn fit(scene: &mut Scene, count: usize, progress: &dyn Progress) {
    if scene.figures.iter().all(|figure| !figure.spheres.is_empty()) {
        return;
    }
    let task = progress.begin("the blocker spheres");
    let mut progress = |share: f32| task.reach(share);
    let asked: Vec<usize> = scene.figures.iter().map(|figure| figure.sphere_count).collect();
    if count > 0 {
        scene.figures.iter_mut().for_each(|figure| figure.sphere_count = count.clamp(4, 64));
    }
    spheres::fit_scene(scene, cache_folder().as_deref(), &mut progress);
    cache_folder::tidy();
    for (figure, asked) in scene.figures.iter_mut().zip(asked) {
        figure.sphere_count = asked;
    }
}
