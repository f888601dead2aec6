//! Products of functions given by SH: the sparse triple-product tensor, the truncated product and the
//! product matrix.

use super::{MAX_COEFFICIENTS, MAX_ORDER, Real, basis};
use crate::quadrature;
use std::sync::OnceLock;

/// One entry of the triple-product tensor, i <= j <= k; it is the same for every permutation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gamma {
    /// Smallest index.
    pub i: usize,
    /// Middle index.
    pub j: usize,
    /// Largest index.
    pub k: usize,
    /// Integral of y_i y_j y_k over the sphere.
    pub integral: f64,
}

/// Below this an integral is zero by symmetry: the quadrature's rounding is about 1e-15, the smallest true
/// entry of order 6 is above 1e-3.
const ZERO: f64 = 1e-12;

/// The entries of Gamma_ijk = integral y_i y_j y_k (Eq. 4 of [Now11]) that are not zero, for orders 1..=6, with
/// i <= j <= k, ascending in k. 4, 25, 77, 238 and 549 of them at orders 2 to 6. Made once, by exact quadrature.
pub fn gamma(order: usize) -> &'static [Gamma] {
    static TABLE: OnceLock<Vec<Gamma>> = OnceLock::new();
    let table = TABLE.get_or_init(make_table);
    let count = order.clamp(1, MAX_ORDER).pow(2);
    &table[..table.partition_point(|g| g.k < count)]
}

fn make_table() -> Vec<Gamma> {
    // Three factors of degree 5.
    let nodes: Vec<([f64; MAX_COEFFICIENTS], f64)> = quadrature::sphere(3 * (MAX_ORDER - 1))
        .into_iter()
        .map(|(direction, weight)| {
            let mut y = [0.0; MAX_COEFFICIENTS];
            basis::evaluate(MAX_ORDER, direction, &mut y);
            (y, weight)
        })
        .collect();
    let mut table = Vec::new();
    for k in 0..MAX_COEFFICIENTS {
        for j in 0..=k {
            for i in 0..=j {
                let integral: f64 = nodes.iter().map(|(y, weight)| weight * y[i] * y[j] * y[k]).sum();
                if integral.abs() > ZERO {
                    table.push(Gamma { i, j, k, integral });
                }
            }
        }
    }
    table
}

/// The product of two functions, projected to the same order: h_k = sum_ij Gamma_ijk f_i g_j (Eq. 4 of [Now11]).
///
/// Because it is truncated it is commutative but not associative. All slices have order^2 numbers or more.
pub fn product<T: Real>(order: usize, f: &[T], g: &[T], out: &mut [T]) {
    let count = order.clamp(1, MAX_ORDER).pow(2);
    out[..count].fill(T::zero());
    for &Gamma { i, j, k, integral } in gamma(order) {
        let weight = T::of(integral);
        let mut add = |to: usize, a: usize, b: usize| {
            let both = if a == b { f[a] * g[a] } else { f[a] * g[b] + f[b] * g[a] };
            out[to] += weight * both;
        };
        // Each different choice of the output index once.
        add(k, i, j);
        if j != k {
            add(j, i, k);
        }
        if i != j {
            add(i, j, k);
        }
    }
}

/// The symmetric matrix, row by row, that multiplies by f: M_kj = sum_i Gamma_ijk f_i (Eq. 5 of [Now11]), so that
/// `product(f, g) = M g`. `out` has room for order^4 numbers.
pub fn product_matrix<T: Real>(order: usize, f: &[T], out: &mut [T]) {
    let count = order.clamp(1, MAX_ORDER).pow(2);
    out[..count * count].fill(T::zero());
    for &Gamma { i, j, k, integral } in gamma(order) {
        let weight = T::of(integral);
        let mut add = |of: usize, row: usize, column: usize| {
            out[row * count + column] += weight * f[of];
            if row != column {
                out[column * count + row] += weight * f[of];
            }
        };
        add(k, i, j);
        if j != k {
            add(j, i, k);
        }
        if i != j {
            add(i, j, k);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn as_many_entries_as_the_spec_counts() {
        let unique: Vec<usize> = (2..=6).map(|order| gamma(order).len()).collect();
        assert_eq!(unique, [4, 25, 77, 238, 549]);
        let all = |order| -> usize {
            gamma(order)
                .iter()
                .map(|g| {
                    if g.i == g.k {
                        1
                    } else if g.i == g.j || g.j == g.k {
                        3
                    } else {
                        6
                    }
                })
                .sum()
        };
        assert_eq!((2..=6).map(all).collect::<Vec<_>>(), [10, 83, 353, 1158, 2907]);
        let smallest = gamma(6).iter().map(|g| g.integral.abs()).fold(1.0, f64::min);
        assert!(smallest > 1e-3, "{smallest}");
    }

    #[test]
    fn a_constant_scales() {
        // Gamma_0jk = delta_jk/sqrt(4 pi): the constant 1 is (sqrt(4 pi), 0, ..).
        let mut one = [0.0_f64; 36];
        one[0] = (4.0 * std::f64::consts::PI).sqrt();
        let f: [f64; 36] = std::array::from_fn(|i| (i as f64 * 0.7).sin());
        let mut h = [0.0; 36];
        product(6, &one, &f, &mut h);
        for (got, want) in h.iter().zip(f) {
            assert!((got - want).abs() < 1e-14);
        }
    }

    proptest! {
        #[test]
        fn the_matrix_multiplies(
            f in prop::collection::vec(-2.0..2.0_f64, 36), g in prop::collection::vec(-2.0..2.0_f64, 36), order in 1..=6_usize,
        ) {
            let count = order * order;
            let (mut fg, mut gf, mut matrix) = ([0.0; 36], [0.0; 36], vec![0.0; count * count]);
            product(order, &f, &g, &mut fg);
            product(order, &g, &f, &mut gf);
            product_matrix(order, &f, &mut matrix);
            for k in 0..count {
                prop_assert!((fg[k] - gf[k]).abs() < 1e-13);
                let row: f64 = (0..count).map(|j| matrix[k * count + j] * g[j]).sum();
                prop_assert!((row - fg[k]).abs() < 1e-12);
                prop_assert!((0..count).all(|j| matrix[k * count + j] == matrix[j * count + k]));
            }
        }

        #[test]
        fn the_product_is_the_projected_product(
            f in prop::collection::vec(-2.0..2.0_f64, 16), g in prop::collection::vec(-2.0..2.0_f64, 16),
        ) {
            let mut h = [0.0; 16];
            product(4, &f, &g, &mut h);
            let mut want = [0.0; 16];
            for (direction, weight) in quadrature::sphere(9) {
                let mut y = [0.0; 16];
                basis::evaluate(4, direction, &mut y);
                let value = |c: &[f64]| c.iter().zip(y).map(|(c, y)| c * y).sum::<f64>();
                let both = weight * value(&f) * value(&g);
                for (want, y) in want.iter_mut().zip(y) {
                    *want += both * y;
                }
            }
            for (h, want) in h.iter().zip(want) {
                prop_assert!((h - want).abs() < 1e-12);
            }
        }
    }
}
