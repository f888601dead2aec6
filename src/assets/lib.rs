//! Files in, model out.

use halflight_core::{animate, light, model, nearfield, visibility};
use halflight_math as math;

pub mod calibration;
pub mod dds;
pub mod error;
pub mod gltf;
pub mod kept;
pub mod known_room;
mod names;
pub mod near_word;
pub mod normals;
pub mod obj;
pub mod pictures;
pub mod response;
pub mod rig;
pub mod room;
pub mod scene;
pub mod shapes;
pub mod spheres;
pub mod transfer;
pub mod walker;
pub mod whole;
