//! Real spherical harmonics of orders 1 to 6 (generic over f32 and f64). Convention: orthonormal,
//! Condon-Shortley phase inside P, index l(l+1)+m, z up.

pub mod basis;
pub mod cap;
pub mod lanes;
pub mod log_exp;
pub mod product;
pub mod project;
pub mod rotate;
pub mod soft_directions;
pub mod zonal;

/// Largest order supported; bands 0..=5.
pub const MAX_ORDER: usize = 6;
/// Coefficients of the largest order.
pub const MAX_COEFFICIENTS: usize = MAX_ORDER * MAX_ORDER;

/// The two number types that the formulas are written for: f32 (as on the GPU) and f64 (as in tests).
pub trait Real:
    num_traits::Float
    + num_traits::FloatConst
    + num_traits::FromPrimitive
    + std::ops::AddAssign
    + Default
    + std::fmt::Debug
    + Send
    + Sync
    + 'static
{
    /// The nearest number of this type.
    fn of(number: f64) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(number: f64) -> Self {
        number as Self
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(number: f64) -> Self {
        number
    }
}

/// Where band l, -l <= m <= l, stands in a list of coefficients: l(l+1)+m.
pub const fn index(band: usize, m: isize) -> usize {
    (band * (band + 1)).saturating_add_signed(m)
}
