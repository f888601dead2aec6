//! Visibility by soft tests of fixed directions (the rung `directions`): no logarithm, no product, no guard.
//! L receivers side by side.

use super::{Real, lanes::Lane};

/// Half the step between N directions, softened: h = 0.7 sqrt(4 pi/N), radians.
pub fn softness(count: usize) -> f64 {
    0.7 * (4.0 * std::f64::consts::PI / count.max(1) as f64).sqrt()
}

/// One cap of each receiver as a ramp of the cosine: v(w) = clamp(threshold - slope w.axis, 0, 1), which is
/// clamp((cos s - w.axis)/(h sin max(s, h/2)) + 1/2, 0, 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp<T, const L: usize> {
    /// slope times the axis.
    pub scaled_axis: [Lane<T, L>; 3],
    /// Value at w.axis = 0.
    pub threshold: Lane<T, L>,
    /// 1/(h sin max(s, h/2)).
    pub slope: Lane<T, L>,
}

impl<T: Real, const L: usize> Ramp<T, L> {
    /// Of caps about `axis`, R = sin^2 and `cosine` of their half angle s; `softness` is h, `least_sine` sin(h/2).
    #[inline(always)]
    pub fn of_cap(
        axis: [Lane<T, L>; 3],
        sine_squared: Lane<T, L>,
        cosine: Lane<T, L>,
        softness: T,
        least_sine: T,
    ) -> Self {
        let slope = sine_squared.sqrt().at_least(least_sine).map(|sine| T::one() / (softness * sine));
        Self {
            scaled_axis: axis.map(|v| v * slope),
            threshold: cosine * slope + Lane::splat(T::of(0.5)),
            slope,
        }
    }

    /// The same for caps narrower than the ramp itself, q = 1 - cosine of the half angle: thinned so that they hide their own
    /// solid angle in the mean. The ramp hides (q + e)^2 / (4 e) for q below e = h sin max(s, h/2) / 2, where its
    /// peak is below 1: a quarter of e for no cap at all. From e on (half angles above about h/sqrt 2) nothing changes.
    #[inline(always)]
    pub fn thinned(mut self, q: Lane<T, L>) -> Self {
        let one = Lane::splat(T::one());
        let share = q.zip(self.slope, |q, slope| {
            let e = T::of(0.5) / slope;
            let both = q + e;
            if q < e { T::of(4.0) * q * e / (both * both) } else { T::one() }
        });
        self.scaled_axis = self.scaled_axis.map(|v| v * share);
        self.threshold = one - share + share * self.threshold;
        self.slope = self.slope * share;
        self
    }

    /// How much of a direction each receiver sees, 0 to 1.
    #[inline(always)]
    pub fn at(&self, direction: [T; 3]) -> Lane<T, L> {
        let [x, y, z] = self.scaled_axis;
        let along = x * direction[0] + y * direction[1] + z * direction[2];
        (self.threshold - along).at_most(T::one()).at_least(T::zero())
    }
}
