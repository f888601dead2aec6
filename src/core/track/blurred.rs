//! Corners of a tag out of focus: a drawing of the whole tag, blurred, is laid over the picture until both agree.
//!
//! Where the blur is wider than the border, no profile across an edge reaches the levels on its sides, and
//! `edges` has nothing to measure against. Here all edges of the tag are fitted at once: eight coordinates of the corners,
//! the blur's own width, and the levels of black, white and what lies beyond the rim. Light mixes in linear light;
//! the residuals are counted in the picture's own 8-bit values, in which noise is about even.

use super::edges::{RefinedCorners, area_share};
use super::normal;
use super::tag_pose::homography_from_square;
use super::template::{Cells, MASKS, RIM, TagPatch, Template};
use crate::math::solve::solve_positive;
use crate::model::image::Image;
use glam::{DMat3, DVec2, DVec3};

/// Unknowns: eight coordinates, the logarithm of the blur, three of white and three of black (level and slopes along
/// the tag), one beyond each side of the rim.
const UNKNOWNS: usize = 19;
/// Where the levels begin among them.
const LEVELS: usize = 9;
/// Steps at most; six suffice.
const STEPS: usize = 15;
/// Times that cells are read anew before the corners move.
const MENDINGS: usize = 6;
/// Steps below this end the search, pixels.
const SETTLED_PX: f64 = 0.002;
/// Blurs that are tried at first, pixels of the patch.
const FIRST_BLURS_PX: [f64; 3] = [0.6, 1.5, 3.0];
/// Blurs within these are followed, pixels of the patch.
const BLURS_PX: (f64, f64) = (0.25, 8.0);
/// Pixels beyond this are left out, as what lies beyond the rim need not be of one level (the black square is -1..1).
const SEEN: f64 = 1.2;
/// Residuals beyond this many of their standard deviations count no more than one at it.
const HUBER: f64 = 3.0;
/// Least difference of white and black, 8-bit values.
const LEAST_CONTRAST: f64 = 6.0;
/// A tag larger than this is drawn from a picture reduced by a whole factor, pixels of the patch's side.
const LARGEST_PX: f64 = 110.0;
/// Patches above this are refused, pixels each way.
const PATCH_LIMIT_PX: usize = 400;
/// What even a perfect fit may be wrong by, measured on drawn tags without noise, pixels of the patch: with any blur,
/// and what is added without one, as sharp edges show how pixels are drawn.
const FLOOR_PX: (f64, f64) = (0.0015, 0.006);
/// From this share of a square's area on (over that of its longest side), and by how much more for each share below,
/// errors are larger than the residuals tell: cells seen from the side are narrow. Measured on drawn tags.
const OBLIQUE: (f64, f64) = (0.6, 1.7);

/// Memory of the fit, reused from tag to tag.
#[derive(Clone, Debug, Default)]
pub struct BlurredScratch {
    template: Template,
    pixels: Vec<Seen>,
    light: Vec<f32>,
}

/// A pixel that takes part.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// In the patch.
    at: u32,
    /// Its value as encoded, 0..=255.
    value: f32,
}

/// The picture's own curve, both ways.
struct Curve<'a>(&'a [f32; 256]);

impl Curve<'_> {
    /// Value and slope (values for a unit of light) of some light; clipped as the camera clips.
    fn encode(&self, light: f64) -> (f64, f64) {
        let table = self.0;
        let light = light as f32;
        let after = table.partition_point(|t| *t <= light);
        if after >= 256 {
            return (255.0, 0.0);
        }
        let low = after.max(1) - 1;
        let step = f64::from(table[low + 1] - table[low]);
        let value = low as f64 + f64::from(light - table[low]) / step;
        // Over two steps: one alone makes the slope jump.
        let (from, to) = (low.saturating_sub(1), (low + 2).min(255));
        let slope = (to - from) as f64 / f64::from(table[to] - table[from]);
        (value.max(0.0), slope)
    }
}

/// The unknowns as they stand.
#[derive(Clone, Copy, Debug)]
struct Guess {
    corners_px: [DVec2; 4],
    blur_px: f64,
    levels: [f64; UNKNOWNS - LEVELS],
}

