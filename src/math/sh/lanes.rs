//! Several receivers side by side: one number of each in a [`Lane`], and the SH kernels over lanes.
//!
//! Every lane goes through the same operations in the same order whatever the width, so a batch of eight gives, bit
//! for bit, what eight batches of one give. Only plain additions and multiplications: no fused ones.

use super::{MAX_COEFFICIENTS, MAX_ORDER, Real, basis, rings};
use crate::widest::Wide;
use pulp::{Arch, Simd, WithSimd};
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// One number of each of L receivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lane<T, const L: usize>(pub [T; L]);

/// Coefficients of L functions: order^2 of them are in use.
pub type LaneSh<T, const L: usize> = [Lane<T, L>; MAX_COEFFICIENTS];

impl<T: Real, const L: usize> Lane<T, L> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(number: T) -> Self {
        Self([number; L])
    }

    /// Zero in every lane.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([T::zero(); L])
    }

    /// A function of each lane's number.
    #[inline(always)]
    pub fn map(self, f: impl Fn(T) -> T) -> Self {
        let mut out = self.0;
        for a in &mut out {
            *a = f(*a);
        }
        Self(out)
    }

    /// A function of each lane's two numbers.
    #[inline(always)]
    pub fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        let mut out = self.0;
        for lane in 0..L {
            out[lane] = f(out[lane], other.0[lane]);
        }
        Self(out)
    }

    /// The smaller number; as `if a < b { a } else { b }`, one instruction.
    #[inline(always)]
    pub fn at_most(self, other: T) -> Self {
        self.map(|a| if a < other { a } else { other })
    }

    /// The larger number; NaN becomes `other`.
    #[inline(always)]
    pub fn at_least(self, other: T) -> Self {
        self.map(|a| if a > other { a } else { other })
    }

    /// Square roots.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(T::sqrt)
    }

    /// This lane's number where `keep`, else the other's.
    #[inline(always)]
    pub fn or(self, keep: [bool; L], other: Self) -> Self {
        let mut out = other.0;
        for ((out, own), keep) in out.iter_mut().zip(self.0).zip(keep) {
            *out = if keep { own } else { *out };
        }
        Self(out)
    }
}

impl<T: Real, const L: usize> Add for Lane<T, L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl<T: Real, const L: usize> AddAssign for Lane<T, L> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Real, const L: usize> Sub for Lane<T, L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl<T: Real, const L: usize> Mul for Lane<T, L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl<T: Real, const L: usize> Mul<T> for Lane<T, L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: T) -> Self {
        self.map(|a| a * factor)
    }
}

impl<T: Real, const L: usize> Neg for Lane<T, L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

/// All zero.
#[inline(always)]
pub fn nothing<T: Real, const L: usize>() -> LaneSh<T, L> {
    [Lane::zero(); MAX_COEFFICIENTS]
}

/// Adds zonal functions, each turned to its lane's axis: out_lm += z_l sqrt(4 pi/(2l+1)) y_lm(axis)
/// (Eq. 3 of [Now11]). `scaled[l]` is z_l sqrt(4 pi/(2l+1)); N is the order, 1 to 6.
#[inline(always)]
pub fn add_zonal<T: Real, const N: usize, const L: usize>(
    axis: [Lane<T, L>; 3],
    scaled: &[Lane<T, L>; MAX_ORDER],
    out: &mut LaneSh<T, L>,
) {
    let [x, y, z] = axis;
    let (mut re, mut im) = (Lane::splat(T::one()), Lane::zero());
    for m in 0..N {
        let (mut below, mut legendre) = (Lane::zero(), Lane::splat(T::of(basis::DIAGONAL[m])));
        for l in m..N {
            if l > m {
                let (a, b) = basis::RECURRENCE[l][m];
                let next = (z * legendre - below * T::of(b)) * T::of(a);
                (below, legendre) = (legendre, next);
            }
            let centre = l * (l + 1);
            let weighted = legendre * scaled[l];
            out[centre + m] += weighted * re;
            if m > 0 {
                out[centre - m] += weighted * im;
            }
        }
        (re, im) = (x * re - y * im, x * im + y * re);
    }
}

/// The truncated product of functions, lane by lane (Eq. 4 of [Now11]); N is the order. As `product::product`
/// up to rounding; the same bits whatever the number of lanes. f32 goes by the widest registers of the processor.
pub fn product<T: Real, const N: usize, const L: usize>(
    f: &LaneSh<T, L>,
    g: &LaneSh<T, L>,
    out: &mut LaneSh<T, L>,
) {
    T::product::<N, L>(f, g, out);
}

/// [`product`] by [`PRODUCT_LANES`] lanes, as every processor can.
#[inline]
pub(super) fn plain_product<T: Real, const N: usize, const L: usize>(
    f: &LaneSh<T, L>,
    g: &LaneSh<T, L>,
    out: &mut LaneSh<T, L>,
) {
    if L <= PRODUCT_LANES || !L.is_multiple_of(PRODUCT_LANES) {
        return rings::product::<T, _, N>(Lane::zero(), f, g, out);
    }
    for first in (0..L).step_by(PRODUCT_LANES) {
        let mut part = nothing::<T, PRODUCT_LANES>();
        let (f, g) = (some::<T, N, L>(f, first), some::<T, N, L>(g, first));
        rings::product::<T, _, N>(Lane::zero(), &f, &g, &mut part);
        for (out, part) in out.iter_mut().zip(&part).take(N * N) {
            out.0[first..first + PRODUCT_LANES].copy_from_slice(&part.0);
        }
    }
}

