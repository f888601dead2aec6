//! Where a camera sees something mirrored in a ball.

use glam::DVec3;

/// What is mirrored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MirroredPlace {
    /// Something at infinity, in this unit direction.
    Towards(DVec3),
    /// A point at hand, outside the ball.
    At(DVec3),
}

/// Point of the ball in which `eye` (outside) sees `mirrored`; `guess` is a normal near the answer. `None` where
/// the ball hides it, or too near the outline to be found.
///
/// The way eye - point - thing is shortest there (Fermat). Newton's method on the sphere: with unit vectors u to the
/// eye and v to the thing, the slope is the tangential part of u + v, and the curvature along a tangent a is the sum of (u + v).n / radius,
/// (1 - (u.a)^2) / |eye - point| and (1 - (v.a)^2) / |thing - point|; its axes lie in the plane of incidence and across it. For things at infinity the result is that of `math::sphere::sphere_point_reflecting`, at
/// a fraction of its time when the guess is good.
pub(super) fn point_reflecting(
    eye: DVec3,
    centre: DVec3,
    radius: f64,
    mirrored: MirroredPlace,
    guess: DVec3,
) -> Option<DVec3> {
    let mut normal = guess.try_normalize()?;
    for _ in 0..12 {
        let point = centre + radius * normal;
        let (u, eye_curvature) = unit_and_inverse_length(eye - point);
        let (v, thing_curvature) = match mirrored {
            MirroredPlace::Towards(direction) => (direction, 0.0),
            MirroredPlace::At(thing) => unit_and_inverse_length(thing - point),
        };
        let bend = (u + v).dot(normal);
        let slope = u + v - bend * normal;
        // In the plane of incidence (along u's tangential part), and across it.
        let along = u - u.dot(normal) * normal;
        let length_squared = along.length_squared().max(1e-30);
        let flat = |w: DVec3| 1.0 - w.dot(along).powi(2) / length_squared;
        let stiff = bend.max(1e-3) / radius;
        let stiff_along = stiff + flat(u) * eye_curvature + flat(v) * thing_curvature;
        let stiff_across = stiff + eye_curvature + thing_curvature;
        let part_along = along * (slope.dot(along) / length_squared);
        let step = (part_along / stiff_along + (slope - part_along) / stiff_across) / radius;
        let length = step.length();
        normal = (normal + if length > 0.5 { step * (0.5 / length) } else { step }).normalize();
        // The step before the last is 1e-4 of the radius at most, hundredths of a pixel; this one mends it.
        if length < 1e-4 {
            let point = centre + radius * normal;
            return (normal.dot(eye - point) > 0.0).then_some(point);
        }
    }
    None
}

fn unit_and_inverse_length(v: DVec3) -> (DVec3, f64) {
    let inverse = v.length_recip();
    (v * inverse, inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sphere::{reflect_off_sphere, sphere_point_reflecting};

    fn directions() -> impl Iterator<Item = DVec3> {
        (0..200).map(|k| {
            let z = 1.0 - (f64::from(k) + 0.5) / 100.0;
            let phi = 2.4 * f64::from(k);
            DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z)
        })
    }

    #[test]
    fn things_at_infinity_are_seen_where_the_exact_form_sees_them() {
        let (eye, centre, radius) = (DVec3::new(0.1, -0.5, 0.4), DVec3::new(0.0, 0.0, 0.05), 0.05);
        let mut found = 0;
        for direction in directions() {
            let guess = (direction + DVec3::new(0.1, -0.7, 0.5).normalize()).normalize();
            let Some(point) = point_reflecting(eye, centre, radius, MirroredPlace::Towards(direction), guess)
            else {
                continue;
            };
            let exact = sphere_point_reflecting(eye, centre, radius, direction).unwrap();
            // The last step of Newton's method mends up to 1e-4 of the radius.
            assert!(point.distance(exact) < 3e-5 * radius, "{direction}: {}", point.distance(exact) / radius);
            found += 1;
        }
        // All but the directions behind the ball.
        assert!(found >= 195, "{found}");
    }

    #[test]
    fn points_at_hand_are_seen_by_the_law_of_reflection() {
        let (eye, centre, radius) = (DVec3::new(0.1, -0.5, 0.4), DVec3::new(0.0, 0.0, 0.05), 0.05);
        for thing in [DVec3::new(0.2, -0.1, 0.0), DVec3::new(-0.07, 0.02, 0.0), DVec3::new(0.0, -0.09, 0.0)] {
            let guess = (eye - centre).normalize();
            let point = point_reflecting(eye, centre, radius, MirroredPlace::At(thing), guess).unwrap();
            let hit = reflect_off_sphere(eye, point - eye, centre, radius).unwrap();
            let miss = hit.reflected.cross((thing - hit.point).normalize()).length();
            assert!(miss < 1e-4, "{thing}: {miss}");
        }
    }
}
