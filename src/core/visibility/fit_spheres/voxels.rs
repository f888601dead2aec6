//! A mesh's volume as cubes, and how many spheres cover each.

use super::{refine::FoundSphere, thickness::weights};
use crate::math::bvh::Bvh;
use glam::{DVec3, Vec3};

/// About so many cubes lie inside.
const INNER: f64 = 16_000.0;
/// Most cubes in all.
const MOST: f64 = 3e6;
/// Fewer inner cubes than this are no volume.
const FEWEST: usize = 64;
/// Free cubes around the mesh.
const MARGIN: f64 = 2.0;

/// Cubes with sides of 1 (one cube is `cell` long in the mesh's frame); cube (i, j, k) has its centre at (i, j, k).
pub struct Voxels {
    size: [i32; 3],
    inside: Vec<bool>,
    covered: Vec<u8>,
    weights: Vec<f32>,
    /// Cube (0, 0, 0)'s centre in the mesh's frame.
    pub origin: DVec3,
    /// A cube's side there.
    pub cell: f64,
}

impl Voxels {
    /// `None` where no triangle has an area.
    pub fn of_mesh(positions: &[Vec3], triangles: &[[u32; 3]]) -> Option<Self> {
        let bvh = Bvh::build(positions, triangles);
        let (low, high) = bvh.bounds().map(|(low, high)| (low.as_dvec3(), high.as_dvec3()))?;
        let extent = high - low;
        let longest = extent.max_element();
        // Nothing is thinner than this; a flat mesh still has room around it.
        let volume = extent.max(DVec3::splat(longest * 1e-2)).element_product();
        let first_cell = (volume / INNER).cbrt();
        let smallest_cell = (volume / MOST).cbrt();
        let first = Self::cut(&bvh, positions, triangles, low, high, first_cell);
        let inner = first.inside.iter().filter(|&&inside| inside).count();
        let cell = if inner >= FEWEST {
            first_cell * (inner as f64 / INNER).cbrt()
        } else {
            // Perhaps thin: as fine as may be.
            first_cell * 0.4
        };
        let mut voxels = Self::cut(&bvh, positions, triangles, low, high, cell.max(smallest_cell));
        if voxels.inside.iter().filter(|&&inside| inside).count() < FEWEST {
            voxels = first;
            voxels.mark_surface(positions, triangles);
        }
        voxels.weights = weights(voxels.size, &voxels.inside);
        Some(voxels)
    }

