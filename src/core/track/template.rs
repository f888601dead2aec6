//! A whole tag36h11 tag as a picture: which cells are white, where a homography puts them, how a blur spreads them.

use super::normal;
use super::tag_pose::homography_from_square;
use glam::{DMat3, DVec2, DVec3};

/// Masks: the white of cells and rim, and what lies beyond the rim on each of the four sides. Black is what is left.
pub const MASKS: usize = 5;
/// Variance of a pixel's own box, square pixels.
const BOX: f64 = 1.0 / 12.0;
/// A blurred border is felt up to this many of its standard deviations away.
const FELT: f64 = 4.0;
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

    /// Returns whether a column and a row of cells are white, the rim being 1 and 10, and what lies beyond 0 and 11 (white, too).
    fn is_light(self, column: usize, row: usize) -> bool {
        let inner = 2..10;
        !(inner.contains(&column) && inner.contains(&row)) || self.is_white(column - 2, row - 2)
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
    /// Where the middle of each pixel lies on the tag, row by row.
    pub places: Vec<[f32; 2]>,
    /// The share of all that is not black, and of what it was drawn; then the same blurred.
    sharp: Vec<f32>,
    sharp_of: Option<(Cells, [DVec2; 4], TagPatch)>,
    light: Vec<f32>,
    rows: Vec<f32>,
    kernel: Vec<f32>,
    /// Blurs of the rim's four borders where the black square is -1..1: right, left, lower, upper.
    rim: [f64; 4],
}

impl Template {
    /// Where the pixels of a patch lie on a tag, without drawing it. `None` for corners that are no proper quadrangle.
    pub fn lay(&mut self, corners_px: &[DVec2; 4], patch: &TagPatch) -> Option<()> {
        let tag_from_pixel = homography_from_square(corners_px)?.inverse();
        self.places.clear();
        self.sharp_of = None;
        for y in 0..patch.height {
            for x in 0..patch.width {
                let p = patch.middle_of(x, y);
                let q = tag_from_pixel * DVec3::new(p.x, p.y, 1.0);
                self.places.push([(q.x / q.z) as f32, (q.y / q.z) as f32]);
            }
        }
        Some(())
    }

    /// Draws a tag into a patch, each pixel the mean over its area, then blurred by a Gaussian of `blur_px`. `None`
    /// for corners that are no proper quadrangle.
    pub fn draw(
        &mut self,
        cells: Cells,
        corners_px: &[DVec2; 4],
        blur_px: f64,
        patch: &TagPatch,
    ) -> Option<()> {
        let pixel_from_tag = homography_from_square(corners_px)?;
        let tag_from_pixel = pixel_from_tag.inverse();
        // Another blur of the same tag needs no other drawing.
        let what = Some((cells, *corners_px, *patch));
        if self.sharp_of != what {
            self.draw_sharp(cells, &tag_from_pixel, patch);
            self.sharp_of = what;
        }
        let borders = [(RIM, 0.0), (-RIM, 0.0), (0.0, RIM), (0.0, -RIM)];
        for (slot, (u, v)) in self.rim.iter_mut().zip(borders) {
            let p = pixel_from_tag * DVec3::new(u, v, 1.0);
            let (_, by_x, by_y) = place_of(&tag_from_pixel, DVec2::new(p.x, p.y) / p.z);
            let across = if v == 0.0 { by_x.x.hypot(by_y.x) } else { by_x.y.hypot(by_y.y) };
            *slot = across * (blur_px * blur_px + BOX).sqrt();
        }
        self.blur(blur_px, patch);
        Some(())
    }

    fn draw_sharp(&mut self, cells: Cells, tag_from_pixel: &DMat3, patch: &TagPatch) {
        self.sharp.clear();
        self.places.clear();
        for y in 0..patch.height {
            for x in 0..patch.width {
                let (place, by_x, by_y) = place_of(tag_from_pixel, patch.middle_of(x, y));
                self.places.push([place.x as f32, place.y as f32]);
                // Nothing is black beyond the square.
                let outside = (place.abs() - 0.5 * (by_x + by_y)).max_element() > 1.0;
                self.sharp.push(if outside {
                    1.0
                } else {
                    let columns = Bands::of(place.x, by_x.x, by_y.x);
                    light_share(cells, &columns, &Bands::of(place.y, by_x.y, by_y.y))
                });
            }
        }
    }

