//! The sphere on a square without seams: an octahedron about the sphere, its lower half folded out around the upper.
//! Twin: `shaders/shared/surroundings.wgsl`.

use glam::{Vec2, Vec3};

/// 1 with the sign of x; +1 for both zeros, so that a fold is never lost.
fn sign(x: f32) -> f32 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

/// Unit direction at a point of the square [-1, 1] x [-1, 1]: the middle is +z, the four corners are -z.
pub fn direction(at: Vec2) -> Vec3 {
    let z = 1.0 - at.x.abs() - at.y.abs();
    let folded = Vec2::new((1.0 - at.y.abs()) * sign(at.x), (1.0 - at.x.abs()) * sign(at.y));
    let xy = if z < 0.0 { folded } else { at };
    xy.extend(z).normalize_or(Vec3::Z)
}

/// Where a direction (any length but zero) lies on the square: the inverse of [`direction`]. A zero or non-finite
/// vector gives the middle.
pub fn place(direction: Vec3) -> Vec2 {
    let size = direction.x.abs() + direction.y.abs() + direction.z.abs();
    if !(size > 0.0 && size.is_finite()) {
        return Vec2::ZERO;
    }
    let at = Vec2::new(direction.x, direction.y) / size;
    if direction.z >= 0.0 {
        return at;
    }
    Vec2::new((1.0 - at.y.abs()) * sign(at.x), (1.0 - at.x.abs()) * sign(at.y))
}

/// The texel that a column and row up to one outside of `side` texels a side stands for: over an edge the square meets
/// itself, mirrored.
pub fn wrapped(column: i32, row: i32, side: i32) -> (usize, usize) {
    let (mut x, mut y) = (column, row);
    if x < 0 || x >= side {
        (x, y) = (x.clamp(0, side - 1), side - 1 - y);
    }
    if y < 0 || y >= side {
        (x, y) = (side - 1 - x, y.clamp(0, side - 1));
    }
    (x.clamp(0, side - 1) as usize, y.clamp(0, side - 1) as usize)
}

/// Centre of a texel in the square.
pub fn centre(column: usize, row: usize, side: usize) -> Vec2 {
    let place = |k: usize| (2 * k + 1) as f32 / side as f32 - 1.0;
    Vec2::new(place(column), place(row))
}

/// Solid angle of a texel, steradians: the area of the octahedron's shadow over the distance cubed, at its centre.
/// All together are 4 pi to 1 % from 16 texels a side on.
pub fn texel_sr(column: usize, row: usize, side: usize) -> f32 {
    let at = centre(column, row, side);
    let z = 1.0 - at.x.abs() - at.y.abs();
    let folded = Vec2::new(1.0 - at.y.abs(), 1.0 - at.x.abs());
    let xy = if z < 0.0 { folded } else { at };
    let width = 2.0 / side as f32;
    width * width / xy.extend(z).length().powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_lead_back_and_solid_angles_fill_the_sphere() {
        for side in [16, 64, 200] {
            let mut sum = 0.0f64;
            for row in 0..side {
                for column in 0..side {
                    let at = centre(column, row, side);
                    let d = direction(at);
                    assert!((d.length() - 1.0).abs() < 1e-6);
                    assert!(place(d * 3.0).distance(at) < 1e-5, "{at} {d}");
                    sum += f64::from(texel_sr(column, row, side));
                }
            }
            // Midpoints of a smooth density with kinks along the axes: 0.3 % measured at 16.
            assert!(
                (sum / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.01 * 16.0 / side as f64,
                "{side}: {sum}"
            );
        }
        assert_eq!(place(Vec3::Z), Vec2::ZERO);
        assert_eq!(place(Vec3::ZERO), Vec2::ZERO);
        assert_eq!(place(Vec3::NEG_Z).abs(), Vec2::ONE);
    }

    #[test]
    fn over_an_edge_lies_the_texel_that_is_next_on_the_sphere() {
        let side = 32;
        let near = 2.0 * (4.0 * std::f32::consts::PI).sqrt() / side as f32;
        for k in 0..side {
            for (outside, inside) in
                [((-1, k), (0, k)), ((side, k), (side - 1, k)), ((k, -1), (k, 0)), ((k, side), (k, side - 1))]
            {
                let (x, y) = wrapped(outside.0, outside.1, side);
                let d = direction(centre(x, y, side as usize));
                let beside = direction(centre(inside.0 as usize, inside.1 as usize, side as usize));
                assert!(d.angle_between(beside) < near, "{outside:?}: {}", d.angle_between(beside));
            }
        }
        assert_eq!(wrapped(-1, -1, side), (31, 31));
    }
}
