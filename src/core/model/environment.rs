//! The picture of the environment that mirrors and sharp gloss see.

use crate::math::octahedral;
use glam::{Vec2, Vec3};

/// Linear radiance from every direction, world frame, on the octahedral square (`math::octahedral`).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OctahedralMap {
    side: usize,
    texels: Vec<[f32; 3]>,
}

impl OctahedralMap {
    /// Black, so many texels a side (at least 1).
    pub fn new(side: usize) -> Self {
        let mut map = Self::default();
        map.reshape(side);
        map
    }

    /// Makes it so many texels a side (at least 1), keeping its memory where that suffices; texels keep old values.
    pub fn reshape(&mut self, side: usize) {
        self.side = side.max(1);
        self.texels.resize(self.side * self.side, [0.0; 3]);
    }

    /// Texels a side; 0 for one that was never made.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Row by row.
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.texels
    }

    /// Row by row.
    pub fn texels_mut(&mut self) -> &mut [[f32; 3]] {
        &mut self.texels
    }

    /// Radiance in a direction (any length but zero), bilinear between texel centres, over the square's edges too.
    /// Twin: `seen_at` in `shaders/shared/surroundings.wgsl`.
    pub fn look(&self, direction: Vec3) -> [f32; 3] {
        if self.texels.is_empty() {
            return [0.0; 3];
        }
        let side = self.side as i32;
        let at = (octahedral::place(direction) + Vec2::ONE) * (0.5 * self.side as f32) - 0.5;
        let corner = at.floor();
        let (fx, fy) = (at.x - corner.x, at.y - corner.y);
        let (left, top) = (corner.x as i32, corner.y as i32);
        let texel = |dx: i32, dy: i32| {
            let (x, y) = octahedral::wrapped(left + dx, top + dy, side);
            self.texels[y * self.side + x]
        };
        let (a, b, c, d) = (texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1));
        std::array::from_fn(|k| {
            let upper = a[k] + fx * (b[k] - a[k]);
            let lower = c[k] + fx * (d[k] - c[k]);
            upper + fy * (lower - upper)
        })
    }
}

/// Prefiltered pictures at most.
pub const MOST_GLOSSY_LEVELS: usize = 10;
/// Exponent of the first prefiltered picture; each further one has twice the exponent of the one before.
pub const FIRST_EXPONENT: f32 = 8.0;

/// What mirrors and sharp gloss see of the place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnvironmentPicture {
    /// Another number: other pictures. `light::prefilter` gives each content its own.
    pub revision: u64,
    /// All light, hard lights included: what mirrors see (Eq. 21 of [Now11]). Never made: there is no picture.
    pub all: OctahedralMap,
    /// Level k: the mean under the Phong lobe of exponent `FIRST_EXPONENT * 2^k` (whatever its norm) about each
    /// direction. Without the hard lights, unless `holds_hard_lights`. May be empty.
    pub glossy: Vec<OctahedralMap>,
    /// The levels hold the hard lights, too: they are not to be added again.
    pub holds_hard_lights: bool,
}

impl EnvironmentPicture {
    /// Exponent of a level.
    pub fn exponent_of(level: usize) -> f32 {
        FIRST_EXPONENT * (level as f32).exp2()
    }

    /// The mean radiance under the lobe cos^exponent about a direction: between the two nearest levels, linear in the
    /// logarithm of the exponent; the first or last level beyond them. Black without levels.
    /// Twin: `gloss` in `shaders/shared/surroundings.wgsl`.
    pub fn gloss(&self, exponent: f32, direction: Vec3) -> [f32; 3] {
        let Some(last) = self.glossy.len().checked_sub(1) else { return [0.0; 3] };
        let at = (exponent / FIRST_EXPONENT).max(1.0).log2().min(last as f32);
        let low = at.floor();
        let below = self.glossy[low as usize].look(direction);
        let above = self.glossy[(low as usize + 1).min(last)].look(direction);
        std::array::from_fn(|c| below[c] + (at - low) * (above[c] - below[c]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_is_continuous_and_finds_the_texels() {
        let mut map = OctahedralMap::new(24);
        for row in 0..24 {
            for column in 0..24 {
                let d = octahedral::direction(octahedral::centre(column, row, 24));
                map.texels_mut()[row * 24 + column] = [d.x, d.y, d.z];
            }
        }
        for k in 0..2000 {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / 2000.0;
            let (s, c) = (2.4 * k as f32).sin_cos();
            let d = Vec3::new((1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z);
            // Linear between directions 9 to 14 degrees apart, with the fold at the equator: 0.035 measured.
            assert!(Vec3::from(map.look(d)).distance(d) < 0.05, "{d}: {:?}", map.look(d));
        }
        assert_eq!(OctahedralMap::default().look(Vec3::X), [0.0; 3]);
        assert!(map.look(Vec3::NAN).iter().all(|c| c.is_finite()));
    }

    #[test]
    fn gloss_passes_through_its_levels() {
        let level = |c: f32| {
            let mut map = OctahedralMap::new(4);
            map.texels_mut().fill([c; 3]);
            map
        };
        let picture =
            EnvironmentPicture { glossy: vec![level(1.0), level(2.0), level(4.0)], ..Default::default() };
        for (exponent, want) in [(0.0, 1.0), (8.0, 1.0), (16.0, 2.0), (32.0, 4.0), (1e6, 4.0)] {
            assert!((picture.gloss(exponent, Vec3::X)[1] - want).abs() < 1e-6, "{exponent}");
        }
        assert!((picture.gloss(8.0 * 2f32.sqrt(), Vec3::X)[0] - 1.5).abs() < 1e-5);
        assert_eq!(EnvironmentPicture::default().gloss(10.0, Vec3::X), [0.0; 3]);
    }
}
