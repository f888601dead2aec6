//! The laboratory: what people measure with and the daemon never calls. Ground truth by ray tracing (`reference`), the
//! hard cases (`stress`), reference cases (`case`), OpenEXR (`open_exr`).

use halflight_assets as assets;
use halflight_core::{animate, hdr, light, model, nearfield, plan, track, visibility};
use halflight_engine as engine;
use halflight_math as math;

pub mod case;
pub mod open_exr;
pub mod reference;
pub mod stress;

/// Reads what the product reads, and OpenEXR and reference cases.
pub const READERS: assets::known_room::Readers =
    assets::known_room::Readers { radiance: open_exr::load_radiance, room: case::load_room };
