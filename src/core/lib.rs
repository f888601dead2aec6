//! Layers 1 and 2: plain data, and the pure stages. Values in, values out; time is an argument. No input or output, no
//! clock. The CPU twin of every shader lives here.
//!
//! Frames, units and the keys of papers stand in the crate `halflight`.

use halflight_math as math;

pub mod animate;
pub mod calibrate;
pub mod compose;
pub mod hdr;
pub mod light;
pub mod model;
pub mod nearfield;
pub mod plan;
pub mod sources;
pub mod track;
pub mod visibility;
