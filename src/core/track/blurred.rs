//! Corners of a tag out of focus: a drawing of the whole tag, blurred, is laid over the picture until both agree.
//!
//! Where the blur is wider than the border, no profile across an edge reaches the levels on its sides, and
//! `edges` has nothing to measure against. Here all edges of the tag are fitted at once: eight coordinates of the corners,
//! the blur's own width, and the levels of black, white and what lies beyond the rim. Light mixes in linear light;
//! the residuals are counted in the picture's own 8-bit values, in which noise is about even.
//!
//! What is blurred is seen as well in a smaller picture: the fit begins in one in which cells are a few pixels wide, and
//! ends in the smallest one that still shows the shape of the edges.

use super::edges::{RefinedCorners, area_share};
use super::normal;
use super::template::{Cells, RIM, TagPatch, Template};
use crate::model::image::Image;
use curve::Curve;
use glam::DVec2;
use sums::{CornerPull, FitSums, LEVEL_COUNT, LEVELS, Normal, UNKNOWNS, weights};

mod curve;
mod sums;

/// Steps at most; four suffice.
const STEPS: usize = 15;
/// Times that cells are read anew before the corners move.
const MENDINGS: usize = 6;
/// A step below this is the last, pixels of the patch: what would be left is of second order in it.
const SETTLED_PX: f64 = 0.02;
/// Blurs that are tried at first, pixels of the patch.
const FIRST_BLURS_PX: [f64; 3] = [0.5, 1.2, 2.4];
/// Blurs within these are followed, pixels of the patch.
const BLURS_PX: (f64, f64) = (0.25, 8.0);
/// Pixels beyond this are left out, as what lies beyond the rim need not be of one level (the black square is -1..1).
const SEEN: f64 = 1.2;
/// Residuals beyond this many of their standard deviations count no more than one at it.
const HUBER: f64 = 3.0;
/// Least difference of white and black, 8-bit values.
const LEAST_CONTRAST: f64 = 6.0;
/// In the first picture the tag's shorter way across is about this long, pixels.
const FIRST_PX: f64 = 28.0;
/// In the last one the blur is about this wide, and the tag not shorter than this, pixels.
const LAST_PX: (f64, f64) = (0.8, 16.0);
/// Pictures are reduced by at most this.
const LARGEST_FACTOR: f64 = 16.0;
/// From so many pixels on only a share of them is counted.
const PIXELS: usize = 10_000;
/// Patches above this are refused, pixels each way.
const PATCH_LIMIT_PX: usize = 400;
/// Pixels around the rim: what its borders' shape is told from.
const MARGIN_PX: f64 = 4.0;
/// What even a perfect fit may be wrong by, measured on drawn tags without noise, pixels of the patch: with any blur,
/// and what is added without one, as sharp edges show how pixels are drawn.
const FLOOR_PX: (f64, f64) = (0.0015, 0.006);
/// Below this share of a square's area (over that of its longest side) errors are larger than the residuals tell, as cells seen
/// from the side are narrow: by how much more of sigma, and of the second floor, for each share. Measured on drawn tags.
const OBLIQUE: (f64, f64, f64) = (0.6, 2.0, 8.0);

/// Memory of the fit, reused from tag to tag.
#[derive(Clone, Debug, Default)]
pub struct BlurredScratch {
    curve: Curve,
    template: Template,
    pixels: Vec<Seen>,
    parts: Vec<[f32; LEVEL_COUNT]>,
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

/// The unknowns as they stand.
#[derive(Clone, Copy, Debug)]
struct Guess {
    corners_px: [DVec2; 4],
    blur_px: f64,
    levels: [f64; LEVEL_COUNT],
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

    /// The same in a picture larger by a factor.
    fn scaled(&self, factor: f64) -> Self {
        Self { corners_px: self.corners_px.map(|c| c * factor), blur_px: self.blur_px * factor, ..*self }
    }
}

/// A guess that has settled.
#[derive(Clone, Copy)]
struct Found {
    guess: Guess,
    cells: Cells,
    /// Of the corners' coordinates, pixels of the patch.
    sigma_px: f64,
}

/// One fit.
struct Fit<'a> {
    patch: TagPatch,
    /// How many pixels of the picture, each way, one of the patch is.
    factor: usize,
    cells: Cells,
    scratch: &'a mut BlurredScratch,
    /// Standard deviation of a residual, 8-bit values.
    noise: f64,
}

