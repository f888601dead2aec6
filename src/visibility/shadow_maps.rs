//! Hard shadows of the directional light: one orthographic depth map of the virtual objects (Section 7 of
//! [Now11]; Section 7.2 of [Gib03] for the bias), read through a percentage-closer filter.
//! Twin: `shaders/visibility/shadow_maps.wgsl`.
//!
//! What is drawn: every triangle, whichever way it faces; the nearest one stays. A closed body is then
//! represented by its lit side, so that its shadow reaches up to where it touches the ground (a map of far
//! sides would leave a bright gap of the bias' width there), and open meshes cast shadows too. Only virtual
//! objects are drawn: what real objects block is already in the camera's picture.

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
        let tight = (size.x.max(size.y) / usable).max(1e-6);
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
mod tests {
    use super::*;

    /// A sphere of `rows` x 2 rows quads, radius 1.
    fn sphere(rows: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let columns = 2 * rows;
        let mut positions = Vec::new();
        for j in 0..=rows {
            for i in 0..=columns {
                let theta = std::f32::consts::PI * j as f32 / rows as f32;
                let phi = std::f32::consts::TAU * i as f32 / columns as f32;
                positions.push(Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
            }
        }
        let mut triangles = Vec::new();
        for j in 0..rows as u32 {
            for i in 0..columns as u32 {
                let a = j * (columns as u32 + 1) + i;
                let b = a + columns as u32 + 1;
                triangles.push([a, b, b + 1]);
                triangles.push([a, b + 1, a + 1]);
            }
        }
        (positions, triangles)
    }

    fn fibonacci(n: usize) -> impl Iterator<Item = Vec3> {
        (0..n).map(move |j| {
            let z = 1.0 - 2.0 * (j as f32 + 0.5) / n as f32;
            let phi = std::f32::consts::PI * (1.0 + 5.0f32.sqrt()) * (j as f32 + 0.5);
            let r = (1.0 - z * z).max(0.0).sqrt();
            Vec3::new(r * phi.cos(), r * phi.sin(), z)
        })
    }

    #[test]
    fn what_faces_the_light_squarely_is_lit() {
        let corner = |x: f32, y: f32| Vec3::new(3.0 + x, y - 7.0, 0.15);
        let top = [corner(0.0, 0.0), corner(0.3, 0.0), corner(0.0, 0.3), Vec3::new(3.0, -7.0, 0.0)];
        let camera = ShadowCamera::fit([0.0, 0.0, 1.0], top.into_iter(), 256).unwrap();
        let mut map = ShadowMap::default();
        map.draw(&camera, &top, &[[0, 1, 2]]);
        for i in 0..400 {
            let p = corner(0.007 * (i % 20) as f32, 0.007 * (i / 20) as f32);
            assert_eq!(visibility(map.depth(), &camera, 4, p, 1.0), 1.0, "{p}");
        }
    }

    #[test]
    fn every_caster_lies_inside_of_the_map_for_every_direction() {
        let corners: Vec<Vec3> = (0..8)
            .map(|k| Vec3::new((k & 1) as f32 * 0.3, (k >> 1 & 1) as f32 * 0.1 - 2.0, (k >> 2) as f32))
            .collect();
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Z, Vec3::new(1e-9, 0.0, 1.0)];
        for w in fibonacci(500).chain(axes) {
            let camera = ShadowCamera::fit(w.to_array(), corners.iter().copied(), 256).unwrap();
            let (inner, outer) = (EDGE_TEXELS - 0.01, 256.0 - EDGE_TEXELS + 0.01);
            for &p in &corners {
                let [x, y, depth] = camera.map(p);
                assert!(x >= inner && x <= outer && y >= inner && y <= outer, "{w}: {x} {y}");
                assert!(depth > 0.0 && depth < 1.0, "{w}: depth {depth}");
            }
            // A metre towards the light is a metre less of depth and no step aside.
            let (there, here) = (camera.map(w.normalize()), camera.map(Vec3::ZERO));
            let step: [f32; 3] = std::array::from_fn(|a| there[a] - here[a]);
            assert!(step[0].abs() < 1e-3 && step[1].abs() < 1e-3, "{w}: {step:?}");
            assert!((step[2] * camera.depth_m + 1.0).abs() < 1e-5, "{w}: {step:?}");
            // The longest extent fills the map up to one rung of the ladder of texel sizes.
            let spans = [0, 1].map(|a| {
                let of = |p: &Vec3| camera.map(*p)[a];
                corners.iter().map(of).fold(f32::MIN, f32::max)
                    - corners.iter().map(of).fold(f32::MAX, f32::min)
            });
            let usable = 256.0 - 2.0 * EDGE_TEXELS - 1.0;
            assert!(spans[0].max(spans[1]) > usable * 0.917, "{w}: {spans:?}");
        }
    }

    #[test]
    fn no_light_or_no_caster_makes_no_camera() {
        let point = [Vec3::ZERO];
        assert!(ShadowCamera::fit([0.0; 3], point.iter().copied(), 64).is_none());
        assert!(ShadowCamera::fit([f32::NAN, 0.0, 1.0], point.iter().copied(), 64).is_none());
        assert!(ShadowCamera::fit([0.0, 0.0, 1.0], std::iter::empty(), 64).is_none());
        let bad = [Vec3::new(f32::INFINITY, 0.0, 0.0)];
        assert!(ShadowCamera::fit([0.0, 0.0, 1.0], bad.iter().copied(), 64).is_none());
    }

