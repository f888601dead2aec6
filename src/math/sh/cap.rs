//! What one sphere hides from a point: a cap of directions, never more than a hemisphere.

use super::{Real, zonal};

/// The cap that a sphere of some radius about `to_centre` (from the receiver, the same unit) hides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cap<T> {
    /// Unit vector towards the centre.
    pub axis: [T; 3],
    /// R = sin^2 of the half angle = min((r/d)^2, 1) (Eq. 22 of [Now11]; 1 is a hemisphere).
    pub sine_squared: T,
}

impl<T: Real> Cap<T> {
    /// `None` where nothing is hidden (the radius is not above 0) or a number is not finite. A receiver inside sees a
    /// hemisphere hidden; one at the very centre sees it about `fallback_axis`, a unit vector.
    pub fn of_sphere(to_centre: [T; 3], radius: T, fallback_axis: [T; 3]) -> Option<Self> {
        let square = to_centre.iter().fold(T::zero(), |sum, v| sum + *v * *v);
        if !(radius > T::zero()) || !square.is_finite() || !radius.is_finite() {
            return None;
        }
        if !(square > T::min_positive_value()) {
            return Some(Self { axis: fallback_axis, sine_squared: T::one() });
        }
        let distance = square.sqrt();
        let ratio = radius / distance;
        Some(Self { axis: to_centre.map(|v| v / distance), sine_squared: (ratio * ratio).min(T::one()) })
    }

    /// Cosine of the half angle, 0 to 1.
    pub fn cosine(&self) -> T {
        (T::one() - self.sine_squared).max(T::zero()).sqrt()
    }

    /// Whether this cap lies in the other: angle between the axes + own half angle <= the other's.
    pub fn is_inside(&self, other: &Self) -> bool {
        let along = self.axis.iter().zip(other.axis).fold(T::zero(), |sum, (a, b)| sum + *a * b);
        let sines = (self.sine_squared * other.sine_squared).sqrt();
        self.sine_squared <= other.sine_squared && along >= self.cosine() * other.cosine() + sines
    }
}

/// Bands 0..order-1 of what is seen beside a sphere, V = 1 - B, axis +z: V_0 = sqrt(pi)(1+c), V_l = -sqrt(pi(2l+1)) R
/// P_l'(c)/(l(l+1)) (Eq. 23 of [Now11], exact). R is taken into [0, 1]; `out` has room for `order` numbers.
pub fn visible<T: Real>(order: usize, sine_squared: T, out: &mut [T]) {
    zonal::cap(order, sine_squared, out);
    for v in out.iter_mut().take(order) {
        *v = -*v;
    }
    if let Some(first) = out.first_mut().filter(|_| order > 0) {
        *first = (T::of(4.0) * T::PI()).sqrt() + *first;
    }
}

/// The product of the mean visibilities, V_0/sqrt(4 pi) = (1+c)/2 each: the DC rung.
pub fn mean_product<T: Real>(sines_squared: impl IntoIterator<Item = T>) -> T {
    sines_squared
        .into_iter()
        .fold(T::one(), |product, r| product * (T::one() - T::of(0.5) * zonal::one_minus_cosine(r)))
}
