//! Logarithms and exponentials of visibility in SH: products of many caps become one sum (Eq. 24 of [Now11]).
//!
//! The logarithm is the eigen-clip of spec 7 (E); the exponentials are the rungs `linear`, `hybrid` and `squared`.

use super::{
    MAX_ORDER, Real, cap, index,
    lanes::{Lane, LaneSh, guard, nothing, product},
    product as scalar_product,
};
use crate::{quadrature::gauss_legendre, solve::symmetric_eigen};
use std::sync::OnceLock;

/// Eigenvalues of the product matrix are taken to be at least this before their logarithm (spec 7 (E)).
pub const SMALLEST_EIGENVALUE: f64 = 0.02;

/// sqrt(4 pi): the coefficient of the constant 1.
pub fn whole<T: Real>() -> T {
    (T::of(4.0) * T::PI()).sqrt()
}

/// Bands 0..order-1 of the logarithm of what one cap leaves visible, R = sin^2 of its half angle, axis +z:
/// g = U log(max(w, 0.02)) U^T 1 with M_V = U diag(w) U^T the product matrix of the truncated V; the zonal block
/// suffices. Computed in f64. R is taken into [0, 1]; `order` into 1..=6; `out` has room for `order` numbers.
pub fn log_cap<T: Real>(order: usize, sine_squared: T, out: &mut [T]) {
    let order = order.clamp(1, MAX_ORDER);
    let mut v = [0.0; MAX_ORDER];
    cap::visible(order, sine_squared.to_f64().unwrap_or(0.0), &mut v);
    // Beyond the order the identity, which nothing mixes with.
    let mut matrix = [[0.0; MAX_ORDER]; MAX_ORDER];
    for (l, row) in matrix.iter_mut().enumerate() {
        row[l] = if l < order { 0.0 } else { 1.0 };
    }
    let band = |i: usize| i.isqrt();
    let zonal = |i: usize| i == index(band(i), 0);
    for entry in scalar_product::gamma(order) {
        let [i, j, k] = [entry.i, entry.j, entry.k];
        if !(zonal(i) && zonal(j) && zonal(k)) {
            continue;
        }
        let [i, j, k] = [i, j, k].map(band);
        let mut orders = [[i, j, k], [i, k, j], [j, i, k], [j, k, i], [k, i, j], [k, j, i]];
        orders.sort_unstable();
        for (at, [of, row, column]) in orders.into_iter().enumerate() {
            if at == 0 || orders[at - 1] != orders[at] {
                matrix[row][column] += entry.integral * v[of];
            }
        }
    }
    out.iter_mut().take(order).for_each(|g| *g = T::zero());
    let Some((values, vectors)) = symmetric_eigen(&matrix) else { return };
    for (value, vector) in values.iter().zip(vectors) {
        let along = value.max(SMALLEST_EIGENVALUE).ln() * vector[0] * whole::<f64>();
        for (g, u) in out.iter_mut().zip(vector).take(order) {
            *g += T::of(along * u);
        }
    }
}

/// The mix of caps that a and b are averaged over: half angles in degrees, each with the same weight. The optimum
/// depends on the mix (b at x = 2 is 0.66 to 0.83 over single caps of 10 to 80 degrees), so this is a choice: the one
/// that the golden numbers were made with (their note speaks of 10, 20, .. 60 degrees; these four reproduce them to 1e-12).
pub const CAP_MIX_DEG: [f64; 4] = [10.0, 20.0, 40.0, 50.0];

