//! The truncated product of two functions through their values on rings of equal z, for L pairs side by side.
//!
//! f g y_k has degree 3(n-1): Gauss-Legendre nodes of z and S equal steps of phi integrate it exactly, so this is
//! Eq. 4 of [Now11] and no approximation. Going to the rings and back costs O(n^3); half of the work is saved by taking
//! rings at z and -z together, and the sums over phi are short Fourier transforms written out. At order 6 it takes a
//! third of the operations of the sparse sum over Gamma.

use super::{MAX_COEFFICIENTS, MAX_ORDER, Real, basis};
use crate::quadrature::gauss_legendre;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Numbers of type T of several functions side by side: plain operations, each on all of them.
pub trait Number<T>:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Mul<T, Output = Self> + AddAssign
{
}

impl<T, V> Number<T> for V where
    V: Copy + Add<Output = V> + Sub<Output = V> + Mul<Output = V> + Mul<T, Output = V> + AddAssign
{
}

/// Pairs of l and m >= 0.
const LEGENDRE: usize = MAX_ORDER * (MAX_ORDER + 1) / 2;

/// One ring at z >= 0, which stands for the one at -z too unless z = 0.
#[derive(Clone, Debug)]
struct LatitudeRing<T> {
    /// P_lm(z), normalised, at `place(l, m)`: y_lm = P_lm cos(m phi), y_l-m = P_lm sin(m phi).
    values: [T; LEGENDRE],
    /// The same times the solid angle of a sample.
    weighted: [T; LEGENDRE],
}

/// The rings of one order.
#[derive(Clone, Debug)]
pub struct Rings<T> {
    /// Those at +-z.
    pairs: Vec<LatitudeRing<T>>,
    /// The one at z = 0, where their number is odd.
    centre: Option<LatitudeRing<T>>,
}

const fn place(l: usize, m: usize) -> usize {
    l * (l + 1) / 2 + m
}

/// Samples of a ring: above 3(n-1).
const fn samples(order: usize) -> usize {
    match order {
        0..=3 => 8,
        4 => 12,
        _ => 16,
    }
}

impl<T: Real> Rings<T> {
    /// For orders 2 to 6.
    pub fn new(order: usize) -> Self {
        let count = (3 * (order - 1)) / 2 + 1;
        let ring = |z: f64, weight: f64| {
            let mut y = [0.0; MAX_COEFFICIENTS];
            basis::evaluate(order, [(1.0 - z * z).sqrt(), 0.0, z], &mut y);
            let mut ring = LatitudeRing { values: [T::zero(); LEGENDRE], weighted: [T::zero(); LEGENDRE] };
            let solid_angle = weight * 2.0 * std::f64::consts::PI / samples(order) as f64;
            for l in 0..order {
                for m in 0..=l {
                    let value = y[l * (l + 1) + m];
                    ring.values[place(l, m)] = T::of(value);
                    ring.weighted[place(l, m)] = T::of(value * solid_angle);
                }
            }
            ring
        };
        let nodes = gauss_legendre(count);
        Self {
            pairs: nodes.iter().filter(|(z, _)| *z > 1e-9).map(|(z, weight)| ring(*z, *weight)).collect(),
            centre: nodes.iter().find(|(z, _)| z.abs() <= 1e-9).map(|(_, weight)| ring(0.0, *weight)),
        }
    }
}

impl Rings<f64> {
    /// What a shader that takes so many samples of each ring, above 3(n-1), reads: for each pair of rings the values and the
    /// weighted values, P_lm at l (l + 1)/2 + m. A ring at z = 0 is a pair of half the weight.
    pub fn pairs_of(order: usize, samples_taken: usize) -> impl Iterator<Item = [[f64; LEGENDRE]; 2]> {
        let rings = f64::rings(order);
        let share = samples(order.clamp(2, MAX_ORDER)) as f64 / samples_taken.max(1) as f64;
        let scaled = move |ring: &LatitudeRing<f64>, weight: f64| {
            [ring.values, ring.weighted.map(|w| w * weight * share)]
        };
        let pairs = rings.pairs.iter().map(move |ring| scaled(ring, 1.0));
        pairs.chain(rings.centre.iter().map(move |ring| scaled(ring, 0.5)))
    }
}

/// Fourier coefficients of a ring: of cos(m phi) and sin(m phi).
type Waves<V> = [[V; 2]; MAX_ORDER];

/// Does something for each m below N, with m as a constant: the loops inside are then written out.
macro_rules! each_m {
    ($n:ident, $f:ident::<$t:ty, $v:ty>($($argument:expr),*)) => {
        $f::<$t, $v, $n, 0>($($argument),*);
        $f::<$t, $v, $n, 1>($($argument),*);
        if $n > 2 {
            $f::<$t, $v, $n, 2>($($argument),*);
        }
        if $n > 3 {
            $f::<$t, $v, $n, 3>($($argument),*);
        }
        if $n > 4 {
            $f::<$t, $v, $n, 4>($($argument),*);
        }
        if $n > 5 {
            $f::<$t, $v, $n, 5>($($argument),*);
        }
    };
}

