//! Rigid transforms with unit quaternions, in f64: `rigid` with glam's types.

use super::{
    rigid::{self, Quaternion, Rigid},
    vector::Vector,
};
use glam::{DMat3, DMat4, DQuat, DVec3};

/// A rigid transform, named by what it maps: `world_from_camera.transform(p_camera)` is `p_world`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Metres, in the destination frame.
    pub translation: DVec3,
}

impl Pose {
    /// Maps every point to itself.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// Builds a pose; the quaternion is renormalised (a zero or non-finite one becomes the identity).
    pub fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation: renormalise(rotation), translation }
    }

    /// Builds a pose from a rotation matrix whose columns are orthonormal up to rounding.
    pub fn from_matrix(rotation: DMat3, translation: DVec3) -> Self {
        Self::new(DQuat::from_mat3(&rotation), translation)
    }

    /// Builds a pose from a 4x4 rigid matrix given row by row (the last row is ignored).
    pub fn from_rows(rows: [[f64; 4]; 4]) -> Self {
        let matrix = DMat3::from_cols_array_2d(&[
            [rows[0][0], rows[1][0], rows[2][0]],
            [rows[0][1], rows[1][1], rows[2][1]],
            [rows[0][2], rows[1][2], rows[2][2]],
        ]);
        Self::from_matrix(matrix, DVec3::new(rows[0][3], rows[1][3], rows[2][3]))
    }

    /// The 4x4 matrix, row by row.
    pub fn to_rows(self) -> [[f64; 4]; 4] {
        let m = self.to_matrix().transpose().to_cols_array_2d();
        [m[0], m[1], m[2], m[3]]
    }

    /// The 4x4 matrix.
    pub fn to_matrix(self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// A camera at `eye` that looks at `target`, with +y of the camera (down) away from `up`.
    /// Where `up` is parallel to the view, another axis takes its place.
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let forward = (target - eye).normalize_or(DVec3::Z);
        let mut right = forward.cross(up);
        if right.length_squared() < 1e-12 {
            right = forward.cross(if forward.x.abs() < 0.9 { DVec3::X } else { DVec3::Y });
        }
        let right = right.normalize();
        let down = forward.cross(right);
        Self::from_matrix(DMat3::from_cols(right, down, forward), eye)
    }

    /// Maps a point.
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Maps a direction (no translation).
    pub fn rotate(&self, direction: DVec3) -> DVec3 {
        self.rotation * direction
    }

    /// `a_from_b.then(b_from_c)` is `a_from_c`; renormalised, so that chains do not drift.
    pub fn then(&self, inner: &Self) -> Self {
        Rigid::from(*self).then(&(*inner).into()).into()
    }

    /// `a_from_b` becomes `b_from_a`.
    pub fn inverse(&self) -> Self {
        Rigid::from(*self).inverse().into()
    }

    /// Short-arc interpolation: rotation by slerp (lerp when nearly equal), translation linearly.
    pub fn interpolate(&self, other: &Self, t: f64) -> Self {
        Self::new(slerp(self.rotation, other.rotation, t), self.translation.lerp(other.translation, t))
    }

    /// Angle between two rotations, in radians, within [0, pi].
    pub fn angle_to(&self, other: &Self) -> f64 {
        Rigid::from(*self).angle_to(&(*other).into())
    }
}

/// Unit length again; a zero or non-finite quaternion becomes the identity.
pub fn renormalise(q: DQuat) -> DQuat {
    glam(Quaternion(q.to_array()).renormalised())
}

/// Short-arc spherical interpolation ([`Quaternion::slerp`]).
pub fn slerp(from: DQuat, to: DQuat, t: f64) -> DQuat {
    glam(Quaternion(from.to_array()).slerp(Quaternion(to.to_array()), t))
}

/// The rotation nearest to a matrix ([`rigid::nearest_rotation`]). `None` where the matrix is not finite or leaves
/// the rotation open (rank below 2).
pub fn nearest_rotation(matrix: DMat3) -> Option<DQuat> {
    rigid::nearest_rotation(&matrix.to_cols_array_2d().map(Vector)).map(glam)
}

fn glam(q: Quaternion<f64>) -> DQuat {
    DQuat::from_array(q.0)
}

impl From<Pose> for Rigid<f64> {
    fn from(pose: Pose) -> Self {
        Self { rotation: Quaternion(pose.rotation.to_array()), translation: pose.translation.into() }
    }
}

