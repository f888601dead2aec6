//! From exposures to linear radiance [DM97].

pub mod attribute;
pub mod merge_bracket;
pub mod register;
pub mod response;
pub mod sliding;
