//! From a room and its light to a room that is known. Each step takes the values of the steps before it and gives one:
//!
//! `map_probe` -> patches, suns | `Ends::of` -> sources, receivers | `Sent::find` -> what arrives where |
//! `NearField::of` -> hierarchies | `IrradianceVolume::build` -> the light everywhere | `measure_reflectance`
//!
//! [`prepare_kept`] is the only place that knows their order; what is kept from run to run passes through its keeper.

use super::{
    error::RoomError,
    faces::Faces,
    field::{NearField, Preparation},
    irradiance::{IrradianceVolume, VolumeInput, VolumeSettings},
    patches::{MAX_PATCHES, Subdivision, subdivide},
    probe::{MappedInput, Probe, ProbeReport, map_probe},
    reflectance::{ReflectanceReport, measure_reflectance},
    sent::{Ends, Sent, SentInput},
    suns::sun_at_vertices,
};
use crate::{
    math::{lens::Lens, pose::Pose},
    model::{
        image::RadianceImage,
        keep::{Keeper, KeepsNothing},
        room::{Face, Room, RoomSun},
    },
};
use glam::Vec3;

/// Smallest and largest patch that may be asked for, metres.
pub const PATCH_SIZES_M: (f32, f32) = (0.005, 10.0);
/// Shares of the progress at whose end the light is mapped, sent light known, the hierarchies built.
const MAPPED_BY: f32 = 0.3;
const SENT_BY: f32 = 0.7;
const FIELD_BY: f32 = 0.8;

/// How a room is prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomSettings {
    /// Mean size of a patch, metres, within [`PATCH_SIZES_M`]: the room gets its area over the square of this many
    /// patches, at most 20,000. `None`: 1500 patches whatever its size.
    pub patch_m: Option<f32>,
    /// What is spent on transfers and shafts.
    pub preparation: Preparation,
}

impl Default for RoomSettings {
    /// 1500 patches, and `Preparation`'s own.
    fn default() -> Self {
        Self { patch_m: None, preparation: Preparation::default() }
    }
}

/// Where a room's radiance comes from.
#[derive(Clone, Copy, Debug)]
pub enum RoomLight<'a> {
    /// From the room itself: what its surfaces emit, and nothing else.
    Given,
    /// Measured by a probe: an HDR picture of the whole sphere, taken at a known place in the room.
    Probe(Probe<'a>),
}

/// A linear picture of the room without virtual objects.
#[derive(Clone, Copy, Debug)]
pub struct CameraPicture<'a> {
    /// Radiance, of the lens's size.
    pub radiance: &'a RadianceImage,
    /// Lens of the camera that took it.
    pub lens: Lens,
    /// Where it was taken from.
    pub world_from_camera: Pose,
}

/// A room made ready for shadows.
pub struct KnownRoom {
    /// The room as it was given.
    pub room: Room,
    /// Patches, sources, transfers and shafts.
    pub field: NearField,
    /// The room's light everywhere in it, but for the suns.
    pub volume: IrradianceVolume,
    /// Suns that shine in; their light is in no patch.
    pub suns: Vec<RoomSun>,
    /// What the suns give each vertex, like `NearField::gathered_rgb`: times the diffuse reflectance it is the radiance that
    /// leaves there.
    pub sun_rgb: Vec<[f32; 3]>,
    /// For each patch whether its reflectance was measured by the camera; else it is its surface's.
    pub reflectance_measured: Vec<bool>,
    /// Its area, patches, and what became of measured light.
    pub report: RoomReport,
}

impl std::fmt::Debug for KnownRoom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KnownRoom")
            .field("suns", &self.suns)
            .field("report", &self.report)
            .finish_non_exhaustive()
    }
}

/// What was done to make a room ready; `NearField::report` has the rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomReport {
    /// Area of all faces, square metres.
    pub area_m2: f32,
    /// Patches that the settings ask for.
    pub patches_wanted: usize,
    /// What became of the probe's light; `None` where light is given.
    pub probe: Option<ProbeReport>,
    /// What the camera's picture gave; `None` where there is none.
    pub reflectance: Option<ReflectanceReport>,
}

/// Makes a room ready, and keeps nothing; all else as [`prepare_kept`].
///
/// # Errors
/// As [`prepare_kept`].
pub fn prepare(
    room: Room,
    how: &RoomSettings,
    light: RoomLight<'_>,
    camera: Option<&CameraPicture<'_>>,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<KnownRoom, RoomError> {
    prepare_kept(room, how, light, camera, &KeepsNothing, progress)
}