/// The waves of one m on the rings at z and -z: the bands with l - m even are equal on both, the others opposite.
#[inline(always)]
fn to_ring<T: Real, V: Number<T>, const N: usize, const M: usize>(
    zero: V,
    ring: &LatitudeRing<T>,
    f: &[V; MAX_COEFFICIENTS],
    above: &mut Waves<V>,
    below: &mut Waves<V>,
) {
    for part in 0..if M == 0 { 1 } else { 2 } {
        let (mut even, mut odd) = (zero, zero);
        for l in M..N {
            let i = if part == 0 { l * (l + 1) + M } else { l * (l + 1) - M };
            let term = f[i] * ring.values[place(l, M)];
            match l - M {
                0 => even = term,
                1 => odd = term,
                apart if apart % 2 == 0 => even += term,
                _ => odd += term,
            }
        }
        above[M][part] = even + odd;
        below[M][part] = even - odd;
    }
}

/// f on the rings at z and -z.
#[inline(always)]
fn to_rings<T: Real, V: Number<T>, const N: usize>(
    zero: V,
    ring: &LatitudeRing<T>,
    f: &[V; MAX_COEFFICIENTS],
) -> (Waves<V>, Waves<V>) {
    let (mut above, mut below) = ([[zero; 2]; MAX_ORDER], [[zero; 2]; MAX_ORDER]);
    each_m!(N, to_ring::<T, V>(zero, ring, f, &mut above, &mut below));
    (above, below)
}

/// Adds what the rings at z and -z give to the coefficients of one m.
#[inline(always)]
fn from_ring<T: Real, V: Number<T>, const N: usize, const M: usize>(
    ring: &LatitudeRing<T>,
    above: &Waves<V>,
    below: &Waves<V>,
    out: &mut [V; MAX_COEFFICIENTS],
) {
    for part in 0..if M == 0 { 1 } else { 2 } {
        let both = above[M][part] + below[M][part];
        let apart = above[M][part] - below[M][part];
        for l in M..N {
            let i = if part == 0 { l * (l + 1) + M } else { l * (l + 1) - M };
            let side = if (l - M).is_multiple_of(2) { both } else { apart };
            out[i] += side * ring.weighted[place(l, M)];
        }
    }
}

/// Multiplies two rings sample by sample and goes back to waves.
#[inline(always)]
fn multiply<T: Real, V: Number<T>, const N: usize>(zero: V, f: &Waves<V>, g: &Waves<V>) -> Waves<V> {
    match N {
        0..=3 => {
            let (f, g) = (eight::<T, V>(f), eight::<T, V>(g));
            from_eight::<T, V>(zero, &times(&f, &g))
        }
        4 => {
            let (f, g) = (twelve::<T, V>(f), twelve::<T, V>(g));
            from_twelve::<T, V>(zero, &times(&f, &g))
        }
        _ => {
            let (f, g) = (sixteen::<T, V>(f), sixteen::<T, V>(g));
            from_sixteen::<T, V>(zero, &times(&f, &g))
        }
    }
}

/// The truncated product (Eq. 4 of [Now11]); N is the order, 2 to 6. Commutative bit for bit. `zero` is 0 in each place.
#[inline(always)]
pub fn product<T: Real, V: Number<T>, const N: usize>(
    zero: V,
    f: &[V; MAX_COEFFICIENTS],
    g: &[V; MAX_COEFFICIENTS],
    out: &mut [V; MAX_COEFFICIENTS],
) {
    let rings = T::rings(N);
    for out in out.iter_mut().take(N * N) {
        *out = zero;
    }
    for ring in &rings.pairs {
        let (f_above, f_below) = to_rings::<T, V, N>(zero, ring, f);
        let (g_above, g_below) = to_rings::<T, V, N>(zero, ring, g);
        let above = multiply::<T, V, N>(zero, &f_above, &g_above);
        let below = multiply::<T, V, N>(zero, &f_below, &g_below);
        each_m!(N, from_ring::<T, V>(ring, &above, &below, out));
    }
    if let Some(ring) = &rings.centre {
        // z and -z are one ring: what is odd vanishes there, and nothing stands below.
        let (f, _) = to_rings::<T, V, N>(zero, ring, f);
        let (g, _) = to_rings::<T, V, N>(zero, ring, g);
        let waves = multiply::<T, V, N>(zero, &f, &g);
        each_m!(N, from_ring::<T, V>(ring, &waves, &[[zero; 2]; MAX_ORDER], out));
    }
}

