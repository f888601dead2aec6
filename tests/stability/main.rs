//! Hard cases: every number finite, within its bound, continuous through the singular points, the same whichever way
//! the scene is turned and in whatever unit its light is. The list is `halflight::stress`; `halflight stress` shows it.

#[path = "../support/gles.rs"]
mod gles;
#[path = "../support/mod.rs"]
mod support;

mod engines;
mod table;
