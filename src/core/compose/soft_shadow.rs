//! What virtual objects take of the soft half of the light on real surfaces: the global term of Section 6.2 of [Now11],
//! with spheres for the objects. Evaluated for each pixel, or at half or quarter resolution and carried up along the
//! surface: soft shadows are smooth. Twin: `shaders/compose/soft_shadow.wgsl`, for 256 spheres
//! at most; the GPU engine runs more here.

use super::shade_object::LightTerms;
use crate::math::sh::{MAX_COEFFICIENTS, MAX_ORDER, basis, product::product_matrix, zonal};
use crate::visibility::{
    blockers::{BlockedPlane, Blockers, LANES},
    shadow_maps::{FlatLight, ShadowMapSet},
};
use glam::Vec3;

/// Distinct normals of flat receivers that are prepared together; more are evaluated one point at a time.
const MOST_PLANES: usize = 32;
/// Neighbours of a coarse picture count as the same surface where their inverse depths agree to this share.
pub const SAME_SURFACE: f32 = 0.02;

/// M^{L_g}, the lighting product matrix of each channel (Eq. 5 and 19 of [Now11]): made anew when the light changes.
#[derive(Clone, Debug)]
pub struct Transfer {
    order: usize,
    global_rgb: [[f32; 3]; MAX_COEFFICIENTS],
    /// Row by row, order^2 of order^2.
    matrix_rgb: Vec<[f32; 3]>,
    /// sqrt(4 pi / (2 l + 1)) z_l of Lambert.
    bands: [f32; MAX_ORDER],
}

impl Default for Transfer {
    fn default() -> Self {
        Self {
            order: 0,
            global_rgb: [[0.0; 3]; MAX_COEFFICIENTS],
            matrix_rgb: Vec::new(),
            bands: [0.0; MAX_ORDER],
        }
    }
}

impl Transfer {
    /// Takes over the light; free where it has not changed. Whether it had.
    pub fn update(&mut self, light: &LightTerms) -> bool {
        if self.is_of(light) {
            return false;
        }
        (self.order, self.global_rgb) = (light.order, light.global_rgb);
        let count = self.order * self.order;
        self.matrix_rgb.clear();
        self.matrix_rgb.resize(count * count, [0.0; 3]);
        let mut matrix = [0.0f32; MAX_COEFFICIENTS * MAX_COEFFICIENTS];
        for c in 0..3 {
            let channel = light.global_rgb.map(|row| row[c]);
            product_matrix(self.order, &channel, &mut matrix);
            for (out, m) in self.matrix_rgb.iter_mut().zip(matrix) {
                out[c] = m;
            }
        }
        let mut lambert = [0.0f64; MAX_ORDER];
        zonal::lambert(self.order, &mut lambert);
        for (l, (band, z)) in self.bands.iter_mut().zip(lambert).enumerate() {
            *band = ((4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt() * z) as f32;
        }
        true
    }

    /// Whether it is of this light already.
    pub fn is_of(&self, light: &LightTerms) -> bool {
        self.order == light.order && self.global_rgb == light.global_rgb
    }

    /// Order of the light.
    pub fn order(&self) -> usize {
        self.order
    }

    /// The matrix of all channels, row by row.
    pub fn matrix_rgb(&self) -> &[[f32; 3]] {
        &self.matrix_rgb
    }

    /// sqrt(4 pi / (2 l + 1)) z_l of Lambert.
    pub fn bands(&self) -> [f32; MAX_ORDER] {
        self.bands
    }

    /// The transfer row of a white matt receiver, t = M^{L_g} f+: sum of t_i V_i is what it radiates through a visibility V.
    pub fn of_normal(&self, normal: Vec3) -> [[f32; 3]; MAX_COEFFICIENTS] {
        let mut lobe = [0.0f32; MAX_COEFFICIENTS];
        basis::evaluate(self.order, normal.to_array(), &mut lobe);
        for l in 0..self.order {
            lobe[l * l..(l + 1) * (l + 1)].iter_mut().for_each(|y| *y *= self.bands[l]);
        }
        self.of_lobe(&lobe)
    }

    /// M^{L_g} f of any function f by its coefficients: sum of t_i V_i is the integral of L_g f V, cut to the order.
    pub fn of_lobe(&self, lobe: &[f32; MAX_COEFFICIENTS]) -> [[f32; 3]; MAX_COEFFICIENTS] {
        let count = self.order * self.order;
        let mut row = [[0.0f32; 3]; MAX_COEFFICIENTS];
        for (out, matrix) in row.iter_mut().zip(self.matrix_rgb.chunks(count.max(1))) {
            for (m, f) in matrix.iter().zip(lobe) {
                for (out, m) in out.iter_mut().zip(m) {
                    *out += m * f;
                }
            }
        }
        row
    }
}

/// What the points of a flat receiver share under the hard lights of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatReceiver {
    /// Unit, world frame.
    pub normal: Vec3,
    /// Irradiance where nothing is in the way of the light.
    pub whole_rgb: [f32; 3],
    /// Where its lights are in the list of all planes.
    lights: [usize; 2],
}

