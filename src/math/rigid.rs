//! Quaternions and rigid transforms over f32 or f64. `pose` gives them as glam's types in f64.

use super::{sh::Real, solve::symmetric_eigen, vector::Vector};

/// A quaternion x i + y j + z k + w; a rotation where its length is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quaternion<T>(pub [T; 4]);

impl<T: Real> Quaternion<T> {
    /// The rotation that leaves all as it is.
    pub fn identity() -> Self {
        Self([T::zero(), T::zero(), T::zero(), T::one()])
    }

    /// Unit length again; a zero or non-finite quaternion becomes the identity.
    pub fn renormalised(self) -> Self {
        let length = self.dot(self).sqrt();
        if length.is_finite() && length > T::of(1e-12) {
            Self((Vector(self.0) / length).0)
        } else {
            Self::identity()
        }
    }

    /// A turn by `angle_rad` about a unit axis, counter-clockwise seen from its tip.
    pub fn about(axis: Vector<T, 3>, angle_rad: T) -> Self {
        let (sine, cosine) = (angle_rad * T::of(0.5)).sin_cos();
        let [x, y, z] = (axis * sine).0;
        Self([x, y, z, cosine])
    }

    /// exp of a rotation vector: the turn by its length, radians, about it.
    pub fn exp(vector: Vector<T, 3>) -> Self {
        let length = vector.length();
        if length == T::zero() {
            return Self::identity();
        }
        Self::about(vector / length, length)
    }

    /// The shortest turn of one unit vector into another; for opposite ones, half a turn about any axis across.
    pub fn arc(from: Vector<T, 3>, to: Vector<T, 3>) -> Self {
        let cosine = from.dot(to);
        let parallel = T::one() - T::of(2.0) * T::epsilon();
        if cosine > parallel {
            return Self::identity();
        }
        if cosine < -parallel {
            return Self::about(from.across(), T::PI());
        }
        let [x, y, z] = from.cross(to).0;
        let sum = Vector([x, y, z, T::one() + cosine]);
        Self((sum * (T::one() / sum.length())).0)
    }

    /// From the columns of a rotation matrix, orthonormal up to rounding. The largest of the four numbers is the
    /// root, so that no digits are lost.
    pub fn from_columns(columns: &[Vector<T, 3>; 3]) -> Self {
        let at = |row: usize, column: usize| columns[column].0[row];
        // (k, l) off the diagonal: x y, z x, y z share a sum; the turn about each axis a difference.
        let (xy, zx, yz) = (at(1, 0) + at(0, 1), at(2, 0) + at(0, 2), at(2, 1) + at(1, 2));
        let (x, y, z) = (at(2, 1) - at(1, 2), at(0, 2) - at(2, 0), at(1, 0) - at(0, 1));
        let one = T::one();
        // Four times the square of the largest number, and four times its product with each.
        let (square, products) = if at(2, 2) <= T::zero() {
            let (rest, difference) = (one - at(2, 2), at(1, 1) - at(0, 0));
            if difference <= T::zero() {
                let square = rest - difference;
                (square, [square, xy, zx, x])
            } else {
                let square = rest + difference;
                (square, [xy, square, yz, y])
            }
        } else {
            let (rest, sum) = (one + at(2, 2), at(1, 1) + at(0, 0));
            if sum <= T::zero() {
                let square = rest - sum;
                (square, [zx, yz, square, z])
            } else {
                let square = rest + sum;
                (square, [x, y, z, square])
            }
        };
        let scale = T::of(0.5) / square.sqrt();
        Self(products.map(|p| p * scale))
    }

    /// The columns of the rotation matrix: where the three axes go.
    pub fn columns(self) -> [Vector<T, 3>; 3] {
        let [x, y, z, w] = self.0;
        let (x2, y2, z2) = (x + x, y + y, z + z);
        let (xx, xy, xz, yy, yz, zz) = (x * x2, x * y2, x * z2, y * y2, y * z2, z * z2);
        let (wx, wy, wz) = (w * x2, w * y2, w * z2);
        let one = T::one();
        [
            Vector([one - (yy + zz), xy + wz, xz - wy]),
            Vector([xy - wz, one - (xx + zz), yz + wx]),
            Vector([xz + wy, yz - wx, one - (xx + yy)]),
        ]
    }