/// Waves up to m = 2 at phi = 2 pi j/8. Even waves repeat after half a turn, odd ones change sign.
#[inline(always)]
fn eight<T: Real, V: Number<T>>(w: &Waves<V>) -> [V; 8] {
    let k = T::FRAC_1_SQRT_2();
    let [[mean, _], [c1, s1], [c2, s2], ..] = *w;
    let even = [mean + c2, mean + s2, mean - c2, mean - s2];
    let odd = [c1, (c1 + s1) * k, s1, (s1 - c1) * k];
    halves(&even, &odd)
}

/// Sums of 8 samples times cos and sin of m phi, m up to 2.
#[inline(always)]
fn from_eight<T: Real, V: Number<T>>(zero: V, h: &[V; 8]) -> Waves<V> {
    let k = T::FRAC_1_SQRT_2();
    let (e, o): ([V; 4], [V; 4]) = unhalve(h);
    [
        [(e[0] + e[2]) + (e[1] + e[3]), zero],
        [o[0] + (o[1] - o[3]) * k, o[2] + (o[1] + o[3]) * k],
        [e[0] - e[2], e[1] - e[3]],
        [zero; 2],
        [zero; 2],
        [zero; 2],
    ]
}

/// Waves up to m = 3 at phi = 2 pi j/12.
#[inline(always)]
fn twelve<T: Real, V: Number<T>>(w: &Waves<V>) -> [V; 12] {
    let (half, root) = (T::of(0.5), T::of(0.75_f64.sqrt()));
    let [[mean, _], [c1, s1], [c2, s2], [c3, s3], ..] = *w;
    let (c, s) = (c2 * half, s2 * root);
    let (plus, minus) = (mean + c, mean - c);
    let even = [mean + c2, plus + s, minus + s, mean - c2, minus - s, plus - s];
    let (c_half, c_root, s_half, s_root) = (c1 * half, c1 * root, s1 * half, s1 * root);
    let (side, tilt) = (s_half + s3, c_half - c3);
    let odd = [c1 + c3, side + c_root, s_root + tilt, s1 - s3, s_root - tilt, side - c_root];
    halves(&even, &odd)
}

/// Sums of 12 samples times cos and sin of m phi, m up to 3.
#[inline(always)]
fn from_twelve<T: Real, V: Number<T>>(zero: V, h: &[V; 12]) -> Waves<V> {
    let (half, root) = (T::of(0.5), T::of(0.75_f64.sqrt()));
    let (e, o): ([V; 6], [V; 6]) = unhalve(h);
    let (near, far) = (e[1] + e[5], e[2] + e[4]);
    let (side, cross) = (o[1] + o[5], o[2] - o[4]);
    [
        [(e[0] + e[3]) + (near + far), zero],
        [o[0] + (o[1] - o[5]) * root + cross * half, o[3] + (o[2] + o[4]) * root + side * half],
        [(e[0] - e[3]) + (near - far) * half, ((e[1] - e[5]) + (e[2] - e[4])) * root],
        [o[0] - cross, side - o[3]],
        [zero; 2],
        [zero; 2],
    ]
}

/// Waves up to m = 5 at phi = 2 pi j/16.
#[inline(always)]
fn sixteen<T: Real, V: Number<T>>(w: &Waves<V>) -> [V; 16] {
    let (a, b, k) = (T::of(COS_22_5), T::of(SIN_22_5), T::FRAC_1_SQRT_2());
    let [[mean, _], [c1, s1], [c2, s2], [c3, s3], [c4, s4], [c5, s5]] = *w;
    let quarter = [mean + c4, mean + s4, mean - c4, mean - s4];
    let turn = [c2, (c2 + s2) * k, s2, (s2 - c2) * k];
    let even: [V; 8] = halves(&quarter, &turn);
    let (sum, gap) = (c3 + c5, c3 - c5);
    let x = [c1 + sum, c1 * a + gap * b, (c1 - sum) * k, c1 * b - gap * a];
    let (sum, gap) = (s3 + s5, s3 - s5);
    let y = [s1 * b + sum * a, (s1 + gap) * k, s1 * a - sum * b, s1 - gap];
    let odd = [x[0], x[1] + y[0], x[2] + y[1], x[3] + y[2], y[3], y[2] - x[3], y[1] - x[2], y[0] - x[1]];
    halves(&even, &odd)
}

