//! Shadow maps of near light: the depths of casters as seen from a place (Section 7.2 of [Gib03]). What a map holds is
//! projective, `1 - near / distance along the axis`, which is an affine function over the map for every plane: the same
//! rasteriser draws it, and the depth of a flat receiver is known at every texel.
//! Twin: `shaders/visibility/point_maps.wgsl`.

use super::shadow_maps::{EDGE_TEXELS, EMPTY_DEPTH, MAX_BIAS_TEXELS, ROUNDING_TEXELS, ShadowMap};
use glam::Vec3;
use rayon::prelude::*;

mod places;

pub use places::PlaceReads;

/// A map looks no farther off its axis than this tangent (80 degrees): what lies beyond is lit.
const WIDEST: f32 = 5.7;
/// The near plane lies no nearer to the light than this share of the farthest caster's distance. Casters nearer than it
/// are cut off there: only a body around the light comes so near.
const NEAREST_SHARE: f32 = 0.02;
/// Nor nearer than this, metres.
const NEAREST_M: f32 = 1e-3;
/// A filter is at least this many texels wide to each side.
const SMOOTH_TEXELS: f32 = 0.75;
/// Room between the near plane and the nearest caster, as a share of its distance.
const NEAR_ROOM: f32 = 1e-3;

/// A perspective camera at a light, that looks along a world axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCamera {
    /// Rows of the projective map from world metres: column and row in texels, both times w, and w, the distance from the
    /// light along the axis in metres. `w = rows[2].xyz . p + rows[2].w`.
    pub rows: [[f32; 4]; 3],
    /// Distance of the near plane, metres.
    pub near_m: f32,
    /// Side of a texel one metre before the light, metres.
    pub texel: f32,
    /// Texels a side.
    pub texels: u32,
    /// The light's place, world frame, metres.
    pub place_world: Vec3,
    /// The three axes right, up and forward, as numbers of the world's axes and their signs.
    axes: [(usize, f32); 3],
}

impl PointCamera {
    /// Fits the map to the casters (world frame, metres). It looks along the world axis next to their middle, and its
    /// texels lie on a fixed grid about the light, a ladder of 8 sizes an octave, so that shadows do not swim with what
    /// moves. `None` where no caster lies before the light, or something is not finite.
    ///
    /// A light whose place lies within the casters' box looks to its `front` (any length; zero: none), for they may be all
    /// around it.
    pub fn fit(place_world: Vec3, front: Vec3, casters: &[Vec3], texels: u32) -> Option<Self> {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &p in casters.iter().filter(|p| p.is_finite()) {
            (low, high) = (low.min(p), high.max(p));
        }
        let towards = 0.5 * (low + high) - place_world;
        if !(towards.is_finite() && place_world.is_finite()) || texels < 16 {
            return None;
        }
        let is_within = place_world.cmpge(low).all() && place_world.cmple(high).all();
        let forward = largest(if is_within && front != Vec3::ZERO { front } else { towards });
        let axes = [((forward.0 + 1) % 3, 1.0), ((forward.0 + 2) % 3, 1.0), forward];
        let seen = |p: Vec3| axes.map(|(axis, sign)| sign * (p - place_world)[axis]);
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        for w in casters.iter().map(|&p| seen(p)[2]).filter(|w| w.is_finite()) {
            (nearest, farthest) = (nearest.min(w), farthest.max(w));
        }
        let least = (NEAREST_SHARE * farthest).max(NEAREST_M);
        if !(farthest > least) {
            return None;
        }
        let is_cut = nearest * (1.0 - NEAR_ROOM) < least;
        let near_m = if is_cut { least } else { nearest * (1.0 - NEAR_ROOM) };
        let (mut from, mut to) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        if is_cut {
            (from, to) = ([-WIDEST; 2], [WIDEST; 2]);
        } else {
            for [x, y, w] in casters.iter().map(|&p| seen(p)).filter(|[.., w]| *w > 0.0) {
                for (k, v) in [x / w, y / w].into_iter().enumerate() {
                    (from[k], to[k]) = (from[k].min(v), to[k].max(v));
                }
            }
            from = from.map(|v| v.max(-WIDEST));
            to = to.map(|v| v.min(WIDEST));
        }
        let across = (to[0] - from[0]).max(to[1] - from[1]);
        if !(across >= 0.0) {
            return None;
        }
        let usable = texels as f32 - 2.0 * EDGE_TEXELS - 1.0;
        let tight = f64::from((across / usable).max(1e-7));
        let texel = ((tight.log2() * 8.0).ceil() / 8.0).exp2();
        let corner = from.map(|v| (f64::from(v) / texel).floor() - f64::from(EDGE_TEXELS));
        let row = |(axis, sign): (usize, f32)| {
            let mut row = [0.0f64; 4];
            row[axis] = f64::from(sign);
            row[3] = -f64::from(sign) * f64::from(place_world[axis]);
            row
        };
        let w = row(axes[2]);
        let mapped = |k: usize| {
            let lateral = row(axes[k]);
            std::array::from_fn(|i| (lateral[i] / texel - corner[k] * w[i]) as f32)
        };
        Some(Self {
            rows: [mapped(0), mapped(1), w.map(|v| v as f32)],
            near_m,
            texel: texel as f32,
            texels,
            place_world,
            axes,
        })
    }

