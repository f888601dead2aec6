//! Makes the known room of a scene ready, showing progress where somebody looks.

use super::{
    cache_folder::{self, cache_folder},
    host::Host,
};
use crate::assets::{error::AssetError, known_room::make_ready_with, scene::SceneFile};
use crate::model::scene::Scene;
use crate::nearfield::prepare::KnownRoom;
use std::{sync::Arc, time::Instant};

/// The room that a scene file names, ready for an engine, with what the user's cache folder keeps of it; `scene` stands in it then. `None` where the file names none.
///
/// # Errors
/// As of [`make_ready_with`].
pub fn of_scene(
    file: &SceneFile,
    scene: &mut Scene,
    host: &Host<'_>,
) -> Result<Option<Arc<KnownRoom>>, AssetError> {
    let Some(source) = &file.room else { return Ok(None) };
    let (begun, task) = (Instant::now(), host.progress.begin("the room"));
    let cache = cache_folder();
    let progress = |share: f32| task.reach(share);
    let ready = make_ready_with(source, None, cache.as_deref(), host.readers, &progress)?;
    drop(task);
    cache_folder::tidy();
    for note in &ready.notes {
        tracing::warn!("{}: {note}", source.file.display());
    }
    let report = ready.known.field.report();
    tracing::info!(
        "known room: {} patches, {} sources with {:.0} % of the power, {} suns, ready after {:.2} s{}",
        report.patches,
        report.sources,
        100.0 * report.power_share,
        ready.known.suns.len(),
        begun.elapsed().as_secs_f32(),
        if ready.from_cache { ", its light from the cache" } else { "" }
    );
    scene.room = Some(Arc::new(ready.known.room.clone()));
    Ok(Some(Arc::new(ready.known)))
}
