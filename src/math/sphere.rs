//! Directions and solid angles on the sphere, and reflection by a mirror ball, in f64.

use super::{charts, mirror_ball::mirrored};
use glam::DVec3;
use std::f64::consts::PI;

/// Direction of an equirectangular map at (u, v): theta = pi v from +z, phi = 2 pi u - pi from +x towards +y.
/// Row 0 is straight up, the middle column +x, u = 0.75 is +y. Texel centres are at (i + 0.5)/w.
pub fn equirect_direction(u: f64, v: f64) -> DVec3 {
    let (sin_theta, cos_theta) = (PI * v).sin_cos();
    let (sin_phi, cos_phi) = (PI * (2.0 * u - 1.0)).sin_cos();
    DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
}

/// (u, v) of a direction (any length) in an equirectangular map, u in [0, 1), v in [0, 1]: the inverse of
/// [`equirect_direction`]. At the poles u is 0.5.
pub fn equirect_uv(direction: DVec3) -> (f64, f64) {
    let phi = if direction.x == 0.0 && direction.y == 0.0 { 0.0 } else { direction.y.atan2(direction.x) };
    let theta = direction.x.hypot(direction.y).atan2(direction.z);
    let u = phi / (2.0 * PI) + 0.5;
    (if u >= 1.0 { 0.0 } else { u }, theta / PI)
}

/// Exact solid angle, in steradians, of one texel in a row of an equirectangular map:
/// (2 pi / w)(cos theta_0 - cos theta_1) = (4 pi / w) sin(theta_mid) sin(pi / 2h). Rows sum to 4 pi.
pub fn equirect_row_solid_angle(width: usize, height: usize, row: usize) -> f64 {
    let half = 0.5 * PI / height as f64;
    let mid = PI * (row as f64 + 0.5) / height as f64;
    4.0 * PI / width as f64 * mid.sin() * half.sin()
}

/// Direction of an angular map, map axis +z: polar angle pi r, azimuth atan2(v, u), (u, v) in [-1, 1]
/// (Eq. 6 of [Now11] with its two angles put right). `None` outside r <= 1 and for NaN.
pub fn angular_direction(u: f64, v: f64) -> Option<DVec3> {
    charts::angular_direction(u, v).map(DVec3::from_array)
}

/// (u, v) of a direction (any length but zero) in an angular map: the inverse of [`angular_direction`].
/// Straight behind (-z), a whole circle in the map, gives (1, 0); a zero vector gives (0, 0).
pub fn angular_uv(direction: DVec3) -> (f64, f64) {
    let sine = direction.x.hypot(direction.y);
    let r = sine.atan2(direction.z) / PI;
    if sine > 0.0 { (r * direction.x / sine, r * direction.y / sine) } else { (r, 0.0) }
}

/// Solid angle of texel (i, j) of an angular map of w x w texels: (2 pi / w)^2 sinc(pi r) at its centre
/// (Eq. 6 of [Now11]), zero where the centre lies outside the disc.
pub fn angular_texel_solid_angle(width: usize, i: usize, j: usize) -> f64 {
    let w = width as f64;
    let centre = |k: usize| (2.0 * k as f64 + 1.0) / w - 1.0;
    charts::angular_jacobian(centre(i), centre(j)) * 4.0 / (w * w)
}

/// Unit direction of a cube map at (u, v) in [-1, 1], u to the right and v DOWN in the face's picture, faces in
/// the order +x -x +y -y +z -z, laid out as D3D and GL lay them out (seen from inside, y up):
/// +x (1,-v,-u), -x (-1,-v,u), +y (u,1,v), -y (u,-1,-v), +z (u,-v,1), -z (-u,-v,-1). The axes are the
/// map's own. A face above 5 counts as 5.
pub fn cube_direction(face: usize, u: f64, v: f64) -> DVec3 {
    match face {
        0 => DVec3::new(1.0, -v, -u),
        1 => DVec3::new(-1.0, -v, u),
        2 => DVec3::new(u, 1.0, v),
        3 => DVec3::new(u, -1.0, -v),
        4 => DVec3::new(u, -v, 1.0),
        _ => DVec3::new(-u, -v, -1.0),
    }
    .normalize()
}

/// (face, u, v) of a direction (any length but zero): the inverse of [`cube_direction`].
pub fn cube_face_uv(direction: DVec3) -> (usize, f64, f64) {
    let DVec3 { x, y, z } = direction;
    let size = direction.abs();
    if size.x >= size.y && size.x >= size.z {
        if x >= 0.0 { (0, -z / size.x, -y / size.x) } else { (1, z / size.x, -y / size.x) }
    } else if size.y >= size.z {
        if y >= 0.0 { (2, x / size.y, z / size.y) } else { (3, x / size.y, -z / size.y) }
    } else if z >= 0.0 {
        (4, x / size.z, -y / size.z)
    } else {
        (5, -x / size.z, -y / size.z)
    }
}

