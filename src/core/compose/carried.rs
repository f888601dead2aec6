//! Soft shadows carried up from a coarse picture along a flat surface, for several neighbours of a row at once: what
//! `soft_shadow::carried_up` gives each of them.

use super::{
    raster::Rays,
    soft_shadow::{carried_up, is_same_surface},
};
use crate::math::widest::widest;
use glam::Vec3;

/// Neighbours that are taken together.
pub const RUN: usize = 32;
/// Neighbours with those of the same coarse cells on either side.
const ROOM: usize = RUN + 8;
/// Coarse columns around them, at every second pixel.
const COLUMNS: usize = RUN / 2 + 2;

/// A coarse picture of what is taken (r, g, b) and the inverse depth (a; 0: nothing there), and its rays.
#[derive(Clone, Copy)]
pub struct Coarse<'a> {
    /// Row by row.
    pub pixels: &'a [[f32; 4]],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The rays through its pixels.
    pub rays: &'a Rays,
    /// Every so many pixels of the fine picture: 1, 2 or 4.
    pub step: usize,
}

/// A plane as the camera sees it.
#[derive(Clone, Copy)]
pub struct SeenPlane {
    /// Unit normal, camera frame.
    pub normal_camera: Vec3,
    /// n.(p - eye) of its points p.
    pub to_plane: f32,
}

