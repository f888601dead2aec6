//! Small dense systems: least squares by pivoted QR with a rank report and Cholesky, in f64, and the eigenvectors of
//! symmetric matrices, in f32 or f64.

use super::sh::Real;
use std::cmp::Ordering;

/// What least squares gave.
#[derive(Clone, Debug, PartialEq)]
pub struct LeastSquares {
    /// x that makes |A x - b| smallest; where the rank is short, free unknowns are zero.
    pub solution: Vec<f64>,
    /// Columns that are independent, numerically.
    pub rank: usize,
    /// |A x - b| / sqrt(rows).
    pub residual_rms: f64,
}

/// Minimises |A x - b| by Householder QR with column pivoting. `matrix` is A row by row, rows x columns;
/// `right` is b. Any shape; `None` where the lengths disagree or a number is not finite.
///
/// A column counts as dependent when its part that is new is below max(rows, columns) eps times the largest.
pub fn least_squares(rows: usize, columns: usize, matrix: &[f64], right: &[f64]) -> Option<LeastSquares> {
    let sized = matrix.len() == rows * columns && right.len() == rows && rows > 0;
    if !sized || !matrix.iter().chain(right).all(|v| v.is_finite()) {
        return None;
    }
    // Column after column, so that the inner loops run along memory.
    let mut a: Vec<Vec<f64>> =
        (0..columns).map(|c| (0..rows).map(|r| matrix[r * columns + c]).collect()).collect();
    let mut b = right.to_vec();
    let mut order: Vec<usize> = (0..columns).collect();
    let tail_norm = |column: &[f64], from: usize| dot(&column[from..], &column[from..]).sqrt();
    let mut norms: Vec<f64> = a.iter().map(|column| tail_norm(column, 0)).collect();
    let mut exact = norms.clone();
    let threshold = rows.max(columns) as f64 * f64::EPSILON * norms.iter().fold(0.0, |m: f64, n| m.max(*n));
    let mut diagonal = Vec::new();
    for step in 0..columns.min(rows) {
        let mut pivot = step;
        for c in step + 1..columns {
            if norms[c] > norms[pivot] {
                pivot = c;
            }
        }
        a.swap(step, pivot);
        order.swap(step, pivot);
        norms.swap(step, pivot);
        exact.swap(step, pivot);
        let length = tail_norm(&a[step], step);
        if !(length > threshold) {
            break;
        }
        // Householder vector v = x + sign(x_0)|x| e_0, kept in place of the column; R's entry apart.
        let head = a[step][step];
        let entry = if head > 0.0 { -length } else { length };
        diagonal.push(entry);
        a[step][step] = head - entry;
        // |v|^2 / 2
        let half = length * (length + head.abs());
        let (done, rest) = a.split_at_mut(step + 1);
        let vector = &done[step][step..];
        for (offset, column) in rest.iter_mut().enumerate() {
            reflect(vector, half, &mut column[step..]);
            let c = step + 1 + offset;
            let left = norms[c] * norms[c] - column[step] * column[step];
            norms[c] = left.max(0.0).sqrt();
            // Downdating loses digits; begin anew once it has lost half of them.
            if norms[c] < 1e-6 * exact[c] {
                norms[c] = tail_norm(column, step + 1);
                exact[c] = norms[c];
            }
        }
        reflect(vector, half, &mut b[step..]);
    }
    let rank = diagonal.len();
    let mut permuted = vec![0.0; rank];
    for row in (0..rank).rev() {
        let known: f64 = (row + 1..rank).map(|c| a[c][row] * permuted[c]).sum();
        permuted[row] = (b[row] - known) / diagonal[row];
    }
    let mut solution = vec![0.0; columns];
    for (position, x) in permuted.into_iter().enumerate() {
        solution[order[position]] = x;
    }
    let residual_rms = (dot(&b[rank..], &b[rank..]) / rows as f64).sqrt();
    Some(LeastSquares { solution, rank, residual_rms })
}