/// Fits a tag36h11 tag's corners, starting from `corners_px`. `blur_px` is about how wide its edges are.
/// `None` where the picture does not look like that tag, blurred.
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
    scratch.curve.take(linear_of_value);
    let side = (0..4).map(|i| corners_px[i].distance(corners_px[(i + 1) % 4])).fold(0.0, f64::max);
    let shortest = side * area_share(corners_px);
    let whole = |factor: f64| factor.floor().clamp(1.0, LARGEST_FACTOR);
    let last = |blur_px: f64| whole((blur_px / LAST_PX.0).min(shortest / LAST_PX.1));
    let mut factor = whole(shortest / FIRST_PX);
    let first = Fit::of(gray, corners_px, factor, scratch).and_then(|mut fit| fit.begin(corners_px));
    let mut found = match first {
        Some(found) => found,
        None => {
            // In a small picture narrow cells run together.
            factor = last(blur_px).min(factor - 1.0);
            if factor < 1.0 {
                return None;
            }
            Fit::of(gray, corners_px, factor, scratch)?.begin(corners_px)?
        }
    };
    let finer = last(found.guess.blur_px * factor);
    if finer < factor {
        let guess = found.guess.scaled(factor / finer);
        let mut fit = Fit::of(gray, &guess.corners_px.map(|c| c * finer), finer, scratch)?;
        fit.cells = found.cells;
        found = fit.settle(guess)?;
        factor = finer;
    }
    let guess = found.guess.scaled(factor);
    let cell_px = side / 8.0;
    let moved = (0..4).map(|i| guess.corners_px[i].distance(corners_px[i])).fold(0.0, f64::max);
    let sigma_px = found.sigma_px * factor;
    if moved > cell_px + 1.0 || sigma_px > cell_px {
        return None;
    }
    Some(RefinedCorners { corners_px: guess.corners_px, sigma_px, width_px: guess.blur_px, seen_whole: true })
}

impl<'a> Fit<'a> {
    /// Around a tag, in the picture reduced by a whole factor.
    fn of(
        gray: &Image<u8>,
        corners_px: &[DVec2; 4],
        factor: f64,
        scratch: &'a mut BlurredScratch,
    ) -> Option<Self> {
        let patch = TagPatch::around(&corners_px.map(|c| c / factor), MARGIN_PX)?;
        if patch.width > PATCH_LIMIT_PX || patch.height > PATCH_LIMIT_PX {
            return None;
        }
        let factor = factor as usize;
        let mut fit = Self { patch, factor, cells: Cells::default(), scratch, noise: f64::INFINITY };
        fit.gather(gray, &corners_px.map(|c| c / factor as f64))?;
        Some(fit)
    }

    /// Lists the pixels that show the tag, each the mean of `factor` x `factor` of the picture's in linear light.
    fn gather(&mut self, gray: &Image<u8>, corners_px: &[DVec2; 4]) -> Option<()> {
        let (factor, patch) = (self.factor, self.patch);
        let BlurredScratch { curve, template, pixels, .. } = &mut *self.scratch;
        template.lay(corners_px, &patch)?;
        pixels.clear();
        let (columns, rows) = (gray.width() / factor, gray.height() / factor);
        for (at, [u, v]) in template.places.iter().enumerate() {
            let (across, down) = (at % patch.width, at / patch.width);
            // Light is differentiated over two pixels on either side.
            let inner = (2..patch.width - 2).contains(&across) && (2..patch.height - 2).contains(&down);
            let x = i64::from(patch.left) + across as i64;
            let y = i64::from(patch.top) + down as i64;
            let inside = inner && (0..columns as i64).contains(&x) && (0..rows as i64).contains(&y);
            if !inside || f64::from(u.abs().max(v.abs())) > SEEN {
                continue;
            }
            let (x, y) = (x as usize * factor, y as usize * factor);
            let value = if factor == 1 {
                f32::from(*gray.at(x, y))
            } else {
                let rows = (y..y + factor).map(|y| &gray.row(y)[x..x + factor]);
                let light = rows.flatten().map(|value| curve.of(*value)).sum::<f32>();
                curve.encode(light / (factor * factor) as f32).0
            };
            pixels.push(Seen { at: at as u32, value });
        }
        // Any share will do that is not one of columns or rows.
        let share = (pixels.len() / PIXELS + 1) as u32;
        if share > 1 {
            pixels.retain(|seen| (seen.at.wrapping_mul(2_654_435_761) >> 16).is_multiple_of(share));
        }
        (pixels.len() > 4 * UNKNOWNS).then_some(())
    }