    fn cut(
        bvh: &Bvh,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        low: DVec3,
        high: DVec3,
        cell: f64,
    ) -> Self {
        // Off by an odd share of a cube, so that lines do not run along faces of boxes and through corners.
        let origin = low - DVec3::new(MARGIN - 0.137, MARGIN - 0.271, MARGIN - 0.193) * cell;
        let cells = ((high - origin) / cell + MARGIN).ceil();
        let size = [cells.x as i32 + 1, cells.y as i32 + 1, cells.z as i32 + 1];
        let total = size.iter().map(|&n| n as usize).product();
        let mut votes = vec![0i8; total];
        let mut voxels =
            Self { size, inside: Vec::new(), covered: vec![0; total], weights: Vec::new(), origin, cell };
        let mut crossings: Vec<(f32, i32)> = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut direction = Vec3::ZERO;
            direction[axis] = 1.0;
            for j in 0..size[v] {
                for i in 0..size[u] {
                    let mut at = [0i32; 3];
                    (at[u], at[v]) = (i, j);
                    let start = (origin + DVec3::from(at.map(f64::from)) * cell).as_vec3();
                    cross(bvh, positions, triangles, start, direction, &mut crossings);
                    // A line that does not come out as it went in met a hole: it has no vote.
                    if crossings.iter().map(|c| c.1).sum::<i32>() != 0 {
                        continue;
                    }
                    let (mut winding, mut next) = (0, 0);
                    for k in 0..size[axis] {
                        let here = (f64::from(k) * cell) as f32;
                        while next < crossings.len() && crossings[next].0 < here {
                            winding += crossings[next].1;
                            next += 1;
                        }
                        at[axis] = k;
                        votes[voxels.index(at)] += if winding != 0 { 1 } else { -1 };
                    }
                }
            }
        }
        voxels.inside = votes.iter().map(|&v| v > 0).collect();
        voxels
    }

    /// Takes the cubes that the surface passes as inside.
    fn mark_surface(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) {
        for triangle in triangles {
            let corner = |i: u32| positions.get(i as usize).filter(|p| p.is_finite()).map(|p| p.as_dvec3());
            let [Some(a), Some(b), Some(c)] = triangle.map(corner) else { continue };
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            let steps = (longest / (0.5 * self.cell)).ceil().clamp(1.0, 1000.0) as u32;
            for i in 0..=steps {
                for j in 0..=steps - i {
                    let (s, t) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                    let at = (a + (b - a) * s + (c - a) * t - self.origin) / self.cell;
                    let at = at.round();
                    let at = [at.x as i32, at.y as i32, at.z as i32];
                    if (0..3).all(|k| (0..self.size[k]).contains(&at[k])) {
                        let index = self.index(at);
                        self.inside[index] = true;
                    }
                }
            }
        }
    }

    fn index(&self, at: [i32; 3]) -> usize {
        (at[0] as usize) + self.size[0] as usize * (at[1] as usize + self.size[1] as usize * at[2] as usize)
    }

    /// Centres of all inner cubes, in cubes.
    pub fn inner_points(&self) -> Vec<DVec3> {
        self.points(|_, inside| inside)
    }

    /// Centres of the inner cubes that no sphere covers.
    pub fn uncovered_points(&self) -> Vec<DVec3> {
        self.points(|index, inside| inside && self.covered[index] == 0)
    }

    fn points(&self, take: impl Fn(usize, bool) -> bool) -> Vec<DVec3> {
        let [nx, ny, _] = self.size.map(|n| n as usize);
        let at = |i: usize| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
        (0..self.inside.len()).filter(|&i| take(i, self.inside[i])).map(at).collect()
    }

    /// Calls `row(first index, number of cubes)` for the rows of cubes within a sphere, and returns how many of its
    /// cubes lie beyond the grid.
    fn rows(&self, sphere: &FoundSphere, mut row: impl FnMut(usize, usize)) -> f64 {
        let (c, r2) = (sphere.centre, sphere.radius * sphere.radius);
        let [nx, ny, nz] = self.size;
        let mut beyond = 0.0;
        for z in (c.z - sphere.radius).ceil() as i32..=(c.z + sphere.radius).floor() as i32 {
            let dz = f64::from(z) - c.z;
            let reach = (r2 - dz * dz).max(0.0).sqrt();
            for y in (c.y - reach).ceil() as i32..=(c.y + reach).floor() as i32 {
                let dy = f64::from(y) - c.y;
                let reach = (r2 - dz * dz - dy * dy).max(0.0).sqrt();
                let (from, to) = ((c.x - reach).ceil() as i32, (c.x + reach).floor() as i32);
                if to < from {
                    continue;
                }
                let within = if (0..ny).contains(&y) && (0..nz).contains(&z) {
                    (from.max(0), to.min(nx - 1))
                } else {
                    (0, -1)
                };
                let count = (within.1 - within.0 + 1).max(0);
                beyond += f64::from(to - from + 1 - count);
                if count > 0 {
                    row(self.index([within.0, y, z]), count as usize);
                }
            }
        }
        beyond
    }

    /// Counts a sphere in (1) or out (-1).
    pub fn add(&mut self, sphere: &FoundSphere, change: i8) {
        let mut covered = std::mem::take(&mut self.covered);
        self.rows(sphere, |first, count| {
            for cover in &mut covered[first..first + count] {
                *cover = cover.saturating_add_signed(change);
            }
        });
        self.covered = covered;
    }

    /// What a sphere that is not counted in would bring: `newly` for each inner cube it covers first, -1 for each outer
    /// one, `-again` for each cube that is covered already, all times the cubes' weights.
    pub fn gain(&self, sphere: &FoundSphere, newly: f64, again: f64) -> f64 {
        let (newly, again) = (newly as f32, again as f32);
        let mut sum = 0.0f64;
        let beyond = self.rows(sphere, |first, count| {
            let range = first..first + count;
            let cubes = self.covered[range.clone()].iter().zip(&self.inside[range.clone()]);
            let mut row = 0.0f32;
            for ((&cover, &inside), weight) in cubes.zip(&self.weights[range]) {
                let worth = if cover > 0 {
                    -again
                } else if inside {
                    newly
                } else {
                    -1.0
                };
                row += worth * weight;
            }
            sum += f64::from(row);
        });
        sum - beyond
    }

    /// Cubes of the union outside the mesh, cubes of the mesh in no sphere, cubes of the mesh.
    pub fn shares(&self, spheres: &[FoundSphere]) -> (f64, f64, f64) {
        let beyond: f64 = spheres.iter().map(|sphere| self.rows(sphere, |_, _| ())).sum();
        let mut sums = (beyond, 0.0, 0.0);
        for (&cover, &inside) in self.covered.iter().zip(&self.inside) {
            sums.0 += f64::from(u8::from(cover > 0 && !inside));
            sums.1 += f64::from(u8::from(cover == 0 && inside));
            sums.2 += f64::from(u8::from(inside));
        }
        sums
    }
}

/// Where a line meets the surface and how often it goes in (1) or out (-1) there, in order.
fn cross(
    bvh: &Bvh,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    start: Vec3,
    direction: Vec3,
    crossings: &mut Vec<(f32, i32)>,
) {
    /// More than this many crossings of one line are noise.
    const MOST: usize = 256;
    crossings.clear();
    let mut after = 0.0;
    while let Some(hit) = bvh.intersect(start, direction, after, f32::INFINITY) {
        let [a, b, c] = triangles[hit.triangle as usize].map(|i| positions[i as usize].as_dvec3());
        let across = (b - a).cross(c - a).dot(direction.as_dvec3());
        crossings.push((hit.t, if across < 0.0 { 1 } else { -1 }));
        after = hit.t;
        if crossings.len() > MOST {
            break;
        }
    }
}
