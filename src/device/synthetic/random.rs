//! Counter-based random numbers: a number is a function of its key, so threads and order change nothing.

use crate::math::dice::{STEP, mix, unit};

/// Mixes a key to 64 well-spread bits (`dice::mix`, applied after each part).
pub fn bits(key: [u64; 3]) -> u64 {
    mix(key.into_iter().fold(STEP, |h, part| mix(h ^ part).wrapping_add(STEP)))
}

/// Uniform in [0, 1).
pub fn uniform(key: [u64; 3]) -> f64 {
    unit(bits(key))
}

/// Two independent uniform numbers in [0, 1) with 32 bits each.
pub fn uniform_pair(key: [u64; 3]) -> (f64, f64) {
    let h = bits(key);
    let scale = 1.0 / (1u64 << 32) as f64;
    ((h >> 32) as f64 * scale, (h & 0xffff_ffff) as f64 * scale)
}

/// Normal, mean 0 and standard deviation 1 (Box-Muller).
pub fn normal(key: [u64; 3]) -> f64 {
    let (a, b) = uniform_pair(key);
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Smooth noise over the plane, in [0, 1]: values at whole numbers, blended smoothly.
pub fn noise(seed: u64, x: f64, y: f64) -> f64 {
    let (ix, iy) = (x.floor(), y.floor());
    let (fx, fy) = (x - ix, y - iy);
    let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
    let at = |i: i64, j: i64| {
        uniform([seed, (ix as i64).wrapping_add(i) as u64, (iy as i64).wrapping_add(j) as u64])
    };
    let top = at(0, 0) + (at(1, 0) - at(0, 0)) * sx;
    let bottom = at(0, 1) + (at(1, 1) - at(0, 1)) * sx;
    top + (bottom - top) * sy
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_fixed_by_their_key_and_have_the_stated_moments() {
        assert_eq!(bits([1, 2, 3]), bits([1, 2, 3]));
        assert_ne!(bits([1, 2, 3]), bits([1, 3, 2]));
        let n = 100_000;
        let (mut mean, mut square, mut flat) = (0.0, 0.0, 0.0);
        for i in 0..n {
            let z = normal([7, 0, i]);
            mean += z / n as f64;
            square += z * z / n as f64;
            flat += uniform([8, 0, i]) / n as f64;
        }
        // Three standard errors: 3 / sqrt(1e5) = 0.0095; 3 sqrt(2 / 1e5) = 0.0134; 3 / sqrt(12e5) = 0.0027.
        assert!(mean.abs() < 0.0095 && (square - 1.0).abs() < 0.0134 && (flat - 0.5).abs() < 0.0027);
    }
}
