//! Rotation of SH coefficients by any rotation matrix.

use super::{MAX_COEFFICIENTS, MAX_ORDER, Real, basis};
use crate::quadrature;
use std::sync::OnceLock;

/// Entries of all band matrices: the sum of (2l+1)^2.
const ENTRIES: usize = 286;

/// A rotation as one (2l+1) x (2l+1) matrix for each band.
#[derive(Clone, Debug)]
pub struct Rotation<T> {
    order: usize,
    /// Band after band, row by row.
    entries: [T; ENTRIES],
}

/// Directions with weights times the basis there, exact for products of two functions of order 6.
fn nodes() -> &'static [([f64; 3], [f64; MAX_COEFFICIENTS])] {
    static NODES: OnceLock<Vec<([f64; 3], [f64; MAX_COEFFICIENTS])>> = OnceLock::new();
    NODES.get_or_init(|| {
        quadrature::sphere(2 * (MAX_ORDER - 1))
            .into_iter()
            .map(|(direction, weight)| {
                let mut y = [0.0; MAX_COEFFICIENTS];
                basis::evaluate(MAX_ORDER, direction, &mut y);
                (direction, y.map(|value| value * weight))
            })
            .collect()
    })
}

impl<T: Real> Rotation<T> {
    /// Prepares a rotation. `matrix` is given row by row and maps directions, `to_from_from`: a function f becomes
    /// f' with f'(R w) = f(w), so coefficients in the frame `from` become coefficients in the frame `to`.
    ///
    /// M_mn = integral y_lm(R w) y_ln(w) dw, by quadrature that is exact for it: within 1e-14 in f64 and
    /// 1e-6 in f32 where the matrix is orthonormal. `order` is taken into 1..=6.
    pub fn new(order: usize, matrix: [[T; 3]; 3]) -> Self {
        let order = order.clamp(1, MAX_ORDER);
        let mut entries = [T::zero(); ENTRIES];
        let mut turned = [T::zero(); MAX_COEFFICIENTS];
        for (direction, weighted) in nodes() {
            let [x, y, z] = direction.map(T::of);
            basis::evaluate(order, matrix.map(|row| row[0] * x + row[1] * y + row[2] * z), &mut turned);
            let mut entry = entries.iter_mut();
            for l in 0..order {
                let band = l * l..(l + 1) * (l + 1);
                for m in band.clone() {
                    for (value, entry) in weighted[band.clone()].iter().zip(&mut entry) {
                        *entry += turned[m] * T::of(*value);
                    }
                }
            }
        }
        Self { order, entries }
    }

    /// Order that it was made for.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Rotates order^2 coefficients. Each band keeps its norm; no band flows into another.
    pub fn apply(&self, coefficients: &[T], out: &mut [T]) {
        self.each(|m, n, entry| {
            let term = entry * coefficients[n];
            out[m] = if self.starts(m, n) { term } else { out[m] + term };
        });
    }

    /// Rotates order^2 rows of C channels (r, g, b), each channel alike.
    pub fn apply_rows<const C: usize>(&self, rows: &[[T; C]], out: &mut [[T; C]]) {
        self.each(|m, n, entry| {
            for c in 0..C {
                let term = entry * rows[n][c];
                out[m][c] = if self.starts(m, n) { term } else { out[m][c] + term };
            }
        });
    }

    /// Whether n is the first column of m's band.
    fn starts(&self, m: usize, n: usize) -> bool {
        n == m.isqrt().pow(2)
    }

    /// Every entry with its row and column as coefficient indices.
    fn each(&self, mut visit: impl FnMut(usize, usize, T)) {
        let mut entry = self.entries.iter();
        for l in 0..self.order {
            for m in l * l..(l + 1) * (l + 1) {
                for (n, entry) in (l * l..(l + 1) * (l + 1)).zip(&mut entry) {
                    visit(m, n, *entry);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec3};
    use proptest::prelude::*;

    fn rows(q: DQuat) -> [[f64; 3]; 3] {
        DMat3::from_quat(q).transpose().to_cols_array_2d()
    }

    fn rotation() -> impl Strategy<Value = DQuat> {
        prop::array::uniform4(-1.0..1.0_f64)
            .prop_filter("a direction in 4D", |q| q.iter().map(|v| v * v).sum::<f64>() > 0.01)
            .prop_map(|q| DQuat::from_array(q).normalize())
    }

    fn coefficients() -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(-2.0..2.0_f64, 36)
    }

    fn value(coefficients: &[f64], direction: DVec3) -> f64 {
        let mut y = [0.0; 36];
        basis::evaluate(6, direction.to_array(), &mut y);
        coefficients.iter().zip(y).map(|(c, y)| c * y).sum()
    }

    #[test]
    fn the_identity_changes_nothing() {
        let f: [f64; 36] = std::array::from_fn(|i| (i as f64).cos());
        let mut g = [0.0; 36];
        Rotation::new(6, rows(DQuat::IDENTITY)).apply(&f, &mut g);
        for (f, g) in f.iter().zip(g) {
            assert!((f - g).abs() < 1e-13);
        }
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let mut x_axis = [0.0; 4];
        basis::evaluate(2, [1.0, 0.0, 0.0], &mut x_axis);
        let mut turned = [0.0; 4];
        Rotation::new(2, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).apply(&x_axis, &mut turned);
        let mut y_axis = [0.0_f64; 4];
        basis::evaluate(2, [0.0, 1.0, 0.0], &mut y_axis);
        for (got, want) in turned.iter().zip(y_axis) {
            assert!((got - want).abs() < 1e-14);
        }
    }

    proptest! {
        #[test]
        fn the_function_turns_along(q in rotation(), f in coefficients(), d in rotation()) {
            let mut g = vec![0.0; 36];
            let turn = Rotation::new(6, rows(q));
            turn.apply(&f, &mut g);
            let direction = d * DVec3::Z;
            // f'(R w) = f(w); 36 terms of size 2.
            let off = (value(&g, q * direction) - value(&f, direction)).abs();
            prop_assert!(off < 1e-12, "off by {off:e}");
            for l in 0..6 {
                let norm = |c: &[f64]| c[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum::<f64>().sqrt();
                prop_assert!((norm(&f) - norm(&g)).abs() < 1e-12);
            }
            let mut back = vec![0.0; 36];
            Rotation::new(6, rows(q.conjugate())).apply(&g, &mut back);
            prop_assert!(back.iter().zip(&f).all(|(a, b)| (a - b).abs() < 1e-12));
            // Channels alike, lower orders alike, f32 within its own rounding.
            let pairs: Vec<[f64; 2]> = f.iter().map(|v| [*v, -2.0 * v]).collect();
            let mut pairs_out = vec![[0.0; 2]; 16];
            let low = Rotation::new(4, rows(q));
            low.apply_rows(&pairs[..16], &mut pairs_out);
            let single = Rotation::new(6, rows(q).map(|row| row.map(|v| v as f32)));
            let mut single_out = vec![0.0; 36];
            single.apply(&f.iter().map(|v| *v as f32).collect::<Vec<_>>(), &mut single_out);
            for i in 0..36 {
                prop_assert!(i >= 16 || (pairs_out[i][0] - g[i]).abs() < 1e-12);
                prop_assert!(i >= 16 || (pairs_out[i][1] + 2.0 * g[i]).abs() < 1e-12);
                prop_assert!((f64::from(single_out[i]) - g[i]).abs() < 2e-5);
            }
            prop_assert_eq!((turn.order(), low.order()), (6, 4));
        }
    }
}
