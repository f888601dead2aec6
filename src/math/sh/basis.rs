//! The basis functions y_lm as polynomials of (x, y, z): no angle is ever formed.

use super::{MAX_ORDER, Real};

/// Square root by Newton's iteration, for tables that are made while compiling (`f64::sqrt` is not `const`).
const fn const_sqrt(square: f64) -> f64 {
    let mut root = if square > 1.0 { square } else { 1.0 };
    let mut step = 0;
    while step < 64 {
        root = 0.5 * (root + square / root);
        step += 1;
    }
    root
}

/// y_mm / (sin theta)^m / cos(m phi): N_m = -sqrt((2m+1)/(2m)) N_{m-1}, N_0 = 1/sqrt(4 pi), times sqrt 2
/// for m > 0. The minus is the Condon-Shortley phase.
pub const DIAGONAL: [f64; MAX_ORDER] = {
    let mut table = [0.0; MAX_ORDER];
    let mut normalisation = const_sqrt(0.25 / std::f64::consts::PI);
    table[0] = normalisation;
    let mut m = 1;
    while m < MAX_ORDER {
        let twice = 2.0 * m as f64;
        normalisation *= -const_sqrt((twice + 1.0) / twice);
        table[m] = normalisation * std::f64::consts::SQRT_2;
        m += 1;
    }
    table
};

/// `[l][m]`: (a, b) of the three-term recurrence P_l^m = a (z P_{l-1}^m - b P_{l-2}^m) of normalised
/// associated Legendre functions with sin^m factored out.
pub const RECURRENCE: [[(f64, f64); MAX_ORDER]; MAX_ORDER] = {
    let mut table = [[(0.0, 0.0); MAX_ORDER]; MAX_ORDER];
    let mut l = 1;
    while l < MAX_ORDER {
        let mut m = 0;
        while m < l {
            let (l2, m2) = ((l * l) as f64, (m * m) as f64);
            let below = ((l - 1) * (l - 1)) as f64;
            table[l][m] = (
                const_sqrt((4.0 * l2 - 1.0) / (l2 - m2)),
                // Where l - 1 = m there is no P_{l-2}^m and the root is zero.
                if l - 1 == m { 0.0 } else { const_sqrt((below - m2) / (4.0 * below - 1.0)) },
            );
            m += 1;
        }
        l += 1;
    }
    table
};

/// All y_lm of bands 0..order-1 at a direction: Re/Im (x+iy)^m times a polynomial of z (Eq. 1 of [Now11],
/// with abs(m) in K and the Condon-Shortley phase inside P).
///
/// `direction` must be a unit vector: a length of 1+e costs about l e of relative accuracy.
/// `order` is taken into 1..=6; `out` must have room for order^2 numbers, the rest is left alone.
/// Largest absolute error in f32: 3e-7 at order 4, 8e-7 at order 6.
#[inline]
pub fn evaluate<T: Real>(order: usize, direction: [T; 3], out: &mut [T]) {
    let order = order.clamp(1, MAX_ORDER);
    let [x, y, z] = direction;
    // Real and imaginary part of (x + iy)^m.
    let (mut re, mut im) = (T::one(), T::zero());
    for m in 0..order {
        let (mut below, mut legendre) = (T::zero(), T::of(DIAGONAL[m]));
        for (l, row) in RECURRENCE.iter().enumerate().take(order).skip(m) {
            if l > m {
                let (a, b) = row[m];
                let next = T::of(a) * (z * legendre - T::of(b) * below);
                (below, legendre) = (legendre, next);
            }
            let centre = l * (l + 1);
            out[centre + m] = legendre * re;
            if m > 0 {
                out[centre - m] = legendre * im;
            }
        }
        (re, im) = (x * re - y * im, x * im + y * re);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_are_those_of_the_condon_shortley_phase() {
        let mut y = [0.0_f64; 4];
        evaluate(2, [0.36, 0.48, 0.8], &mut y);
        let k = (3.0 / (4.0 * std::f64::consts::PI)).sqrt();
        for (got, want) in y.iter().zip([0.5 / std::f64::consts::PI.sqrt(), -k * 0.48, k * 0.8, -k * 0.36]) {
            assert!((got - want).abs() < 1e-15, "{got} instead of {want}");
        }
    }

    #[test]
    fn const_sqrt_is_within_an_ulp() {
        for n in 1..200 {
            let x = f64::from(n) / 7.0;
            let got = const_sqrt(x);
            assert!((got - x.sqrt()).abs() <= f64::EPSILON * x.sqrt(), "sqrt({x}) = {got}");
        }
    }

    #[test]
    fn sum_of_squares_of_a_band_is_constant() {
        // Addition theorem at equal directions: sum_m y_lm^2 = (2l+1)/(4 pi).
        let direction = glam::DVec3::new(-0.7, -0.1, 0.05).normalize().to_array();
        let mut y = [0.0; 36];
        evaluate(6, direction, &mut y);
        for l in 0..6 {
            let sum: f64 = y[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum();
            let want = (2 * l + 1) as f64 / (4.0 * std::f64::consts::PI);
            assert!((sum - want).abs() < 1e-14, "band {l}: {sum} instead of {want}");
        }
    }

    #[test]
    fn nothing_is_written_beyond_the_order() {
        let mut y = [7.0_f32; 36];
        evaluate(3, [0.0, 0.0, 1.0], &mut y);
        assert!(y[9..].iter().all(|v| *v == 7.0) && y[..9].iter().all(|v| *v != 7.0));
    }
}