/// Exact solid angle of texel (i, j) of a cube face of w x w texels; the six faces sum to 4 pi. (Eq. 7 of
/// [Now11] is its midpoint rule: `charts::cube_texel_solid_angle_midpoint`.)
pub fn cube_texel_solid_angle(width: usize, i: usize, j: usize) -> f64 {
    charts::cube_texel_solid_angle(width, i, j)
}

/// Solid angle of the spherical triangle of three unit vectors, in (-2 pi, 2 pi]: positive where they turn
/// counter-clockwise seen from outside: 2 atan2(a.(b x c), 1 + a.b + b.c + c.a).
pub fn triangle_solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    // The triple product of differences is the same number, and keeps its digits in small triangles.
    let triple = a.dot((b - a).cross(c - a));
    2.0 * triple.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
}

/// A ray's meeting with a mirror ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflection {
    /// Where the ray meets the sphere, in the frame of the ray.
    pub point: DVec3,
    /// Unit normal there, away from the centre.
    pub normal: DVec3,
    /// Unit direction of the mirrored ray, R = d - 2 (d.n) n.
    pub reflected: DVec3,
    /// Length of the ray up to the point.
    pub distance: f64,
}

/// Mirrors a ray off a sphere, from outside ([`mirrored`]). `direction` may have any length but zero. `None` where
/// the ray misses, where the sphere is behind it, or where it starts inside.
pub fn reflect_off_sphere(origin: DVec3, direction: DVec3, centre: DVec3, radius: f64) -> Option<Reflection> {
    let hit = mirrored(origin.into(), direction.into(), centre.into(), radius)?;
    Some(Reflection {
        point: hit.point.into(),
        normal: hit.normal.into(),
        reflected: hit.reflected.into(),
        distance: hit.distance,
    })
}

