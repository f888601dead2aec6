//! Hard shadows: for each hard light one orthographic depth map of the virtual objects (Section 7 of
//! [Now11]; Section 7.2 of [Gib03] for the bias), read through a percentage-closer filter.
//! Twin: `shaders/visibility/shadow_maps.wgsl`.
//!
//! What is drawn: every triangle, whichever way it faces; the nearest one stays. A closed body is then
//! represented by its lit side, so that its shadow reaches up to where it touches the ground (a map of far
//! sides would leave a bright gap of the bias' width there), and open meshes cast shadows too. Only virtual
//! objects are drawn: what real objects block is already in the camera's picture.

mod set;

pub use set::{ShadowMaps, side_of_each};

use crate::math::sh::Real;
use glam::Vec3;
use rayon::prelude::*;

/// Free texels at each border of the map, so that a filter of up to 8 taps never looks past it from inside.
pub const EDGE_TEXELS: f32 = 5.0;
/// The bias never exceeds this many texels. A sphere of a diameter of half a map of 1024 needs 4 to 43
/// texels at its terminator, the ground under a sun of 3 degrees 67.
pub const MAX_BIAS_TEXELS: f32 = 64.0;
/// Added to every bias, texels: a receiver that faces the light has none, but its depth and the map's are rounded apart.
pub const ROUNDING_TEXELS: f32 = 0.1;
/// Texels across the casters at least, however wide the light.
const LEAST_ACROSS: f64 = 96.0;
/// Depth of an empty texel. Depths of casters are below 1.
pub const EMPTY_DEPTH: f32 = 1.0;
/// Vertices are snapped to this fraction of a texel, so that neighbours leave no gaps.
const SUBTEXELS: f32 = 256.0;
/// Rows of one unit of parallel work; fixed, so that no result depends on the number of threads.
const BAND_ROWS: usize = 64;

/// An orthographic camera that looks along the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowCamera {
    /// Rows of the affine map from world metres to: column in texels, row in texels (continuous, texel
    /// (i, j) covers [i, i+1) x [j, j+1)), depth (0 nearest to the light, below 1 for every caster; beyond
    /// 1 behind the last caster). `x = rows[0].xyz . p + rows[0].w`.
    pub rows: [[f32; 4]; 3],
    /// Side of a texel, metres.
    pub texel_m: f32,
    /// Metres for a depth of 1.
    pub depth_m: f32,
    /// Texels a side.
    pub texels: u32,
    /// Towards the light, unit, world frame.
    pub to_light_world: [f32; 3],
}

impl ShadowCamera {
    /// Fits the map to the casters' vertices (world frame, metres). The map's axes come from the world axis
    /// of smallest absolute component of the light's direction (spec 10), so that no direction is singular;
    /// the texel's side is rounded up to a ladder of 8 steps an octave and the map's corner to whole texels,
    /// so that a moving object does not make the shadows of others swim. The depth range is the casters':
    /// receivers need none, see [`lit`]. `None` without a finite caster or a finite direction.
    pub fn fit(to_light_world: [f32; 3], casters: impl Iterator<Item = Vec3>, texels: u32) -> Option<Self> {
        Self::fit_soft(to_light_world, casters, texels, 0.0)
    }

