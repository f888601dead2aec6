//! The CPU's depth rasteriser of shadow maps.

use super::{
    BAND_ROWS, EMPTY_DEPTH, ShadowCamera,
    reach::{LEAST_TEXELS, MOST_TILES, Reach, SMALL_TEXELS},
};
use glam::Vec3;
use rayon::prelude::*;

/// Vertices are snapped to this fraction of a texel, so that neighbours leave no gaps.
const SUBTEXELS: f32 = 256.0;
/// Triangles of at most so many columns are tested texel by texel.
const NARROW: i64 = 16;

/// The CPU's depth rasteriser and its memory.
#[derive(Clone, Debug, Default)]
pub struct ShadowMap {
    depth: Vec<f32>,
    vertices: Vec<Vertex>,
    /// For each row of tiles, where casters were drawn last.
    held: Vec<u64>,
    reach: Reach,
    /// Tiles are as small as they may be, for reads without a filter.
    small_tiles: bool,
}

/// A projected vertex: column and row in 1/256 texel, and depth.
#[derive(Clone, Copy, Debug, Default)]
struct Vertex {
    x: i32,
    y: i32,
    depth: f32,
}

impl Vertex {
    fn at([x, y, depth]: [f32; 3]) -> Self {
        Self { x: (x * SUBTEXELS).round() as i32, y: (y * SUBTEXELS).round() as i32, depth }
    }
}

impl ShadowMap {
    /// An empty one that is read without a filter.
    pub(in crate::visibility) fn of_small_tiles() -> Self {
        Self { small_tiles: true, ..Self::default() }
    }

    /// Depths, row by row; `EMPTY_DEPTH` where nothing is.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// Where casters are.
    #[inline(always)]
    pub(in crate::visibility) fn reach(&self) -> &Reach {
        &self.reach
    }

    /// Takes depths that were drawn elsewhere, of a square map.
    pub fn set_depth(&mut self, depth: Vec<f32>) {
        let side = depth.len().isqrt();
        self.clear(side);
        self.depth = depth;
        for (y, row) in self.depth.chunks(side.max(1)).enumerate() {
            let held = row.iter().enumerate().filter(|(_, stored)| **stored != EMPTY_DEPTH);
            let bits = held.fold(0, |bits, (x, _)| bits | self.reach.columns(x, x));
            if let Some(slot) = self.held.get_mut(y / self.reach.tile()) {
                *slot |= bits;
            }
        }
        self.reach.take(self.held.iter().copied());
    }

    /// An empty map of `side` texels a side.
    fn clear(&mut self, side: usize) {
        self.depth.clear();
        self.depth.resize(side * side, EMPTY_DEPTH);
        let least = if self.small_tiles { SMALL_TEXELS } else { LEAST_TEXELS };
        self.reach = Reach::empty(side, least);
        self.held.clear();
        self.held.resize(side.div_ceil(self.reach.tile()), 0);
    }

    /// Draws triangles (world frame, metres) into the map. A texel is covered where its centre lies inside
    /// or on the edge of the triangle whose corners are snapped to 1/256 texel. Same result for any number of threads.
    pub fn draw(&mut self, camera: &ShadowCamera, positions: &[Vec3], triangles: &[[u32; 3]]) {
        self.draw_in_bands(camera, positions, triangles, BAND_ROWS);
    }

    /// [`ShadowMap::draw`] with units of parallel work of about `band_rows` rows.
    pub(super) fn draw_in_bands(
        &mut self,
        camera: &ShadowCamera,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        band_rows: usize,
    ) {
        self.vertices.resize(positions.len(), Vertex::default());
        self.vertices.par_chunks_mut(1024).zip(positions.par_chunks(1024)).for_each(|(out, positions)| {
            for (v, &p) in out.iter_mut().zip(positions) {
                *v = Vertex::at(camera.map(p));
            }
        });
        self.rasterise(camera.texels as usize, triangles, band_rows);
    }

    /// Has room for a map of `side` texels a side and for so many vertices, so that drawing them allocates nothing.
    pub(in crate::visibility) fn reserve(&mut self, side: usize, vertices: usize) {
        fn provide<T>(list: &mut Vec<T>, count: usize) {
            list.reserve_exact(count.saturating_sub(list.len()));
        }
        provide(&mut self.depth, side * side);
        provide(&mut self.held, MOST_TILES);
        provide(&mut self.vertices, vertices);
    }

    /// Takes vertices that are projected already: column and row in texels, and depth.
    pub(in crate::visibility) fn set_vertices(&mut self, mapped: impl Iterator<Item = [f32; 3]>) {
        self.vertices.clear();
        self.vertices.extend(mapped.map(Vertex::at));
    }

