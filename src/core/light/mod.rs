//! From a linear picture to light: unwrap, project, split, follow.

pub mod below;
pub mod clipped;
pub mod compact;
pub mod cone;
pub mod dering;
pub mod exported;
pub mod fill;
pub mod follow;
pub mod foreign;
pub mod halve;
pub mod maps;
pub mod place_ball;
pub mod prefilter;
pub mod project_sh;
pub mod split;
pub mod surface;
pub mod unwrap_ball;
