//! A scene file's room, loaded and made ready.

use super::{
    error::AssetError,
    kept_room, mapped_probe,
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
        prepare::{CameraPicture, KnownRoom, LitRoom, RoomLight, subdivision},
        probe::Probe,
        soundness::Soundness,
    },
};
use std::path::Path;

/// Share of the progress that mapping a probe takes.
const PROBE_SHARE: f32 = 0.5;

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
    /// The room.
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

/// `make_ready`, with a folder in which what takes long is kept from run to run under a hash of all that goes in: a probe that
/// was mapped onto its room (`mapped_probe`), what sources send, and the light everywhere (`kept_room`).
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
    let refused = |error: RoomError| {
        let file = match (&error, &source.light) {
            (RoomError::ProbePicture { .. }, RoomLightSource::Probe { file, .. }) => file,
            _ => &source.file,
        };
        AssetError::new(file, "known room").cause(error)
    };
    let mapped;
    let (light, share) = match &source.light {
        RoomLightSource::Given => (RoomLight::Given, 0.0),
        RoomLightSource::Probe { file, layout, y_up, rotation_deg, position_world, factor_sun, rows } => {
            let radiance = reduced((readers.radiance)(file)?.hdr.radiance, *layout, *rows);
            let map = EnvironmentMap { layout: *layout, radiance };
            let probe = Probe {
                map: &map,
                world_from_map: MapAxes::of_up(*y_up, *layout).world_from_map(rotation_deg.to_radians()),
                position_world: *position_world,
                factor_sun: *factor_sun,
            };
            let how = subdivision(&room, &source.settings).map_err(refused)?;
            let begun = |share: f32| progress(PROBE_SHARE * share);
            mapped = mapped_probe::of_room(&room, &how, &probe, cache, &begun).map_err(refused)?;
            (RoomLight::Mapped(&mapped), PROBE_SHARE)
        }
    };
    let rest = |done: f32| progress(share + (1.0 - share) * done);
    let lit = LitRoom::new(room, &source.settings, light, &|_| ()).map_err(refused)?;
    let (known, from_cache) =
        kept_room::ready(lit, &source.settings, camera, cache, &rest).map_err(refused)?;
    if let Some(probe) = &known.report.probe
        && probe.backs + probe.nothing > 0.02
    {
        notes.push(format!(
            "the probe sees {:.1} % of all directions on backs of faces and {:.1} % beyond the room: that light is lost",
            100.0 * probe.backs,
            100.0 * probe.nothing
        ));
    }
    Ok(ReadyRoom { known, soundness, notes, from_cache })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_probe_keeps_its_mean_and_its_faces() {
        let pixels = (0..24 * 12).map(|i| [i as f32, 1.0, 0.0]).collect();
        let picture = RadianceImage::from_pixels(24, 12, pixels).unwrap();
        let size = |layout, rows| {
            let small = reduced(picture.clone(), layout, rows);
            let mean =
                small.pixels().iter().map(|p| f64::from(p[0])).sum::<f64>() / small.pixels().len() as f64;
            assert!((mean - 143.5).abs() < 1e-3, "{mean}");
            (small.width(), small.height())
        };
        assert_eq!(size(MapLayout::Equirect, None), (24, 12));
        assert_eq!(size(MapLayout::Equirect, Some(100)), (24, 12));
        assert_eq!(size(MapLayout::Equirect, Some(3)), (6, 3));
        // 12 / 5 = 2 texels a side; faces of a cube are 2 rows high and cannot be reduced further.
        assert_eq!(size(MapLayout::Equirect, Some(5)), (12, 6));
        assert_eq!(size(MapLayout::Cube, Some(1)), (12, 6));
    }
}