/// Sums of 16 samples times cos and sin of m phi, m up to 5.
#[inline(always)]
fn from_sixteen<T: Real, V: Number<T>>(zero: V, h: &[V; 16]) -> Waves<V> {
    let (a, b, k) = (T::of(COS_22_5), T::of(SIN_22_5), T::FRAC_1_SQRT_2());
    let (e, o): ([V; 8], [V; 8]) = unhalve(h);
    let (quarter, turn): ([V; 4], [V; 4]) = unhalve(&e);
    let q = [o[1] - o[7], (o[2] - o[6]) * k, o[3] - o[5]];
    let p = [o[1] + o[7], (o[2] + o[6]) * k, o[3] + o[5]];
    let (c_in, c_gap) = (o[0] - q[1], q[0] * b - q[2] * a);
    let (s_in, s_gap) = (p[1] - o[4], p[0] * a - p[2] * b);
    [
        [(quarter[0] + quarter[2]) + (quarter[1] + quarter[3]), zero],
        [(o[0] + q[1]) + (q[0] * a + q[2] * b), (o[4] + p[1]) + (p[0] * b + p[2] * a)],
        [turn[0] + (turn[1] - turn[3]) * k, turn[2] + (turn[1] + turn[3]) * k],
        [c_in + c_gap, s_gap + s_in],
        [quarter[0] - quarter[2], quarter[1] - quarter[3]],
        [c_in - c_gap, s_gap - s_in],
    ]
}

/// cos and sin of pi/8.
const COS_22_5: f64 = 0.923_879_532_511_286_7;
const SIN_22_5: f64 = 0.382_683_432_365_089_8;

/// Sample by sample. Loops, here and below: the body of a closure would not get the instructions of its surroundings.
#[inline(always)]
fn times<V: Copy + Mul<Output = V>, const S: usize>(f: &[V; S], g: &[V; S]) -> [V; S] {
    let mut all = *f;
    for j in 0..S {
        all[j] = f[j] * g[j];
    }
    all
}

/// All samples of what repeats (even) plus what changes sign (odd) after half of them.
#[inline(always)]
fn halves<V: Copy + Add<Output = V> + Sub<Output = V>, const H: usize, const S: usize>(
    even: &[V; H],
    odd: &[V; H],
) -> [V; S] {
    let mut all = [even[0]; S];
    for j in 0..H {
        all[j] = even[j] + odd[j];
        all[j + H] = even[j] - odd[j];
    }
    all
}

/// Sums and differences of samples half a turn apart.
#[inline(always)]
fn unhalve<V: Copy + Add<Output = V> + Sub<Output = V>, const H: usize, const S: usize>(
    h: &[V; S],
) -> ([V; H], [V; H]) {
    let (mut sums, mut gaps) = ([h[0]; H], [h[0]; H]);
    for j in 0..H {
        sums[j] = h[j] + h[j + H];
        gaps[j] = h[j] - h[j + H];
    }
    (sums, gaps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::{
        lanes::{Lane, LaneSh, nothing},
        product as sparse,
    };
    use proptest::prelude::*;

    fn compare<T: Real, const N: usize, const L: usize>(f: &[f64], g: &[f64], most: f64) {
        let lanes = |c: &[f64]| {
            let mut out: LaneSh<T, L> = nothing();
            for (i, out) in out.iter_mut().enumerate() {
                // Each lane another function.
                out.0 = std::array::from_fn(|lane| T::of(c[(i + lane) % c.len()]));
            }
            out
        };
        let (f, g) = (lanes(f), lanes(g));
        let (mut fg, mut gf) = (nothing(), nothing());
        product::<T, _, N>(Lane::zero(), &f, &g, &mut fg);
        product::<T, _, N>(Lane::zero(), &g, &f, &mut gf);
        assert_eq!(fg, gf);
        for lane in 0..L {
            let of = |c: &LaneSh<T, L>| c.map(|c| c.0[lane].to_f64().unwrap());
            let mut want = [0.0; MAX_COEFFICIENTS];
            sparse::product(N, &of(&f), &of(&g), &mut want);
            for (got, want) in of(&fg).iter().zip(want).take(N * N) {
                assert!((got - want).abs() < most, "order {N}, lane {lane}: {got} instead of {want}");
            }
            assert!(fg[N * N..].iter().all(|v| v.0[lane] == T::zero()), "nothing beyond the order");
        }
    }

    proptest! {
        #[test]
        fn rings_give_the_sparse_sum(
            f in prop::collection::vec(-2.0..2.0_f64, 36), g in prop::collection::vec(-2.0..2.0_f64, 36),
        ) {
            // Values of f up to 2 * 36 / 3.5, and 3e-7 of their product in f32.
            compare::<f64, 2, 1>(&f, &g, 1e-13);
            compare::<f64, 3, 1>(&f, &g, 1e-13);
            compare::<f64, 4, 1>(&f, &g, 1e-12);
            compare::<f64, 5, 1>(&f, &g, 1e-12);
            compare::<f64, 6, 1>(&f, &g, 1e-12);
            compare::<f32, 4, 4>(&f, &g, 2e-5);
            compare::<f32, 6, 4>(&f, &g, 5e-5);
        }
    }
}