/// Flat receivers with what their points share. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    normals: Vec<Vec3>,
    /// n.p of its points.
    offsets: Vec<f32>,
    flat: Vec<FlatReceiver>,
    flat_lights: Vec<FlatLight>,
    prepared: Vec<BlockedPlane>,
    /// For each triangle of the surfaces its plane, or `u32::MAX`.
    of_triangle: Vec<u32>,
}

impl Planes {
    /// Finds the planes of receiving triangles whose vertex normals are the facet's.
    pub fn find(&mut self, surfaces: &super::geometry::SurfaceGeometry) {
        self.normals.clear();
        self.offsets.clear();
        self.of_triangle.clear();
        for (i, corners) in surfaces.triangles.iter().enumerate() {
            let facet = surfaces.facet_normals[i];
            let is_flat = corners.iter().all(|&v| surfaces.normals[v as usize].dot(facet) > 0.999_999);
            let offset = facet.dot(surfaces.positions[corners[0] as usize]);
            let known = (0..self.normals.len())
                .find(|&k| self.normals[k].dot(facet) > 0.999_999 && (self.offsets[k] - offset).abs() < 1e-5);
            let index = match known {
                _ if !(is_flat && surfaces.receives[i]) => u32::MAX,
                Some(index) => index as u32,
                None if self.normals.len() < MOST_PLANES => {
                    self.normals.push(facet);
                    self.offsets.push(offset);
                    self.normals.len() as u32 - 1
                }
                None => u32::MAX,
            };
            self.of_triangle.push(index);
        }
        if self.prepared.len() < self.normals.len() {
            self.prepared.resize_with(self.normals.len(), BlockedPlane::default);
        }
    }

    /// Prepares all of them for the blockers and the light of a frame.
    pub fn prepare(&mut self, blockers: &Blockers, transfer: &Transfer) {
        for (normal, plane) in self.normals.iter().zip(&mut self.prepared) {
            blockers.plane(*normal, None, &transfer.of_normal(*normal), plane);
        }
    }

    /// Sums up the whole light on each of them, and what their points share under each hard light.
    pub fn prepare_light(&mut self, light: &LightTerms, shadows: &ShadowMapSet, taps: u32) {
        self.flat.clear();
        self.flat_lights.clear();
        for &normal in &self.normals {
            let first = self.flat_lights.len();
            let lights = light.hard().iter().enumerate().filter_map(|(k, hard)| {
                shadows.flat_light(k, taps, normal.dot(Vec3::from(hard.to_light_world)))
            });
            self.flat_lights.extend(lights);
            let lights = [first, self.flat_lights.len()];
            self.flat.push(FlatReceiver {
                normal,
                whole_rgb: super::shade_surface::whole(light, normal),
                lights,
            });
        }
    }

    /// The hard lights that a flat receiver faces and that have a shadow map.
    pub fn lights(&self, flat: &FlatReceiver) -> &[FlatLight] {
        self.flat_lights.get(flat.lights[0]..flat.lights[1]).unwrap_or(&[])
    }

    /// What the points of a flat triangle share, seen from its front.
    pub fn flat(&self, triangle: usize, is_front: bool) -> Option<&FlatReceiver> {
        let index = *self.of_triangle.get(triangle)? as usize;
        if is_front { self.flat.get(index) } else { None }
    }

    /// Those prepared last.
    pub fn prepared(&self) -> &[BlockedPlane] {
        &self.prepared[..self.prepared.len().min(self.normals.len())]
    }

    /// The plane of a triangle seen from the side of `normal`, if it is one of them.
    pub fn of(&self, triangle: usize, normal: Vec3) -> Option<&BlockedPlane> {
        let index = *self.of_triangle.get(triangle)? as usize;
        let is_front = self.normals.get(index)?.dot(normal) > 0.9;
        if is_front { self.prepared.get(index) } else { None }
    }
}