/// Makes a room ready: its light mapped onto patches, what those send one another, the light everywhere. `keeper` is asked for
/// each of the three before it is computed. `progress` is told the share done, 0 to 1, from several threads, in no strict
/// order. The result does not depend on the number of threads, nor on what was kept.
///
/// # Errors
/// A setting out of range; no face that has an area; no patch with a radiance above zero; none that reflects; a probe
/// that is not in the room, or whose picture has the wrong shape; a camera's picture that is not of its lens's size.
pub fn prepare_kept(
    room: Room,
    how: &RoomSettings,
    light: RoomLight<'_>,
    camera: Option<&CameraPicture<'_>>,
    keeper: &impl Keeper,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<KnownRoom, RoomError> {
    let area_m2 = area_m2(&room);
    let subdivision = Subdivision { patches: patch_count(how, area_m2)?, ..Subdivision::default() };
    let (patches, suns, probe) = match light {
        RoomLight::Given => (subdivide(&room, &subdivision, &|_| None)?, Vec::new(), None),
        RoomLight::Probe(probe) => {
            let input = MappedInput { room: &room, subdivision: &subdivision, probe: &probe };
            let begun = |share: f32| progress(MAPPED_BY * share);
            let mapped = keeper.keep(&input, || map_probe(&room, &subdivision, &probe, &begun))?;
            (mapped.patches, mapped.suns, Some(mapped.report))
        }
    };
    progress(MAPPED_BY);
    let ends = Ends::of(&patches, &how.preparation)?;
    let input = SentInput { room: &room, patches: &patches, ends: &ends, how: &how.preparation };
    let begun = |share: f32| progress(MAPPED_BY + (SENT_BY - MAPPED_BY) * share);
    let sent = keeper.keep(&input, || Ok(Sent::find(&input, &begun)))?;
    progress(SENT_BY);
    let begun = |share: f32| progress(SENT_BY + (FIELD_BY - SENT_BY) * share);
    let field = NearField::of(patches, ends, sent, &how.preparation, &begun);
    let input = VolumeInput { room: &room, field: &field, how: &VolumeSettings::default() };
    let begun = |share: f32| progress(FIELD_BY + (1.0 - FIELD_BY) * share);
    let volume = keeper.keep(&input, || Ok(IrradianceVolume::build(&room, &field, input.how, &begun)))?;
    let sun_rgb = sun_at_vertices(&suns, &Faces::of_room(&room), &field.patches);
    let reflectance_measured = vec![false; field.patches.patches.len()];
    let report = RoomReport { area_m2, patches_wanted: subdivision.patches, probe, reflectance: None };
    let mut known = KnownRoom { room, field, volume, suns, sun_rgb, reflectance_measured, report };
    if let Some(camera) = camera {
        known.report.reflectance = Some(measure_reflectance(&mut known, camera)?);
    }
    progress(1.0);
    Ok(known)
}

fn patch_count(how: &RoomSettings, area_m2: f32) -> Result<usize, RoomError> {
    let Some(patch_m) = how.patch_m else { return Ok(Subdivision::default().patches) };
    if !(PATCH_SIZES_M.0..=PATCH_SIZES_M.1).contains(&patch_m) {
        let (value, allowed) = (patch_m.to_string(), "within 0.005 to 10 m");
        return Err(RoomError::Setting { setting: "patch_m", value, allowed });
    }
    Ok(((area_m2 / (patch_m * patch_m)).round() as usize).clamp(1, MAX_PATCHES))
}

/// Of all faces that are finite.
fn area_m2(room: &Room) -> f32 {
    let of_face = |corners: &[Vec3], face: &Face| {
        let at = |i: u32| corners.get(i as usize).copied();
        let list = face.corners();
        let triangles =
            (1..list.len() - 1).filter_map(|k| Some([at(list[0])?, at(list[k])?, at(list[k + 1])?]));
        triangles.map(|[a, b, c]| 0.5 * f64::from((b - a).cross(c - a).length())).sum::<f64>()
    };
    let areas = room.surfaces.iter().flat_map(|s| s.faces.iter().map(|f| of_face(&s.corners_world, f)));
    areas.filter(|a| a.is_finite()).sum::<f64>() as f32
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    fn given(how: &RoomSettings) -> Result<KnownRoom, RoomError> {
        prepare(fixture::room(), how, RoomLight::Given, None, &|_| ())
    }

    #[test]
    fn patches_are_as_large_as_asked_for() {
        // Walls of 59 m2, a table of 2 m2 and a lamp.
        let known = given(&RoomSettings { patch_m: Some(0.3), ..RoomSettings::default() }).unwrap();
        assert!((known.report.area_m2 - 61.44).abs() < 0.01, "{}", known.report.area_m2);
        assert_eq!(known.report.patches_wanted, 683);
        assert_eq!(known.field.patches.patches.len(), 683);
        assert!(known.suns.is_empty() && known.report.probe.is_none());
        assert!(known.sun_rgb.iter().flatten().all(|c| *c == 0.0));
    }

    #[test]
    fn a_size_out_of_range_is_refused() {
        for patch_m in [0.0, -1.0, 11.0, f32::NAN] {
            let error =
                given(&RoomSettings { patch_m: Some(patch_m), ..RoomSettings::default() }).err().unwrap();
            assert!(error.to_string().starts_with("room.patch_m = "), "{error}");
        }
    }
}
