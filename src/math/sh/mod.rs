//! Real spherical harmonics of orders 1 to 6 (generic over f32 and f64). Convention: orthonormal,
//! Condon-Shortley phase inside P, index l(l+1)+m, z up.

/// Largest order supported; bands 0..=5.
pub const MAX_ORDER: usize = 6;
/// Coefficients of the largest order.
pub const MAX_COEFFICIENTS: usize = MAX_ORDER * MAX_ORDER;
