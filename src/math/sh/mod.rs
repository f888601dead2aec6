//! Real spherical harmonics of orders 1 to 6 (generic over f32 and f64). Convention: orthonormal,
//! Condon-Shortley phase inside P, index l(l+1)+m, z up.

pub mod basis;
pub mod cap;
pub mod dering;
pub mod lanes;
pub mod log_exp;
pub mod product;
pub mod project;
pub mod rings;
pub mod rotate;
pub mod soft_directions;
pub mod zonal;

use std::sync::OnceLock;

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

    /// The table of [`rings::product`] for an order, taken into 2..=6; made when first asked for.
    fn rings(order: usize) -> &'static rings::Rings<Self>;

    /// [`lanes::product`] as fast as this type allows.
    #[inline]
    fn product<const N: usize, const L: usize>(
        f: &lanes::LaneSh<Self, L>,
        g: &lanes::LaneSh<Self, L>,
        out: &mut lanes::LaneSh<Self, L>,
    ) {
        lanes::plain_product::<Self, N, L>(f, g, out);
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(number: f64) -> Self {
        number as Self
    }

    #[inline]
    fn rings(order: usize) -> &'static rings::Rings<Self> {
        static TABLES: [OnceLock<rings::Rings<f32>>; MAX_ORDER - 1] =
            [const { OnceLock::new() }; MAX_ORDER - 1];
        let order = order.clamp(2, MAX_ORDER);
        TABLES[order - 2].get_or_init(|| rings::Rings::new(order))
    }

    #[inline]
    fn product<const N: usize, const L: usize>(
        f: &lanes::LaneSh<Self, L>,
        g: &lanes::LaneSh<Self, L>,
        out: &mut lanes::LaneSh<Self, L>,
    ) {
        if L == 1 {
            return lanes::plain_product::<Self, N, L>(f, g, out);
        }
        lanes::wide_product::<N, L>(f, g, out);
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(number: f64) -> Self {
        number
    }

    #[inline]
    fn rings(order: usize) -> &'static rings::Rings<Self> {
        static TABLES: [OnceLock<rings::Rings<f64>>; MAX_ORDER - 1] =
            [const { OnceLock::new() }; MAX_ORDER - 1];
        let order = order.clamp(2, MAX_ORDER);
        TABLES[order - 2].get_or_init(|| rings::Rings::new(order))
    }
}

/// Where band l, -l <= m <= l, stands in a list of coefficients: l(l+1)+m.
pub const fn index(band: usize, m: isize) -> usize {
    (band * (band + 1)).saturating_add_signed(m)
}
