//! Figures through time: clips, skins, walks, and everything of a scene as it stands at one moment.

pub mod bind;
pub mod clip;
pub mod posed;
pub mod skin;
pub mod walk;
