//! Rigid transforms with unit quaternions, in f64.

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
        Self::new(self.rotation * inner.rotation, self.rotation * inner.translation + self.translation)
    }

    /// `a_from_b` becomes `b_from_a`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Short-arc interpolation: rotation by slerp (lerp when nearly equal), translation linearly.
    pub fn interpolate(&self, other: &Self, t: f64) -> Self {
        Self::new(slerp(self.rotation, other.rotation, t), self.translation.lerp(other.translation, t))
    }

    /// Angle between two rotations, in radians, within [0, pi].
    pub fn angle_to(&self, other: &Self) -> f64 {
        let delta = self.rotation.conjugate() * other.rotation;
        2.0 * delta.xyz().length().atan2(delta.w.abs())
    }
}

/// Unit length again; a zero or non-finite quaternion becomes the identity.
pub fn renormalise(q: DQuat) -> DQuat {
    let length = q.length();
    if length.is_finite() && length > 1e-12 { q / length } else { DQuat::IDENTITY }
}

/// Short-arc spherical interpolation: flips the sign where the dot product is negative, and is linear
/// where it exceeds 0.9995.
pub fn slerp(from: DQuat, to: DQuat, t: f64) -> DQuat {
    let mut dot = from.dot(to);
    let to = if dot < 0.0 { -to } else { to };
    dot = dot.abs();
    if dot > 0.9995 {
        return renormalise(from * (1.0 - t) + to * t);
    }
    let angle = dot.clamp(-1.0, 1.0).acos();
    let sine = angle.sin();
    renormalise(from * (((1.0 - t) * angle).sin() / sine) + to * ((t * angle).sin() / sine))
}
