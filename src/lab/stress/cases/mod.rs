//! The cases, by what they are about.

pub mod exposures;
pub mod gloss;
pub mod light;
pub mod near;
pub mod pictures;
pub mod poses;
pub mod shadows;
pub mod spheres;