impl Guess {
    fn moved(&self, step: &[f64; UNKNOWNS]) -> Self {
        let mut next = *self;
        for (i, corner) in next.corners_px.iter_mut().enumerate() {
            *corner += DVec2::new(step[2 * i], step[2 * i + 1]);
        }
        next.blur_px = (self.blur_px * step[8].clamp(-0.7, 0.7).exp()).clamp(BLURS_PX.0, BLURS_PX.1);
        for (level, step) in next.levels.iter_mut().zip(&step[LEVELS..]) {
            *level += step;
        }
        next
    }
}

/// What each level weighs in a pixel's light.
fn weights(shares: &[f32; MASKS], [u, v]: [f32; 2]) -> [f64; UNKNOWNS - LEVELS] {
    let (white, u, v) = (f64::from(shares[0]), f64::from(u), f64::from(v));
    let beyond = [1, 2, 3, 4].map(|i| f64::from(shares[i]));
    let black = 1.0 - white - beyond.iter().sum::<f64>();
    let [a, b, c, d] = beyond;
    [white, white * u, white * v, black, black * u, black * v, a, b, c, d]
}

/// Sums of one step of Gauss and Newton.
struct Normal {
    matrix: [[f64; UNKNOWNS]; UNKNOWNS],
    right: [f64; UNKNOWNS],
    /// Sum of the residuals' costs, squared 8-bit values.
    cost: f64,
}

/// One fit.
struct Fit<'a> {
    curve: Curve<'a>,
    patch: TagPatch,
    cells: Cells,
    scratch: &'a mut BlurredScratch,
    /// Standard deviation of a residual, 8-bit values.
    noise: f64,
}

/// Fits a tag36h11 tag's corners, starting from `corners_px`. `blur_px` is about how wide its edges are (a large tag that is
/// blurred is measured in a reduced picture). `None` where the picture does not look like that tag, blurred.
pub fn refine_blurred(
    gray: &Image<u8>,
    linear_of_value: &[f32; 256],
    corners_px: &[DVec2; 4],
    blur_px: f64,
    scratch: &mut BlurredScratch,
) -> Option<RefinedCorners> {
    if !linear_of_value.windows(2).all(|w| w[0] < w[1]) || !corners_px.iter().all(|c| c.is_finite()) {
        return None;
    }
    let side = (0..4).map(|i| corners_px[i].distance(corners_px[(i + 1) % 4])).fold(0.0, f64::max);
    // A reduced picture still has to show the edges' shape.
    let factor = (side / LARGEST_PX).ceil().min((blur_px / 0.6).floor()).clamp(1.0, 8.0);
    let start = corners_px.map(|c| c / factor);
    let margin = 3.5 * 2.0f64.max(blur_px / factor) + 2.0;
    let patch = TagPatch::around(&start, margin)?;
    if patch.width > PATCH_LIMIT_PX || patch.height > PATCH_LIMIT_PX {
        return None;
    }
    let curve = Curve(linear_of_value);
    let mut fit = Fit { curve, patch, cells: Cells::default(), scratch, noise: f64::INFINITY };
    fit.gather(gray, &start, factor as usize)?;
    let guess = fit.first_guess(&start)?;
    let (guess, sigma_px) = fit.settle(guess)?;
    let cell_px = side / 8.0;
    let moved = (0..4).map(|i| (guess.corners_px[i] * factor).distance(corners_px[i])).fold(0.0, f64::max);
    let narrow = (OBLIQUE.0 - area_share(&guess.corners_px)).max(0.0);
    let sigma_px = sigma_px * factor * (1.0 + OBLIQUE.1 * narrow);
    if moved > cell_px + 1.0 || sigma_px > cell_px {
        return None;
    }
    let corners_px = guess.corners_px.map(|c| c * factor);
    Some(RefinedCorners { corners_px, sigma_px, width_px: guess.blur_px * factor, seen_whole: true })
}