    /// Draws triangles of the vertices into a map of `side` texels a side.
    pub(in crate::visibility) fn rasterise(&mut self, side: usize, triangles: &[[u32; 3]], band_rows: usize) {
        if self.depth.len() != side * side {
            self.clear(side);
        }
        let (vertices, last) = (&self.vertices, self.reach);
        let tile_rows = (band_rows / last.tile()).max(1);
        let bands = self.depth.par_chunks_mut((tile_rows * last.tile() * side).max(1));
        bands.zip(self.held.par_chunks_mut(tile_rows)).enumerate().for_each(|(band, (rows, held))| {
            let mut rows =
                MapRows { side, first_row: band * tile_rows * last.tile(), rows, held, reach: &last };
            rows.clear();
            for triangle in triangles {
                let corners = triangle.map(|i| vertices[i as usize]);
                rows.draw(&corners);
            }
        });
        self.reach.take(self.held.iter().copied());
    }

    /// Draws triangles whose corners are projected already (column and row in texels, and depth) into a map of `side` texels a
    /// side: one unit of work.
    pub(in crate::visibility) fn rasterise_mapped(
        &mut self,
        side: usize,
        triangles: impl Iterator<Item = [[f32; 3]; 3]>,
    ) {
        if self.depth.len() != side * side {
            self.clear(side);
        }
        let last = self.reach;
        let mut rows =
            MapRows { side, first_row: 0, rows: &mut self.depth, held: &mut self.held, reach: &last };
        rows.clear();
        for corners in triangles {
            rows.draw(&corners.map(Vertex::at));
        }
        self.reach.take(self.held.iter().copied());
    }
}

/// Some rows of a map.
struct MapRows<'a> {
    side: usize,
    first_row: usize,
    rows: &'a mut [f32],
    held: &'a mut [u64],
    reach: &'a Reach,
}

impl MapRows<'_> {
    /// Empties what was drawn last.
    fn clear(&mut self) {
        let (side, tile) = (self.side, self.reach.tile());
        for (y, row) in self.rows.chunks_mut(side.max(1)).enumerate() {
            row[self.reach.held((self.first_row + y) / tile, side)].fill(EMPTY_DEPTH);
        }
        self.held.fill(0);
    }

    /// Draws one triangle.
    fn draw(&mut self, v: &[Vertex; 3]) {
        let (side, first_row) = (self.side, self.first_row);
        let unit = SUBTEXELS as i64;
        // Row j has its centre at (j + 1/2) units: the first centre at or below the lowest, the last at or above the highest.
        let range = |[a, b, c]: [i32; 3], first: i64, last: i64| {
            let (low, high) = (i64::from(a.min(b).min(c)), i64::from(a.max(b).max(c)));
            let from = (low - unit / 2).div_ceil_signed(unit).max(first);
            (from, (high - unit / 2).div_euclid(unit).min(last))
        };
        let last_row = (first_row + self.rows.len() / side) as i64 - 1;
        let (first, last) = range(v.map(|c| c.y), first_row as i64, last_row);
        if first > last {
            return;
        }
        let (left, right) = range(v.map(|c| c.x), 0, side as i64 - 1);
        if left > right {
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
        let narrow = right - left < NARROW;
        for j in first..=last {
            let y = j * unit + unit / 2;
            // Inside where step * i + rest >= 0 for each edge.
            let edges: [[i64; 2]; 3] = std::array::from_fn(|k| {
                let (a, b) = (p[k], p[(k + 1) % 3]);
                let step = -sign * (b.1 - a.1) * unit;
                [step, sign * ((b.0 - a.0) * (y - a.1) - (b.1 - a.1) * (unit / 2 - a.0))]
            });
            let (start, end) = if narrow { (left, right) } else { within(&edges, left, right) };
            if start > end {
                continue;
            }
            let dy = (y - p[0].1) as f32;
            let row = j as usize - first_row;
            self.held[row / self.reach.tile()] |= self.reach.columns(start as usize, end as usize);
            let texels = &mut self.rows[row * side + start as usize..=row * side + end as usize];
            for (i, slot) in (start..=end).zip(texels) {
                if narrow && edges.iter().any(|[step, rest]| step * i + rest < 0) {
                    continue;
                }
                let dx = (i * unit + unit / 2 - p[0].0) as f32;
                // Slivers have steep planes: never outside of the corners' own range.
                let z = (v[0].depth + slope_x * dx + slope_y * dy).max(nearest).min(farthest);
                *slot = slot.min(z);
            }
        }
    }
}

/// First and last texel of a row that lie inside of all edges, within bounds.
fn within(edges: &[[i64; 2]; 3], left: i64, right: i64) -> (i64, i64) {
    let (mut start, mut end) = (left, right);
    for &[step, rest] in edges {
        if step > 0 {
            start = start.max((-rest).div_ceil_signed(step));
        } else if step < 0 {
            end = end.min(rest.div_euclid(-step));
        } else if rest < 0 {
            end = -1;
        }
    }
    (start, end)
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
