//! A whole tag36h11 tag as a picture: which cells are white, where a homography puts them, how a blur spreads them.

use super::tag_pose::homography_from_square;
use glam::{DVec2, DVec3};

/// Masks: the white of cells and rim, and what lies beyond the rim on each of the four sides. Black is what is left.
pub const MASKS: usize = 5;
/// The rim's outer border where the black square is -1..1: one cell beyond it.
pub const RIM: f64 = 1.25;
/// Columns, or rows, of cells with the rim, and one beyond on either side.
const BANDS: usize = 12;

/// White cells of the square, a bit each: column + 8 row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cells(u64);

impl Cells {
    /// Whether a cell (0..8 each way within the black square) is white.
    pub fn is_white(self, column: usize, row: usize) -> bool {
        self.0 >> (column + 8 * row) & 1 == 1
    }

    /// Makes a black cell white, or a white one black.
    pub fn flip(&mut self, column: usize, row: usize) {
        self.0 ^= 1 << (column + 8 * row);
    }

    /// The mask of a column and a row of cells, the rim being 1 and 10, and what lies beyond 0 and 11; `None` for black.
    fn mask_of(self, column: usize, row: usize) -> Option<usize> {
        match (column, row) {
            (11, _) => Some(1),
            (0, _) => Some(2),
            (_, 11) => Some(3),
            (_, 0) => Some(4),
            (1 | 10, _) | (_, 1 | 10) => Some(0),
            _ => self.is_white(column - 2, row - 2).then_some(0),
        }
    }
}

/// A rectangle of pixels in which a tag is drawn: the pixel (x, y) of it is the picture's (left + x, top + y).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TagPatch {
    /// First column; may lie outside the picture.
    pub left: i32,
    /// First row.
    pub top: i32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl TagPatch {
    /// The pixels around a tag with its rim and `margin_px` more. `None` for corners that are no proper quadrangle.
    pub fn around(corners_px: &[DVec2; 4], margin_px: f64) -> Option<Self> {
        let homography = homography_from_square(corners_px)?;
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for (x, y) in [(-RIM, -RIM), (RIM, -RIM), (RIM, RIM), (-RIM, RIM)] {
            let p = homography * DVec3::new(x, y, 1.0);
            // A rim beyond the horizon is no picture of a tag.
            if p.z <= 0.0 {
                return None;
            }
            let p = DVec2::new(p.x / p.z, p.y / p.z);
            (low, high) = (low.min(p), high.max(p));
        }
        let (low, high) = ((low - margin_px).floor(), (high + margin_px).ceil());
        let size = high - low;
        if !(low.abs().max_element() < 1e6 && size.max_element() < 1e6) {
            return None;
        }
        Some(Self { left: low.x as i32, top: low.y as i32, width: size.x as usize, height: size.y as usize })
    }

    /// The middle of a pixel of it, in the picture's continuous pixels.
    pub fn middle_of(&self, x: usize, y: usize) -> DVec2 {
        DVec2::new(f64::from(self.left) + x as f64 + 0.5, f64::from(self.top) + y as f64 + 0.5)
    }
}

/// A drawn tag: for every pixel of its patch the share of each mask, blurred. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Template {
    /// Shares, pixel by pixel, row by row.
    pub shares: Vec<[f32; MASKS]>,
    /// Where the middle of each pixel lies on the tag.
    pub places: Vec<[f32; 2]>,
    rows: Vec<[f32; MASKS]>,
    kernel: Vec<f32>,
}

impl Template {
    /// Draws a tag into a patch, each pixel the mean over its area, then blurred by a Gaussian of `blur_px`. `None`
    /// for corners that are no proper quadrangle.
    pub fn draw(
        &mut self,
        cells: Cells,
        corners_px: &[DVec2; 4],
        blur_px: f64,
        patch: &TagPatch,
    ) -> Option<()> {
        let tag_from_pixel = homography_from_square(corners_px)?.inverse();
        self.shares.clear();
        self.places.clear();
        for y in 0..patch.height {
            for x in 0..patch.width {
                let p = patch.middle_of(x, y);
                let q = tag_from_pixel * DVec3::new(p.x, p.y, 1.0);
                let (u, v) = (q.x / q.z, q.y / q.z);
                let slope = |column: DVec3| {
                    DVec2::new(column.x - u * column.z, column.y - v * column.z).abs() / q.z.abs()
                };
                let (by_x, by_y) = (slope(tag_from_pixel.x_axis), slope(tag_from_pixel.y_axis));
                self.places.push([u as f32, v as f32]);
                let columns = Bands::of(u, by_x.x, by_y.x);
                self.shares.push(shares_of(cells, &columns, &Bands::of(v, by_x.y, by_y.y)));
            }
        }
        self.blur(blur_px, patch);
        Some(())
    }