    /// Turns a vector.
    pub fn rotate(self, v: Vector<T, 3>) -> Vector<T, 3> {
        let [x, y, z, w] = self.0;
        let (axis, two) = (Vector([x, y, z]), T::of(2.0));
        v * (w * w - axis.dot(axis)) + axis * (v.dot(axis) * two) + axis.cross(v) * (w * two)
    }

    /// The turn by `inner`, then by this.
    pub fn times(self, inner: Self) -> Self {
        let ([a, b, c, d], [x, y, z, w]) = (self.0, inner.0);
        Self([
            d * x + a * w + b * z - c * y,
            d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w,
            d * w - a * x - b * y - c * z,
        ])
    }

    /// The turn back.
    pub fn conjugate(self) -> Self {
        let [x, y, z, w] = self.0;
        Self([-x, -y, -z, w])
    }

    /// Sum of the four products.
    pub fn dot(self, other: Self) -> T {
        Vector(self.0).dot(Vector(other.0))
    }

    /// Short-arc spherical interpolation: flips the sign where the dot product is negative, and is linear
    /// where it exceeds 0.9995.
    pub fn slerp(self, to: Self, t: T) -> Self {
        let one = T::one();
        let (from, to, cosine) = (Vector(self.0), Vector(to.0), self.dot(to));
        let (to, cosine) = (if cosine < T::zero() { -to } else { to }, cosine.abs());
        if cosine > T::of(0.9995) {
            return Self((from * (one - t) + to * t).0).renormalised();
        }
        let angle = cosine.min(one).acos();
        let sine = angle.sin();
        let (first, second) = (((one - t) * angle).sin() / sine, (t * angle).sin() / sine);
        Self((from * first + to * second).0).renormalised()
    }
}

/// The rotation nearest to a matrix, given by its columns, in the sum of squares, U diag(1, 1, det U V^T) V^T of its
/// decomposition U S V^T: the mean of rotations when given their sum (Section 3.2 of [Now11]), and the repair of one
/// with noise.
///
/// It is the q that makes trace(R^T M) = q^T N q largest: the first eigenvector of the symmetric 4x4 matrix N. `None` where
/// the matrix is not finite or leaves the rotation open (rank below 2).
pub fn nearest_rotation<T: Real>(columns: &[Vector<T, 3>; 3]) -> Option<Quaternion<T>> {
    let [[xx, yx, zx], [xy, yy, zy], [xz, yz, zz]] = columns.map(|c| c.0);
    let o = T::zero();
    let (values, vectors) = symmetric_eigen(&[
        [xx + yy + zz, o, o, o],
        [zy - yz, xx - yy - zz, o, o],
        [xz - zx, xy + yx, yy - xx - zz, o],
        [yx - xy, xz + zx, yz + zy, zz - xx - yy],
    ])?;
    let scale = values[0].abs().max(values[3].abs());
    // 1e-12 in f64; in f32 the eigenvalues themselves are good to a few units in the last place.
    if !(values[0] - values[1] > T::of(1e-12).max(T::of(8.0) * T::epsilon()) * scale) {
        return None;
    }
    let [w, x, y, z] = vectors[0];
    Some(Quaternion([x, y, z, w]).renormalised())
}

/// A rigid transform, named by what it maps: `world_from_camera.transform(p_camera)` is `p_world`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid<T> {
    /// Of unit length.
    pub rotation: Quaternion<T>,
    /// In the destination frame.
    pub translation: Vector<T, 3>,
}

impl<T: Real> Rigid<T> {
    /// Builds a transform; the quaternion is renormalised (a zero or non-finite one becomes the identity).
    pub fn new(rotation: Quaternion<T>, translation: Vector<T, 3>) -> Self {
        Self { rotation: rotation.renormalised(), translation }
    }

    /// Builds a transform from the columns of a rotation matrix, orthonormal up to rounding.
    pub fn from_columns(columns: &[Vector<T, 3>; 3], translation: Vector<T, 3>) -> Self {
        Self::new(Quaternion::from_columns(columns), translation)
    }

    /// Maps a point.
    pub fn transform(&self, point: Vector<T, 3>) -> Vector<T, 3> {
        self.rotation.rotate(point) + self.translation
    }