impl From<Rigid<f64>> for Pose {
    fn from(rigid: Rigid<f64>) -> Self {
        Self { rotation: glam(rigid.rotation), translation: rigid.translation.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn rotation() -> impl Strategy<Value = DQuat> {
        prop::array::uniform4(-1.0..1.0_f64)
            .prop_filter("a direction in 4D", |q| q.iter().map(|v| v * v).sum::<f64>() > 0.01)
            .prop_map(|q| renormalise(DQuat::from_array(q)))
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-5.0..5.0_f64).prop_map(DVec3::from_array)
    }

    fn pose() -> impl Strategy<Value = Pose> {
        (rotation(), vector()).prop_map(|(rotation, translation)| Pose { rotation, translation })
    }

    fn close(a: DQuat, b: DQuat) -> bool {
        (a - b).length().min((a + b).length()) < 1e-12
    }

    #[test]
    fn a_million_products_keep_the_norm() {
        let step = Pose::new(DQuat::from_xyzw(0.01, -0.02, 0.015, 1.0), DVec3::ZERO);
        let mut pose = Pose::IDENTITY;
        for _ in 0..1_000_000 {
            pose = pose.then(&step);
        }
        assert!((pose.rotation.length() - 1.0).abs() < 1e-15, "{}", pose.rotation.length());
    }

    #[test]
    fn bad_rotations_become_the_identity() {
        for bad in [DQuat::from_array([0.0; 4]), DQuat::from_array([f64::NAN; 4])] {
            assert_eq!(Pose::new(bad, DVec3::X).rotation, DQuat::IDENTITY);
        }
        assert_eq!(nearest_rotation(DMat3::ZERO), None);
        assert_eq!(nearest_rotation(DMat3::NAN), None);
        // Rank 1: every turn about the one axis is as good.
        assert_eq!(nearest_rotation(DMat3::from_diagonal(DVec3::X)), None);
    }

    #[test]
    fn a_mirrored_matrix_gives_a_rotation() {
        let q = nearest_rotation(DMat3::from_diagonal(DVec3::new(1.0, 2.0, -0.5))).unwrap();
        assert!(close(q, DQuat::IDENTITY));
    }

    #[test]
    fn slerp_at_its_seams() {
        let a = DQuat::from_rotation_z(0.3);
        // Nearly equal: linear, still of unit length; the same rotation with the other sign: no turn.
        let b = DQuat::from_rotation_z(0.3 + 1e-9);
        assert!((slerp(a, b, 0.5).length() - 1.0).abs() < 1e-15);
        assert!(close(slerp(a, -a, 0.5), a));
        // Just beyond the linear range both forms agree to the third order of the angle.
        for angle in [0.0630, 0.0634] {
            let b = DQuat::from_rotation_z(0.3 + angle);
            let mid = DQuat::from_rotation_z(0.3 + 0.25 * angle);
            assert!((slerp(a, b, 0.25) - mid).length() < 2e-6);
        }
    }

    #[test]
    fn look_at_keeps_up_up() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.0, 0.5, 0.1), DVec3::Z);
        assert!(pose.rotate(DVec3::Y).z < 0.0, "down of the picture points down");
        assert!(pose.rotate(DVec3::X).z.abs() < 1e-15, "the horizon is level");
        assert!((pose.rotation.length() - 1.0).abs() < 1e-15);
        let down = Pose::look_at(DVec3::Z, DVec3::ZERO, DVec3::Z);
        assert!(down.rotate(DVec3::Z).distance(DVec3::NEG_Z) < 1e-15);
    }

    proptest! {
        #[test]
        fn poses_form_a_group(a in pose(), b in pose(), c in pose(), p in vector()) {
            let ab = a.then(&b);
            prop_assert!(ab.transform(p).distance(a.transform(b.transform(p))) < 1e-13);
            let (left, right) = (ab.then(&c), a.then(&b.then(&c)));
            prop_assert!(left.transform(p).distance(right.transform(p)) < 1e-13);
            prop_assert!(a.inverse().transform(a.transform(p)).distance(p) < 1e-13);
            prop_assert!(a.then(&a.inverse()).transform(p).distance(p) < 1e-13);
            prop_assert!(a.to_matrix().transform_point3(p).distance(a.transform(p)) < 1e-13);
            let again = Pose::from_rows(a.to_rows());
            prop_assert!(close(again.rotation, a.rotation) && again.translation == a.translation);
        }

        #[test]
        fn slerp_turns_evenly_by_the_short_way(a in rotation(), b in rotation(), t in 0.0..1.0_f64) {
            let pose = |rotation| Pose { rotation, translation: DVec3::ZERO };
            let mid = pose(slerp(a, b, t));
            let whole = pose(a).angle_to(&pose(b));
            prop_assert!(whole <= PI + 1e-12);
            prop_assert!((mid.rotation.length() - 1.0).abs() < 1e-15);
            // Lerp within dot > 0.9995 costs at most 3e-6 rad.
            prop_assert!((pose(a).angle_to(&mid) - t * whole).abs() < 3e-6);
            prop_assert!(close(slerp(a, b, 0.0), a) && close(slerp(a, b, 1.0), b));
            prop_assert!(close(slerp(a, -b, t), slerp(a, b, t)));
        }

        #[test]
        fn the_nearest_rotation_of_a_rotation_is_itself(q in rotation(), scale in 0.1..10.0_f64) {
            let got = nearest_rotation(DMat3::from_quat(q) * scale).unwrap();
            prop_assert!(close(got, q));
        }

        #[test]
        fn the_nearest_rotation_is_nearest(m in prop::array::uniform9(-1.0..1.0_f64), other in rotation()) {
            let m = DMat3::from_cols_array(&m);
            prop_assume!(m.determinant().abs() > 1e-3);
            let Some(q) = nearest_rotation(m) else { return Ok(()) };
            let distance = |q| {
                let difference = DMat3::from_quat(q) - m;
                difference.to_cols_array().iter().map(|v| v * v).sum::<f64>()
            };
            prop_assert!(distance(q) <= distance(other) + 1e-12);
        }
    }
}
