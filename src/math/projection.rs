//! What a pose solver asks of a camera, over f32 or f64.

use super::{
    lens::{Distortion, Lens},
    sh::Real,
    vector::Vector,
};
use glam::{DMat3, DVec3};

/// A camera's map from points of its frame to pixels.
pub trait Projection<T: Real> {
    /// Where a point in the camera's frame appears, continuous pixels; `None` where it cannot be seen.
    fn project(&self, point_camera: Vector<T, 3>) -> Option<Vector<T, 2>>;

    /// The unit direction, in the camera's frame, of the ray through a pixel; `None` where there is none.
    fn unproject(&self, pixel: Vector<T, 2>) -> Option<Vector<T, 3>>;

    /// Rows du/dp and dv/dp of the projection at a point that can be seen.
    fn jacobian(&self, point_camera: Vector<T, 3>) -> Option<[Vector<T, 3>; 2]>;
}

/// A camera without distortion: u = fx x/z + cx, v = fy y/z + cy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole<T> {
    /// Focal lengths along x and y, pixels.
    pub focal_px: Vector<T, 2>,
    /// Principal point, continuous pixels.
    pub principal_px: Vector<T, 2>,
}

impl<T: Real> Projection<T> for Pinhole<T> {
    fn project(&self, point_camera: Vector<T, 3>) -> Option<Vector<T, 2>> {
        let seen = point_camera.is_finite() && point_camera.0[2] > T::zero();
        let [x, y] = seen.then(|| point_camera.on_plane())?.0;
        let ([fx, fy], [cx, cy]) = (self.focal_px.0, self.principal_px.0);
        let pixel = Vector([x * fx + cx, y * fy + cy]);
        pixel.is_finite().then_some(pixel)
    }

    fn unproject(&self, pixel: Vector<T, 2>) -> Option<Vector<T, 3>> {
        let [x, y] = (pixel - self.principal_px).0;
        let [fx, fy] = self.focal_px.0;
        let plane = Vector([x / fx, y / fy]);
        plane.is_finite().then(|| plane.extend(T::one()).unit())?
    }

    fn jacobian(&self, point_camera: Vector<T, 3>) -> Option<[Vector<T, 3>; 2]> {
        let ([x, y, z], [fx, fy]) = (point_camera.0, self.focal_px.0);
        let o = T::zero();
        Some([Vector([fx / z, o, -fx * x / (z * z)]), Vector([o, fy / z, -fy * y / (z * z)])])
    }
}

impl Lens {
    /// The same lens with its distortion left out.
    pub fn without_distortion(&self) -> Pinhole<f64> {
        Pinhole { focal_px: Vector([self.fx, self.fy]), principal_px: Vector([self.cx, self.cy]) }
    }
}

impl Projection<f64> for Lens {
    fn project(&self, point_camera: Vector<f64, 3>) -> Option<Vector<f64, 2>> {
        Lens::project(self, point_camera.into()).map(Vector::from)
    }

    fn unproject(&self, pixel: Vector<f64, 2>) -> Option<Vector<f64, 3>> {
        Lens::unproject(self, pixel.into()).map(Vector::from)
    }

    fn jacobian(&self, point_camera: Vector<f64, 3>) -> Option<[Vector<f64, 3>; 2]> {
        if self.distortion == Distortion::None {
            return self.without_distortion().jacobian(point_camera);
        }
        // Central differences: the step balances truncation (h^2) and rounding (1e-16 / h).
        let p = DVec3::from(point_camera);
        let h = 1e-5 * p.length();
        let mut columns = [glam::DVec2::ZERO; 3];
        for (column, axis) in columns.iter_mut().zip(DMat3::IDENTITY.to_cols_array_2d()) {
            let axis = DVec3::from_array(axis) * h;
            *column = (Lens::project(self, p + axis)? - Lens::project(self, p - axis)?) / (2.0 * h);
        }
        let row = |i: usize| Vector(columns.map(|c| c[i]));
        Some([row(0), row(1)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;

    const LENS: Lens = Lens::pinhole(640, 480, 420.0, 430.0, 318.2, 241.7);

    #[test]
    fn what_no_pinhole_sees() {
        let pinhole = LENS.without_distortion();
        assert_eq!(pinhole.project(Vector([1.0, 0.0, -2.0])), None);
        assert_eq!(pinhole.project(Vector([1.0, 0.0, 0.0])), None);
        assert_eq!(pinhole.project(Vector([f64::NAN, 0.0, 1.0])), None);
        assert_eq!(pinhole.unproject(Vector([f64::INFINITY, 0.0])), None);
    }

    proptest! {
        #[test]
        fn a_pinhole_is_the_lens_without_distortion(x in -1.0..1.0_f64, y in -1.0..1.0_f64, z in 0.1..5.0_f64) {
            let (pinhole, point) = (LENS.without_distortion(), DVec3::new(x, y, z));
            let pixel = pinhole.project(point.into()).unwrap();
            prop_assert_eq!(DVec2::from(pixel), LENS.project(point).unwrap());
            prop_assert_eq!(DVec3::from(pinhole.unproject(pixel).unwrap()), LENS.unproject(pixel.into()).unwrap());
        }

        /// Of the pinhole in closed form, of the others by differences.
        #[test]
        fn jacobians_are_slopes(x in -0.5..0.5_f64, y in -0.5..0.5_f64, z in 0.5..2.0_f64) {
            let bent = Lens { distortion: Distortion::RadialTangential([-0.2, 0.05, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]), ..LENS };
            for lens in [LENS, bent] {
                let p = DVec3::new(x, y, z);
                let rows = lens.jacobian(p.into()).unwrap().map(DVec3::from);
                let step = DVec3::new(2e-4, -1e-4, 3e-4);
                let (Some(a), Some(b)) = (lens.project(p - step), lens.project(p + step)) else { return Ok(()) };
                let along = DVec2::new(rows[0].dot(step), rows[1].dot(step)) * 2.0;
                // The third derivative over a step of 4e-4 m.
                prop_assert!((b - a - along).length() < 1e-4, "{:?}", b - a - along);
            }
        }
    }
}