    #[test]
    fn neighbouring_triangles_leave_no_gap_and_a_disc_has_its_area() {
        let (positions, triangles) = sphere(24);
        let w = Vec3::new(0.3, -0.5, 0.7).normalize();
        let camera = ShadowCamera::fit(w.to_array(), positions.iter().copied(), 512).unwrap();
        let mut map = ShadowMap::default();
        map.draw(&camera, &positions, &triangles);
        let centre = camera.map(Vec3::ZERO);
        let radius = 1.0 / camera.texel_m;
        let mut covered = 0;
        for (k, &depth) in map.depth().iter().enumerate() {
            let (i, j) = ((k % 512) as f32 + 0.5 - centre[0], (k / 512) as f32 + 0.5 - centre[1]);
            covered += usize::from(depth < EMPTY_DEPTH);
            if i.hypot(j) < 0.97 * radius {
                // Facets of 7.5 degrees lie at most 0.6 % of the radius inside of the sphere.
                let exact = centre[2] - (1.0 - (i * i + j * j) / (radius * radius)).sqrt() / camera.depth_m;
                assert!((depth - exact).abs() * camera.depth_m < 0.03, "{i} {j}: {depth} {exact}");
            }
        }
        let area = covered as f32 / (std::f32::consts::PI * radius * radius);
        assert!((0.985..1.0).contains(&area), "{area}");
    }

    #[test]
    fn no_acne_on_a_sphere_and_no_light_behind_it() {
        let (positions, triangles) = sphere(64);
        let (mut worst, mut leak) = (1.0f32, 0.0f32);
        for w in [Vec3::Z, Vec3::new(0.6, 0.1, 0.2).normalize(), Vec3::new(-0.5, 0.5, 0.7).normalize()] {
            let camera = ShadowCamera::fit(w.to_array(), positions.iter().copied(), 1024).unwrap();
            let mut map = ShadowMap::default();
            map.draw(&camera, &positions, &triangles);
            for t in &triangles {
                let [a, b, c] = t.map(|i| positions[i as usize]);
                let normal = (b - a).cross(c - a);
                if normal.length() < 1e-6 {
                    continue;
                }
                let cosine = normal.normalize().dot(w);
                let seen = visibility(map.depth(), &camera, 4, (a + b + c) / 3.0, cosine);
                if cosine > 0.1 {
                    worst = worst.min(seen);
                } else if cosine < -0.3 {
                    // Not asked for in rendering: turned away. The map must know all the same.
                    leak = leak.max(seen);
                }
            }
        }
        assert!(worst == 1.0, "lit facets must be wholly lit: {worst}");
        assert!(leak == 0.0, "the far side must be dark: {leak}");
    }

    #[test]
    fn a_body_on_the_ground_has_no_bright_gap_at_its_foot() {
        // A cube of 1 m on z = 0 under a sun of 35 degrees: points of the ground 2 mm beside its shadowed side.
        let positions: Vec<Vec3> =
            (0..8).map(|k| Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32)).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        let w = Vec3::new(-0.82, 0.0, 0.5736).normalize();
        let camera = ShadowCamera::fit(w.to_array(), positions.iter().copied(), 1024).unwrap();
        let mut map = ShadowMap::default();
        map.draw(&camera, &positions, &triangles);
        for k in 0..90 {
            let y = 0.05 + 0.01 * k as f32;
            let dark = visibility(map.depth(), &camera, 4, Vec3::new(1.002, y, 0.0), w.z);
            assert!(dark == 0.0, "y {y}: {dark}");
            let bright = visibility(map.depth(), &camera, 4, Vec3::new(-0.002, y, 0.0), w.z);
            assert!(bright == 1.0, "y {y}: {bright}");
        }
    }

    #[test]
    fn the_filter_is_a_box_of_taps_minus_one_texels() {
        let mut map = vec![EMPTY_DEPTH; 64 * 64];
        for row in map.chunks_mut(64) {
            row[..32].fill(0.25);
        }
        for taps in 2..=8u32 {
            let width = (taps - 1) as f32;
            for k in 0..400 {
                let x = 20.0 + 0.0637 * k as f32;
                let exact = ((x + 0.5 * width - 32.0) / width).clamp(0.0, 1.0);
                let seen = lit(&map, 64, taps, x, 30.3, 0.5);
                assert!((seen - exact).abs() < 1e-5, "{taps} taps at {x}: {seen}, not {exact}");
            }
        }
        assert_eq!(lit(&map, 64, 1, 31.9, 3.0, 0.5), 0.0);
        assert_eq!(lit(&map, 64, 1, 32.1, 3.0, 0.5), 1.0);
        assert_eq!(lit(&map, 64, 4, 10.0, 10.0, 0.2), 1.0, "in front of the caster");
        assert_eq!(lit(&map, 64, 4, 10.0, 10.0, 7.0), 0.0, "far behind the caster");
        assert_eq!(lit(&map, 64, 4, 40.0, 10.0, 7.0), 1.0, "far behind nothing");
        for outside in [-1e30, -20.0, 70.0, 1e30, f32::NAN, f32::INFINITY] {
            assert_eq!(lit(&map, 64, 4, outside, 10.0, 0.5), 1.0);
            assert_eq!(lit(&map, 64, 4, 10.0, outside, 0.5), 1.0);
        }
    }

    #[test]
    fn bias_is_bounded_and_finite() {
        assert_eq!(bias_m(0.01, 2.0, 1.0, 0.2), 0.0);
        assert_eq!(bias_m(0.01, 2.0, 0.0, 0.2), 0.2);
        assert_eq!(bias_m(0.01, 2.0, -0.5, 0.2), 0.2);
        assert_eq!(bias_m(0.01, 2.0, f32::MIN_POSITIVE, 0.2), 0.2);
        assert_eq!(bias_m(0.01, 2.0, 1.0 + 1e-6, 0.2), 0.0);
    }
}