    /// [`Self::fit`] for a light whose penumbra is as wide as a texel of `texel_of_depth` times the casters' extent along
    /// the light: no finer than that.
    pub fn fit_soft(
        to_light_world: [f32; 3],
        casters: impl Iterator<Item = Vec3>,
        texels: u32,
        texel_of_depth: f32,
    ) -> Option<Self> {
        let light = Vec3::from(to_light_world).as_dvec3();
        if !light.is_finite() || light.length_squared() < 0.25 || texels < 16 {
            return None;
        }
        let light = light.normalize();
        let (right, up) = axes(light);
        let mut low = glam::DVec3::INFINITY;
        let mut high = glam::DVec3::NEG_INFINITY;
        for p in casters {
            let p = p.as_dvec3();
            let q = glam::DVec3::new(right.dot(p), up.dot(p), -light.dot(p));
            low = low.min(q);
            high = high.max(q);
        }
        if !(low.is_finite() && high.is_finite()) {
            return None;
        }
        let size = high - low;
        let usable = f64::from(texels) - 2.0 * f64::from(EDGE_TEXELS) - 1.0;
        let across = size.x.max(size.y);
        // Wide lights in few maps: the casters' shapes stay recognisable.
        let wide = (f64::from(texel_of_depth) * size.z).min(across / LEAST_ACROSS);
        let tight = (across / usable).max(wide).max(1e-6);
        let texel = ((tight.log2() * 8.0).ceil() / 8.0).exp2();
        let corner_x = ((low.x / texel).floor() - f64::from(EDGE_TEXELS)) * texel;
        let corner_y = ((low.y / texel).floor() - f64::from(EDGE_TEXELS)) * texel;
        let pad = (1e-3 * size.z).max(texel);
        let depth = size.z + 2.0 * pad;
        let row = |axis: glam::DVec3, start: f64, unit: f64| {
            let a = axis / unit;
            [a.x as f32, a.y as f32, a.z as f32, (-start / unit) as f32]
        };
        Some(Self {
            rows: [row(right, corner_x, texel), row(up, corner_y, texel), row(-light, low.z - pad, depth)],
            texel_m: texel as f32,
            depth_m: depth as f32,
            texels,
            to_light_world: light.as_vec3().to_array(),
        })
    }

    /// Column, row (texels) and depth of a point in the world frame.
    pub fn map(&self, p: Vec3) -> [f32; 3] {
        self.rows.map(|r| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3])
    }

    /// Whether the map says anything about a point: elsewhere nothing blocks the light.
    pub fn covers(&self, p: Vec3) -> bool {
        let [x, y, depth] = self.map(p);
        let side = self.texels as f32;
        x > 0.0 && x < side && y > 0.0 && y < side && depth > 0.0
    }
}

/// Right and up of the map for a unit direction: right = e x light for the world axis e of smallest absolute
/// component, up = light x right.
fn axes(light: glam::DVec3) -> (glam::DVec3, glam::DVec3) {
    let a = light.abs();
    let e = if a.x <= a.y && a.x <= a.z {
        glam::DVec3::X
    } else if a.y <= a.z {
        glam::DVec3::Y
    } else {
        glam::DVec3::Z
    };
    let right = e.cross(light).normalize();
    (right, light.cross(right))
}

/// Depth bias in metres: the largest change of depth of a flat receiver over the filter's footprint,
/// `min(max, texel (pcf + 1/2) sqrt2 tan(theta))` (spec 10), with `pcf` the half width of the filter in
/// texels and `theta` between the receiver's normal and the light. A cosine of zero or less gives the largest.
pub fn bias_m<T: Real>(texel_m: T, pcf_half_width_texels: T, cos_theta: T, max_bias_m: T) -> T {
    let c = cos_theta.min(T::one());
    let tan = if c > T::zero() { ((T::one() - c) * (T::one() + c)).sqrt() / c } else { T::infinity() };
    (texel_m * (pcf_half_width_texels + T::of(0.5)) * T::SQRT_2() * tan).min(max_bias_m)
}

