//! Gives a scene its precomputed transfer, showing progress where somebody looks.

use super::{
    cache_folder::{self, cache_folder},
    host::Progress,
};
use crate::assets::transfer;
use crate::model::{
    quality::{Quality, SelfShadow},
    scene::Scene,
    transfer::ObjectTransfer,
};
use crate::visibility::transfer::DEFAULT_RAYS;
use std::{sync::Arc, time::Instant};

/// Bakes the transfer of what never moves, or takes it from the user's cache folder, where the quality asks for it.
pub fn bake(scene: &mut Scene, quality: &Quality, progress: &dyn Progress) {
    if quality.self_shadow != SelfShadow::Transfer || scene.objects.is_empty() {
        return;
    }
    let (begun, task) = (Instant::now(), progress.begin("the transfer"));
    let progress = |share: f32| task.reach(share);
    let folder = cache_folder();
    let baked = transfer::of_scene(scene, quality.sh_order, DEFAULT_RAYS, folder.as_deref(), &progress);
    cache_folder::tidy();
    let numbers = |o: &ObjectTransfer| o.rows.len() + o.blocked.len();
    let bytes: usize = baked.objects.iter().flatten().map(numbers).sum::<usize>() * 2;
    scene.transfer = Some(Arc::new(baked));
    if bytes > 0 {
        let (kib, seconds) = (bytes.div_ceil(1024), begun.elapsed().as_secs_f32());
        tracing::info!("transfer of what never moves: {kib} KiB, ready after {seconds:.2} s");
    }
}