    /// Column and row (texels) and depth of a point in the world frame: depths are above 0 behind the near plane and below
    /// 1. `None` for points before it.
    pub fn map(&self, p: Vec3) -> Option<[f32; 3]> {
        let [x, y, w] = self.rows.map(|r| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]);
        (w > self.near_m).then(|| [x / w, y / w, 1.0 - self.near_m / w])
    }

    /// A vector of the world in the camera's axes: right, up, forward.
    pub fn along_axes(&self, v: Vec3) -> [f32; 3] {
        self.axes.map(|(axis, sign)| sign * v[axis])
    }

    /// How the depth of a flat receiver through `point` with a unit `normal` changes from texel to texel along columns and
    /// rows, everywhere alike (the depth of a plane is affine over the map); bounded where the light lies nearly in its plane.
    pub fn slope(&self, point_world: Vec3, normal: Vec3) -> [f32; 2] {
        let from_light = point_world - self.place_world;
        let off = normal.dot(from_light);
        let w = self.along_axes(from_light)[2].max(self.near_m);
        let most = MAX_BIAS_TEXELS * self.texel * self.near_m / w;
        let [x, y, _] = self.along_axes(normal);
        [x, y].map(|n| {
            let slope = -self.near_m * self.texel * n / off;
            if slope.is_finite() { slope.clamp(-most, most) } else { 0.0 }
        })
    }
}

/// The axis of largest component and its sign.
fn largest(v: Vec3) -> (usize, f32) {
    let a = v.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    (axis, if v[axis] < 0.0 { -1.0 } else { 1.0 })
}

/// Maps of near lights; memory is kept.
#[derive(Clone, Debug, Default)]
pub struct PointMaps {
    cameras: Vec<Option<PointCamera>>,
    maps: Vec<ShadowMap>,
    cut: Vec<Cut>,
}

/// Casters cut off at a near plane.
#[derive(Clone, Debug, Default)]
struct Cut {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl PointMaps {
    /// No map: nothing is shadowed.
    pub fn clear(&mut self) {
        self.cameras.clear();
    }

    /// Fits a camera to the casters for each place and the light's front there; `None` where none lies before the light.
    pub fn fit(&mut self, places_world: impl Iterator<Item = (Vec3, Vec3)>, casters: &[Vec3], texels: u32) {
        self.cameras.clear();
        self.cameras
            .extend(places_world.map(|(place, front)| PointCamera::fit(place, front, casters, texels)));
        if self.maps.len() < self.cameras.len() {
            self.maps.resize_with(self.cameras.len(), ShadowMap::default);
            self.cut.resize_with(self.cameras.len(), Cut::default);
        }
    }

    /// Draws the casters into every map, after [`Self::fit`]. Same result for any number of threads.
    pub fn draw(&mut self, casters: &[Vec3], triangles: &[[u32; 3]]) {
        let Self { cameras, maps, cut } = self;
        cameras.par_iter().zip(maps.par_iter_mut()).zip(cut.par_iter_mut()).for_each(
            |((camera, map), cut)| {
                if let Some(camera) = camera {
                    draw(camera, casters, triangles, map, cut);
                }
            },
        );
    }

    /// One for each place of [`Self::fit`].
    pub fn cameras(&self) -> &[Option<PointCamera>] {
        &self.cameras
    }

    /// Light `k`'s camera and map, where it has one.
    pub fn get(&self, k: usize) -> Option<(&PointCamera, &ShadowMap)> {
        Some((self.cameras.get(k)?.as_ref()?, self.maps.get(k)?))
    }

    /// Depths of map `k`, row by row; empty where there is none.
    pub fn depth(&self, k: usize) -> &[f32] {
        self.maps.get(k).map_or(&[], ShadowMap::depth)
    }

    /// Takes depths of map `k` that were drawn elsewhere.
    pub fn set_depth(&mut self, k: usize, depth: Vec<f32>) {
        if let Some(map) = self.maps.get_mut(k) {
            map.set_depth(depth);
        }
    }