/// a(x) and b(x) of Eq. 24 of [Now11] by their definition, x = |g^| >= 0: the least-squares fit of exp(g^) by
/// a 1 + b g^, a = E[<exp g^, 1>]/(4 pi), b = E[<exp g^, g^>]/x^2, over g^ = x u, u the unit logarithms (bands above 0) of
/// the caps of [`CAP_MIX_DEG`]. a(0) = b(0) = 1. Only for blockers: not valid for -g^.
pub fn linear_response(order: usize, norm: f64) -> (f64, f64) {
    if !(norm > 1e-9) {
        return (1.0, 1.0);
    }
    let order = order.clamp(2, MAX_ORDER);
    let nodes = nodes();
    let (mut a, mut b) = (0.0, 0.0);
    for degrees in CAP_MIX_DEG {
        let mut unit = [0.0; MAX_ORDER];
        log_cap(order, degrees.to_radians().sin().powi(2), &mut unit);
        unit[0] = 0.0;
        let length = unit.iter().map(|v| v * v).sum::<f64>().sqrt();
        for (legendre, weight) in nodes {
            let u: f64 = unit.iter().zip(legendre).map(|(u, p)| u / length * p).sum();
            let exponential = weight * (norm * u).exp();
            a += exponential;
            b += exponential * u / norm;
        }
    }
    // The integral over the sphere is 2 pi times that over z.
    let caps = CAP_MIX_DEG.len() as f64;
    (0.5 * a / caps, 2.0 * std::f64::consts::PI * b / caps)
}

/// y_l0 at Gauss-Legendre nodes of z, with their weights: exponentials of x up to 32 have converged.
fn nodes() -> &'static [([f64; MAX_ORDER], f64)] {
    static NODES: OnceLock<Vec<([f64; MAX_ORDER], f64)>> = OnceLock::new();
    NODES.get_or_init(|| {
        gauss_legendre(96)
            .iter()
            .map(|&(z, weight)| {
                let (mut below, mut legendre) = (0.0, 1.0);
                let mut y = [0.0; MAX_ORDER];
                for (l, y) in y.iter_mut().enumerate() {
                    *y = legendre * ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI)).sqrt();
                    let next = ((2 * l + 1) as f64 * z * legendre - l as f64 * below) / (l + 1) as f64;
                    (below, legendre) = (legendre, next);
                }
                (y, weight)
            })
            .collect()
    })
}

/// Nodes of the table of a and b: steps of 1/8 up to 2, 1/2 up to 8, 2 up to 32.
pub const RESPONSE_NODES: usize = 41;

/// x at a node of the table.
pub fn response_node(node: usize) -> f64 {
    match node {
        0..=16 => node as f64 * 0.125,
        17..=28 => 2.0 + (node - 16) as f64 * 0.5,
        _ => 8.0 + (node.min(RESPONSE_NODES - 1) - 28) as f64 * 2.0,
    }
}

/// a and b as a table that is read by linear interpolation, x at most 32 (beyond it the last entry). Made from
/// [`linear_response`]. Against it a and b are within 7e-4 (relative) for x < 2, where `hybrid`
/// reads, 5e-3 for x < 8, and 11 % beyond. The nodes are those of the golden numbers, and coarse ones do: what `linear`
/// leaves out is ten times as large.
#[derive(Clone, Debug)]
pub struct ResponseTable<T> {
    /// (a, b) at each node.
    pub nodes: [(T, T); RESPONSE_NODES],
}

impl<T: Real> ResponseTable<T> {
    /// For one order, 2 to 6.
    pub fn new(order: usize) -> Self {
        let nodes = std::array::from_fn(|node| {
            let (a, b) = linear_response(order, response_node(node));
            (T::of(a), T::of(b))
        });
        Self { nodes }
    }

    /// (a, b) at x >= 0.
    #[inline]
    pub fn at(&self, norm: T) -> (T, T) {
        let position = if norm < T::of(2.0) {
            norm * T::of(8.0)
        } else if norm < T::of(8.0) {
            (norm - T::of(2.0)) * T::of(2.0) + T::of(16.0)
        } else {
            (norm - T::of(8.0)) * T::of(0.5) + T::of(28.0)
        };
        let position = position.min(T::of((RESPONSE_NODES - 1) as f64));
        let node = position.to_usize().unwrap_or(0).min(RESPONSE_NODES - 2);
        let part = position - T::of(node as f64);
        let ((a0, b0), (a1, b1)) = (self.nodes[node], self.nodes[node + 1]);
        (a0 + (a1 - a0) * part, b0 + (b1 - b0) * part)
    }
}

/// Rows of the table of logarithms, less one.
pub const LOG_STEPS: usize = 512;