/// Share of the light, 0 to 1, that reaches a position of the map: percentage-closer filtering by a box of
/// `taps - 1` texels around (x, y), each of the `taps` x `taps` texels weighted by its overlap with the box
/// (one tap: the texel itself). A texel lets the light through where `min(depth - bias, 1) <= stored`; the
/// clamp makes an empty texel (depth 1) never block, however far behind the casters the receiver lies.
/// Texels outside of the map let all light through. `depth` has its bias taken off already.
pub fn lit(map: &[f32], texels: u32, taps: u32, x: f32, y: f32, depth: f32) -> f32 {
    let reference = depth.min(EMPTY_DEPTH);
    let side = taps.max(1) - 1;
    let half = 0.5 * side as f32;
    let (left, top) = ((x - half).floor(), (y - half).floor());
    // Beyond the map by more than the filter: lit (also keeps the conversions below in range; NaN ends here).
    let limit = texels as f32;
    let inside = left >= -16.0 && top >= -16.0 && left < limit && top < limit;
    if !inside {
        return 1.0;
    }
    let (fx, fy) = (x - half - left, y - half - top);
    let (left, top) = (left as i32, top as i32);
    let (mut sum, mut all) = (0.0, 0.0);
    let size = texels as usize;
    let (reach_x, reach_y) = (left + side as i32, top + side as i32);
    if left >= 0 && top >= 0 && reach_x < texels as i32 && reach_y < texels as i32 && side < 8 {
        // The usual case, all taps inside: the same sums in the same order.
        let mut weights_x = [0.0f32; 8];
        for (i, weight) in weights_x.iter_mut().enumerate().take(side as usize + 1) {
            *weight = tap_weight(i as u32, side, fx);
        }
        for j in 0..=side {
            let weight_y = tap_weight(j, side, fy);
            let start = (top as usize + j as usize) * size + left as usize;
            for (stored, weight_x) in map[start..=start + side as usize].iter().zip(weights_x) {
                let weight = weight_x * weight_y;
                all += weight;
                sum += if reference <= *stored { weight } else { 0.0 };
            }
        }
        return sum / all;
    }
    for j in 0..=side {
        let row = top + j as i32;
        let weight_y = tap_weight(j, side, fy);
        let row_within = row >= 0 && row < texels as i32;
        for i in 0..=side {
            let column = left + i as i32;
            let within = row_within && column >= 0 && column < texels as i32;
            let stored =
                if within { map[row as usize * texels as usize + column as usize] } else { EMPTY_DEPTH };
            let weight = tap_weight(i, side, fx) * weight_y;
            all += weight;
            sum += if reference <= stored { weight } else { 0.0 };
        }
    }
    sum / all // Exactly 0 or 1 where all taps agree.
}

/// Overlap of tap `i` of `0..=side` with the filter's box that starts `fraction` into tap 0.
fn tap_weight(i: u32, side: u32, fraction: f32) -> f32 {
    if side == 0 {
        1.0
    } else if i == 0 {
        1.0 - fraction
    } else if i == side {
        fraction
    } else {
        1.0
    }
}

/// Share of the directional light, 0 to 1, that virtual objects let through to a point (world frame).
/// `cos_theta` is the receiver's true (facet) normal times the light; zero or less means turned away, which
/// the caller has dealt with where it wants such points dark: here they get the largest bias.
pub fn visibility(map: &[f32], camera: &ShadowCamera, taps: u32, point_world: Vec3, cos_theta: f32) -> f32 {
    let [x, y, depth] = camera.map(point_world);
    let max_bias_m = MAX_BIAS_TEXELS * camera.texel_m;
    let bias =
        bias_m(camera.texel_m, 0.5 * taps as f32, cos_theta, max_bias_m) + ROUNDING_TEXELS * camera.texel_m;
    lit(map, camera.texels, taps, x, y, depth - bias / camera.depth_m)
}

/// The CPU's depth rasteriser and its memory.
#[derive(Clone, Debug, Default)]
pub struct ShadowMap {
    depth: Vec<f32>,
    vertices: Vec<Vertex>,
}

/// A projected vertex: column and row in 1/256 texel, and depth.
#[derive(Clone, Copy, Debug, Default)]
struct Vertex {
    x: i32,
    y: i32,
    depth: f32,
}

impl ShadowMap {
    /// Depths, row by row; `EMPTY_DEPTH` where nothing is.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// Takes depths that were drawn elsewhere.
    pub fn set_depth(&mut self, depth: Vec<f32>) {
        self.depth = depth;
    }

