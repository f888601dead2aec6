//! Layer 4: what is shown, between engine and pipeline: views of every part of a picture, text over it, the light of a
//! known room where objects are. Nothing here knows of frames that come one after the other.

pub mod gray_place;
pub mod hud;
pub mod letters;
pub mod room_light;
pub mod views;