    /// `a_from_b.then(b_from_c)` is `a_from_c`; renormalised, so that chains do not drift.
    pub fn then(&self, inner: &Self) -> Self {
        Self::new(self.rotation.times(inner.rotation), self.transform(inner.translation))
    }

    /// `a_from_b` becomes `b_from_a`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -rotation.rotate(self.translation) }
    }

    /// Angle between two rotations, in radians, within [0, pi].
    pub fn angle_to(&self, other: &Self) -> T {
        let [x, y, z, w] = self.rotation.conjugate().times(other.rotation).0;
        T::of(2.0) * Vector([x, y, z]).length().atan2(w.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec3};
    use proptest::prelude::*;

    fn quaternion() -> impl Strategy<Value = DQuat> {
        prop::array::uniform4(-1.0..1.0_f64)
            .prop_filter("a direction in 4D", |q| q.iter().map(|v| v * v).sum::<f64>() > 0.01)
            .prop_map(|q| DQuat::from_array(q).normalize())
    }

    fn columns(matrix: DMat3) -> [Vector<f64, 3>; 3] {
        matrix.to_cols_array_2d().map(Vector)
    }

    fn narrow<const N: usize>(numbers: [f64; N]) -> [f32; N] {
        numbers.map(|v| v as f32)
    }

    proptest! {
        /// The same bits as glam's.
        #[test]
        fn quaternions_are_glams(a in quaternion(), b in quaternion(), p in prop::array::uniform3(-3.0..3.0_f64)) {
            let (u, v) = (Quaternion(a.to_array()), Quaternion(b.to_array()));
            prop_assert_eq!(u.times(v).0, (a * b).to_array());
            prop_assert_eq!(DVec3::from(u.rotate(Vector(p))), a * DVec3::from(p));
            let matrix = DMat3::from_quat(a);
            prop_assert_eq!(u.columns(), columns(matrix));
            prop_assert_eq!(Quaternion::from_columns(&columns(matrix)).0, DQuat::from_mat3(&matrix).to_array());
            prop_assert_eq!(Quaternion::exp(Vector(p)).0, DQuat::from_scaled_axis(DVec3::from(p)).to_array());
            let (from, to) = (a * DVec3::Z, b * DVec3::Z);
            for to in [to, from, -from] {
                let want = DQuat::from_rotation_arc(from, to).to_array();
                prop_assert_eq!(Quaternion::arc(from.into(), to.into()).0, want);
            }
        }

        /// f32 does the same to a few units in the last place.
        #[test]
        fn single_precision_follows(a in quaternion(), b in quaternion(), t in 0.0..1.0_f64, spread in 0.0..0.3_f64) {
            let wide = |q: DQuat| Quaternion(q.to_array());
            let slim = |q: DQuat| Quaternion(narrow(q.to_array()));
            let off = |got: Quaternion<f32>, want: Quaternion<f64>| {
                let sign = if want.dot(Quaternion(got.0.map(f64::from))) < 0.0 { -1.0 } else { 1.0 };
                got.0.iter().zip(want.0).map(|(g, w)| (f64::from(*g) * sign - w).abs()).fold(0.0, f64::max)
            };
            // Measured over 100,000 cases: 2e-7, 6e-7 (the angle's own error over its sine, near half a turn).
            prop_assert!(off(slim(a).times(slim(b)), wide(a).times(wide(b))) < 4e-7);
            prop_assume!(a.dot(b).abs() > 0.05);
            let (got, want) = (slim(a).slerp(slim(b), t as f32), wide(a).slerp(wide(b), t));
            // Either side of the seam at 0.9995 the two forms differ by 3e-6.
            let seam = (a.dot(b).abs() - 0.9995).abs() < 1e-6;
            prop_assert!(seam || off(got, want) < 2e-6, "{}", off(got, want));
            // The mean of three turns that differ by up to `spread`.
            let turn = |axis| DMat3::from_quat(a * DQuat::from_axis_angle(axis, spread));
            let sum = turn(DVec3::X) + turn(DVec3::Y) + turn(-DVec3::Z);
            let want = nearest_rotation(&columns(sum)).unwrap();
            let got = nearest_rotation(&sum.to_cols_array_2d().map(|c| Vector(narrow(c)))).unwrap();
            prop_assert!(off(got, want) < 2e-6, "{}", off(got, want));
        }
    }
}
