//! Where a mirror ball is, from the circle that it fills in a picture.

use crate::math::{lens::Lens, pose::Pose, solve::solve_positive};
use glam::{DMat3, DVec2, DVec3};

/// Points of the circle that are looked through.
const RIM_POINTS: usize = 64;

/// Centre, in the camera's frame and metres, of a ball whose outline is the circle of `radius_px` about `centre_px`
/// (continuous pixels). The rays d through the outline form a cone d.m = 1 with m = axis / cos beta, fitted by least
/// squares (a true outline off the axis is an ellipse; then the circle should be its mean); the ball is at
/// radius / sin beta along the axis.
///
/// `None` where the lens has no rays there, the sizes are not positive, or the rays form no cone.
pub fn centre_from_outline(lens: &Lens, centre_px: DVec2, radius_px: f64, radius_m: f64) -> Option<DVec3> {
    if !(radius_px > 0.0 && radius_m > 0.0 && radius_m.is_finite()) {
        return None;
    }
    let mut rays = [DVec3::ZERO; RIM_POINTS];
    for (k, ray) in rays.iter_mut().enumerate() {
        let angle = std::f64::consts::TAU * k as f64 / RIM_POINTS as f64;
        *ray = lens.unproject(centre_px + radius_px * DVec2::from_angle(angle))?;
    }
    let middle = rays.iter().sum::<DVec3>().try_normalize()?;
    // In axes across and along the middle ray, the across parts scaled to about 1: the matrix is then well conditioned
    // for the smallest ball.
    let (right, up) = middle.any_orthonormal_pair();
    let scale = rays.iter().map(|d| d.reject_from(middle).length()).sum::<f64>() / RIM_POINTS as f64;
    if !(scale > 0.0) {
        return None;
    }
    // d.m = 1 with m = middle + n: d.n = 1 - d.middle, a small number known to all its digits.
    let (mut matrix, mut right_side) = ([[0.0; 3]; 3], [0.0; 3]);
    for d in rays {
        let across = d.reject_from(middle);
        let row = [across.dot(right) / scale, across.dot(up) / scale, d.dot(middle)];
        let short = across.length_squared() / (1.0 + d.dot(middle));
        for i in 0..3 {
            for j in 0..3 {
                matrix[i][j] += row[i] * row[j];
            }
            right_side[i] += row[i] * short;
        }
    }
    let n = solve_positive(&matrix, right_side)?;
    let m = middle * (1.0 + n[2]) + right * (n[0] / scale) + up * (n[1] / scale);
    // |m|^2 - 1 = tan^2 beta, without the cancellation.
    let tangent_squared = n[2] * (2.0 + n[2]) + (n[0] / scale).powi(2) + (n[1] / scale).powi(2);
    if !(tangent_squared > 0.0) {
        return None;
    }
    let sine = (tangent_squared / (1.0 + tangent_squared)).sqrt();
    let centre = m.try_normalize()? * (radius_m / sine);
    centre.is_finite().then_some(centre)
}

/// The camera's pose in a world made from what it sees: z is `up_camera`, x looks away from the camera (the level part
/// of its view), y to the left, and the ball's centre is at (0, 0, `height_m`). `None` where `up_camera` is zero or
/// not finite. Where the camera looks straight up or down, x is the direction of the picture's upper edge.
pub fn world_about_ball(centre_camera: DVec3, up_camera: DVec3, height_m: f64) -> Option<Pose> {
    let z = up_camera.try_normalize()?;
    let level = |v: DVec3| v.reject_from_normalized(z);
    let ahead = level(DVec3::Z);
    let x = if ahead.length() > 1e-6 { ahead } else { level(DVec3::NEG_Y) }.try_normalize()?;
    // Rows are the world's axes in the camera's frame.
    let world_from_camera = DMat3::from_cols(x, z.cross(x), z).transpose();
    let translation = DVec3::new(0.0, 0.0, height_m) - world_from_camera * centre_camera;
    translation.is_finite().then(|| Pose::from_matrix(world_from_camera, translation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LENS: Lens = Lens::pinhole(640, 480, 700.0, 700.0, 320.0, 240.0);

    #[test]
    fn on_the_axis_the_circle_is_exact() {
        for (distance, radius) in [(0.3, 0.05), (2.0, 0.03), (40.0, 0.01)] {
            let sine: f64 = radius / distance;
            let radius_px = 700.0 * sine / (1.0 - sine * sine).sqrt();
            let got = centre_from_outline(&LENS, DVec2::new(320.0, 240.0), radius_px, radius).unwrap();
            assert!(got.distance(DVec3::Z * distance) < 1e-9 * distance, "{got}");
        }
    }

    #[test]
    fn circles_that_are_none_are_refused() {
        let middle = DVec2::new(320.0, 240.0);
        for (radius_px, radius_m) in [(0.0, 0.1), (-1.0, 0.1), (f64::NAN, 0.1), (9.0, 0.0), (9.0, f64::NAN)] {
            assert!(centre_from_outline(&LENS, middle, radius_px, radius_m).is_none());
        }
        assert!(centre_from_outline(&LENS, DVec2::NAN, 9.0, 0.1).is_none());
        assert!(world_about_ball(DVec3::Z, DVec3::ZERO, 0.1).is_none());
        assert!(world_about_ball(DVec3::Z, DVec3::NAN, 0.1).is_none());
    }

    #[test]
    fn the_world_stands_upright_about_the_ball() {
        let centre = DVec3::new(0.1, 0.2, 1.5);
        let pose = world_about_ball(centre, DVec3::new(0.0, -1.0, -0.5), 0.05).unwrap();
        assert!(pose.transform(centre).distance(DVec3::new(0.0, 0.0, 0.05)) < 1e-15);
        assert!(pose.rotate(DVec3::new(0.0, -1.0, -0.5).normalize()).distance(DVec3::Z) < 1e-15);
        // What is right in the picture is towards -y.
        assert!(pose.rotate(DVec3::X).distance(DVec3::NEG_Y) < 1e-15);
        let below = world_about_ball(centre, DVec3::NEG_Z, 0.05).unwrap();
        assert!(below.rotate(DVec3::NEG_Y).distance(DVec3::X) < 1e-15);
    }

    proptest! {
        #[test]
        fn off_the_axis_the_mean_circle_is_close(x in -0.4..0.4f64, y in -0.3..0.3f64, q in 0.01..0.06f64) {
            let centre = DVec3::new(x, y, 1.0);
            let (axis, radius) = (centre.normalize(), q * centre.length());
            let (a, b) = axis.any_orthonormal_pair();
            // The outline's points as the lens shows them, and their mean circle.
            let points: Vec<DVec2> = (0..90)
                .map(|k| {
                    let side = DVec2::from_angle(f64::from(k) * std::f64::consts::TAU / 90.0);
                    let normal = axis * -q + (a * side.x + b * side.y) * (1.0 - q * q).sqrt();
                    LENS.project(centre + radius * normal).unwrap()
                })
                .collect();
            let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            let got = centre_from_outline(&LENS, middle, (half.x * half.y).sqrt(), radius).unwrap();
            // The direction is that of the ellipse's centre, not the ball's: up to q^2 off; the size a few percent.
            prop_assert!(got.angle_between(centre) < 1.2 * q * q + 1e-9, "{}", got.angle_between(centre));
            prop_assert!((got.length() / centre.length() - 1.0).abs() < 0.1, "{}", got.length() / centre.length());
        }
    }
}