/// What spheres take of the soft light that a white matt receiver would radiate (irradiance / pi), each channel: the sum
/// of t_i V_i without spheres less the one with them. Exactly 0 where nothing blocks; may be a little below 0 where the
/// truncated sums are.
pub fn taken(
    blockers: &Blockers,
    transfer: &Transfer,
    plane: Option<&BlockedPlane>,
    point_world: Vec3,
    normal: Vec3,
) -> [f32; 3] {
    if let Some(plane) = plane {
        let mut left = [[0.0f32; 3]];
        blockers.shade_plane(plane, &[point_world], &mut left);
        let whole = plane.unblocked();
        return std::array::from_fn(|c| whole[c] - left[0][c]);
    }
    let (left, whole) = blockers.shade(point_world, normal, None, &transfer.of_normal(normal));
    std::array::from_fn(|c| whole[c] - left[c])
}

/// What a pixel of the coarse picture sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CoarsePoint {
    /// World frame, metres.
    pub point_world: Vec3,
    /// Unit, world frame, on the seen side.
    pub normal: Vec3,
    /// 0: nothing there.
    pub inverse_depth: f32,
    /// The surface's triangle, where shadows fall on it.
    pub receiver: Option<u32>,
}

/// What is taken (r, g, b) and the inverse depth (a) for some pixels of the coarse picture. Neighbours on one plane are
/// evaluated together, as many as the blockers take side by side; the result is that of [`taken`] for each.
pub fn taken_in_row(
    blockers: &Blockers,
    transfer: &Transfer,
    planes: &Planes,
    row: &[CoarsePoint],
    out: &mut [[f32; 4]],
) {
    let mut first = 0;
    while first < row.len().min(out.len()) {
        let CoarsePoint { point_world, normal, inverse_depth, receiver } = row[first];
        out[first] = [0.0, 0.0, 0.0, inverse_depth];
        let Some(triangle) = receiver else {
            first += 1;
            continue;
        };
        let Some(plane) = planes.of(triangle as usize, normal) else {
            let [r, g, b] = taken(blockers, transfer, None, point_world, normal);
            out[first] = [r, g, b, inverse_depth];
            first += 1;
            continue;
        };
        let (mut points, mut count) = ([Vec3::ZERO; LANES], 0);
        for other in row[first..].iter().take(LANES) {
            let of = other.receiver.and_then(|t| planes.of(t as usize, other.normal));
            if !of.is_some_and(|of| std::ptr::eq(of, plane)) {
                break;
            }
            points[count] = other.point_world;
            count += 1;
        }
        let mut left = [[0.0f32; 3]; LANES];
        blockers.shade_plane(plane, &points[..count], &mut left[..count]);
        let whole = plane.unblocked();
        for ((out, point), left) in out[first..].iter_mut().zip(&row[first..]).zip(&left[..count]) {
            let [r, g, b] = std::array::from_fn(|c| whole[c] - left[c]);
            *out = [r, g, b, point.inverse_depth];
        }
        first += count;
    }
}

/// Whether an inverse depth (0: nothing there) is that of a surface, given as numerator and denominator.
#[inline(always)]
pub fn is_same_surface(inverse_depth: f32, [above, below]: [f32; 2]) -> bool {
    inverse_depth > 0.0 && (inverse_depth * below - above).abs() <= SAME_SURFACE * above.abs()
}

