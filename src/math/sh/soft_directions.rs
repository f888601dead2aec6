//! Visibility by soft tests of fixed directions (the rung `directions`): no logarithm, no product, no guard.

use super::{Real, cap::Cap};

/// Direction j of N on the Fibonacci spiral: z = 1 - 2(j+1/2)/N, phi = pi (1 + sqrt 5)(j+1/2). Unit.
pub fn direction(j: usize, count: usize) -> [f64; 3] {
    let half = j as f64 + 0.5;
    let z = 1.0 - 2.0 * half / count.max(1) as f64;
    let phi = std::f64::consts::PI * (1.0 + 5.0_f64.sqrt()) * half;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    [sine * phi.cos(), sine * phi.sin(), z]
}

/// Half the step between N directions, softened: h = 0.7 sqrt(4 pi/N), radians.
pub fn softness(count: usize) -> f64 {
    0.7 * (4.0 * std::f64::consts::PI / count.max(1) as f64).sqrt()
}

/// One cap as a ramp of the cosine: v(w) = clamp(threshold - slope w.axis, 0, 1), which is
/// clamp((cos s - w.axis)/(h sin max(s, h/2)) + 1/2, 0, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp<T> {
    /// slope times the axis.
    pub scaled_axis: [T; 3],
    /// Value at w.axis = 0.
    pub threshold: T,
    /// 1/(h sin max(s, h/2)).
    pub slope: T,
}

impl<T: Real> Ramp<T> {
    /// `softness` is h, `least_sine` sin(h/2).
    #[inline(always)]
    pub fn of_cap(cap: &Cap<T>, softness: T, least_sine: T) -> Self {
        let slope = T::one() / (softness * cap.sine_squared.sqrt().max(least_sine));
        Self { scaled_axis: cap.axis.map(|v| v * slope), threshold: cap.cosine() * slope + T::of(0.5), slope }
    }

    /// How much of a direction is seen, 0 to 1.
    #[inline(always)]
    pub fn at(&self, direction: [T; 3]) -> T {
        let [x, y, z] = self.scaled_axis;
        let open = self.threshold - (x * direction[0] + y * direction[1] + z * direction[2]);
        let open = if open < T::one() { open } else { T::one() };
        if open > T::zero() { open } else { T::zero() }
    }
}
