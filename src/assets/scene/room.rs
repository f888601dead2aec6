//! `[room]`: the known room of a scene.

use super::{resolved, walk::Section};
use crate::model::light::MapLayout;
use crate::nearfield::{field::Preparation, prepare::RoomSettings};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// A known room, as the scene file names it.
#[derive(Clone, Debug, PartialEq)]
pub struct RoomSource {
    /// glTF, or a reference case (its folder or JSON file). Resolved.
    pub file: PathBuf,
    /// Where its radiance comes from.
    pub light: RoomLightSource,
    /// How it is prepared.
    pub settings: RoomSettings,
}

/// Where a room's radiance comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum RoomLightSource {
    /// What its surfaces emit.
    Given,
    /// An environment picture taken in it.
    Probe {
        /// Resolved path.
        file: PathBuf,
        /// How its texels cover the sphere.
        layout: MapLayout,
        /// Whether its up is +y (else +z).
        y_up: bool,
        /// Turned about the world's z axis, counter-clockwise seen from above.
        rotation_deg: f64,
        /// Where it was taken, metres.
        position_world: Vec3,
        /// Whether small strong lights become suns.
        factor_sun: bool,
        /// Rows that its picture is reduced to, about; `None`: as it is.
        rows: Option<usize>,
    },
}

/// Keys that speak of a probe.
const PROBE_KEYS: [&str; 7] =
    ["probe", "probe_position", "layout", "up", "rotation_deg", "sun", "probe_rows"];

/// `[room]`
pub fn room(section: &Section<'_>, folder: &Path) -> Option<RoomSource> {
    let file = section.need("file", "a text", |v| v.as_str().map(|name| resolved(folder, name)));
    let is_probe = section
        .read("light", "\"given\" or \"probe\"", |v| match v.as_str()? {
            "given" => Some(false),
            "probe" => Some(true),
            _ => None,
        })
        .unwrap_or(false);
    let probe = section.text("probe").map(|name| resolved(folder, name));
    let position = section.point("probe_position");
    let (layout, y_up, rotation_deg) = super::rig::map_keys(section);
    let factor_sun = section.switch("sun", true);
    let rows = section.read("probe_rows", "a whole number within 8..=16384", |v| {
        v.as_integer().filter(|rows| (8..=16384).contains(rows)).map(|rows| rows as usize)
    });
    let light = if is_probe {
        for key in ["probe", "probe_position"] {
            if !section.has(key) {
                section.refuse(key, "given: light is \"probe\"");
            }
        }
        probe.zip(position).map(|(file, position)| RoomLightSource::Probe {
            file,
            layout,
            y_up,
            rotation_deg,
            position_world: position.as_vec3(),
            factor_sun,
            rows,
        })
    } else {
        for key in PROBE_KEYS.into_iter().filter(|key| section.has(key)) {
            section.refuse(key, "left out where light is not \"probe\"");
        }
        Some(RoomLightSource::Given)
    };
    let patch_m = section.number("patch_m", 0.005, 10.0).map(|size| size as f32);
    let mut preparation = Preparation::default();
    let share = section.read("power_share", "a number above 0, at most 1", |v| {
        super::number(v).filter(|s| *s > 0.0 && *s <= 1.0)
    });
    preparation.power_share = share.map_or(preparation.power_share, |s| s as f32);
    let neglected = section.number("neglected_share", 0.0, 0.5);
    preparation.neglected = neglected.map_or(preparation.neglected, |s| s as f32);
    let side = section.read("rays", "the square of a whole number: 1, 4, 9, 16, 25, 36, 49 or 64", |v| {
        let rays = u32::try_from(v.as_integer()?).ok()?;
        (1..=8).find(|side| side * side == rays)
    });
    preparation.rays_side = side.unwrap_or(preparation.rays_side);
    section.finish();
    Some(RoomSource { file: file?, light: light?, settings: RoomSettings { patch_m, preparation } })
}
