//! Hard cases: every number finite, within its bound, continuous through the singular points, the same whichever way
//! the scene is turned and in whatever unit its light is. The list is `halflight::stress`; `halflight stress` shows it.

#[path = "../support/gles.rs"]
mod gles;
#[path = "../support/lit_room.rs"]
mod lit_room;
#[path = "../support/mod.rs"]
mod support;

mod ball;
mod engines;
mod exposures;
mod light;
mod near;
mod odd;
mod pictures;
mod poses;
mod random;
mod table;
mod verb;
