//! Short vectors over f32 or f64, for formulas that run in both. Elsewhere vectors are glam's.

use super::sh::Real;
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A vector of `N` numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector<T, const N: usize>(pub [T; N]);

impl<T: Real, const N: usize> Vector<T, N> {
    /// All zero.
    pub fn zero() -> Self {
        Self([T::zero(); N])
    }

    /// The unit vector along an axis; zero for an axis from `N` on.
    pub fn axis(axis: usize) -> Self {
        Self(from_fn(|i| if i == axis { T::one() } else { T::zero() }))
    }

    /// The first `N` numbers; zero for those that are not there.
    pub fn from_slice(numbers: &[T]) -> Self {
        Self(from_fn(|i| numbers.get(i).copied().unwrap_or(T::zero())))
    }

    /// Sum of products, in the order of the numbers.
    pub fn dot(self, other: Self) -> T {
        let mut sum = self.0[0] * other.0[0];
        for i in 1..N {
            sum += self.0[i] * other.0[i];
        }
        sum
    }

    /// Euclidean length.
    pub fn length(self) -> T {
        self.dot(self).sqrt()
    }

    /// Squared distance to another.
    pub fn distance_squared(self, other: Self) -> T {
        (self - other).dot(self - other)
    }

    /// The same direction with length 1; `None` for a zero vector and for one that is not finite.
    pub fn unit(self) -> Option<Self> {
        let shrink = T::one() / self.length();
        (shrink.is_finite() && shrink > T::zero()).then(|| self * shrink)
    }

    /// Whether no number is infinite or NaN.
    pub fn is_finite(self) -> bool {
        self.0.iter().all(|v| v.is_finite())
    }
}

impl<T: Real> Vector<T, 2> {
    /// x y' - y x': positive where the other lies on the side of +y from +x.
    pub fn cross(self, other: Self) -> T {
        self.0[0] * other.0[1] - self.0[1] * other.0[0]
    }

    /// With a third number.
    pub fn extend(self, z: T) -> Vector<T, 3> {
        Vector([self.0[0], self.0[1], z])
    }
}

impl<T: Real> Vector<T, 3> {
    /// The vector product.
    pub fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - y * c, c * x - z * a, a * y - x * b])
    }

    /// A unit vector at right angles to this unit vector, without a branch but the sign of z: the first row of
    /// the frame I - v v^T / (1 + |z|) with the sign put right.
    pub fn across(self) -> Self {
        let [x, y, z] = self.0;
        let sign = z.signum();
        let shrink = -T::one() / (sign + z);
        Self([x * y * shrink, sign + y * y * shrink, -y])
    }

    /// Without the third number, over it: the point of the plane z = 1.
    pub fn on_plane(self) -> Vector<T, 2> {
        let [x, y, z] = self.0;
        Vector([x / z, y / z])
    }
}

impl<T: Real, const N: usize> Add for Vector<T, N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl<T: Real, const N: usize> Sub for Vector<T, N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(from_fn(|i| self.0[i] - other.0[i]))
    }
}

impl<T: Real, const N: usize> Mul<T> for Vector<T, N> {
    type Output = Self;
    fn mul(self, factor: T) -> Self {
        Self(self.0.map(|v| v * factor))
    }
}

impl<T: Real, const N: usize> Div<T> for Vector<T, N> {
    type Output = Self;
    fn div(self, divisor: T) -> Self {
        Self(self.0.map(|v| v / divisor))
    }
}

impl<T: Real, const N: usize> Neg for Vector<T, N> {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|v| -v))
    }
}

impl From<glam::DVec2> for Vector<f64, 2> {
    fn from(v: glam::DVec2) -> Self {
        Self(v.to_array())
    }
}

impl From<glam::DVec3> for Vector<f64, 3> {
    fn from(v: glam::DVec3) -> Self {
        Self(v.to_array())
    }
}

impl From<Vector<f64, 2>> for glam::DVec2 {
    fn from(v: Vector<f64, 2>) -> Self {
        Self::from_array(v.0)
    }
}

impl From<Vector<f64, 3>> for glam::DVec3 {
    fn from(v: Vector<f64, 3>) -> Self {
        Self::from_array(v.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec2, DVec3};
    use proptest::prelude::*;

    #[test]
    fn nothing_has_no_direction() {
        assert_eq!(Vector([0.0_f32; 3]).unit(), None);
        assert_eq!(Vector([f64::NAN, 1.0, 0.0]).unit(), None);
        assert_eq!(Vector([f32::INFINITY, 1.0, 0.0]).unit(), None);
        assert_eq!(Vector::<f64, 2>::axis(2), Vector::zero());
    }

    proptest! {
        /// The same bits as glam's, so that a formula may move from one to the other.
        #[test]
        fn products_are_glams(a in prop::array::uniform3(-5.0..5.0_f64), b in prop::array::uniform3(-5.0..5.0_f64)) {
            let (u, v) = (Vector(a), Vector(b));
            let (p, q) = (DVec3::from(a), DVec3::from(b));
            prop_assert_eq!(u.dot(v), p.dot(q));
            prop_assert_eq!(DVec3::from(u.cross(v)), p.cross(q));
            prop_assert_eq!(u.unit().map(DVec3::from), p.try_normalize());
            prop_assert_eq!(u.distance_squared(v), p.distance_squared(q));
            let (p, q) = (p.truncate(), q.truncate());
            prop_assert_eq!(Vector::from(p).cross(q.into()), p.perp_dot(q));
            prop_assert_eq!(DVec2::from(u.on_plane()), p / a[2]);
        }

        #[test]
        fn across_is_at_right_angles(v in prop::array::uniform3(-1.0..1.0_f32)) {
            let Some(v) = Vector(v).unit() else { return Ok(()) };
            let side = v.across();
            // A few units in the last place of 1.
            prop_assert!(side.dot(v).abs() < 4e-7 && (side.length() - 1.0).abs() < 4e-7, "{side:?}");
        }
    }
}
