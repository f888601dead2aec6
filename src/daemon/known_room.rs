//! Makes the known room of a scene ready, with a progress bar where somebody looks.

use super::cache_folder::cache_folder;
use crate::assets::{error::AssetError, known_room::make_ready_with, scene::SceneFile};
use crate::model::scene::Scene;
use crate::nearfield::prepare::KnownRoom;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::Arc;

/// The room that a scene file names, ready for an engine, with what the user's cache folder keeps of it; `scene` stands in it then. `None` where the file names none.
///
/// # Errors
/// As of [`make_ready_with`].
pub fn of_scene(file: &SceneFile, scene: &mut Scene) -> Result<Option<Arc<KnownRoom>>, AssetError> {
    let Some(source) = &file.room else { return Ok(None) };
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of the room, {eta} left") {
        bar.set_style(style);
    }
    let cache = cache_folder();
    let progress = |share: f32| bar.set_position((share * 100.0) as u64);
    let ready = make_ready_with(source, None, cache.as_deref(), &progress)?;
    bar.finish_and_clear();
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
        bar.elapsed().as_secs_f32(),
        if ready.from_cache { ", its light from the cache" } else { "" }
    );
    scene.room = Some(Arc::new(ready.known.room.clone()));
    Ok(Some(Arc::new(ready.known)))
}
