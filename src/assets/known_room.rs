//! A scene file's room, loaded and made ready.

use super::{
    error::AssetError,
    kept::Cache,
    pictures::{self, LoadedRadiance},
    room::{LoadedRoom, load_room},
    scene::{RoomLightSource, RoomSource},
};
use crate::{
    light::maps::MapAxes,
    model::{
        image::RadianceImage,
        light::{EnvironmentMap, MapLayout},
    },
    nearfield::{
        error::RoomError,
        prepare::{CameraPicture, KnownRoom, RoomLight, prepare_kept},
        probe::Probe,
        soundness::Soundness,
    },
};
use std::path::Path;

/// Share of the probe's light lost from which on it is said.
const MUCH_LOST: f32 = 0.02;

/// How files become radiance and rooms. A program that reads more formats puts its own functions here.
#[derive(Clone, Copy, Debug)]
pub struct Readers {
    /// Reads a picture of linear radiance.
    pub radiance: fn(&Path) -> Result<LoadedRadiance, AssetError>,
    /// Reads a room's geometry.
    pub room: fn(&Path) -> Result<LoadedRoom, AssetError>,
}

impl Default for Readers {
    fn default() -> Self {
        Self { radiance: pictures::load_radiance, room: load_room }
    }
}

/// A room made ready, and what is wrong with its file.
pub struct ReadyRoom {
    /// Patches, transfers, hierarchies, light.
    pub known: KnownRoom,
    /// What was looked at in its geometry.
    pub soundness: Soundness,
    /// What is wrong with it, a sentence each.
    pub notes: Vec<String>,
    /// Whether all that rays find came from the cache.
    pub from_cache: bool,
}

/// A picture of about so many rows, each texel the mean of a whole number of texels a side, such that its width and its faces
/// are divided evenly; as it is where nothing does.
fn reduced(picture: RadianceImage, layout: MapLayout, rows: Option<usize>) -> RadianceImage {
    let (width, height) = (picture.width(), picture.height());
    let face_rows = if layout == MapLayout::Cube { height / 6 } else { height };
    let most = rows.map_or(1, |rows| height / rows.max(1));
    let fits = |step: &usize| width.is_multiple_of(*step) && face_rows.is_multiple_of(*step);
    let Some(step) = (2..=most).rev().find(fits) else { return picture };
    let mut out = RadianceImage::filled(width / step, height / step, [0.0; 3]);
    let share = 1.0 / (step * step) as f32;
    for y in 0..height / step * step {
        for (x, texel) in picture.row(y).iter().enumerate() {
            let sum = out.at_mut(x / step, y / step);
            sum.iter_mut().zip(texel).for_each(|(s, t)| *s += share * t);
        }
    }
    out
}

/// Loads a room and its probe's picture and prepares it (`nearfield::prepare`). `camera`: a linear picture of the room without
/// virtual objects, from which reflectance is measured. `progress` is told the share done, 0 to 1, from several threads.
///
/// # Errors
/// A file cannot be read or is damaged; what `prepare` refuses, with the room's file named.
pub fn make_ready(
    source: &RoomSource,
    camera: Option<&CameraPicture<'_>>,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<ReadyRoom, AssetError> {
    make_ready_with(source, camera, None, Readers::default(), progress)
}

/// `make_ready`, with a folder in which what takes long is kept from run to run: a probe that was mapped onto its room, what
/// sources send, and the light everywhere.
///
/// # Errors
/// As `make_ready`.
pub fn make_ready_with(
    source: &RoomSource,
    camera: Option<&CameraPicture<'_>>,
    cache: Option<&Path>,
    readers: Readers,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<ReadyRoom, AssetError> {
    let LoadedRoom { room, soundness, mut notes } = (readers.room)(&source.file)?;
    let map = probe_picture(&source.light, readers)?;
    let light = match (&source.light, &map) {
        (
            RoomLightSource::Probe { layout, y_up, rotation_deg, position_world, factor_sun, .. },
            Some(map),
        ) => RoomLight::Probe(Probe {
            map,
            world_from_map: MapAxes::of_up(*y_up, *layout).world_from_map(rotation_deg.to_radians()),
            position_world: *position_world,
            factor_sun: *factor_sun,
        }),
        _ => RoomLight::Given,
    };
    let keeper = Cache::new(cache);
    let known = prepare_kept(room, &source.settings, light, camera, &keeper, progress)
        .map_err(|error| refused(source, error))?;
    notes.extend(lost_light(&known));
    let from_cache = cache.is_some() && keeper.computed() == 0;
    Ok(ReadyRoom { known, soundness, notes, from_cache })
}

/// The picture that a room's probe took; `None` where its light is given.
fn probe_picture(light: &RoomLightSource, readers: Readers) -> Result<Option<EnvironmentMap>, AssetError> {
    let RoomLightSource::Probe { file, layout, rows, .. } = light else { return Ok(None) };
    let radiance = reduced((readers.radiance)(file)?.hdr.radiance, *layout, *rows);
    Ok(Some(EnvironmentMap { layout: *layout, radiance }))
}

/// Names the file that is to blame.
fn refused(source: &RoomSource, error: RoomError) -> AssetError {
    let file = match (&error, &source.light) {
        (RoomError::ProbePicture { .. }, RoomLightSource::Probe { file, .. }) => file,
        _ => &source.file,
    };
    AssetError::new(file, "known room").cause(error)
}

/// What is said where much of the probe's light met no front of a face.
fn lost_light(known: &KnownRoom) -> Option<String> {
    let probe = known.report.probe.as_ref().filter(|probe| probe.backs + probe.nothing > MUCH_LOST)?;
    Some(format!(
        "the probe sees {:.1} % of all directions on backs of faces and {:.1} % beyond the room: that light is lost",
        100.0 * probe.backs,
        100.0 * probe.nothing
    ))
}

#[cfg(test)]
mod tests;
