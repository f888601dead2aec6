//! Hard shadows: for each hard light one orthographic depth map of the virtual objects (Section 7 of
//! [Now11]; Section 7.2 of [Gib03] for the bias), read through a percentage-closer filter.
//! Twin: `shaders/visibility/shadow_maps.wgsl`.
//!
//! What is drawn: every triangle, whichever way it faces; the nearest one stays. A closed body is then
//! represented by its lit side, so that its shadow reaches up to where it touches the ground (a map of far
//! sides would leave a bright gap of the bias' width there), and open meshes cast shadows too. Only virtual
//! objects are drawn: what real objects block is already in the camera's picture.

mod draw;
mod many;
mod reach;
mod receivers;
mod set;

pub use draw::ShadowMap;
pub use many::FlatLight;
pub use receivers::{Receivers, ShadowedBody};
pub use set::{ShadowMapSet, side_of_each};

use crate::math::sh::Real;
use glam::Vec3;

/// Free texels at each border of the map, so that a filter of up to 8 taps never looks past it from inside.
pub const EDGE_TEXELS: f32 = 5.0;
/// The bias never exceeds this many texels. A sphere of a diameter of half a map of 1024 needs 4 to 43
/// texels at its terminator, the ground under a sun of 3 degrees 67.
pub const MAX_BIAS_TEXELS: f32 = 64.0;
/// Added to every bias, texels: a receiver that faces the light has none, but its depth and the map's are rounded apart.
pub const ROUNDING_TEXELS: f32 = 0.1;
/// Texels across the casters at least, however wide the light.
const LEAST_ACROSS: f64 = 96.0;
/// Where little of the shadows is seen, texels get no finer than one in so many of those over all casters: positions in a map
/// stay within what 32 bits hold.
const FINEST: f64 = 64.0;
/// Depth of an empty texel. Depths of casters are below 1.
pub const EMPTY_DEPTH: f32 = 1.0;
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
    /// so that a moving object does not make the shadows of others swim. The depth range is that of all
    /// casters: receivers need none, see [`lit`], and whoever throws a shadow to where it is seen may be anywhere before it. `None` without a finite caster or a finite direction.
    pub fn fit(to_light_world: [f32; 3], casters: impl Iterator<Item = Vec3>, texels: u32) -> Option<Self> {
        Self::fit_soft(to_light_world, casters, &Receivers::default(), texels, 0.0)
    }

    /// [`Self::fit`] to those shadows that are seen, for a light whose penumbra is as wide as a texel of `texel_of_depth`
    /// times the casters' extent along the light: no finer than that. Each point of a receiver that is seen and that a
    /// filter of up to 8 taps may find shadowed then lies inside of the map with all its filter. `None` also where no shadow falls on what is seen.
    pub fn fit_soft(
        to_light_world: [f32; 3],
        casters: impl Iterator<Item = Vec3>,
        receivers: &Receivers,
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
        let texel_across = |metres: f64| {
            let tight = (metres / usable).max(wide).max(1e-6);
            ((tight.log2() * 8.0).ceil() / 8.0).exp2()
        };
        // What lies beside all casters is shadowed as far as the filter reaches.
        let beside = f64::from(EDGE_TEXELS) * texel_across(across);
        let rectangle = [low.truncate(), high.truncate()];
        let [from, to] = receivers.within([right, up, light], rectangle, beside)?;
        let texel = texel_across((to - from).max_element().max(across / FINEST));
        let corner_x = ((from.x / texel).floor() - f64::from(EDGE_TEXELS)) * texel;
        let corner_y = ((from.y / texel).floor() - f64::from(EDGE_TEXELS)) * texel;
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
        let start = top as usize * size + left as usize;
        // Where all taps agree their weights do not matter.
        match taps_lit(map, size, start, side as usize + 1, reference) {
            Some(true) => return 1.0,
            Some(false) => return 0.0,
            None => {}
        }
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

/// Whether all of `taps` x `taps` texels from `start` on let the light through, or none; `None`: some do.
#[inline(always)]
fn taps_lit(map: &[f32], size: usize, start: usize, taps: usize, reference: f32) -> Option<bool> {
    let mut lit = 0;
    if taps == 4 {
        for row in map[start..].chunks(size).take(4) {
            let [a, b, c, d] = *row.first_chunk::<4>()?;
            lit += [a, b, c, d].map(|stored| u32::from(reference <= stored)).iter().sum::<u32>();
        }
    } else {
        for row in map[start..].chunks(size).take(taps) {
            lit += row.iter().take(taps).filter(|stored| reference <= **stored).count() as u32;
        }
    }
    match lit as usize {
        0 => Some(false),
        all if all == taps * taps => Some(true),
        _ => None,
    }
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

#[cfg(test)]
mod tests;
