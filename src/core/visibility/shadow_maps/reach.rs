//! Which parts of a shadow map hold casters, in tiles: what lies elsewhere is lit and need not be looked up.

/// Tiles a side at most: the bits of a word.
pub const MOST_TILES: usize = 64;
/// Texels a side of a tile at least: above half of the widest filter (8 taps) and its rounding, so that a filter around a
/// position looks no farther than the next tile.
pub const LEAST_TEXELS: usize = 16;
/// Of maps that are read without a filter.
pub const SMALL_TEXELS: usize = 4;

/// A bit for each tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// Texels a side of a tile.
    tile: usize,
    /// Tiles that hold a caster.
    held: [u64; MOST_TILES],
    /// Those and their neighbours.
    near: [u64; MOST_TILES],
}

impl Default for Reach {
    fn default() -> Self {
        Self { tile: LEAST_TEXELS, held: [0; MOST_TILES], near: [0; MOST_TILES] }
    }
}

/// Bits of tiles `first..=last`.
fn bits(first: usize, last: usize) -> u64 {
    if first > last || first >= MOST_TILES {
        0
    } else {
        (!0 << first) & (!0 >> (MOST_TILES - 1 - last.min(MOST_TILES - 1)))
    }
}

impl Reach {
    /// Nothing in a map of `side` texels a side, in tiles of at least so many.
    pub fn empty(side: usize, least_texels: usize) -> Self {
        Self { tile: side.div_ceil(MOST_TILES).max(least_texels), ..Self::default() }
    }

    /// Texels a side of a tile.
    pub fn tile(&self) -> usize {
        self.tile
    }

    /// The bits of a row of texels between two columns, both included.
    pub fn columns(&self, first: usize, last: usize) -> u64 {
        bits(first / self.tile, last / self.tile)
    }

    /// First texel and the one after the last that a row of tiles holds; `side` texels a side.
    pub fn held(&self, tile_row: usize, side: usize) -> std::ops::Range<usize> {
        match self.held.get(tile_row) {
            None | Some(0) => 0..0,
            Some(held) => {
                let end = (MOST_TILES - held.leading_zeros() as usize) * self.tile;
                held.trailing_zeros() as usize * self.tile..end.min(side)
            }
        }
    }

    /// Takes the tiles that hold casters, row by row of tiles.
    pub fn take(&mut self, held: impl Iterator<Item = u64>) {
        self.held = [0; MOST_TILES];
        for (slot, held) in self.held.iter_mut().zip(held) {
            *slot = held;
        }
        let wide: [u64; MOST_TILES] = self.held.map(|row| row | row << 1 | row >> 1);
        for (y, near) in self.near.iter_mut().enumerate() {
            let above = if y > 0 { wide[y - 1] } else { 0 };
            *near = above | wide[y] | wide.get(y + 1).copied().unwrap_or(0);
        }
    }

    /// Whether a caster may be within the filter around a position, in texels, within the map.
    #[inline(always)]
    pub fn is_near(&self, x: f32, y: f32) -> bool {
        let of = |v: f32| (v as usize / self.tile).min(MOST_TILES - 1);
        self.near[of(y)] >> of(x) & 1 == 1
    }

    /// Whether a caster may be at some position of a box: low and high corner, texels, anywhere.
    #[inline(always)]
    pub fn is_held_box(&self, low: [f32; 2], high: [f32; 2]) -> bool {
        let of = |v: f32| v as usize / self.tile;
        let columns = bits(of(low[0]), of(high[0]));
        let rows = of(low[1]).min(MOST_TILES)..(of(high[1]) + 1).min(MOST_TILES);
        self.held.get(rows).unwrap_or(&[]).iter().any(|row| row & columns != 0)
    }

    /// Whether a caster may be within the filter around some position of a box: low and high corner, texels, anywhere.
    #[inline(always)]
    pub fn is_near_box(&self, low: [f32; 2], high: [f32; 2]) -> bool {
        // Conversions saturate; what lies before the map is taken to its first tile.
        let of = |v: f32| v as usize / self.tile;
        let columns = bits(of(low[0]), of(high[0]));
        let rows = of(low[1]).min(MOST_TILES)..(of(high[1]) + 1).min(MOST_TILES);
        self.near.get(rows).unwrap_or(&[]).iter().any(|row| row & columns != 0)
    }
}
