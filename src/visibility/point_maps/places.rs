//! [`visibility`](super::visibility) for neighbours on a flat receiver side by side: the same numbers, bit for bit.

use super::{EMPTY_DEPTH, LightPlaces, MAX_BIAS_TEXELS, PointCamera, ROUNDING_TEXELS, SMOOTH_TEXELS};
use crate::visibility::shadow_maps::ShadowMap;
use glam::Vec3;

/// Places of a light at most.
const MOST: usize = 64;

/// The places of a light, made ready to read its map.
#[derive(Clone, Debug)]
pub struct PlaceReads {
    /// How far they move what the map is read at, metres at the light.
    reach_m: f32,
    count: usize,
    /// Of each, how far along both half axes of the part that is seen, and how far beside its position it is read, texels
    /// right and up.
    places: [[f32; 4]; MOST],
    half_axes: [[f32; 3]; 2],
}

/// Neighbours as a light's camera sees them.
struct Lanes<const N: usize> {
    /// Column and row, texels.
    at: [[f32; N]; 2],
    depth: [f32; N],
    /// Inverse distances along the axis, 1 / metres.
    inverse: [f32; N],
    slope: [[f32; N]; 2],
    rounding: [f32; N],
    /// Behind the near plane.
    valid: [bool; N],
}

impl PlaceReads {
    /// Of a light; `reach_m` as for `PointMaps::may_shadow`.
    pub fn new(places: &LightPlaces, reach_m: f32) -> Self {
        let n = places.side.clamp(1, 8);
        let step = |i: u32| (2.0 * i as f32 + 1.0) / n as f32 - 1.0;
        let smooth = if n > 1 { SMOOTH_TEXELS } else { 0.0 };
        let mut all = [[0.0; 4]; MOST];
        for (k, slot) in (0..n * n).zip(&mut all) {
            let (a, b) = (step(k % n), step(k / n));
            *slot = [a, b, smooth * a, smooth * b];
        }
        Self { reach_m, count: (n * n) as usize, places: all, half_axes: places.half_axes }
    }

    /// How far the places move what the map is read at, metres at the light.
    pub fn reach_m(&self) -> f32 {
        self.reach_m
    }

    /// Share of the light that reaches each of N points (world frame, coordinate by coordinate) of a flat receiver of unit
    /// `normal`; `part` gives what of the light they see: middles and half lengths as in `SeenPart`, along both axes.
    #[inline(always)]
    pub fn visibility<const N: usize>(
        &self,
        map: &ShadowMap,
        camera: &PointCamera,
        points_world: &[[f32; N]; 3],
        normal: Vec3,
        part: impl FnOnce() -> [[f32; N]; 4],
    ) -> [f32; N] {
        let seen = Lanes::new(camera, points_world, normal);
        let mut visible = [1.0; N];
        if !self.is_near(map, camera, &seen) {
            return visible;
        }
        let stored = |texel: i32| map.depth().get(texel as usize).copied().unwrap_or(EMPTY_DEPTH);
        let inverse = |depth: f32| (1.0 - depth) / camera.near_m;
        if self.count == 1 {
            // All reads are one.
            let (texels, limits) = texels_of(camera, &seen, &seen.at);
            for i in 0..N {
                let hides = seen.valid[i] && stored(texels[i]) < limits[i];
                visible[i] = if hides { 0.0 } else { 1.0 };
            }
            return visible;
        }
        let part = part();
        let (mut sums, mut counts) = ([0.0f32; N], [0u32; N]);
        let mut add = |(texels, limits): ([i32; N], [f32; N])| {
            for i in 0..N {
                let depth = stored(texels[i]);
                let hides = depth < limits[i];
                sums[i] += if hides { depth } else { 0.0 };
                counts[i] += u32::from(hides);
            }
        };
        // Blockers at the near plane, and what hides the point itself.
        for k in 0..self.count {
            add(self.read(camera, &seen, &part, &[inverse(0.0); N], k));
        }
        add(texels_of(camera, &seen, &seen.at));
        let mut inverse_b = [0.0f32; N];
        let mut any = false;
        for i in 0..N {
            inverse_b[i] = inverse(sums[i] / counts[i].max(1) as f32);
            any |= seen.valid[i] & (counts[i] > 0);
        }
        if !any {
            return visible;
        }
        let mut hidden = [0u32; N];
        for k in 0..self.count {
            let (texels, limits) = self.read(camera, &seen, &part, &inverse_b, k);
            for i in 0..N {
                hidden[i] += u32::from(stored(texels[i]) < limits[i]);
            }
        }
        for i in 0..N {
            let share = (self.count as u32 - hidden[i]) as f32 / self.count as f32;
            visible[i] = if seen.valid[i] & (counts[i] > 0) { share } else { 1.0 };
        }
        visible
    }

