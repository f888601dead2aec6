//! Exact quadrature of polynomials on [-1, 1] and on the sphere: where tables come from.

use std::f64::consts::PI;

/// Nodes and weights of the Gauss-Legendre rule with `count` points on [-1, 1], exact up to degree
/// 2 count - 1: the roots of P_n by Newton's iteration, w = 2 / ((1 - x^2) P_n'(x)^2).
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    (0..count)
        .map(|i| {
            let mut x = (PI * (i as f64 + 0.75) / (count as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..50 {
                let (value, derivative) = legendre(count, x);
                slope = derivative;
                let step = value / derivative;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// P_n(x) and its derivative by the three-term recurrence; x strictly inside (-1, 1).
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut below, mut here) = (0.0, 1.0);
    for l in 1..=n {
        let l = l as f64;
        (below, here) = (here, ((2.0 * l - 1.0) * x * here - (l - 1.0) * below) / l);
    }
    (here, n as f64 * (x * here - below) / (x * x - 1.0))
}

/// Unit directions and weights (steradians, summing to 4 pi) that integrate every polynomial of x, y, z up to
/// `degree` exactly: Gauss-Legendre in z times equal steps in phi.
pub fn sphere(degree: usize) -> Vec<([f64; 3], f64)> {
    let steps = degree + 1;
    let mut nodes = Vec::with_capacity((degree / 2 + 1) * steps);
    for (z, weight) in gauss_legendre(degree / 2 + 1) {
        let sine = (1.0 - z * z).sqrt();
        for step in 0..steps {
            let (sin_phi, cos_phi) = (2.0 * PI * step as f64 / steps as f64).sin_cos();
            nodes.push(([sine * cos_phi, sine * sin_phi, z], weight * 2.0 * PI / steps as f64));
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_up_to_the_stated_degree() {
        for count in 1..=9 {
            for power in 0..2 * count {
                let got: f64 = gauss_legendre(count).iter().map(|(x, w)| w * x.powi(power as i32)).sum();
                let want = if power % 2 == 0 { 2.0 / (power as f64 + 1.0) } else { 0.0 };
                assert!((got - want).abs() < 1e-14, "{count} points, x^{power}: {got}");
            }
        }
    }

    #[test]
    fn moments_of_the_sphere() {
        let integral = |f: fn([f64; 3]) -> f64| sphere(6).iter().map(|(d, w)| w * f(*d)).sum::<f64>();
        assert!((integral(|_| 1.0) - 4.0 * PI).abs() < 1e-13);
        assert!((integral(|[x, ..]| x * x) - 4.0 * PI / 3.0).abs() < 1e-13);
        assert!((integral(|[x, y, z]| (x * y * z).powi(2)) - 4.0 * PI / 105.0).abs() < 1e-14);
        assert!(integral(|[x, y, z]| x * y * z).abs() < 1e-14);
    }
}