/// What is carried up from a coarse picture to a pixel of the fine one: the bilinear mean of those of its four neighbours
/// that lie on the same surface. `at` is the pixel's centre in the coarse picture (continuous); `inverse_depth(i)` is what
/// the surface would have at pixel i of the coarse picture, as a numerator and a denominator. `None` where no neighbour is
/// of the surface.
///
/// A coarse pixel is what was taken (r, g, b) and its inverse depth (a; 0: nothing there).
pub fn carried_up(
    coarse: &[[f32; 4]],
    width: usize,
    height: usize,
    at: [f32; 2],
    inverse_depth: impl Fn(usize) -> [f32; 2],
) -> Option<[f32; 3]> {
    let (x, y) = (at[0] - 0.5, at[1] - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    let (mut sum, mut weights) = ([0.0f32; 3], 0.0f32);
    for (dx, dy, weight) in [
        (0.0, 0.0, (1.0 - fx) * (1.0 - fy)),
        (1.0, 0.0, fx * (1.0 - fy)),
        (0.0, 1.0, (1.0 - fx) * fy),
        (1.0, 1.0, fx * fy),
    ] {
        let column = (left + dx).clamp(0.0, width as f32 - 1.0) as usize;
        let row = (top + dy).clamp(0.0, height as f32 - 1.0) as usize;
        let i = row * width + column;
        let pixel = coarse[i];
        if weight > 0.0 && is_same_surface(pixel[3], inverse_depth(i)) {
            for (s, c) in sum.iter_mut().zip(pixel) {
                *s += weight * c;
            }
            weights += weight;
        }
    }
    (weights > 1e-3).then(|| sum.map(|s| s / weights))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::shade_object::soft_over_pi;
    use crate::model::blocker::{BlockerSphere, Rung};
    use crate::model::light::{Lights, RadianceSh};

    fn light(order: usize) -> LightTerms {
        let mut global = RadianceSh::zero(order);
        for (i, row) in global.rgb.iter_mut().enumerate().take(order * order) {
            let x = 0.3 * ((i * 7 % 5) as f32 - 2.0);
            *row = if i == 0 { [4.0, 3.5, 3.0] } else { [x, 0.5 * x, -x] };
        }
        LightTerms::of(&Lights::soft(global))
    }

    #[test]
    fn without_blockers_the_row_gives_the_irradiance() {
        for order in 2..=6 {
            let light = light(order);
            let mut transfer = Transfer::default();
            assert!(transfer.update(&light) && !transfer.update(&light));
            for n in [Vec3::Z, Vec3::new(0.6, -0.48, 0.64), Vec3::NEG_Y] {
                let row = transfer.of_normal(n);
                let want = soft_over_pi(&light, n);
                for c in 0..3 {
                    let got = row[0][c] * (4.0 * std::f32::consts::PI).sqrt();
                    assert!((got - want[c]).abs() < 2e-6, "order {order}: {got} {}", want[c]);
                }
            }
        }
    }

    #[test]
    fn a_plane_gives_what_a_point_gives() {
        let light = light(4);
        let mut transfer = Transfer::default();
        transfer.update(&light);
        let spheres = [
            BlockerSphere { centre_world: Vec3::new(0.0, 0.0, 0.1), radius_m: 0.08, body: 0 },
            BlockerSphere { centre_world: Vec3::new(0.1, 0.05, 0.05), radius_m: 0.04, body: 0 },
        ];
        let surfaces = super::super::geometry::SurfaceGeometry {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            facet_normals: vec![Vec3::Z],
            albedo_rgb: vec![None],
            receives: vec![true],
        };
        let mut planes = Planes::default();
        planes.find(&surfaces);
        for rung in Rung::ALL {
            let mut blockers = Blockers::new();
            blockers.prepare(&spheres, rung, 4, 64);
            planes.prepare(&blockers, &transfer);
            let plane = planes.of(0, Vec3::Z);
            assert!(plane.is_some() && planes.of(0, Vec3::NEG_Z).is_none());
            for k in 0..20 {
                let p = Vec3::new(0.03 * k as f32 - 0.2, 0.02, 0.0);
                let a = taken(&blockers, &transfer, plane, p, Vec3::Z);
                let b = taken(&blockers, &transfer, None, p, Vec3::Z);
                for c in 0..3 {
                    assert!((a[c] - b[c]).abs() < 1e-5, "{rung:?}: {a:?} {b:?}");
                }
            }
            let near = taken(&blockers, &transfer, plane, Vec3::new(0.0, 0.02, 0.0), Vec3::Z);
            assert!(near[0] > 0.2, "{rung:?}: {near:?}");
            blockers.prepare(&[], rung, 4, 64);
            assert_eq!(taken(&blockers, &transfer, None, Vec3::ZERO, Vec3::Z), [0.0; 3]);
        }
    }

    #[test]
    fn only_neighbours_on_the_same_surface_count() {
        let coarse = [[1.0, 2.0, 3.0, 1.0], [9.0, 9.0, 9.0, 0.5], [1.0, 2.0, 3.0, 1.0], [0.0, 0.0, 0.0, 0.0]];
        let got = carried_up(&coarse, 2, 2, [1.0, 1.0], |_| [-2.0, -2.0]).unwrap();
        assert_eq!(got, [1.0, 2.0, 3.0]);
        assert_eq!(carried_up(&coarse, 2, 2, [1.0, 1.0], |_| [0.2, 1.0]), None);
        // Beyond the border the border's own pixel counts.
        assert_eq!(carried_up(&coarse, 2, 2, [0.0, 0.0], |_| [1.0, 1.0]).unwrap(), [1.0, 2.0, 3.0]);
        // Half way between two of them the mean.
        let slope = [[0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 1.0, 1.0]];
        assert_eq!(carried_up(&slope, 2, 1, [1.0, 0.5], |_| [1.0, 1.0]).unwrap(), [0.5; 3]);
    }
}