/// The logarithm of one cap as a table over q = 1 - cos(half angle), 0 to 1, read by linear interpolation. V is a
/// polynomial of q, so the entries are smooth but where an eigenvalue meets the clip: against [`log_cap`] within 2e-4
/// (relative) up to 30 degrees (2e-5 but at order 6), and 5e-3 beyond, near the clip.
#[derive(Clone, Debug)]
pub struct LogTable<T> {
    /// `[row][l]`: g_l sqrt(4 pi/(2l+1)) / q: ready to be turned, and finite at q = 0.
    pub rows: Vec<[T; 8]>,
}

impl<T: Real> LogTable<T> {
    /// For one order, 2 to 6.
    pub fn new(order: usize) -> Self {
        let row = |step: usize| {
            // At q = 0 the limit: its neighbour is within 1e-7 of it.
            let q = if step == 0 { 1e-7 } else { step as f64 / LOG_STEPS as f64 };
            let mut g = [0.0; MAX_ORDER];
            log_cap(order, q * (2.0 - q), &mut g);
            std::array::from_fn(|l| {
                let turn = (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt();
                if l < order.min(MAX_ORDER) { T::of(g[l] * turn / q) } else { T::zero() }
            })
        };
        Self { rows: (0..=LOG_STEPS).map(row).collect() }
    }

    /// g_l sqrt(4 pi/(2l+1)) of a cap of q = 1 - cos(half angle), each band; zero at q <= 0.
    #[inline(always)]
    pub fn at(&self, q: T) -> [T; 8] {
        let position = (q * T::of(LOG_STEPS as f64)).max(T::zero()).min(T::of(LOG_STEPS as f64));
        let row = position.to_usize().unwrap_or(0).min(LOG_STEPS - 1);
        let part = position - T::of(row as f64);
        match self.rows.get(row..row + 2) {
            Some([low, high]) => std::array::from_fn(|l| (low[l] + (high[l] - low[l]) * part) * q),
            _ => [T::zero(); 8],
        }
    }
}

/// What the rungs look up, for one order.
#[derive(Clone, Debug)]
pub struct Tables {
    /// a and b of Eq. 24.
    pub response: ResponseTable<f32>,
    /// The logarithm of one cap.
    pub log: LogTable<f32>,
}

/// The tables of an order (taken into 2..=6), made from their definitions when first asked for: 549 products, 513
/// small eigenproblems and 246 integrals at most, some milliseconds.
pub fn tables(order: usize) -> &'static Tables {
    static ALL: [OnceLock<Tables>; MAX_ORDER - 1] = [const { OnceLock::new() }; MAX_ORDER - 1];
    let order = order.clamp(2, MAX_ORDER);
    ALL[order - 2].get_or_init(|| Tables { response: ResponseTable::new(order), log: LogTable::new(order) })
}

/// |g^|: the norm of all bands above 0.
#[inline(always)]
pub fn norm_above_mean<T: Real, const N: usize, const L: usize>(g: &LaneSh<T, L>) -> Lane<T, L> {
    let mut square = Lane::zero();
    for g in &g[1..N * N] {
        square += *g * *g;
    }
    square.sqrt()
}

/// Halvings until each norm is at most `limit`, at most 24 of them.
#[inline(always)]
fn halvings<T: Real, const L: usize>(norm: Lane<T, L>, limit: T) -> [u32; L] {
    norm.0.map(|norm| {
        let (mut halved, mut count) = (norm, 0);
        while halved > limit && count < 24 {
            halved = halved * T::of(0.5);
            count += 1;
        }
        count
    })
}

/// 2^-count.
#[inline(always)]
fn halved<T: Real, const L: usize>(counts: [u32; L]) -> Lane<T, L> {
    Lane(counts.map(|count| T::of(0.5).powi(count as i32)))
}

