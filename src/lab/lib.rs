//! The laboratory: what people measure with and the daemon never calls. Ground truth by ray tracing (`reference`), reference
//! cases (`case`), stills of scenes, cases and moments (`still`), what accuracy costs in time (`tradeoff`), the hard cases
//! (`stress`, `stress_report`), experiments of the papers (`papers`), `figures`, OpenEXR (`open_exr`).

use halflight_assets as assets;
use halflight_core::{animate, compose, hdr, light, model, nearfield, plan, sources, track, visibility};
use halflight_device as device;
use halflight_engine as engine;
use halflight_math as math;
use halflightd::{config, daemon, pipeline, present};

pub mod case;
pub mod digest;
pub mod error;
pub mod figures;
pub mod open_exr;
pub mod page;
pub mod papers;
pub mod reference;
pub mod still;
pub mod stress;
pub mod stress_report;
pub mod tradeoff;

/// Reads what the product reads, and OpenEXR and reference cases.
pub const READERS: assets::known_room::Readers =
    assets::known_room::Readers { radiance: open_exr::load_radiance, room: case::load_room };

/// Lends these readers to the wiring of the pipeline, and shows no progress.
pub const HOST: daemon::host::Host<'static> =
    daemon::host::Host { readers: READERS, progress: &daemon::host::Silent };
