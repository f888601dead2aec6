//! Shadow maps read at several points of a flat receiver at once: what looking them up one by one gives.

use super::{MAX_BIAS_TEXELS, ROUNDING_TEXELS, ShadowMapSet, bias_m, lit};

/// What the positions in the maps may be off by, texels: rounding of points far away.
const ROUNDING_ROOM: f32 = 1.0;

/// What all points of a flat receiver share under one light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatLight {
    /// Number of the light and of its map.
    pub light: usize,
    /// Its normal times the light's direction, above 0.
    pub cosine: f32,
    /// Depth that is taken off against acne, as a share of the map's depth.
    bias: f32,
}

impl ShadowMapSet {
    /// For a flat receiver whose normal times light `k`'s direction is `cosine`; `None` where the light has no map or the
    /// receiver is turned away.
    pub fn flat_light(&self, k: usize, taps: u32, cosine: f32) -> Option<FlatLight> {
        let camera = self.cameras.get(k)?.as_ref().filter(|_| cosine > 0.0)?;
        let (texel_m, most_m) = (camera.texel_m, MAX_BIAS_TEXELS * camera.texel_m);
        let bias = bias_m(texel_m, 0.5 * taps as f32, cosine, most_m) + ROUNDING_TEXELS * texel_m;
        Some(FlatLight { light: k, cosine, bias: bias / camera.depth_m })
    }

    /// Whether a light's shadow may fall into a box (low and high corner, world frame).
    #[inline(always)]
    pub fn may_shadow(&self, k: usize, low: [f32; 3], high: [f32; 3]) -> bool {
        let (Some(Some(camera)), Some(map)) = (self.cameras.get(k), self.maps.get(k)) else { return false };
        let (mut from, mut to) = ([0.0; 2], [0.0; 2]);
        for (row, (from, to)) in camera.rows.iter().zip(from.iter_mut().zip(&mut to)) {
            (*from, *to) = (row[3] - ROUNDING_ROOM, row[3] + ROUNDING_ROOM);
            for axis in 0..3 {
                let (a, b) = (row[axis] * low[axis], row[axis] * high[axis]);
                *from += if a < b { a } else { b };
                *to += if a < b { b } else { a };
            }
        }
        if !(to[0] - from[0] + to[1] - from[1]).is_finite() {
            return true;
        }
        let side = camera.texels as f32;
        let beside = to[0] < 0.0 || to[1] < 0.0 || from[0] > side || from[1] > side;
        !beside && map.reach().is_near_box(from, to)
    }

    /// The share of a light that reaches each of the first `count` of N points of a flat receiver (world frame, coordinate
    /// by coordinate): as [`ShadowMapSet::visibility`].
    #[inline(always)]
    pub fn visibility_flat<const N: usize>(
        &self,
        flat: &FlatLight,
        taps: u32,
        points_world: &[[f32; N]; 3],
        count: usize,
    ) -> [f32; N] {
        let mut visible = [1.0; N];
        let (Some(Some(camera)), Some(map)) = (self.cameras.get(flat.light), self.maps.get(flat.light))
        else {
            return visible;
        };
        let side = camera.texels as f32;
        let ([px, py, pz], [a, b, c]) = (points_world, &camera.rows);
        let (mut x, mut y, mut depth) = ([0.0f32; N], [0.0f32; N], [0.0f32; N]);
        let mut inside = [false; N];
        for i in 0..N {
            let map = |r: &[f32; 4]| r[0] * px[i] + r[1] * py[i] + r[2] * pz[i] + r[3];
            (x[i], y[i], depth[i]) = (map(a), map(b), map(c));
            inside[i] = (x[i] > 0.0) & (x[i] < side) & (y[i] > 0.0) & (y[i] < side) & (depth[i] > 0.0);
        }
        for i in 0..count.min(N) {
            if inside[i] && map.reach().is_near(x[i], y[i]) {
                visible[i] = lit(map.depth(), camera.texels, taps, x[i], y[i], depth[i] - flat.bias);
            }
        }
        visible
    }
}