/// exp(g_0/sqrt(4 pi)) (a(x) 1 + b(x) g^) of g times `scale`, with one exponent (Eq. 24 of [Now11]).
#[inline(always)]
fn linear_of<T: Real, const N: usize, const L: usize>(
    g: &LaneSh<T, L>,
    norm: Lane<T, L>,
    scale: Lane<T, L>,
    table: &ResponseTable<T>,
    out: &mut LaneSh<T, L>,
) {
    let x = norm * scale;
    let mean = g[0] * scale * (T::one() / whole::<T>());
    let (mut constant, mut slope) = (Lane::zero(), Lane::zero());
    for lane in 0..L {
        let (a, b) = table.at(x.0[lane]);
        let both = (mean.0[lane] + a.ln()).exp();
        constant.0[lane] = both * whole::<T>();
        slope.0[lane] = both * (b / a) * scale.0[lane];
    }
    out[0] = constant;
    for i in 1..N * N {
        out[i] = g[i] * slope;
    }
}

/// `linear`: the exponential of a sum of logarithms by Eq. 24 of [Now11]. N is the order, 2 to 6.
/// What comes out is still to be guarded.
#[inline(always)]
pub fn linear<T: Real, const N: usize, const L: usize>(
    g: &LaneSh<T, L>,
    table: &ResponseTable<T>,
    out: &mut LaneSh<T, L>,
) {
    linear_of::<T, N, L>(g, norm_above_mean::<T, N, L>(g), Lane::splat(T::one()), table, out);
}

/// Squares each lane as often as it says, guarded after each time and at the end, or not at all.
#[inline(always)]
fn square_up<T: Real, const N: usize, const L: usize>(u: &mut LaneSh<T, L>, counts: [u32; L], guarded: bool) {
    let mut squared = nothing();
    for step in 0..counts.into_iter().max().unwrap_or(0) {
        product::<T, N, L>(u, u, &mut squared);
        if guarded {
            guard::<T, N, L>(&mut squared);
        }
        let more = counts.map(|count| step < count);
        for (u, squared) in u.iter_mut().zip(&squared).take(N * N) {
            *u = squared.or(more, *u);
        }
    }
    if guarded {
        guard::<T, N, L>(u);
    }
}

/// `hybrid`: `linear` of g/2^p, p = max(0, ceil log2 |g^|), then p squarings. The mean's exponent is
/// spread over the squarings, so nothing overflows. `guarded`: after each of them and at the
/// end, as every frame wants it; without it overlaps blow up. Returns p of each lane.
#[inline(always)]
pub fn hybrid<T: Real, const N: usize, const L: usize>(
    g: &LaneSh<T, L>,
    table: &ResponseTable<T>,
    guarded: bool,
    out: &mut LaneSh<T, L>,
) -> [u32; L] {
    let norm = norm_above_mean::<T, N, L>(g);
    let counts = halvings(norm, T::one());
    linear_of::<T, N, L>(g, norm, halved(counts), table, out);
    square_up::<T, N, L>(out, counts, guarded);
    counts
}

/// `squared`: 1 + g^ + g^ g^/2 of g^/2^p with |g^|/2^p <= 1/2, then p squarings; the mean's exponent is spread
/// over them. `guarded` as for `hybrid`.
#[inline(always)]
pub fn squared<T: Real, const N: usize, const L: usize>(
    g: &LaneSh<T, L>,
    guarded: bool,
    out: &mut LaneSh<T, L>,
) {
    let counts = halvings(norm_above_mean::<T, N, L>(g), T::of(0.5));
    let scale = halved::<T, L>(counts);
    let mut rest = nothing();
    for i in 1..N * N {
        rest[i] = g[i] * scale;
    }
    product::<T, N, L>(&rest, &rest, out);
    let mean = (g[0] * scale * (T::one() / whole::<T>())).map(T::exp);
    for i in 0..N * N {
        let one = if i == 0 { whole() } else { T::zero() };
        out[i] = (out[i] * T::of(0.5) + rest[i] + Lane::splat(one)) * mean;
    }
    square_up::<T, N, L>(out, counts, guarded);
}