/// Lanes that a plain product takes at once: of f32 one register of every processor in use. With eight there are too few
/// registers for the rings: three times slower.
const PRODUCT_LANES: usize = 4;

/// `PRODUCT_LANES` lanes of some functions.
#[inline(always)]
fn some<T: Real, const N: usize, const L: usize>(f: &LaneSh<T, L>, first: usize) -> LaneSh<T, PRODUCT_LANES> {
    let mut part = nothing::<T, PRODUCT_LANES>();
    for (part, f) in part.iter_mut().zip(f).take(N * N) {
        part.0.copy_from_slice(&f.0[first..first + PRODUCT_LANES]);
    }
    part
}

/// [`product`] of f32 by the widest registers.
pub(super) fn wide_product<const N: usize, const L: usize>(
    f: &LaneSh<f32, L>,
    g: &LaneSh<f32, L>,
    out: &mut LaneSh<f32, L>,
) {
    struct Multiply<'a, const N: usize, const L: usize> {
        f: &'a LaneSh<f32, L>,
        g: &'a LaneSh<f32, L>,
        out: &'a mut LaneSh<f32, L>,
    }
    impl<const N: usize, const L: usize> WithSimd for Multiply<'_, N, L> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            if S::F32_LANES <= PRODUCT_LANES || L <= 1 {
                return plain_product::<f32, N, L>(self.f, self.g, self.out);
            }
            let zero = Wide::splat(simd, 0.0);
            for first in (0..L).step_by(S::F32_LANES) {
                let (mut f, mut g) = ([zero; MAX_COEFFICIENTS], [zero; MAX_COEFFICIENTS]);
                for i in 0..N * N {
                    f[i] = Wide::load(simd, &self.f[i].0[first..]);
                    g[i] = Wide::load(simd, &self.g[i].0[first..]);
                }
                let mut product = [zero; MAX_COEFFICIENTS];
                rings::product::<f32, _, N>(zero, &f, &g, &mut product);
                for (out, product) in self.out.iter_mut().zip(product).take(N * N) {
                    product.store(&mut out.0[first..]);
                }
            }
        }
    }
    Arch::new().dispatch(Multiply::<N, L> { f, g, out });
}

/// Takes each lane to what 0 <= V <= 1 allows: V_0 into [0, sqrt(4 pi)], then |V_{l>0}| to at most
/// sqrt(sqrt(4 pi) V_0 - V_0^2). A true visibility passes unchanged; what is not finite becomes V_0 alone.
#[inline(always)]
pub fn guard<T: Real, const N: usize, const L: usize>(v: &mut LaneSh<T, L>) {
    let whole = (T::of(4.0) * T::PI()).sqrt();
    v[0] = v[0].at_least(T::zero()).at_most(whole);
    let mut square = Lane::zero();
    for v in &v[1..N * N] {
        square += *v * *v;
    }
    let bound = (v[0] * (Lane::splat(whole) - v[0])).at_least(T::zero());
    if square.0.iter().zip(bound.0).all(|(square, bound)| *square <= bound) {
        return;
    }
    for lane in 0..L {
        let (square, bound) = (square.0[lane], bound.0[lane]);
        if square <= bound {
            continue;
        }
        let scale = if square.is_finite() { (bound / square).sqrt() } else { T::zero() };
        for v in &mut v[1..N * N] {
            v.0[lane] = if scale > T::zero() { v.0[lane] * scale } else { T::zero() };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compare<T: Real, const N: usize, const L: usize>() {
        let wide = |seed: f64| -> LaneSh<T, L> {
            std::array::from_fn(|i| {
                Lane(std::array::from_fn(|lane| T::of((seed * (1 + 7 * i + 40 * lane) as f64).sin())))
            })
        };
        let (f, g) = (wide(0.7), wide(1.3));
        let mut together = nothing();
        product::<T, N, L>(&f, &g, &mut together);
        for lane in 0..L {
            let one = |c: &LaneSh<T, L>| -> LaneSh<T, 1> { std::array::from_fn(|i| Lane([c[i].0[lane]])) };
            let mut alone = nothing();
            product::<T, N, 1>(&one(&f), &one(&g), &mut alone);
            for i in 0..N * N {
                assert_eq!(together[i].0[lane], alone[i].0[0], "order {N}, {L} lanes: coefficient {i}");
            }
        }
    }

    #[test]
    fn products_are_the_same_bits_however_many_lanes() {
        compare::<f32, 2, 4>();
        compare::<f32, 3, 16>();
        compare::<f32, 4, 8>();
        compare::<f32, 4, 24>();
        compare::<f32, 5, 12>();
        compare::<f32, 6, 16>();
        compare::<f64, 6, 8>();
    }
}