    /// Draws triangles (world frame, metres) into the map. A texel is covered where its centre lies inside
    /// or on the edge of the triangle whose corners are snapped to 1/256 texel. Same result for any number of threads.
    pub fn draw(&mut self, camera: &ShadowCamera, positions: &[Vec3], triangles: &[[u32; 3]]) {
        let side = camera.texels as usize;
        self.depth.resize(side * side, EMPTY_DEPTH);
        self.vertices.resize(positions.len(), Vertex::default());
        self.vertices.par_chunks_mut(1024).zip(positions.par_chunks(1024)).for_each(|(out, positions)| {
            for (v, &p) in out.iter_mut().zip(positions) {
                let [x, y, depth] = camera.map(p);
                *v = Vertex { x: (x * SUBTEXELS).round() as i32, y: (y * SUBTEXELS).round() as i32, depth };
            }
        });
        let vertices = &self.vertices;
        self.depth.par_chunks_mut(BAND_ROWS * side).enumerate().for_each(|(band, rows)| {
            rows.fill(EMPTY_DEPTH);
            for triangle in triangles {
                let corners = triangle.map(|i| vertices[i as usize]);
                draw_triangle(&corners, side, band * BAND_ROWS, rows);
            }
        });
    }
}

/// Draws one triangle into the rows that start at `first_row`.
fn draw_triangle(v: &[Vertex; 3], side: usize, first_row: usize, rows: &mut [f32]) {
    let unit = SUBTEXELS as i64;
    let low_y = i64::from(v[0].y.min(v[1].y).min(v[2].y));
    let high_y = i64::from(v[0].y.max(v[1].y).max(v[2].y));
    // Row j has its centre at (j + 1/2) units: the first centre at or below low_y, the last at or above high_y.
    let first = (low_y - unit / 2).div_ceil_signed(unit).max(first_row as i64);
    let last = (high_y - unit / 2).div_euclid(unit).min((first_row + rows.len() / side) as i64 - 1);
    if first > last {
        return;
    }
    let p = v.map(|c| (i64::from(c.x), i64::from(c.y)));
    let area = (p[1].0 - p[0].0) * (p[2].1 - p[0].1) - (p[2].0 - p[0].0) * (p[1].1 - p[0].1);
    if area == 0 {
        return;
    }
    let sign = area.signum();
    // Depth is a plane over the map.
    let (dx1, dy1) = ((p[1].0 - p[0].0) as f32, (p[1].1 - p[0].1) as f32);
    let (dx2, dy2) = ((p[2].0 - p[0].0) as f32, (p[2].1 - p[0].1) as f32);
    let (dz1, dz2) = (v[1].depth - v[0].depth, v[2].depth - v[0].depth);
    let slope_x = (dz1 * dy2 - dz2 * dy1) / area as f32;
    let slope_y = (dz2 * dx1 - dz1 * dx2) / area as f32;
    let nearest = v[0].depth.min(v[1].depth).min(v[2].depth);
    let farthest = v[0].depth.max(v[1].depth).max(v[2].depth);
    for j in first..=last {
        let y = j * unit + unit / 2;
        let (mut start, mut end) = (0i64, side as i64 - 1);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            // Inside where step * i + rest >= 0.
            let step = -sign * (b.1 - a.1) * unit;
            let rest = sign * ((b.0 - a.0) * (y - a.1) - (b.1 - a.1) * (unit / 2 - a.0));
            if step > 0 {
                start = start.max((-rest).div_ceil_signed(step));
            } else if step < 0 {
                end = end.min(rest.div_euclid(-step));
            } else if rest < 0 {
                end = -1;
            }
        }
        if start > end {
            continue;
        }
        let dy = (y - p[0].1) as f32;
        let row = (j as usize - first_row) * side;
        for i in start..=end {
            let dx = (i * unit + unit / 2 - p[0].0) as f32;
            // Slivers have steep planes: never outside of the corners' own range.
            let z = (v[0].depth + slope_x * dx + slope_y * dy).max(nearest).min(farthest);
            let slot = &mut rows[row + i as usize];
            *slot = slot.min(z);
        }
    }
}

/// Division rounded up, for signed numbers and a positive divisor.
trait DivCeil {
    fn div_ceil_signed(self, divisor: Self) -> Self;
}

impl DivCeil for i64 {
    fn div_ceil_signed(self, divisor: Self) -> Self {
        -((-self).div_euclid(divisor))
    }
}

#[cfg(test)]
mod tests;
