//! Gives a scene its precomputed transfer, with a progress bar where somebody looks.

use super::cache_folder::cache_folder;
use crate::assets::transfer;
use crate::model::{
    quality::{Quality, SelfShadow},
    scene::Scene,
    transfer::ObjectTransfer,
};
use crate::visibility::transfer::DEFAULT_RAYS;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::Arc;

/// Bakes the transfer of what never moves, or takes it from the user's cache folder, where the quality asks for it.
pub fn bake(scene: &mut Scene, quality: &Quality) {
    if quality.self_shadow != SelfShadow::Transfer || scene.objects.is_empty() {
        return;
    }
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of the transfer, {eta} left") {
        bar.set_style(style);
    }
    let progress = |share: f32| bar.set_position((share * 100.0) as u64);
    let folder = cache_folder();
    let baked = transfer::of_scene(scene, quality.sh_order, DEFAULT_RAYS, folder.as_deref(), &progress);
    let numbers = |o: &ObjectTransfer| o.rows.len() + o.blocked.len();
    let bytes: usize = baked.objects.iter().flatten().map(numbers).sum::<usize>() * 2;
    scene.transfer = Some(Arc::new(baked));
    bar.finish_and_clear();
    if bytes > 0 {
        let (kib, seconds) = (bytes.div_ceil(1024), bar.elapsed().as_secs_f32());
        tracing::info!("transfer of what never moves: {kib} KiB, ready after {seconds:.2} s");
    }
}
