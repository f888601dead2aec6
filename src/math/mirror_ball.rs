//! Rays mirrored by a ball, over f32 or f64. `sphere` gives them as glam's vectors in f64.

use super::{sh::Real, vector::Vector};

/// A ray's meeting with a mirror ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirrored<T> {
    /// Where the ray meets the sphere, in the frame of the ray.
    pub point: Vector<T, 3>,
    /// Unit normal there, away from the centre.
    pub normal: Vector<T, 3>,
    /// Unit direction of the mirrored ray, R = d - 2 (d.n) n.
    pub reflected: Vector<T, 3>,
    /// Length of the ray up to the point.
    pub distance: T,
}

/// Mirrors a ray off a sphere, from outside. `direction` may have any length but zero. `None` where the ray
/// misses, where the sphere is behind it, or where it starts inside.
pub fn mirrored<T: Real>(
    origin: Vector<T, 3>,
    direction: Vector<T, 3>,
    centre: Vector<T, 3>,
    radius: T,
) -> Option<Mirrored<T>> {
    let d = direction.unit()?;
    let from_centre = origin - centre;
    let along = from_centre.dot(d);
    // Distance of the ray's line from the centre, from the rejected vector: no cancellation far away.
    let miss = from_centre - d * along;
    let discriminant = (radius - miss.length()) * (radius + miss.length());
    let outside = from_centre.length() - radius;
    let o = T::zero();
    if !(radius > o && discriminant >= o && along < o && outside > o) {
        return None;
    }
    let root = discriminant.sqrt();
    // The near root as c / far root: stable where `-along - root` would cancel.
    let distance = outside * (from_centre.length() + radius) / (root - along);
    let normal = (miss - d * root) / radius;
    let point = centre + normal * radius;
    let reflected = (d - normal * (T::of(2.0) * d.dot(normal))).unit()?;
    distance.is_finite().then_some(Mirrored { point, normal, reflected, distance })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// In f32 a ball far off keeps its digits: what is lost is the ray's own rounding, which the curvature
        /// enlarges by distance over radius, and more towards the rim.
        #[test]
        fn single_precision_follows(
            side in prop::array::uniform2(-0.9..0.9_f64), distance in 0.5..20.0_f64, radius in 0.01..0.3_f64,
        ) {
            prop_assume!(distance > 1.5 * radius && side[0].hypot(side[1]) < 0.9);
            let centre = Vector([0.3 * distance, -0.2 * distance, distance]);
            let ray = centre + Vector([side[0] * radius, side[1] * radius, 0.0]);
            let narrow = |v: Vector<f64, 3>| Vector(v.0.map(|x| x as f32));
            let wide = |v: Vector<f32, 3>| Vector(v.0.map(f64::from));
            // Both see the rounded numbers.
            let (centre, ray, radius) = (wide(narrow(centre)), wide(narrow(ray)), f64::from(radius as f32));
            let (Some(want), Some(got)) = (
                mirrored(Vector::zero(), ray, centre, radius),
                mirrored(Vector::zero(), narrow(ray), narrow(centre), radius as f32),
            ) else {
                return Ok(());
            };
            // Half a unit in the last place of the distance, a few times over.
            let floor = 4.0 * f64::from(f32::EPSILON) * distance;
            prop_assert!((wide(got.point) - want.point).length() < floor);
            let steep = 1.0 / (1.0 - side[0].hypot(side[1]).powi(2)).sqrt();
            let off = (wide(got.reflected) - want.reflected).length();
            prop_assert!(off < 4.0 * steep * floor / radius, "{off:e}");
        }
    }
}
