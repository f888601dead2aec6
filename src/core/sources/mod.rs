//! All light as a tree of sources, cut into n representatives: each gets one hard shadow map. Far leaves are
//! directions (texels of compact lights), near leaves points (patches of a known room).

pub mod cut;
pub mod expand;
pub mod tree;