    /// The shares of the masks at a pixel. The borders of the rim are straight: what lies beyond follows from the distance.
    pub fn shares(&self, at: usize) -> [f32; MASKS] {
        let [u, v] = self.places[at].map(f64::from);
        let mut shares = [self.light[at], 0.0, 0.0, 0.0, 0.0];
        if u.abs().max(v.abs()) < RIM - FELT * self.rim.iter().fold(0.0, |m: f64, w| m.max(*w)) {
            return shares;
        }
        let past = |t: f64, width: f64| {
            let z = (t - RIM) / width;
            if z.abs() > FELT { f64::from(z > 0.0) } else { 0.5 + 0.5 * normal::within(z.abs()).copysign(z) }
        };
        let [right, left, lower, upper] = self.rim;
        let (right, left) = (past(u, right), past(-u, left));
        let between = (1.0 - right - left).max(0.0);
        let beyond = [right, left, between * past(v, lower), between * past(-v, upper)];
        for (share, beyond) in shares[1..].iter_mut().zip(beyond) {
            *share = beyond as f32;
        }
        shares[0] = (shares[0] - beyond.iter().sum::<f64>() as f32).max(0.0);
        shares
    }

    /// A Gaussian along rows, then along columns; what lies outside the patch repeats its border.
    fn blur(&mut self, blur_px: f64, patch: &TagPatch) {
        let half = (3.5 * blur_px).ceil() as usize;
        self.kernel.clear();
        self.kernel.extend((0..=half).map(|k| (-0.5 * (k as f64 / blur_px).powi(2)).exp() as f32));
        let sum = 2.0 * self.kernel.iter().sum::<f32>() - self.kernel[0];
        self.kernel.iter_mut().for_each(|w| *w /= sum);
        let (width, height) = (patch.width, patch.height);
        self.rows.resize(width * height, 0.0);
        self.light.resize(width * height, 0.0);
        for (to, from) in self.rows.chunks_exact_mut(width).zip(self.sharp.chunks_exact(width)) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = self.kernel[0] * from;
            }
            for (k, weight) in self.kernel.iter().enumerate().skip(1) {
                let inside = width.saturating_sub(k);
                let (first, last) = (from[0], from[width - 1]);
                // Neighbours on the left, then on the right.
                to[..width - inside].iter_mut().for_each(|t| *t += weight * first);
                to[width - inside..].iter_mut().zip(from).for_each(|(t, f)| *t += weight * f);
                to[..inside].iter_mut().zip(&from[width - inside..]).for_each(|(t, f)| *t += weight * f);
                to[inside..].iter_mut().for_each(|t| *t += weight * last);
            }
        }
        for (y, to) in self.light.chunks_exact_mut(width).enumerate() {
            let row = |y: usize| &self.rows[y * width..(y + 1) * width];
            for (to, from) in to.iter_mut().zip(row(y)) {
                *to = self.kernel[0] * from;
            }
            for (k, weight) in self.kernel.iter().enumerate().skip(1) {
                let (above, below) = (row(y.saturating_sub(k)), row((y + k).min(height - 1)));
                for ((to, a), b) in to.iter_mut().zip(above).zip(below) {
                    *to += weight * (a + b);
                }
            }
        }
    }
}

/// Where a pixel lies on the tag, and by how much (without sign) that changes over its width and its height.
fn place_of(tag_from_pixel: &DMat3, p: DVec2) -> (DVec2, DVec2, DVec2) {
    let q = *tag_from_pixel * DVec3::new(p.x, p.y, 1.0);
    let place = DVec2::new(q.x, q.y) / q.z;
    let slope = |column: DVec3| (DVec2::new(column.x, column.y) - place * column.z).abs() / q.z.abs();
    (place, slope(tag_from_pixel.x_axis), slope(tag_from_pixel.y_axis))
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
        let band = |t: f64| ((t + RIM) * 4.0 + 1.0).clamp(0.0, 11.0);
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

/// The share of one pixel that is not black, taking columns and rows as independent (they are but for the cells' own
/// corners).
fn light_share(cells: Cells, columns: &Bands, rows: &Bands) -> f32 {
    let mut share = 0.0;
    for (row, height) in rows.iter() {
        for (column, width) in columns.iter() {
            if cells.is_light(column, row) {
                share += width * height;
            }
        }
    }
    share as f32
}