impl Fit<'_> {
    /// Lists the pixels that show the tag, each the mean of `factor` x `factor` of the picture's in linear light.
    fn gather(&mut self, gray: &Image<u8>, corners_px: &[DVec2; 4], factor: usize) -> Option<()> {
        let scratch = &mut *self.scratch;
        scratch.template.draw(self.cells, corners_px, BLURS_PX.0, &self.patch)?;
        scratch.pixels.clear();
        let (columns, rows) = (gray.width() / factor, gray.height() / factor);
        for (at, [u, v]) in scratch.template.places.iter().enumerate() {
            let x = i64::from(self.patch.left) + (at % self.patch.width) as i64;
            let y = i64::from(self.patch.top) + (at / self.patch.width) as i64;
            let inside = (0..columns as i64).contains(&x) && (0..rows as i64).contains(&y);
            if !inside || f64::from(u.abs().max(v.abs())) > SEEN {
                continue;
            }
            let (x, y) = (x as usize * factor, y as usize * factor);
            let value = if factor == 1 {
                f32::from(*gray.at(x, y))
            } else {
                let mut light = 0.0;
                for j in 0..factor {
                    for i in 0..factor {
                        light += f64::from(self.curve.0[usize::from(*gray.at(x + i, y + j))]);
                    }
                }
                self.curve.encode(light / (factor * factor) as f64).0 as f32
            };
            scratch.pixels.push(Seen { at: at as u32, value });
        }
        (scratch.pixels.len() > 4 * UNKNOWNS).then_some(())
    }

    /// Cells and blur that explain the picture best with the corners as given.
    fn first_guess(&mut self, corners_px: &[DVec2; 4]) -> Option<Guess> {
        let mut best: Option<(f64, Guess, Cells)> = None;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for seen in &self.scratch.pixels {
            let light = self.curve.0[seen.value.round() as usize];
            (low, high) = (low.min(light), high.max(light));
        }
        let (low, high) = (f64::from(low), f64::from(high));
        for blur_px in FIRST_BLURS_PX {
            self.cells = self.cells_by_threshold(low + 0.5 * (high - low));
            let mut levels = [0.0; UNKNOWNS - LEVELS];
            (levels[0], levels[3]) = (high, low);
            levels[6..].fill(0.5 * (low + high));
            let mut guess = Guess { corners_px: *corners_px, blur_px, levels };
            for _ in 0..MENDINGS {
                guess = self.step(&guess, true, 1e-6)?.0;
                if !self.mend_cells(&guess) {
                    break;
                }
            }
            let cost = self.step(&guess, true, 1e-6)?.1;
            if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                best = Some((cost, guess, self.cells));
            }
        }
        let (_, guess, cells) = best?;
        self.cells = cells;
        Some(guess)
    }

    /// The cells whose middles are brighter than a level of light.
    fn cells_by_threshold(&self, level: f64) -> Cells {
        let mut sums = [[(0.0, 0u32); 6]; 6];
        for seen in &self.scratch.pixels {
            if let Some((column, row)) = self.inner_cell(seen.at as usize) {
                let light = f64::from(self.curve.0[seen.value.round() as usize]);
                sums[row][column].0 += light;
                sums[row][column].1 += 1;
            }
        }
        let mut cells = Cells::default();
        for (row, line) in sums.iter().enumerate() {
            for (column, &(sum, count)) in line.iter().enumerate() {
                if count > 0 && sum / f64::from(count) > level {
                    cells.flip(column + 1, row + 1);
                }
            }
        }
        cells
    }

    /// The cell of the code (0..6 each way) in whose middle half a pixel lies.
    fn inner_cell(&self, at: usize) -> Option<(usize, usize)> {
        let [u, v] = self.scratch.template.places[at].map(|t| (f64::from(t) + 1.0) * 4.0 - 1.0);
        let middle = |t: f64| (0.0..6.0).contains(&t) && (t.fract() - 0.5).abs() < 0.3;
        (middle(u) && middle(v)).then_some((u as usize, v as usize))
    }

    /// Flips the cells whose light the drawing misses by more than half of what a flip would change. Whether any did.
    fn mend_cells(&mut self, guess: &Guess) -> bool {
        let mut sums = [[(0.0, 0u32); 6]; 6];
        for seen in &self.scratch.pixels {
            let at = seen.at as usize;
            if let Some((column, row)) = self.inner_cell(at) {
                let light = f64::from(self.curve.0[seen.value.round() as usize]);
                sums[row][column].0 += light - f64::from(self.scratch.light[at]);
                sums[row][column].1 += 1;
            }
        }
        let kept = self.kept_by_cells(guess) * (guess.levels[0] - guess.levels[3]);
        let missed = sums.map(|line| line.map(|(sum, count)| sum / f64::from(count.max(1)) / kept));
        let mut flipped = false;
        for row in 0..6 {
            for column in 0..6 {
                let miss = missed[row][column];
                let wrong = self.cells.is_white(column + 1, row + 1) == (miss < 0.0) && miss.abs() > 0.5;
                // A wrong cell also spoils its neighbours: only the worst of them is the cause.
                let around = |t: usize| t.saturating_sub(1)..(t + 2).min(6);
                let worst = around(row).flat_map(|r| around(column).map(move |c| (r, c)));
                if wrong && worst.map(|(r, c)| missed[r][c].abs()).fold(0.0, f64::max) <= miss.abs() {
                    self.cells.flip(column + 1, row + 1);
                    flipped = true;
                }
            }
        }
        flipped
    }

    /// What the middle of a cell keeps of its own light under the blur.
    fn kept_by_cells(&self, guess: &Guess) -> f64 {
        let corners = &guess.corners_px;
        let cell = |i: usize, j: usize| {
            let across = corners[i] + corners[j] - corners[(i + 2) % 4] - corners[(j + 2) % 4];
            across.length() / 16.0
        };
        [cell(0, 1), cell(1, 2)].map(|c| normal::within(0.5 * c / guess.blur_px)).iter().product()
    }

    /// Follows the residuals down. The guess and the standard deviation of its corners' coordinates.
    fn settle(&mut self, start: Guess) -> Option<(Guess, f64)> {
        let mut guess = start;
        let mut damping = 1e-3;
        let (mut next, mut cost, mut normal) = self.step(&guess, false, damping)?;
        self.noise = self.deviation(cost);
        let mut settled = false;
        for step in 0..STEPS {
            let moved = (0..4).map(|i| next.corners_px[i].distance(guess.corners_px[i])).fold(0.0, f64::max);
            let tried = self.step(&next, false, damping * 0.1);
            match tried {
                Some((after, lower, sums)) if lower <= cost => {
                    settled = moved < SETTLED_PX;
                    (guess, next, cost, normal) = (next, after, lower, sums);
                    damping = (damping * 0.1f64).max(1e-9);
                    if step % 2 == 1 && !settled {
                        self.noise = self.deviation(cost).max(0.3);
                        self.mend_cells(&guess);
                        (next, cost, normal) = self.step(&guess, false, damping)?;
                    }
                }
                _ => {
                    settled = moved < SETTLED_PX;
                    damping *= 30.0;
                    next = guess.moved(&solved(&normal, damping, false)?);
                }
            }
            if settled {
                break;
            }
        }
        let contrast = self.curve.encode(guess.levels[0]).0 - self.curve.encode(guess.levels[3]).0;
        let deviation = self.deviation(cost);
        if !settled || contrast < LEAST_CONTRAST.max(deviation) {
            return None;
        }
        let floor_px = FLOOR_PX.0 + FLOOR_PX.1 * (-guess.blur_px / 0.5).exp();
        Some((guess, sigma_of(&normal, deviation, floor_px)?))
    }

    /// Standard deviation of a residual at some cost, 8-bit values; not below that of rounding.
    fn deviation(&self, cost: f64) -> f64 {
        (cost / (self.scratch.pixels.len() - UNKNOWNS) as f64).sqrt().max(0.289)
    }

    /// Draws a guess and sums its residuals: the next guess, this one's cost, and the sums.
    fn step(&mut self, guess: &Guess, only_levels: bool, damping: f64) -> Option<(Guess, f64, Normal)> {
        self.draw(guess)?;
        let normal = self.sums(guess)?;
        let next = guess.moved(&solved(&normal, damping, only_levels)?);
        Some((next, normal.cost, normal))
    }

    fn draw(&mut self, guess: &Guess) -> Option<()> {
        let BlurredScratch { template, light, .. } = &mut *self.scratch;
        template.draw(self.cells, &guess.corners_px, guess.blur_px, &self.patch)?;
        light.clear();
        light.extend(template.shares.iter().zip(&template.places).map(|(shares, place)| {
            // Slopes of the levels end with the tag.
            let place = place.map(|t| t.clamp(-RIM as f32, RIM as f32));
            let parts = weights(shares, place);
            parts.iter().zip(&guess.levels).map(|(w, l)| w * l).sum::<f64>() as f32
        }));
        Some(())
    }

    fn sums(&self, guess: &Guess) -> Option<Normal> {
        let mut normal = Normal { matrix: [[0.0; UNKNOWNS]; UNKNOWNS], right: [0.0; UNKNOWNS], cost: 0.0 };
        let pull = CornerPull::of(&guess.corners_px)?;
        let (width, height) = (self.patch.width, self.patch.height);
        let light = |at: usize| f64::from(self.scratch.light[at]);
        for seen in &self.scratch.pixels {
            let at = seen.at as usize;
            let (x, y) = (at % width, at / width);
            if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
                continue;
            }
            let (value, slope) = self.curve.encode(light(at));
            let residual = f64::from(seen.value) - value;
            let size = residual.abs() / self.noise;
            let trust = if size > HUBER { HUBER / size } else { 1.0 };
            normal.cost += trust * residual * residual;
            let gradient =
                DVec2::new(light(at + 1) - light(at - 1), light(at + width) - light(at - width)) / 2.0;
            let bend =
                light(at + 1) + light(at - 1) + light(at + width) + light(at - width) - 4.0 * light(at);
            let mut row = [0.0; UNKNOWNS];
            for (k, pulled) in pull.at(self.patch.middle_of(x, y)).into_iter().enumerate() {
                row[k] = -slope * gradient.dot(pulled);
            }
            // A Gaussian grows by half the Laplacian for each unit of its variance.
            row[8] = slope * guess.blur_px.powi(2) * bend;
            let place = self.scratch.template.places[at].map(|t| t.clamp(-RIM as f32, RIM as f32));
            let parts = weights(&self.scratch.template.shares[at], place);
            for (slot, part) in row[LEVELS..].iter_mut().zip(parts) {
                *slot = slope * part;
            }
            for i in 0..UNKNOWNS {
                let weighted = trust * row[i];
                normal.right[i] += weighted * residual;
                for j in 0..=i {
                    normal.matrix[i][j] += weighted * row[j];
                }
            }
        }
        for i in 0..UNKNOWNS {
            for j in i + 1..UNKNOWNS {
                normal.matrix[i][j] = normal.matrix[j][i];
            }
        }
        normal.cost.is_finite().then_some(normal)
    }
}

