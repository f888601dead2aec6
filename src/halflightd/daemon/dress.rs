//! Gives the bodies of a scene what they carry with them: the spheres that stand for them, and their transfer. That takes
//! seconds where the cache folder does not hold it, so it is never done on the frame's path.

use super::{blocker_spheres, host::Progress, vertex_transfer};
use crate::model::{quality::Quality, scene::Scene};

/// Keys that change what bodies carry with them.
const KEYS_OF_BODIES: [&str; 3] = ["light.order", "quality.self_shadow", "quality.spheres"];

/// Whether bodies must be dressed anew after a change of this key.
pub fn depends_on(key: &str) -> bool {
    KEYS_OF_BODIES.contains(&key)
}

/// Gives bodies what they lack.
pub fn dress(scene: &mut Scene, quality: &Quality, progress: &dyn Progress) {
    blocker_spheres::fit(scene, quality.spheres, progress);
    vertex_transfer::bake(scene, quality, progress);
}

/// The same scene, its bodies dressed for other settings.
pub fn dressed_anew(scene: &Scene, quality: &Quality, progress: &dyn Progress) -> Scene {
    let mut scene = scene.clone();
    for figure in &mut scene.figures {
        figure.spheres.clear();
    }
    scene.transfer = None;
    dress(&mut scene, quality, progress);
    scene
}