/// exp(M_g) 1, the limit of `squared`: what the log domain can give at best. For tests and comparisons, not for
/// frames; not guarded. Slices have order^2 numbers.
pub fn exact<T: Real>(order: usize, g: &[T], out: &mut [T]) {
    let count = order.clamp(1, MAX_ORDER).pow(2);
    let norm = g.iter().take(count).fold(T::zero(), |sum, g| sum + *g * *g).sqrt();
    // |M_g| is at most the largest value of g, which is at most norm * order / sqrt(4 pi).
    let steps = (norm * T::of(2.0)).ceil().to_usize().unwrap_or(1).clamp(1, 4096);
    let share = T::one() / T::of(steps as f64);
    let mut sum = vec![T::zero(); count];
    sum[0] = whole();
    let mut next = vec![T::zero(); count];
    for _ in 0..steps {
        let mut term = sum.clone();
        for degree in 1..=16 {
            scalar_product::product(order, g, &term, &mut next);
            let factor = share / T::of(f64::from(degree));
            for ((term, next), sum) in term.iter_mut().zip(&next).zip(sum.iter_mut()) {
                *term = *next * factor;
                *sum += *term;
            }
        }
    }
    out[..count].copy_from_slice(&sum);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_table_is_within_its_error() {
        for order in 2..=MAX_ORDER {
            let table = LogTable::<f32>::new(order);
            let (mut small, mut large) = (0.0f64, 0.0f64);
            for step in 0..4000 {
                // Between the nodes.
                let q = (f64::from(step) + 0.37) / 4000.0;
                let mut g = [0.0f64; MAX_ORDER];
                log_cap(order, q * (2.0 - q), &mut g);
                let norm = g.iter().map(|g| g * g).sum::<f64>().sqrt();
                let read = table.at(q as f32);
                let off: f64 = (0..order)
                    .map(|l| {
                        let turn = (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt();
                        (f64::from(read[l]) / turn - g[l]).powi(2)
                    })
                    .sum();
                let relative = off.sqrt() / norm;
                // 1 - cos 30 degrees.
                if q < 0.134 { small = small.max(relative) } else { large = large.max(relative) }
            }
            println!("order {order}: log table within {small:.1e} up to 30 degrees, {large:.1e} beyond");
            assert!(
                small < SMALL_CAPS_ERROR && large < LARGE_CAPS_ERROR,
                "order {order}: {small:e}, {large:e}"
            );
            assert_eq!(table.at(0.0), [0.0; 8]);
            assert_eq!(table.at(2.0)[..order], table.at(1.0).map(|g| g * 2.0)[..order]);
        }
    }

    /// Relative errors of the table of logarithms, up to 30 degrees and beyond: measured 1.3e-4 and 3.6e-3.
    const SMALL_CAPS_ERROR: f64 = 2e-4;
    const LARGE_CAPS_ERROR: f64 = 5e-3;

    #[test]
    fn the_response_table_is_within_its_error() {
        for order in 2..=MAX_ORDER {
            let table = ResponseTable::<f64>::new(order);
            let (mut near, mut middle, mut far) = (0.0f64, 0.0f64, 0.0f64);
            for step in 0..640 {
                let x = f64::from(step) * 0.05 + 0.01;
                let (a, b) = linear_response(order, x);
                let (read_a, read_b) = table.at(x);
                let off = (read_a / a - 1.0).abs().max((read_b / b - 1.0).abs());
                let worst = if x < 2.0 {
                    &mut near
                } else if x < 8.0 {
                    &mut middle
                } else {
                    &mut far
                };
                *worst = worst.max(off);
            }
            println!(
                "order {order}: a and b within {near:.1e} below 2, {middle:.1e} below 8, {far:.1e} beyond"
            );
            assert!(near < 1e-3 && middle < 1e-2 && far < 0.15, "order {order}: {near:e} {middle:e} {far:e}");
            assert_eq!(table.at(1e9), table.nodes[RESPONSE_NODES - 1]);
            assert_eq!(table.at(0.0), (1.0, 1.0));
        }
    }

    #[test]
    fn small_x_is_the_series() {
        // a = 1 + x^2/(8 pi) + O(x^3), b = 1 + O(x).
        for order in 2..=MAX_ORDER {
            let (a, b) = linear_response(order, 1e-3);
            assert!((a - 1.0 - 1e-6 / (8.0 * std::f64::consts::PI)).abs() < 1e-10, "{a}");
            assert!((b - 1.0).abs() < 1e-3, "{b}");
        }
    }
}