/// How a point of the picture moves with each coordinate of the corners.
struct CornerPull {
    tag_from_pixel: DMat3,
    /// From the square -1..1, with each coordinate of the corners moved by [`NUDGE_PX`].
    moved: [DMat3; 8],
}

/// Corners move by this for a difference, pixels.
const NUDGE_PX: f64 = 0.01;

impl CornerPull {
    fn of(corners_px: &[DVec2; 4]) -> Option<Self> {
        let mut moved = [DMat3::IDENTITY; 8];
        for (k, slot) in moved.iter_mut().enumerate() {
            let mut corners = *corners_px;
            corners[k / 2][k % 2] += NUDGE_PX;
            *slot = homography_from_square(&corners)?;
        }
        let tag_from_pixel = homography_from_square(corners_px)?.inverse();
        Some(Self { tag_from_pixel, moved })
    }

    fn at(&self, p: DVec2) -> [DVec2; 8] {
        let place = self.tag_from_pixel * DVec3::new(p.x, p.y, 1.0);
        self.moved.map(|pixel_from_tag| {
            let q = pixel_from_tag * place;
            (DVec2::new(q.x / q.z, q.y / q.z) - p) / NUDGE_PX
        })
    }
}

/// The step of damped normal equations; the levels alone where wanted.
fn solved(normal: &Normal, damping: f64, only_levels: bool) -> Option<[f64; UNKNOWNS]> {
    let mut matrix = normal.matrix;
    let mut right = normal.right;
    let largest = (LEVELS..UNKNOWNS).map(|i| matrix[i][i]).fold(0.0, f64::max);
    for i in 0..UNKNOWNS {
        if only_levels && i < LEVELS {
            matrix[i] = [0.0; UNKNOWNS];
            matrix.iter_mut().for_each(|row| row[i] = 0.0);
            (matrix[i][i], right[i]) = (1.0, 0.0);
        }
        matrix[i][i] *= 1.0 + damping;
        if i >= LEVELS {
            // What lies beyond the rim may be out of sight.
            matrix[i][i] += 1e-7 * largest;
        }
    }
    matrix[8][8] += 1e-9;
    solve_positive(&matrix, right)
}

/// The half width that holds 68.27 % of the errors of the corners' coordinates, from each one's own variance.
fn sigma_of(normal: &Normal, deviation: f64, floor_px: f64) -> Option<f64> {
    let mut variances = [0.0; 8];
    for (i, variance) in variances.iter_mut().enumerate() {
        let mut unit = [0.0; UNKNOWNS];
        unit[i] = 1.0;
        let undamped = Normal { matrix: normal.matrix, right: unit, cost: 0.0 };
        *variance = solved(&undamped, 0.0, false)?[i] * deviation * deviation + floor_px * floor_px;
    }
    Some(normal::half_width(&variances))
}
