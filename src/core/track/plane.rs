//! The plane z = 0 of the world: where pixels meet it, and how to find it from a rectangle that lies in it.

use super::{
    refine::{Sighting, refine},
    tag_pose::{homography_from_rectangle, solve_rectangle},
};
use crate::math::{lens::Lens, pose::Pose};
use glam::{DMat3, DVec2, DVec3};

/// A ray in the world: origin and unit direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The camera's centre, metres.
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
}

/// The ray through a pixel; `None` where the lens has none there.
pub fn ray_through(pixel: DVec2, lens: &Lens, world_from_camera: &Pose) -> Option<Ray> {
    let direction = world_from_camera.rotate(lens.unproject(pixel)?);
    Some(Ray { origin: world_from_camera.translation, direction })
}

/// Distance along a ray to the plane `normal . p = offset`; `None` for planes behind the origin and for rays
/// within 1e-9 of parallel.
pub fn distance_to_plane(ray: &Ray, normal: DVec3, offset: f64) -> Option<f64> {
    let approach = normal.dot(ray.direction);
    if approach.is_nan() || approach.abs() < 1e-9 {
        return None;
    }
    let distance = (offset - normal.dot(ray.origin)) / approach;
    (distance.is_finite() && distance > 0.0).then_some(distance)
}

/// Where the ray through a pixel meets z = 0. `None` at and above the horizon.
/// Property: `lens.project` of the result is the pixel again.
pub fn point_on_plane(pixel: DVec2, lens: &Lens, world_from_camera: &Pose) -> Option<DVec3> {
    let ray = ray_through(pixel, lens, world_from_camera)?;
    let distance = distance_to_plane(&ray, DVec3::Z, 0.0)?;
    let point = ray.origin + ray.direction * distance;
    Some(DVec3::new(point.x, point.y, 0.0))
}

/// The homography from (x, y, 1) of z = 0, metres, to homogeneous pixels of the lens *without* its distortion:
/// K (r1 r2 t). Pixels of a distorted lens are to be undistorted first. `None` where the plane is seen edge on.
pub fn pixel_from_plane(lens: &Lens, world_from_camera: &Pose) -> Option<DMat3> {
    let camera_from_world = world_from_camera.inverse();
    let r = DMat3::from_quat(camera_from_world.rotation);
    let k = DMat3::from_cols(
        DVec3::new(lens.fx, 0.0, 0.0),
        DVec3::new(0.0, lens.fy, 0.0),
        DVec3::new(lens.cx, lens.cy, 1.0),
    );
    let homography = k * DMat3::from_cols(r.x_axis, r.y_axis, camera_from_world.translation);
    // The determinant is the height above the plane times fx fy.
    let determinant = homography.determinant();
    (determinant.abs() > 1e-9 * lens.fx * lens.fy).then_some(homography)
}

/// A rectangle that defines the world: its middle is the origin, it lies in z = 0, z is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedRectangle {
    /// Camera to world, the camera above the plane.
    pub world_from_camera: Pose,
    /// Side from the first corner to the second, along x, metres.
    pub width_m: f64,
    /// The other side, along y, metres.
    pub depth_m: f64,
    /// Root of the mean squared residual, over both coordinates of the corners, pixels.
    pub rms_px: f64,
    /// The four corners in the world, in the order of the input.
    pub corners_world: [DVec3; 4],
}

/// The world from four corners of a horizontal rectangle whose side from the first to the second corner is
/// `width_m` and whose other side is not known (the top of a table, of a pouf). The corners go around it either
/// way; x runs from the first towards the second, z is up. `None` where the corners are no picture of a
/// rectangle seen through this lens.
///
/// With the lens known, directions of both sides follow from the homography, and their lengths' ratio from its
/// columns; the ratio is then refined together with the pose, to the least reprojection error.
pub fn plane_from_rectangle(corners_px: &[DVec2; 4], width_m: f64, lens: &Lens) -> Option<PlacedRectangle> {
    if !(width_m > 0.0 && width_m.is_finite()) {
        return None;
    }
    let guess = aspect_of(corners_px, lens)?;
    // One rotation sense leaves the camera below the plane: then y runs the other way.
    let placed = [1.0, -1.0].into_iter().find_map(|sense| {
        let at = |ln_aspect: f64| {
            let corners = rectangle(width_m, width_m * ln_aspect.exp() * sense);
            let pose = settle(&corners, corners_px, lens)?;
            (pose.0.translation.z > 0.0).then_some((pose, corners))
        };
        // Golden section on the logarithm of the aspect, half a third either way: the homography is that good.
        let (mut low, mut high) = (guess.ln() - 0.3, guess.ln() + 0.3);
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let error = |x: f64| at(x).map_or(f64::INFINITY, |p| p.0.1);
        let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
        let (mut error_a, mut error_b) = (error(a), error(b));
        for _ in 0..50 {
            if error_a <= error_b {
                (high, b, error_b) = (b, a, error_a);
                a = high - golden * (high - low);
                error_a = error(a);
            } else {
                (low, a, error_a) = (a, b, error_b);
                b = low + golden * (high - low);
                error_b = error(b);
            }
        }
        at(0.5 * (low + high))
    });
    let ((world_from_camera, rms_px), corners_world) = placed?;
    Some(PlacedRectangle {
        world_from_camera,
        width_m,
        depth_m: (corners_world[3].y - corners_world[0].y).abs(),
        rms_px,
        corners_world,
    })
}

