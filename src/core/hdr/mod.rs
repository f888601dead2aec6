//! From exposures to linear radiance [DM97].

pub mod align;
pub mod attribute;
pub mod black_level;
pub mod develop;
pub mod faults;
pub mod ghosts;
pub mod linear_light;
pub mod merge_bracket;
mod reflected_point;
pub mod register;
pub mod response;
pub mod sliding;