    /// From the corners in the picture alone: cells and blur that explain it best, then all at once.
    fn begin(&mut self, corners_px: &[DVec2; 4]) -> Option<Found> {
        let guess = self.first_guess(&corners_px.map(|c| c / self.factor as f64))?;
        self.settle(guess)
    }

    /// Cells and blur that explain the picture best with the corners as given.
    fn first_guess(&mut self, corners_px: &[DVec2; 4]) -> Option<Guess> {
        let mut best: Option<(f64, Guess, Cells)> = None;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for seen in &self.scratch.pixels {
            let light = self.scratch.curve.between(seen.value);
            (low, high) = (low.min(light), high.max(light));
        }
        let (low, high) = (f64::from(low), f64::from(high));
        let cells = self.cells_by_threshold(low + 0.5 * (high - low));
        for blur_px in FIRST_BLURS_PX {
            self.cells = cells;
            let mut levels = [0.0; LEVEL_COUNT];
            (levels[0], levels[3]) = (high, low);
            levels[6..].fill(0.5 * (low + high));
            let mut guess = Guess { corners_px: *corners_px, blur_px, levels };
            for _ in 0..MENDINGS {
                self.draw(&guess)?;
                self.level(&mut guess)?;
                if !self.mend_cells(&guess) {
                    break;
                }
            }
            self.draw(&guess)?;
            let cost = self.cost();
            if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                best = Some((cost, guess, self.cells));
            } else {
                break;
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
                let light = f64::from(self.scratch.curve.between(seen.value));
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
                let light = f64::from(self.scratch.curve.between(seen.value));
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

    /// Follows the residuals down.
    fn settle(&mut self, start: Guess) -> Option<Found> {
        let mut guess = start;
        let mut damping = 1e-3;
        self.draw(&guess)?;
        let mut normal = self.sums(&guess)?;
        let mut settled = false;
        for step in 0..STEPS {
            let next = guess.moved(&normal.step(damping)?);
            let moved = (0..4).map(|i| next.corners_px[i].distance(guess.corners_px[i])).fold(0.0, f64::max);
            settled = moved < SETTLED_PX && (next.blur_px / guess.blur_px).ln().abs() < 0.05;
            if settled && step > 0 {
                // Damped steps are shorter than what is left.
                guess = if damping < 0.01 { next } else { guess };
                break;
            }
            self.draw(&next)?;
            match self.sums(&next) {
                Some(after) if after.cost <= normal.cost => {
                    (guess, normal) = (next, after);
                    damping = (damping * 0.1f64).max(1e-9);
                    if step < 2 {
                        // What counts as an outlier is known now, and cells that were read wrongly show.
                        let before = self.noise;
                        self.noise = self.deviation(normal.cost);
                        let mended = self.mend_cells(&guess);
                        if mended {
                            self.draw(&guess)?;
                        }
                        if mended || self.noise < 0.8 * before {
                            normal = self.sums(&guess)?;
                        }
                    }
                }
                _ => damping *= 30.0,
            }
        }
        let contrast = self.value(guess.levels[0]) - self.value(guess.levels[3]);
        let deviation = self.deviation(normal.cost);
        if !settled || contrast < LEAST_CONTRAST.max(deviation) {
            return None;
        }
        let narrow = (OBLIQUE.0 - area_share(&guess.corners_px)).max(0.0);
        let sharp_px = FLOOR_PX.1 * (-guess.blur_px / 0.5).exp() * (1.0 + OBLIQUE.2 * narrow);
        let sigma_px = normal.sigma_px(deviation, FLOOR_PX.0 + sharp_px)? * (1.0 + OBLIQUE.1 * narrow);
        Some(Found { guess, cells: self.cells, sigma_px })
    }

    fn value(&self, light: f64) -> f64 {
        f64::from(self.scratch.curve.encode(light as f32).0)
    }

    /// Standard deviation of a residual at some cost, 8-bit values; not below that of rounding.
    fn deviation(&self, cost: f64) -> f64 {
        let rounding = 0.289 / self.factor as f64;
        (cost / (self.scratch.pixels.len() - UNKNOWNS) as f64).sqrt().max(rounding)
    }

    fn draw(&mut self, guess: &Guess) -> Option<()> {
        let BlurredScratch { template, parts, light, .. } = &mut *self.scratch;
        template.draw(self.cells, &guess.corners_px, guess.blur_px, &self.patch)?;
        parts.clear();
        // Slopes of the levels end with the tag.
        let inside = |place: [f32; 2]| place.map(|t| t.clamp(-RIM as f32, RIM as f32));
        parts.extend(
            (0..template.places.len()).map(|at| weights(&template.shares(at), inside(template.places[at]))),
        );
        let levels = guess.levels.map(|l| l as f32);
        light.clear();
        light.extend(parts.iter().map(|parts| parts.iter().zip(&levels).map(|(w, l)| w * l).sum::<f32>()));
        Some(())
    }

    /// Sum of squared residuals of what was drawn.
    fn cost(&self) -> f64 {
        let BlurredScratch { curve, pixels, light, .. } = &*self.scratch;
        let residual = |seen: &Seen| f64::from(seen.value - curve.encode(light[seen.at as usize]).0);
        pixels.iter().map(|seen| residual(seen).powi(2)).sum()
    }

    /// Fits the levels to the light of the pixels, with the cells, the corners and the blur as they were drawn.
    fn level(&self, guess: &mut Guess) -> Option<()> {
        let BlurredScratch { curve, pixels, light, parts, .. } = &*self.scratch;
        let mut sums = FitSums::new();
        for seen in pixels {
            let at = seen.at as usize;
            let (value, slope) = curve.encode(light[at]);
            sums.add(&[0.0; LEVELS], &parts[at].map(|part| slope * part), seen.value - value, 1.0);
        }
        let step = sums.normal()?.step_of_levels()?;
        guess.levels.iter_mut().zip(step).for_each(|(level, step)| *level += step);
        Some(())
    }

    fn sums(&self, guess: &Guess) -> Option<Normal> {
        let BlurredScratch { curve, template, pixels, light, parts } = &*self.scratch;
        let middle = guess.corners_px.iter().sum::<DVec2>() / 4.0;
        let pull = CornerPull::of(&guess.corners_px, middle)?;
        let width = self.patch.width;
        let (limit, variance) = (HUBER as f32 * self.noise as f32, (guess.blur_px * guess.blur_px) as f32);
        let mut sums = FitSums::new();
        for seen in pixels {
            let at = seen.at as usize;
            let (value, slope) = curve.encode(light[at]);
            let residual = seen.value - value;
            let trust = if residual.abs() > limit { limit / residual.abs() } else { 1.0 };
            // Differences of fourth order: those of second order make narrow edges look less steep than they are.
            let gradient = [1, width].map(|step| {
                let near = light[at + step] - light[at - step];
                slope * (8.0 * near - (light[at + 2 * step] - light[at - 2 * step])) / 12.0
            });
            let bend = [1, width].map(|step| {
                let near = light[at + step] + light[at - step];
                (16.0 * near - (light[at + 2 * step] + light[at - 2 * step]) - 30.0 * light[at]) / 12.0
            });
            let p = self.patch.middle_of(at % width, at / width);
            let mut place = [0.0; LEVELS];
            place[..8].copy_from_slice(&pull.at(p, template.places[at], gradient));
            // A Gaussian grows by half the Laplacian for each unit of its variance.
            place[8] = slope * variance * (bend[0] + bend[1]);
            sums.add(&place, &parts[at].map(|part| slope * part), residual, trust);
        }
        sums.normal()
    }
}