    /// Whether a light's shadow may fall on some point of a triangle (world frame). `reach_m` is how far the light's places
    /// move what the map is read at, metres at the light; `is_drawn`: what the map holds counts, else its borders alone.
    pub fn may_shadow<const N: usize>(
        &self,
        k: usize,
        corners_world: &[Vec3; N],
        reach_m: f32,
        is_drawn: bool,
    ) -> bool {
        let Some((camera, map)) = self.get(k) else { return false };
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut before = 0;
        for corner in corners_world {
            let Some(mapped) = camera.map(*corner) else {
                before += 1;
                continue;
            };
            for i in 0..3 {
                (low[i], high[i]) = (low[i].min(mapped[i]), high[i].max(mapped[i]));
            }
        }
        if before > 0 {
            // All before the near plane: before every caster.
            return before < N;
        }
        // The filter looks as far as it would for a blocker at the near plane.
        let behind = high[2] / camera.near_m;
        let room = reach_m * behind / camera.texel + SMOOTH_TEXELS + 1.0;
        let low: [f32; 2] = [low[0] - room, low[1] - room];
        let high: [f32; 2] = [high[0] + room, high[1] + room];
        let side = camera.texels as f32;
        if !(high[0] >= 0.0 && high[1] >= 0.0 && low[0] <= side && low[1] <= side) {
            return false;
        }
        !is_drawn || map.reach().is_near_box(low, high)
    }
}

fn draw(camera: &PointCamera, casters: &[Vec3], triangles: &[[u32; 3]], map: &mut ShadowMap, cut: &mut Cut) {
    let side = camera.texels as usize;
    // Whole maps are one unit of parallel work each.
    if casters.iter().all(|&p| camera.map(p).is_some()) {
        map.set_vertices(casters.iter().filter_map(|&p| camera.map(p)));
        map.rasterise(side, triangles, side);
        return;
    }
    cut.vertices.clear();
    cut.triangles.clear();
    for triangle in triangles {
        let corners = triangle.map(|i| casters.get(i as usize).copied().unwrap_or(Vec3::NAN));
        cut.add(camera, corners);
    }
    map.set_vertices(cut.vertices.iter().copied());
    map.rasterise(side, &cut.triangles, side);
}

impl Cut {
    /// Adds what of a triangle lies behind the near plane: none, one or two triangles.
    fn add(&mut self, camera: &PointCamera, corners: [Vec3; 3]) {
        let rows = &camera.rows;
        let clip = |p: Vec3| rows.map(|r| f64::from(r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]));
        // A little behind the plane, so that depths stay above 0.
        let plane = f64::from(camera.near_m) * (1.0 + 1e-5);
        let corners = corners.map(clip);
        if !corners.iter().flatten().all(|v| v.is_finite()) {
            return;
        }
        let first = self.vertices.len() as u32;
        let limit = 8.0 * f64::from(camera.texels);
        let mut push = |[x, y, w]: [f64; 3]| {
            let at = [x, y].map(|v| (v / w).clamp(-limit, limit) as f32);
            self.vertices.push([at[0], at[1], (1.0 - f64::from(camera.near_m) / w) as f32]);
        };
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a[2] >= plane {
                push(a);
            }
            if (a[2] >= plane) != (b[2] >= plane) {
                let t = (plane - a[2]) / (b[2] - a[2]);
                push(std::array::from_fn(|i| a[i] + t * (b[i] - a[i])));
            }
        }
        let count = self.vertices.len() as u32 - first;
        for k in 2..count {
            self.triangles.push([first, first + k - 1, first + k]);
        }
    }
}

/// The places of a light that stands for some extent, as a map's filter needs them: for each, right, up and forward from
/// the light's middle in the camera's axes, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightPlaces {
    /// Half axes of a parallelogram about the middle, in the camera's axes.
    pub half_axes: [[f32; 3]; 2],
    /// Places along each: 1 to 8.
    pub side: u32,
}

/// Which part of a light a receiver sees: middle and half lengths along the light's two half axes, in their lengths. In 24
/// bits each axis, which a 32-bit float holds exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPart(pub [f32; 2]);

impl SeenPart {
    /// All of it, evenly.
    pub const WHOLE: Self = Self([8_390_656.0; 2]);

    /// Middles within -2 to 2 and half lengths of 0 to 2, cut to that; wrong by at most a 2048th.
    pub fn of(middle: [f32; 2], half: [f32; 2]) -> Self {
        Self([0, 1].map(|k: usize| {
            let middle = (middle[k] * 1024.0 + 2048.0).round().clamp(0.0, 4095.0);
            middle * 4096.0 + (half[k] * 2048.0).round().clamp(0.0, 4095.0)
        }))
    }