    /// Whether a caster may be within the filter around some of the points.
    #[inline(always)]
    fn is_near<const N: usize>(&self, map: &ShadowMap, camera: &PointCamera, seen: &Lanes<N>) -> bool {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        let mut deepest = 0.0f32;
        for i in 0..N {
            if seen.valid[i] {
                for axis in 0..2 {
                    let at = seen.at[axis][i];
                    low[axis] = if at < low[axis] { at } else { low[axis] };
                    high[axis] = if at > high[axis] { at } else { high[axis] };
                }
                deepest = if seen.depth[i] > deepest { seen.depth[i] } else { deepest };
            }
        }
        let room = self.reach_m * (deepest / camera.near_m) / camera.texel + SMOOTH_TEXELS + 1.0;
        let (low, high) = (low.map(|v| v - room), high.map(|v| v + room));
        let side = camera.texels as f32;
        let within = high[0] >= 0.0 && high[1] >= 0.0 && low[0] <= side && low[1] <= side;
        within && map.reach().is_near_box(low, high)
    }

    /// The texels that place `k` is read at for blockers of these inverse distances along the axis, and what depth hides it
    /// there; a texel beside the map is -1.
    #[inline(always)]
    fn read<const N: usize>(
        &self,
        camera: &PointCamera,
        seen: &Lanes<N>,
        [middle_u, middle_v, half_u, half_v]: &[[f32; N]; 4],
        inverse_b: &[f32; N],
        k: usize,
    ) -> ([i32; N], [f32; N]) {
        let [step_u, step_v, beside_x, beside_y] = self.places[k];
        let [u, v] = self.half_axes;
        let corner = camera.corner();
        let mut at = [[0.0f32; N]; 2];
        for i in 0..N {
            let along_u = middle_u[i] + half_u[i] * step_u;
            let along_v = middle_v[i] + half_v[i] * step_v;
            let [right, up, ahead] = [0, 1, 2].map(|c: usize| u[c] * along_u + v[c] * along_v);
            let inverse_r = seen.inverse[i];
            let forward = 1.0 / (1.0 - ahead * inverse_r);
            let scale = forward * (1.0 - ahead * inverse_b[i]);
            let along = forward * (inverse_b[i] - inverse_r) / camera.texel;
            at[0][i] = (seen.at[0][i] + corner[0]) * scale - corner[0] + right * along + beside_x;
            at[1][i] = (seen.at[1][i] + corner[1]) * scale - corner[1] + up * along + beside_y;
        }
        texels_of(camera, seen, &at)
    }
}

#[inline(always)]
fn texels_of<const N: usize>(
    camera: &PointCamera,
    seen: &Lanes<N>,
    at: &[[f32; N]; 2],
) -> ([i32; N], [f32; N]) {
    let side = camera.texels as f32;
    let (mut texels, mut limits) = ([0i32; N], [0.0f32; N]);
    for i in 0..N {
        let (x, y) = (at[0][i].floor(), at[1][i].floor());
        let within = (x >= 0.0) & (y >= 0.0) & (x < side) & (y < side);
        let plane = seen.depth[i]
            + seen.slope[0][i] * (x + 0.5 - seen.at[0][i])
            + seen.slope[1][i] * (y + 0.5 - seen.at[1][i]);
        let limit = plane - seen.rounding[i];
        // What lies beside the map is lit, as what lies behind nothing.
        limits[i] = if limit < EMPTY_DEPTH { limit } else { EMPTY_DEPTH };
        // Numbers of texels are exact: maps have at most 2^24 of them.
        let texel = if within { y * side + x } else { -1.0 };
        texels[i] = texel as i32;
    }
    (texels, limits)
}