/// The point of a mirror ball in which `eye` sees the far direction `reflected` (any length but zero). `None`
/// inside the cone behind the ball, half angle asin(radius / distance), and where the eye is not outside.
///
/// With alpha the angle of the normal from centre -> eye and psi that of the camera ray, the mirrored ray stands at
/// 2 alpha + psi(alpha), psi = atan2(rho sin alpha, D - rho cos alpha), which rises with alpha: the inverse of
/// `charts::ball_polar_angle` for any eye.
pub fn sphere_point_reflecting(eye: DVec3, centre: DVec3, radius: f64, reflected: DVec3) -> Option<DVec3> {
    let to_eye = eye - centre;
    let distance = to_eye.length();
    let axis = to_eye.try_normalize()?;
    let wanted = reflected.try_normalize()?;
    let q = radius / distance;
    if !(q > 0.0 && q < 1.0) {
        return None;
    }
    let across = wanted - axis * wanted.dot(axis);
    let gamma = across.length().atan2(wanted.dot(axis));
    if !(gamma <= PI - q.asin()) {
        return None;
    }
    let Some(side) = across.try_normalize() else { return Some(centre + radius * axis) };
    let (mut low, mut high) = (0.0, q.acos());
    let mut alpha = (gamma / (2.0 + q / (1.0 - q))).min(high);
    // Newton, kept inside the bracket by bisection: quadratic, and total.
    for _ in 0..60 {
        let (sin_a, cos_a) = f64::sin_cos(alpha);
        let error = 2.0 * alpha + (q * sin_a).atan2(1.0 - q * cos_a) - gamma;
        if error > 0.0 {
            high = alpha
        } else {
            low = alpha
        }
        let slope = 2.0 + q * (cos_a - q) / (1.0 + q * q - 2.0 * q * cos_a);
        let newton = alpha - error / slope;
        let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
        if (next - alpha).abs() <= 1e-16 {
            break;
        }
        alpha = next;
    }
    let (sin_a, cos_a) = alpha.sin_cos();
    Some(centre + radius * (axis * cos_a + side * sin_a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0_f64, -PI..PI).prop_map(|(z, phi)| {
            let s = (1.0 - z * z).sqrt();
            DVec3::new(s * phi.cos(), s * phi.sin(), z)
        })
    }

    #[test]
    fn equirect_axes() {
        assert!(equirect_direction(0.5, 0.5).distance(DVec3::X) < 1e-15);
        assert!(equirect_direction(0.75, 0.5).distance(DVec3::Y) < 1e-15);
        assert!(equirect_direction(0.1, 0.0).distance(DVec3::Z) < 1e-15);
        assert_eq!(equirect_uv(DVec3::NEG_X).0, 0.0);
        assert_eq!(equirect_uv(DVec3::NEG_Z), (0.5, 1.0));
    }

    #[test]
    fn solid_angles_sum_to_the_sphere() {
        let equirect: f64 = (0..33).map(|row| 64.0 * equirect_row_solid_angle(64, 33, row)).sum();
        assert!((equirect - 4.0 * PI).abs() < 1e-13, "{equirect}");
        let cube: f64 = (0..17 * 17).map(|t| 6.0 * cube_texel_solid_angle(17, t % 17, t / 17)).sum();
        assert!((cube - 4.0 * PI).abs() < 1e-12, "{cube}");
        // Disc counting at w = 64: 2e-6 relative (spec 3).
        let angular: f64 = (0..4096).map(|t| angular_texel_solid_angle(64, t % 64, t / 64)).sum();
        assert!((angular / (4.0 * PI) - 1.0).abs() < 3e-6, "{angular}");
    }

    #[test]
    fn octant_and_small_triangle() {
        assert!((triangle_solid_angle(DVec3::X, DVec3::Y, DVec3::Z) - 0.5 * PI).abs() < 1e-15);
        assert!((triangle_solid_angle(DVec3::X, DVec3::Z, DVec3::Y) + 0.5 * PI).abs() < 1e-15);
        let e = 1e-6;
        let small = triangle_solid_angle(
            DVec3::Z,
            DVec3::new(e, 0.0, 1.0).normalize(),
            DVec3::new(0.0, e, 1.0).normalize(),
        );
        assert!((small / (0.5 * e * e) - 1.0).abs() < 1e-9, "{small}");
    }

    #[test]
    fn rays_that_do_not_meet_the_ball() {
        let ball = |o, d| reflect_off_sphere(o, d, DVec3::Z * 5.0, 1.0);
        assert!(ball(DVec3::ZERO, DVec3::Z).is_some());
        assert!(ball(DVec3::ZERO, DVec3::NEG_Z).is_none());
        assert!(ball(DVec3::ZERO, DVec3::X).is_none());
        assert!(ball(DVec3::Z * 5.0, DVec3::Z).is_none());
        assert!(ball(DVec3::ZERO, DVec3::ZERO).is_none());
        assert!(ball(DVec3::ZERO, DVec3::NAN).is_none());
        assert!(sphere_point_reflecting(DVec3::ZERO, DVec3::Z * 5.0, 1.0, DVec3::Z).is_none());
        assert!(sphere_point_reflecting(DVec3::ZERO, DVec3::Z * 5.0, 1.0, DVec3::NEG_Z).is_some());
        assert!(angular_direction(f64::NAN, 0.0).is_none());
    }

    proptest! {
        #[test]
        fn charts_invert(d in direction()) {
            let (u, v) = equirect_uv(d);
            prop_assert!((0.0..1.0).contains(&u));
            prop_assert!(equirect_direction(u, v).distance(d) < 1e-13);
            let (face, u, v) = cube_face_uv(d);
            prop_assert!(cube_direction(face, u, v).distance(d) < 1e-14);
            let (u, v) = angular_uv(d);
            prop_assert!(angular_direction(u * (1.0 - 1e-15), v * (1.0 - 1e-15)).unwrap().distance(d) < 1e-13);
        }

        #[test]
        fn the_ball_is_inverted(d in direction(), q in 0.01..0.9_f64, r in 0.05..2.0_f64) {
            let eye = DVec3::new(0.3, -2.0, 1.0);
            let centre = eye + DVec3::new(0.5, 0.7, -0.4).normalize() * (r / q);
            let Some(point) = sphere_point_reflecting(eye, centre, r, d) else {
                let behind = d.angle_between(centre - eye);
                prop_assert!(behind <= q.asin() + 1e-7);
                return Ok(());
            };
            let hit = reflect_off_sphere(eye, point - eye, centre, r);
            // At the very rim rounding may let the ray pass beside the ball.
            prop_assume!(d.angle_between(centre - eye) > q.asin() + 1e-3);
            let hit = hit.unwrap();
            prop_assert!(hit.reflected.distance(d) < 1e-9, "{} away", hit.reflected.distance(d));
            prop_assert!((hit.distance - point.distance(eye)).abs() < 1e-9 * hit.distance);
        }
    }
}
