//! [`visibility`](super::visibility) for neighbours on a receiver side by side: the same numbers, bit for bit.

use super::{FAINT, MOST_VIEWS, PlaceView, PointCamera, part::share};
use crate::visibility::shadow_maps::ShadowMap;
use glam::Vec3;

/// Places along an axis of a light at most.
const MOST: usize = super::MOST_SIDE as usize;

/// The views of a light, made ready to be read.
#[derive(Clone, Debug)]
pub struct PlaceReads {
    count: usize,
    /// Of each view.
    aside: [[f32; MOST_VIEWS]; 2],
    ahead: [f32; MOST_VIEWS],
    start: [[f32; MOST_VIEWS]; 2],
}

/// Neighbours as a light's middle sees them: positions times distance without the map's corner, and the distance.
struct ReadLanes<const N: usize> {
    at: [[f32; N]; 2],
    w: [f32; N],
}

impl PlaceReads {
    /// Of a light without a map: it reaches every point.
    pub const NONE: Self = Self {
        count: 0,
        aside: [[0.0; MOST_VIEWS]; 2],
        ahead: [0.0; MOST_VIEWS],
        start: [[0.0; MOST_VIEWS]; 2],
    };

    /// Of a light.
    pub fn new(camera: &PointCamera) -> Self {
        let count = camera.views().min(MOST_VIEWS);
        let mut all = Self { count, ..Self::NONE };
        for k in 0..count {
            let PlaceView { aside, ahead, start } = camera.view(k);
            for axis in 0..2 {
                (all.aside[axis][k], all.start[axis][k]) = (aside[axis], start[axis]);
            }
            all.ahead[k] = ahead;
        }
        all
    }

    /// Share of the light that reaches each of N points (world frame, coordinate by coordinate) along a straight line; `None`:
    /// all of it reaches all. `part` gives what of the light they see: middles and half lengths as in `SeenPart`, along both
    /// axes.
    #[inline(always)]
    pub fn visibility<const N: usize>(
        &self,
        maps: &[ShadowMap],
        camera: &PointCamera,
        points_world: &[[f32; N]; 3],
        part: impl FnOnce() -> [[f32; N]; 4],
    ) -> Option<[f32; N]> {
        let mut near = self.near(maps, camera, points_world);
        if near == 0 {
            return None;
        }
        let seen = ReadLanes::new(camera, points_world);
        let side = camera.side;
        let mut hidden = [0.0f32; N];
        if self.count == 1 {
            let blocks = self.blocks(0, maps.first()?, camera, &seen);
            for i in 0..N {
                hidden[i] = if blocks[i] { 1.0 } else { 0.0 };
            }
        } else {
            let [middle_u, middle_v, half_u, half_v] = part();
            let (mut along_u, mut along_v) = ([[0.0f32; N]; MOST], [[0.0f32; N]; MOST]);
            for cell in 0..side {
                let c = cell as usize % MOST;
                for i in 0..N {
                    along_u[c][i] = share(cell, side, middle_u[i], half_u[i]);
                    along_v[c][i] = share(cell, side, middle_v[i], half_v[i]);
                }
            }
            while near != 0 {
                let k = near.trailing_zeros();
                near &= near - 1;
                let Some(map) = maps.get(k as usize) else { break };
                let blocks = self.blocks(k as usize, map, camera, &seen);
                let (u, v) = (&along_u[(k % side) as usize % MOST], &along_v[(k / side) as usize % MOST]);
                for i in 0..N {
                    hidden[i] += if blocks[i] { u[i] * v[i] } else { 0.0 };
                }
            }
        }
        let mut visible = [1.0; N];
        for i in 0..N {
            let open = 1.0 - hidden[i];
            visible[i] = if open > FAINT { open } else { 0.0 };
        }
        Some(visible)
    }

    /// In which views casters may be before some of the points: a bit each.
    #[inline(always)]
    fn near<const N: usize>(
        &self,
        maps: &[ShadowMap],
        camera: &PointCamera,
        points_world: &[[f32; N]; 3],
    ) -> u64 {
        let corner = camera.corner();
        let end = |i: usize| {
            let p = points_world.map(|axis| axis[i]);
            let [x, y, w] = camera.rows.map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3]);
            [x + corner[0] * w, y + corner[1] * w, w]
        };
        let ends = [end(0), end(N - 1)];
        let mut at = [[[0.0f32; MOST_VIEWS]; 2]; 2];
        let mut before = [[false; MOST_VIEWS]; 2];
        for (e, [x, y, w]) in ends.into_iter().enumerate() {
            for k in 0..self.count {
                let ahead = w - self.ahead[k];
                let inverse = 1.0 / ahead;
                at[e][0][k] = (x - self.aside[0][k]) * inverse + self.start[0][k];
                at[e][1][k] = (y - self.aside[1][k]) * inverse + self.start[1][k];
                before[e][k] = !(ahead > camera.near_m);
            }
        }
        let mut near = 0;
        for (k, map) in maps.iter().enumerate().take(self.count) {
            let may = if before[0][k] || before[1][k] {
                // Both before the near plane: before every caster.
                before[0][k] != before[1][k]
            } else {
                let low = [0, 1].map(|axis: usize| at[0][axis][k].min(at[1][axis][k]) - super::BESIDE_TEXELS);
                let high =
                    [0, 1].map(|axis: usize| at[0][axis][k].max(at[1][axis][k]) + super::BESIDE_TEXELS);
                super::is_held(map, camera, low, high)
            };
            near |= u64::from(may) << k;
        }
        near
    }

    /// Whether a caster is before each of the points in view `k`.
    #[inline(always)]
    fn blocks<const N: usize>(
        &self,
        k: usize,
        map: &ShadowMap,
        camera: &PointCamera,
        seen: &ReadLanes<N>,
    ) -> [bool; N] {
        let (aside, start) = ([self.aside[0][k], self.aside[1][k]], [self.start[0][k], self.start[1][k]]);
        let (ahead, near_m) = (self.ahead[k], camera.near_m);
        let (side, texels) = (camera.texels as f32, map.depth());
        let (mut at, mut depth) = ([0i32; N], [0.0f32; N]);
        for i in 0..N {
            let w = seen.w[i] - ahead;
            let inverse = 1.0 / w;
            let x = ((seen.at[0][i] - aside[0]) * inverse + start[0]).floor();
            let y = ((seen.at[1][i] - aside[1]) * inverse + start[1]).floor();
            let within = (w > near_m) & (x >= 0.0) & (y >= 0.0) & (x < side) & (y < side);
            // Numbers of texels are exact: views have at most 2^24 of them.
            let texel = if within { y * side + x } else { -1.0 };
            at[i] = texel as i32;
            depth[i] = 1.0 - near_m * inverse;
        }
        let mut blocks = [false; N];
        for i in 0..N {
            blocks[i] = texels.get(at[i] as usize).is_some_and(|stored| *stored < depth[i]);
        }
        blocks
    }
}

impl<const N: usize> ReadLanes<N> {
    #[inline(always)]
    fn new(camera: &PointCamera, points_world: &[[f32; N]; 3]) -> Self {
        let mut lanes = Self { at: [[0.0; N]; 2], w: [0.0; N] };
        let [px, py, pz] = points_world;
        let [column, row, forward] = &camera.rows;
        let corner = camera.corner();
        for i in 0..N {
            let p = Vec3::new(px[i], py[i], pz[i]);
            let along = |r: &[f32; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
            let w = along(forward);
            lanes.at[0][i] = along(column) + corner[0] * w;
            lanes.at[1][i] = along(row) + corner[1] * w;
            lanes.w[i] = w;
        }
        lanes
    }
}
