//! Directions spread evenly on the spiral by the golden angle: the only one of the project.

use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f64::consts::PI;

/// The golden angle in single precision, pi (3 - sqrt 5).
const GOLDEN_F32: f32 = 2.399_963_2;

/// Direction j of n of equal area on the sphere, from +z down to -z: z = 1 - 2 (j + 1/2)/n, phi = pi (1 + sqrt 5)(j + 1/2).
/// Unit.
pub fn direction(j: usize, n: usize) -> DVec3 {
    let step = j as f64 + 0.5;
    let z = 1.0 - 2.0 * step / n.max(1) as f64;
    let (sine, cosine) = (PI * (1.0 + 5.0_f64.sqrt()) * step).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(radius * cosine, radius * sine, z)
}

/// The unit vector of the plane that is turned by k golden angles.
pub fn turn(k: usize) -> DVec2 {
    let (sine, cosine) = (PI * (3.0 - 5f64.sqrt()) * k as f64).sin_cos();
    DVec2::new(cosine, sine)
}

/// [`turn`] in single precision: its own rounding, with which rooms were made ready.
pub fn turn_f32(k: usize) -> Vec2 {
    let (sine, cosine) = (GOLDEN_F32 * k as f32).sin_cos();
    Vec2::new(cosine, sine)
}

/// Distances from +z, as sines, for a density of the cosine...
pub fn by_cosine(share: f64) -> f64 {
    share.sqrt()
}

/// ...and for an even one on the upper half of the sphere.
pub fn evenly(share: f64) -> f64 {
    (share * (2.0 - share)).sqrt()
}

/// `count` directions of the upper half of the sphere; `radius` is the distance from +z, as a sine, that a share of the
/// directions lies within.
pub fn upper(count: usize, radius: fn(f64) -> f64) -> Vec<Vec3> {
    let one = |k: usize| {
        let radius = radius((k as f64 + 0.5) / count as f64);
        (turn(k) * radius).extend((1.0 - radius * radius).sqrt()).as_vec3()
    };
    (0..count).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_unit_and_spread_evenly() {
        let n = 4000;
        let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        for d in (0..n).map(|j| direction(j, n)) {
            assert!((d.length() - 1.0).abs() < 1e-12);
            (sum, squares) = (sum + d, squares + d * d);
        }
        assert!((sum / n as f64).length() < 1e-3 && (squares / n as f64 - 1.0 / 3.0).length() < 1e-3);
        // Means of z over the half: 2/3 by the cosine, 1/2 evenly.
        for (radius, want) in [(by_cosine as fn(f64) -> f64, 2.0 / 3.0), (evenly, 0.5)] {
            let all = upper(1000, radius);
            let mean = all.iter().map(|d| f64::from(d.z)).sum::<f64>() / 1000.0;
            assert!((mean - want).abs() < 1e-3, "{mean} {want}");
            assert!(all.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
        }
        // The angle's error in single precision: k times half a step of the constant, and half a step of their product.
        for k in [0, 1, 7, 100] {
            let most = k as f32 * (1.2e-7 + 0.5 * f32::EPSILON * GOLDEN_F32) + 1e-6;
            assert!((turn(k).as_vec2() - turn_f32(k)).length() < most);
        }
    }
}
