//! Where a camera sees something mirrored in a ball.

use glam::DVec3;

/// What is mirrored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Mirrored {
    /// Something at infinity, in this unit direction.
    Towards(DVec3),
    /// A point at hand, outside the ball.
    At(DVec3),
}

/// Point of the ball in which `eye` (outside) sees `mirrored`; `guess` is a unit normal near the answer. `None` where
/// the ball hides it.
///
/// The normal halves the angle between the ways to the eye and to the thing; both ways depend on the point only
/// through the ball's size, so repeating converges fast for a ball that is small against its distance
/// (a factor of about radius / distance each time, slower towards the rim). For things at infinity the result is that
/// of `math::sphere::sphere_point_reflecting`, at a third of its time.
pub(super) fn point_reflecting(
    eye: DVec3,
    centre: DVec3,
    radius: f64,
    mirrored: Mirrored,
    guess: DVec3,
) -> Option<DVec3> {
    let mut normal = guess;
    for _ in 0..40 {
        let point = centre + radius * normal;
        let to_eye = (eye - point).normalize();
        let to_thing = match mirrored {
            Mirrored::Towards(direction) => direction,
            Mirrored::At(thing) => (thing - point).normalize(),
        };
        let next = (to_eye + to_thing).try_normalize()?;
        let step = next.distance_squared(normal);
        normal = next;
        // 1e-6 of the radius: a few 1e-5 pixels.
        if step < 1e-12 {
            let point = centre + radius * normal;
            return (normal.dot(eye - point) > 0.0).then_some(point);
        }
    }
    None
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
            let Some(point) = point_reflecting(eye, centre, radius, Mirrored::Towards(direction), guess)
            else {
                continue;
            };
            let exact = sphere_point_reflecting(eye, centre, radius, direction).unwrap();
            // The stop rule leaves 1e-6 of the radius times the factor of convergence.
            assert!(point.distance(exact) < 1e-6 * radius, "{direction}: {}", point.distance(exact) / radius);
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
            let point = point_reflecting(eye, centre, radius, Mirrored::At(thing), guess).unwrap();
            let hit = reflect_off_sphere(eye, point - eye, centre, radius).unwrap();
            let miss = hit.reflected.cross((thing - hit.point).normalize()).length();
            assert!(miss < 1e-5, "{thing}: {miss}");
        }
    }
}