    /// A Gaussian along rows, then along columns; what lies outside the patch repeats its border.
    fn blur(&mut self, blur_px: f64, patch: &TagPatch) {
        let half = (3.5 * blur_px).ceil() as usize;
        self.kernel.clear();
        self.kernel.extend((0..=half).map(|k| (-0.5 * (k as f64 / blur_px).powi(2)).exp() as f32));
        let sum = 2.0 * self.kernel.iter().sum::<f32>() - self.kernel[0];
        self.kernel.iter_mut().for_each(|w| *w /= sum);
        let (width, height) = (patch.width, patch.height);
        self.rows.clear();
        self.rows.resize(width * height, [0.0; MASKS]);
        let spread =
            |from: &[[f32; MASKS]], to: &mut [[f32; MASKS]], along: usize, step: usize, at: usize| {
                let position = at / step % along;
                let base = at - position * step;
                let mut sum = from[at].map(|v| v * self.kernel[0]);
                for (k, weight) in self.kernel.iter().enumerate().skip(1) {
                    let before = &from[base + position.saturating_sub(k) * step];
                    let after = &from[base + (position + k).min(along - 1) * step];
                    for (sum, (b, a)) in sum.iter_mut().zip(before.iter().zip(after)) {
                        *sum += weight * (b + a);
                    }
                }
                to[at] = sum;
            };
        for at in 0..width * height {
            spread(&self.shares, &mut self.rows, width, 1, at);
        }
        for at in 0..width * height {
            spread(&self.rows, &mut self.shares, height, width, at);
        }
    }
}

/// The shares of one pixel in neighbouring columns (or rows) of cells.
struct Bands {
    first: usize,
    count: usize,
    shares: [f64; BANDS],
}

impl Bands {
    /// For a pixel with its middle at `t` (the black square is -1..1), over whose width and height `t` changes by
    /// `a` and `b`: exact for straight borders.
    fn of(t: f64, a: f64, b: f64) -> Self {
        let reach = 0.5 * (a + b);
        let band = |t: f64| ((t + RIM) * 4.0).floor().clamp(-1.0, 10.0) + 1.0;
        let (first, last) = (band(t - reach) as usize, band(t + reach) as usize);
        let mut shares = [0.0; BANDS];
        if first == last {
            shares[0] = 1.0;
            return Self { first, count: 1, shares };
        }
        let mut below = 0.0;
        for (k, share) in shares[..=last - first].iter_mut().enumerate() {
            let border = (first + k) as f64 / 4.0 - RIM;
            let up_to = if first + k == last { 1.0 } else { share_below(border - t, a, b) };
            *share = up_to - below;
            below = up_to;
        }
        Self { first, count: last - first + 1, shares }
    }

    fn iter(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.shares[..self.count].iter().enumerate().map(|(k, share)| (self.first + k, *share))
    }
}

/// Share of a pixel below `t` from its middle, where its width spreads over `a` and its height over `b`: the integral of
/// two boxes folded, a sum of four parabolas.
fn share_below(t: f64, a: f64, b: f64) -> f64 {
    let (wide, narrow) = (0.5 * a.max(b), 0.5 * a.min(b));
    // Two boxes, one of which is a needle, are one.
    let narrow = narrow.max(1e-4 * wide);
    let ramp = |x: f64| x.max(0.0).powi(2);
    let sum =
        ramp(t + wide + narrow) - ramp(t + wide - narrow) - ramp(t - wide + narrow) + ramp(t - wide - narrow);
    (sum / (8.0 * wide * narrow)).clamp(0.0, 1.0)
}

/// Shares of one pixel, taking columns and rows as independent (they are but for the cells' own corners).
fn shares_of(cells: Cells, columns: &Bands, rows: &Bands) -> [f32; MASKS] {
    let mut shares = [0.0; MASKS];
    for (row, height) in rows.iter() {
        for (column, width) in columns.iter() {
            if let Some(mask) = cells.mask_of(column, row) {
                shares[mask] += (width * height) as f32;
            }
        }
    }
    shares
}