impl<const N: usize> Lanes<N> {
    /// `PointCamera::map` and `PointCamera::slope`.
    #[inline(always)]
    fn new(camera: &PointCamera, points_world: &[[f32; N]; 3], normal: Vec3) -> Self {
        let mut lanes = Self {
            at: [[0.0; N]; 2],
            depth: [0.0; N],
            inverse: [0.0; N],
            slope: [[0.0; N]; 2],
            rounding: [0.0; N],
            valid: [false; N],
        };
        let [px, py, pz] = points_world;
        let [column, row, forward] = &camera.rows;
        let (place, near_m) = (camera.place_world, camera.near_m);
        let [n_right, n_up, _] = camera.along_axes(normal);
        let (axis, sign) = camera.axes[2];
        let place_ahead = place[axis];
        let ahead = &points_world[axis];
        for i in 0..N {
            let (x, y, z) = (px[i], py[i], pz[i]);
            let along = |r: &[f32; 4]| r[0] * x + r[1] * y + r[2] * z + r[3];
            let w = along(forward);
            lanes.valid[i] = w > near_m;
            lanes.at[0][i] = along(column) / w;
            lanes.at[1][i] = along(row) / w;
            let depth = 1.0 - near_m / w;
            lanes.depth[i] = depth;
            lanes.inverse[i] = (1.0 - depth) / near_m;
            lanes.rounding[i] = ROUNDING_TEXELS * camera.texel * (1.0 - depth);
            let off = normal.x * (x - place.x) + normal.y * (y - place.y) + normal.z * (z - place.z);
            let from_light = sign * (ahead[i] - place_ahead);
            let from_light = if from_light > near_m { from_light } else { near_m };
            let most = MAX_BIAS_TEXELS * camera.texel * near_m / from_light;
            for (slope, n) in lanes.slope.iter_mut().zip([n_right, n_up]) {
                let steep = -near_m * camera.texel * n / off;
                let bounded = if steep < -most { -most } else { steep };
                let bounded = if bounded > most { most } else { bounded };
                slope[i] = if steep.abs() < f32::INFINITY { bounded } else { 0.0 };
            }
        }
        lanes
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PointMaps, visibility};
    use super::*;

    #[test]
    fn neighbours_get_what_each_gets_by_itself() {
        // An octahedron under a light, and a receiver below that leans; some points are beside the light or above it.
        let casters: Vec<Vec3> = [Vec3::X, Vec3::Y, Vec3::Z]
            .into_iter()
            .flat_map(|axis| [axis, -axis].map(|v| Vec3::new(0.1, 0.05, 1.0) + 0.25 * v))
            .collect();
        let triangles: Vec<[u32; 3]> = (0..8u32).map(|k| [k & 1, 2 + (k >> 1 & 1), 4 + (k >> 2)]).collect();
        let mut maps = PointMaps::default();
        maps.fit([(Vec3::new(0.1, 0.0, 2.0), Vec3::ZERO)].into_iter(), &casters, 256);
        maps.draw(&casters, &triangles);
        let (camera, map) = maps.get(0).unwrap();
        for side in 1..=8 {
            let half = if side == 1 { 0.0 } else { 0.15 };
            let half_axes = [Vec3::new(half, 0.1 * half, 0.0), Vec3::new(0.0, 0.5 * half, 0.4 * half)];
            let places = LightPlaces { half_axes: half_axes.map(|v| camera.along_axes(v)), side };
            let reads = PlaceReads::new(&places, 0.7);
            let (mut lit, mut taken) = (0, 0);
            for j in 0..60 {
                for start in [-1.5f32, -0.7, 0.1, 0.9] {
                    let point = |i: usize| {
                        let x = start + 0.025 * i as f32;
                        Vec3::new(x, -1.5 + 0.05 * j as f32, 0.4 + 0.9 * x)
                    };
                    let normal = Vec3::new(-0.9, 0.0, 1.0).normalize();
                    // Another part of the light for each.
                    let part = |i: usize| ([0.02 * i as f32 - 0.3, 0.1], [1.0 - 0.02 * i as f32, 0.8]);
                    let parts: [[f32; 32]; 4] = std::array::from_fn(|k| {
                        std::array::from_fn(|i| if k < 2 { part(i).0[k] } else { part(i).1[k - 2] })
                    });
                    let points: [[f32; 32]; 3] =
                        std::array::from_fn(|axis| std::array::from_fn(|i| point(i)[axis]));
                    let visible = reads.visibility(map, camera, &points, normal, || parts);
                    for (i, fast) in visible.into_iter().enumerate() {
                        let plain = camera.map(point(i)).map_or(1.0, |mapped| {
                            let slope = camera.slope(point(i), normal);
                            visibility(map.depth(), camera, &places, part(i), mapped, slope)
                        });
                        assert_eq!(
                            plain.to_bits(),
                            fast.to_bits(),
                            "{side} places, {}: {plain} {fast}",
                            point(i)
                        );
                        lit += usize::from(plain == 1.0);
                        taken += usize::from(plain < 1.0);
                    }
                }
            }
            assert!(lit > 1000 && taken > 100, "{side}: {lit} {taken}");
        }
    }
}