impl Coarse<'_> {
    /// Numerator and denominator of the inverse depth that a plane has at a coarse pixel.
    #[inline(always)]
    fn inverse_depth(&self, plane: &SeenPlane, i: usize) -> [f32; 2] {
        let ray = self.rays.centre(i);
        [plane.normal_camera.dot(ray), ray.z * plane.to_plane]
    }

    /// What is taken at column x, row y of the fine picture on a plane; `None` where no coarse neighbour is on it.
    pub fn at(&self, plane: &SeenPlane, x: usize, y: usize) -> Option<[f32; 3]> {
        if self.step == 1 {
            let [r, g, b, _] = *self.pixels.get(y * self.width + x)?;
            return Some([r, g, b]);
        }
        let at = [x, y].map(|p| (p as f32 + 0.5) / self.step as f32);
        carried_up(self.pixels, self.width, self.height, at, |i| self.inverse_depth(plane, i))
    }

    /// [`Coarse::at`] for `count` pixels (at most [`RUN`]) from column x on, channel by channel; false where one of them has
    /// no neighbour on the plane. `out` beyond `count` is 0.
    pub fn run(
        &self,
        plane: &SeenPlane,
        x: usize,
        y: usize,
        count: usize,
        out: &mut [[f32; RUN]; 3],
    ) -> bool {
        *out = [[0.0; RUN]; 3];
        let count = count.min(RUN);
        match self.step {
            1 => {
                let row = self.pixels.get(y * self.width + x..).unwrap_or(&[]);
                for (i, pixel) in row.iter().take(count).enumerate() {
                    (0..3).for_each(|c| out[c][i] = pixel[c]);
                }
                row.len() >= count
            }
            2 => widest(
                #[inline(always)]
                || self.cells::<2>(plane, x, y, count, out),
            ),
            4 => widest(
                #[inline(always)]
                || self.cells::<4>(plane, x, y, count, out),
            ),
            _ => false,
        }
    }

    /// S pixels lie between two coarse centres: all have the same four neighbours, and weights that are the same in each
    /// cell and sum to 1 exactly.
    #[inline(always)]
    fn cells<const S: usize>(
        &self,
        plane: &SeenPlane,
        x: usize,
        y: usize,
        count: usize,
        out: &mut [[f32; RUN]; 3],
    ) -> bool {
        if self.pixels.len() < self.width * self.height || self.width == 0 || self.height == 0 {
            return false;
        }
        let cell = |p: usize| ((p + S / 2) / S, (p + S / 2) % S);
        // One more than the coarse pixel to the left (above), which may be -1.
        let ((left, skip), (top, down)) = (cell(x), cell(y));
        let cells = (skip + count).div_ceil(S);
        let part = |p: usize| (p as f32 + 0.5) / S as f32;
        let fy = part(down);
        let weights: [[f32; S]; 4] = {
            let of = |x: fn(f32) -> f32, y: f32| std::array::from_fn(|p| x(part(p)) * y);
            [of(|f| 1.0 - f, 1.0 - fy), of(|f| f, 1.0 - fy), of(|f| 1.0 - f, fy), of(|f| f, fy)]
        };
        let mut corners = [[[0.0f32; 4]; COLUMNS]; 2];
        let mut on_plane = [[false; COLUMNS]; 2];
        for row in 0..2 {
            let start = (top + row).saturating_sub(1).min(self.height - 1) * self.width;
            for j in 0..=cells.min(COLUMNS - 1) {
                let i = start + (left + j).saturating_sub(1).min(self.width - 1);
                corners[row][j] = self.pixels[i];
                on_plane[row][j] = is_same_surface(self.pixels[i][3], self.inverse_depth(plane, i));
            }
        }
        let mut taken = [[0.0f32; ROOM]; 3];
        for j in 0..cells.min(COLUMNS - 1) {
            let four = [corners[0][j], corners[0][j + 1], corners[1][j], corners[1][j + 1]];
            let on = [on_plane[0][j], on_plane[0][j + 1], on_plane[1][j], on_plane[1][j + 1]];
            if on == [true; 4] {
                for c in 0..3 {
                    for p in 0..S {
                        let mut sum = weights[0][p] * four[0][c];
                        for k in 1..4 {
                            sum += weights[k][p] * four[k][c];
                        }
                        taken[c][j * S + p] = sum;
                    }
                }
                continue;
            }
            for p in 0..S {
                let (mut sum, mut all) = ([0.0f32; 3], 0.0f32);
                for k in (0..4).filter(|&k| on[k]) {
                    sum = std::array::from_fn(|c| sum[c] + weights[k][p] * four[k][c]);
                    all += weights[k][p];
                }
                if !(all > 1e-3) {
                    let wanted = skip..skip + count;
                    if wanted.contains(&(j * S + p)) {
                        return false;
                    }
                }
                (0..3).for_each(|c| taken[c][j * S + p] = sum[c] / all);
            }
        }
        for (out, taken) in out.iter_mut().zip(&taken) {
            out[..count].copy_from_slice(&taken[skip..skip + count]);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::soft_shadow::SAME_SURFACE;
    use crate::math::lens::Lens;

    /// Repeatable numbers in [0, 1).
    fn number(i: usize) -> f32 {
        ((i * 2_654_435_761 + 12_345) >> 5 & 0xffff) as f32 / 65_536.0
    }

    #[test]
    fn neighbours_get_what_each_gets_by_itself() {
        let (width, height) = (75, 22);
        let plane = SeenPlane { normal_camera: Vec3::new(0.1, -0.7, -0.5).normalize(), to_plane: -1.3 };
        let (mut whole, mut refused) = (0, 0);
        for step in [1, 2, 4] {
            let lens = Lens::pinhole(
                (width as u32).div_ceil(step as u32),
                (height as u32).div_ceil(step as u32),
                60.0 / step as f64,
                60.0 / step as f64,
                37.0 / step as f64,
                11.0 / step as f64,
            );
            let mut rays = Rays::default();
            rays.update(&lens, 1);
            let (columns, rows) = (rays.width(), rays.height());
            let mut pixels = vec![[0.0; 4]; columns * rows];
            let coarse = Coarse { pixels: &[], width: columns, height: rows, rays: &rays, step };
            for (i, pixel) in pixels.iter_mut().enumerate() {
                let [above, below] = coarse.inverse_depth(&plane, i);
                // Patches of another surface, of nothing, and depths that are just about the plane's.
                let other = match (i / 7) % 11 {
                    3 => 1.0 + 1.5 * SAME_SURFACE,
                    5 | 6 => 0.0,
                    _ => 1.0 + SAME_SURFACE * (number(i) - 0.5),
                };
                *pixel = [number(i + 1), number(i + 2) - 0.1, number(i + 3), above / below * other];
            }
            let coarse = Coarse { pixels: &pixels, ..coarse };
            for y in 0..height {
                for (x, count) in (0..width).flat_map(|x| [1, 5, RUN].map(|n| (x, n.min(width - x)))) {
                    let mut taken = [[9.0; RUN]; 3];
                    let done = coarse.run(&plane, x, y, count, &mut taken);
                    let each: Vec<_> = (x..x + count).map(|x| coarse.at(&plane, x, y)).collect();
                    assert_eq!(done, each.iter().all(Option::is_some), "step {step}: {x} {y} {count}");
                    if !done {
                        refused += 1;
                        continue;
                    }
                    whole += 1;
                    for (i, one) in each.iter().enumerate() {
                        assert_eq!(taken.map(|c| c[i]), one.unwrap(), "step {step}: {x} {y} {count}");
                    }
                    assert!(taken.iter().all(|c| c[count..].iter().all(|t| *t == 0.0)));
                }
            }
        }
        assert!(whole > 1000 && refused > 100, "{whole} {refused}");
    }
}
