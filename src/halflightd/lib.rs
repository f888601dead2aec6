//! Layers 4 and 5: the order of the stages, the settings, and the wiring of the daemon.

use halflight_assets as assets;
use halflight_core::{animate, compose, hdr, light, model, nearfield, plan, track, visibility};
use halflight_device as device;
use halflight_engine as engine;
use halflight_math as math;

pub mod config;
pub mod daemon;
pub mod pipeline;
pub mod present;