/// x - v (v.x)/half, with half = |v|^2/2.
fn reflect(v: &[f64], half: f64, x: &mut [f64]) {
    let share = dot(v, x) / half;
    for (x, v) in x.iter_mut().zip(v) {
        *x -= share * v;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves A x = b for a symmetric positive definite A (row by row, N x N) by Cholesky's A = L L^T. `None` where A
/// is not positive definite to working precision.
pub fn solve_positive<const N: usize>(matrix: &[[f64; N]; N], right: [f64; N]) -> Option<[f64; N]> {
    let mut lower = [[0.0; N]; N];
    for row in 0..N {
        for column in 0..=row {
            let known = dot(&lower[row][..column], &lower[column][..column]);
            let left = matrix[row][column] - known;
            if row == column {
                // The share of the diagonal that is left tells how dependent the row is.
                if !(left > matrix[row][row].abs() * N as f64 * f64::EPSILON) {
                    return None;
                }
                lower[row][row] = left.sqrt();
            } else {
                lower[row][column] = left / lower[column][column];
            }
        }
    }
    let mut x = right;
    for row in 0..N {
        x[row] = (x[row] - dot(&lower[row][..row], &x[..row])) / lower[row][row];
    }
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|below| lower[below][row] * x[below]).sum();
        x[row] = (x[row] - known) / lower[row][row];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// Eigenvalues, largest first, and unit eigenvectors (`vectors[i]` belongs to `values[i]`) of a symmetric matrix by
/// cyclic Jacobi rotations. Only the lower triangle is read. `None` where a number is not finite.
pub fn symmetric_eigen<T: Real, const N: usize>(matrix: &[[T; N]; N]) -> Option<([T; N], [[T; N]; N])> {
    let mut a = [[T::zero(); N]; N];
    for i in 0..N {
        for j in 0..=i {
            a[i][j] = matrix[i][j];
            a[j][i] = matrix[i][j];
        }
    }
    if !a.iter().flatten().all(|v| v.is_finite()) {
        return None;
    }
    // Rows of v are the eigenvectors.
    let mut v = [[T::zero(); N]; N];
    for (i, row) in v.iter_mut().enumerate() {
        row[i] = T::one();
    }
    let scale = a.iter().flatten().fold(T::zero(), |sum, v| sum + *v * *v);
    // Off the diagonal next to nothing: 1e-34 of the sum of squares in f64.
    let enough = scale * T::of(1e-34).max(T::of(1e-3) * T::epsilon() * T::epsilon());
    // Converges quadratically: 6 to 10 sweeps in practice.
    for _ in 0..50 {
        let below = (0..N).flat_map(|i| (0..i).map(move |j| (i, j)));
        let off = below.fold(T::zero(), |sum, (i, j)| sum + a[i][j] * a[i][j]);
        if !(off > enough) {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                if a[p][q] != T::zero() {
                    jacobi(&mut a, &mut v, p, q);
                }
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    // All are finite: rotations keep the sum of squares, but for overflow.
    order.sort_by(|i, j| a[*j][*j].partial_cmp(&a[*i][*i]).unwrap_or(Ordering::Equal));
    Some((order.map(|i| a[i][i]), order.map(|i| v[i])))
}

/// One rotation in the plane (p, q) that makes a_pq zero.
fn jacobi<T: Real, const N: usize>(a: &mut [[T; N]; N], v: &mut [[T; N]; N], p: usize, q: usize) {
    let theta = (a[q][q] - a[p][p]) / (T::of(2.0) * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(T::one()));
    let c = T::one() / t.hypot(T::one());
    let s = t * c;
    for row in a.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    for k in 0..N {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
        (v[p][k], v[q][k]) = (c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]);
    }
    // Exactly, not up to rounding: the sweep must end.
    a[p][q] = T::zero();
    a[q][p] = T::zero();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_line_through_three_points() {
        // y = 1 + 2 x with errors 1, -2, 1: least squares leaves them as they are (orthogonal to 1 and x).
        let fit = least_squares(3, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0], &[2.0, 1.0, 6.0]).unwrap();
        assert_eq!(fit.rank, 2);
        assert!((fit.solution[0] - 1.0).abs() < 1e-14 && (fit.solution[1] - 2.0).abs() < 1e-14);
        assert!((fit.residual_rms - 2.0_f64.sqrt()).abs() < 1e-14);
    }

    #[test]
    fn short_rank_is_told() {
        let fit = least_squares(3, 3, &[1.0, 2.0, 3.0, 2.0, 4.0, 6.0, 1.0, 0.0, 1.0], &[1.0, 2.0, 0.0]);
        assert_eq!(fit.unwrap().rank, 2);
        let wide = least_squares(1, 3, &[0.0, 2.0, 1.0], &[4.0]).unwrap();
        assert_eq!((wide.rank, wide.solution), (1, vec![0.0, 2.0, 0.0]));
        let nothing = least_squares(2, 2, &[0.0; 4], &[3.0, 4.0]).unwrap();
        assert_eq!((nothing.rank, nothing.solution), (0, vec![0.0, 0.0]));
        assert!((nothing.residual_rms - 12.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(least_squares(2, 1, &[1.0, f64::NAN], &[1.0, 1.0]), None);
        assert_eq!(least_squares(2, 2, &[1.0; 3], &[1.0, 1.0]), None);
        assert_eq!(solve_positive(&[[1.0, 2.0], [2.0, 1.0]], [1.0, 1.0]), None);
        assert_eq!(solve_positive(&[[0.0; 2]; 2], [1.0, 1.0]), None);
        assert_eq!(symmetric_eigen(&[[f64::NAN]]), None);
        assert_eq!(symmetric_eigen(&[[0.0_f64; 2]; 2]).unwrap().0, [0.0; 2]);
    }

    proptest! {
        #[test]
        fn normal_equations_hold(entries in prop::array::uniform32(-1.0..1.0_f64), b in prop::array::uniform8(-1.0..1.0_f64)) {
            let fit = least_squares(8, 4, &entries, &b).unwrap();
            prop_assume!(fit.rank == 4);
            let residual: Vec<f64> =
                (0..8).map(|r| dot(&entries[r * 4..r * 4 + 4], &fit.solution) - b[r]).collect();
            let size = fit.solution.iter().fold(1.0, |m: f64, x| m.max(x.abs()));
            for c in 0..4 {
                let gradient: f64 = (0..8).map(|r| entries[r * 4 + c] * residual[r]).sum();
                prop_assert!(gradient.abs() < 1e-12 * size, "column {c}: {gradient}");
            }
            // The same by Cholesky on A^T A, which loses twice the digits.
            let mut normal = [[0.0; 4]; 4];
            let mut right = [0.0; 4];
            for i in 0..4 {
                for j in 0..4 {
                    normal[i][j] = (0..8).map(|r| entries[r * 4 + i] * entries[r * 4 + j]).sum();
                }
                right[i] = (0..8).map(|r| entries[r * 4 + i] * b[r]).sum();
            }
            if size < 100.0 {
                let x = solve_positive(&normal, right).unwrap();
                for (a, b) in x.iter().zip(&fit.solution) {
                    prop_assert!((a - b).abs() < 1e-8 * size);
                }
            }
        }

        #[test]
        fn eigenvectors_diagonalise(lower in prop::array::uniform10(-3.0..3.0_f64)) {
            let mut matrix = [[0.0; 4]; 4];
            let mut next = lower.into_iter();
            for i in 0..4 {
                for j in 0..=i {
                    matrix[i][j] = next.next().unwrap();
                    matrix[j][i] = matrix[i][j];
                }
            }
            let (values, vectors) = symmetric_eigen(&matrix).unwrap();
            prop_assert!(values.is_sorted_by(|a, b| a >= b));
            for i in 0..4 {
                for j in 0..4 {
                    let along = dot(&vectors[i], &vectors[j]);
                    let want = if i == j { 1.0 } else { 0.0 };
                    prop_assert!((along - want).abs() < 1e-13);
                    let turned = dot(&matrix[j], &vectors[i]);
                    prop_assert!((turned - values[i] * vectors[i][j]).abs() < 1e-12);
                }
            }
        }
    }
}
