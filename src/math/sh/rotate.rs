//! Rotation of SH coefficients by any rotation matrix.

use super::{MAX_COEFFICIENTS, MAX_ORDER, Real, basis};
use crate::math::quadrature;
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
