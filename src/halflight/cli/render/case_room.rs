//! Cases of a known room: flat emitters near their receivers, and nothing else that shines.

use crate::assets::case::{Case, Emitter, EmitterKind, Role, Shape};
use crate::cli::CliError;
use crate::model::scene::Scene;
use crate::nearfield::{
    field::Preparation,
    prepare::{KnownRoom, RoomLight, RoomSettings, prepare as prepare_room},
};
use std::sync::Arc;

/// The room of a case, where all its emitters are quadrilaterals; the scene then stands in it, and what the room has of the
/// real surfaces is taken out of them.
///
/// # Errors
/// A room that cannot be prepared.
pub fn prepare(
    case: &Case,
    emitters: &[&Emitter],
    scene: &mut Scene,
) -> Result<Option<Arc<KnownRoom>>, CliError> {
    let is_room = !emitters.is_empty() && emitters.iter().all(|e| matches!(e.kind, EmitterKind::Quad { .. }));
    if !is_room {
        return Ok(None);
    }
    // Truth has all the light: nothing is left out for speed.
    let preparation = Preparation { power_share: 1.0, ..Preparation::default() };
    let how = RoomSettings { preparation, ..RoomSettings::default() };
    let known = prepare_room(case.room(), &how, RoomLight::Given, None, &|_| ())
        .map_err(|e| CliError::on(case.file.display(), e))?;
    let in_room = |name: &str| {
        case.geometry.iter().any(|g| {
            g.role == Role::Receiver
                && g.name == name
                && matches!(g.shape, Shape::PlaneZ0 { .. } | Shape::Quad { .. } | Shape::Box { .. })
        })
    };
    scene.surfaces.retain(|surface| !in_room(&surface.name));
    scene.room = Some(Arc::new(known.room.clone()));
    Ok(Some(Arc::new(known)))
}
