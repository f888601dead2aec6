//! Layer 0: total functions of numbers. No input or output, no clock, no `unsafe`.

pub mod bvh;
pub mod charts;
pub mod color;
pub mod dice;
pub mod lens;
pub mod mirror_ball;
pub mod octahedral;
pub mod pose;
pub mod projection;
pub mod quadrature;
pub mod rigid;
pub mod sh;
pub mod solve;
pub mod sphere;
pub mod spiral;
pub mod vector;
pub mod widest;