    /// Middle and half lengths.
    #[inline(always)]
    pub fn middle_half(self) -> ([f32; 2], [f32; 2]) {
        let codes = self.0.map(|code| code as u32);
        let middle = codes.map(|code| ((code >> 12) as f32 - 2048.0) / 1024.0);
        (middle, codes.map(|code| (code & 4095) as f32 / 2048.0))
    }
}

/// Middle and half lengths of a light that is seen as a whole.
pub const WHOLE: ([f32; 2], [f32; 2]) = ([0.0; 2], [1.0; 2]);

/// Where a map must be read at for the ray from a receiver to a place beside the light's middle: `at` is the receiver's
/// column and row, `inverse_r` and `inverse_b` the inverse distances along the axis of the receiver and of the blocker, 1 /
/// metres, `place` right, up and forward from the middle. Exact for a blocker of that distance.
#[inline(always)]
fn read_at(
    at: [f32; 2],
    corner: [f32; 2],
    texel: f32,
    inverse_r: f32,
    inverse_b: f32,
    place: [f32; 3],
) -> [f32; 2] {
    let forward = 1.0 / (1.0 - place[2] * inverse_r);
    let scale = forward * (1.0 - place[2] * inverse_b);
    let along = forward * (inverse_b - inverse_r) / texel;
    // Tangents from the light are positions less the corner's.
    [0, 1].map(|k| (at[k] + corner[k]) * scale - corner[k] + place[k] * along)
}

impl PointCamera {
    /// The tangent of the map's corner, in texels.
    fn corner(&self) -> [f32; 2] {
        // rows[k] = lateral / texel - corner * w.
        let (axis, sign) = self.axes[2];
        [0, 1].map(|k: usize| -self.rows[k][axis] * sign)
    }
}

/// Share of a light, 0 to 1, that reaches a point of a flat receiver: the mean over places of the part of the light that it
/// sees (middle and half lengths as in [`SeenPart`]) of whether the map lets the light through where the ray to that place
/// passes the mean blocker's distance. `mapped` is the point's position
/// and depth, `slope` its plane's ([`PointCamera::slope`]): a texel hides what lies behind it at the texel's own middle, so
/// that no flat receiver shadows itself and contacts stay closed.
///
/// The mean blocker is that of the texels that would hide the point or any of the light's places if they stood at the near
/// plane; without one the point is lit. Every place is read up to `SMOOTH_TEXELS` beside, so that texels do not show.
pub fn visibility(
    map: &[f32],
    camera: &PointCamera,
    places: &LightPlaces,
    (middle, half): ([f32; 2], [f32; 2]),
    mapped: [f32; 3],
    slope: [f32; 2],
) -> f32 {
    let [x, y, depth] = mapped;
    let side = camera.texels as i32;
    let rounding = ROUNDING_TEXELS * camera.texel * (1.0 - depth);
    // The depth of what hides the point at a position of the map, or nothing.
    let hides = |at: [f32; 2]| {
        let [i, j] = at.map(f32::floor);
        let within = i >= 0.0 && j >= 0.0 && i < side as f32 && j < side as f32;
        let stored = if within { map[(j as i32 * side + i as i32) as usize] } else { EMPTY_DEPTH };
        let plane = depth + slope[0] * (i + 0.5 - x) + slope[1] * (j + 0.5 - y);
        (stored < (plane - rounding).min(EMPTY_DEPTH)).then_some(stored)
    };
    let n = places.side.clamp(1, 8);
    if n == 1 {
        return if hides([x, y]).is_some() { 0.0 } else { 1.0 };
    }
    let step = |i: u32| (2.0 * i as f32 + 1.0) / n as f32 - 1.0;
    let inverse = |depth: f32| (1.0 - depth) / camera.near_m;
    let (corner, inverse_r) = (camera.corner(), inverse(depth));
    let read = |blocker: f32, k: u32| {
        let (a, b) = (step(k % n), step(k / n));
        let [u, v] = places.half_axes;
        let along = [middle[0] + half[0] * a, middle[1] + half[1] * b];
        let place = [0, 1, 2].map(|i: usize| u[i] * along[0] + v[i] * along[1]);
        let at = read_at([x, y], corner, camera.texel, inverse_r, inverse(blocker), place);
        hides([at[0] + SMOOTH_TEXELS * a, at[1] + SMOOTH_TEXELS * b])
    };
    let (mut sum, mut count) = (0.0, 0);
    let near_plane = (0..n * n).map(|k| read(0.0, k));
    for stored in near_plane.chain([hides([x, y])]).flatten() {
        sum += stored;
        count += 1;
    }
    if count == 0 {
        return 1.0;
    }
    let blocker = sum / count as f32;
    let lit = (0..n * n).filter(|&k| read(blocker, k).is_none()).count();
    lit as f32 / (n * n) as f32
}

#[cfg(test)]
mod tests;