/// Corners around a rectangle of z = 0 about the origin; `depth_m` may be negative for the other way round.
fn rectangle(width_m: f64, depth_m: f64) -> [DVec3; 4] {
    let (w, d) = (width_m / 2.0, depth_m / 2.0);
    [DVec3::new(-w, -d, 0.0), DVec3::new(w, -d, 0.0), DVec3::new(w, d, 0.0), DVec3::new(-w, d, 0.0)]
}

/// Camera to world and rms of the best pose for known corners.
fn settle(corners: &[DVec3; 4], corners_px: &[DVec2; 4], lens: &Lens) -> Option<(Pose, f64)> {
    let poses = solve_rectangle(corners, corners_px, 1.0, lens)?;
    let sightings: [Sighting; 4] = std::array::from_fn(|i| Sighting {
        point_object: corners[i].into(),
        pixel: corners_px[i].into(),
        sigma_px: 1.0,
    });
    let refined = refine(&sightings, lens, &poses.best.camera_from_tag.into())?;
    Some((refined.camera_from_object.inverse().into(), refined.rms_px))
}

/// Second side over first side of the rectangle that four corners show. With H = (h1 h2 h3) from the unit square
/// to the plane z = 1 of the camera, h1 and h2 are the sides' vectors up to one common scale.
fn aspect_of(corners_px: &[DVec2; 4], lens: &Lens) -> Option<f64> {
    let mut plane = [DVec2::ZERO; 4];
    for (p, pixel) in plane.iter_mut().zip(corners_px) {
        let ray = lens.unproject(*pixel)?;
        if ray.z < 1e-3 {
            return None;
        }
        *p = ray.truncate() / ray.z;
    }
    let homography = homography_from_rectangle(&rectangle(1.0, 1.0), &plane)?;
    let aspect = homography.y_axis.length() / homography.x_axis.length();
    (aspect.is_finite() && aspect > 0.0).then_some(aspect)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lens::Distortion;
    use proptest::prelude::*;

    const LENS: Lens = Lens::pinhole(1500, 1000, 1264.0, 1264.0, 750.0, 500.0);

    fn camera() -> Pose {
        Pose::look_at(DVec3::new(0.4, -1.3, 0.8), DVec3::ZERO, DVec3::Z)
    }

    #[test]
    fn a_rectangle_of_unknown_depth_gives_the_plane() {
        for distortion in
            [Distortion::None, Distortion::RadialTangential([-0.2, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])]
        {
            let lens = Lens { distortion, ..LENS };
            let truth = camera();
            let corners = rectangle(0.6, 0.41);
            let seen = corners.map(|c| lens.project(truth.inverse().transform(c)).unwrap());
            let got = plane_from_rectangle(&seen, 0.6, &lens).unwrap();
            assert!((got.depth_m - 0.41).abs() < 1e-6, "{}", got.depth_m);
            assert!(got.world_from_camera.translation.distance(truth.translation) < 1e-5);
            assert!(got.world_from_camera.angle_to(&truth) < 1e-5);
            assert!(got.rms_px < 1e-3);
            // The other way round: still above the plane, y now runs against it.
            let reversed = [seen[1], seen[0], seen[3], seen[2]];
            let other = plane_from_rectangle(&reversed, 0.6, &lens).unwrap();
            assert!(other.world_from_camera.translation.z > 0.7);
            assert!((other.depth_m - 0.41).abs() < 1e-6);
            for (pixel, corner) in reversed.iter().zip(other.corners_world) {
                let back = lens.project(other.world_from_camera.inverse().transform(corner)).unwrap();
                assert!(back.distance(*pixel) < 1e-3);
            }
        }
    }

    #[test]
    fn corners_that_are_no_rectangle_are_refused() {
        let line = [0.0, 1.0, 2.0, 3.0].map(|x| DVec2::new(x * 100.0, x * 50.0));
        assert_eq!(plane_from_rectangle(&line, 0.6, &LENS), None);
        assert_eq!(plane_from_rectangle(&[DVec2::NAN; 4], 0.6, &LENS), None);
        let crossed = [(0.0, 0.0), (100.0, 100.0), (100.0, 0.0), (0.0, 100.0)].map(|(x, y)| DVec2::new(x, y));
        assert_eq!(plane_from_rectangle(&crossed, 0.6, &LENS), None);
        let fine = [(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)].map(|(x, y)| DVec2::new(x, y));
        for width_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(plane_from_rectangle(&fine, width_m, &LENS), None);
        }
    }

    #[test]
    fn above_the_horizon_there_is_no_plane() {
        let level = Pose::look_at(DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.0, 5.0, 1.0), DVec3::Z);
        assert_eq!(point_on_plane(DVec2::new(750.0, 400.0), &LENS, &level), None);
        assert_eq!(point_on_plane(DVec2::new(750.0, 500.0), &LENS, &level), None);
        let below = point_on_plane(DVec2::new(750.0, 500.0 + 126.4), &LENS, &level).unwrap();
        assert!(below.distance(DVec3::new(0.0, 10.0, 0.0)) < 1e-9, "{below}");
        let at_plane = Pose::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z);
        assert_eq!(pixel_from_plane(&LENS, &at_plane), None);
    }

    proptest! {
        #[test]
        fn plane_and_pixel_agree(u in 0.0..1500.0_f64, v in 0.0..1000.0_f64) {
            let (pixel, pose) = (DVec2::new(u, v), camera());
            let Some(point) = point_on_plane(pixel, &LENS, &pose) else { return Ok(()) };
            let back = LENS.project(pose.inverse().transform(point)).unwrap();
            prop_assert!(back.distance(pixel) < 1e-7);
            let q = pixel_from_plane(&LENS, &pose).unwrap() * DVec3::new(point.x, point.y, 1.0);
            prop_assert!((q.truncate() / q.z).distance(pixel) < 1e-7);
        }
    }
}
