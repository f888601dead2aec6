//! Brings the pictures of one bracket into one view: a tripod that was bumped, a hand that shook.

use super::{
    linear_light::LinearLight,
    register::{SATURATED, fixed, sample},
};
use crate::math::solve::solve_positive;
use crate::model::{frame::Exposure, image::Rgb8Image, response::Response};
use glam::DVec2;
use rayon::prelude::*;

/// Shifts below this are left alone: interpolation would cost more than it gains.
const LEAST_PX: f64 = 0.3;
/// Halvings of the coarse search, at most.
const MOST_HALVINGS: usize = 6;
/// Largest step in the smallest of these pictures (a seventh of its shorter side): 48 pixels in 480 x 320.
const FIRST_STEP: i32 = 6;
/// The coarse search ends at pictures of about this side.
const COARSEST: usize = 40;
/// Ranks at which two exposures are compared: the one that is well exposed in both is taken.
const RANKS: [f64; 6] = [0.3, 0.5, 0.7, 0.85, 0.93, 0.98];
/// Windows of the fine search along the longer side.
const WINDOWS: usize = 18;
/// Largest step of the fine search around the coarse one, pixels.
const REACH: i32 = 3;
/// Correlation of gradients from which a window counts.
const LEAST_CORRELATION: f64 = 0.6;
/// Least loss of correlation one pixel beside the peak, in each direction: else the window shows an edge along it.
const LEAST_CURVATURE: f64 = 0.04;
/// Fewest windows that agree.
const FEWEST_WINDOWS: usize = 5;

/// Where a picture shows what the reference shows at p: c + R(turn) (p - c) + shift, c the middle of the picture;
/// continuous pixel coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    /// Pixels.
    pub shift_px: DVec2,
    /// Radians, from x towards y.
    pub turn_rad: f64,
}

impl Drift {
    /// Where `p` is found. `middle`: of the picture.
    pub fn of(&self, p: DVec2, middle: DVec2) -> DVec2 {
        middle + DVec2::from_angle(self.turn_rad).rotate(p - middle) + self.shift_px
    }

    /// This drift and then another, as one.
    pub fn then(&self, next: &Self) -> Self {
        Self {
            shift_px: DVec2::from_angle(next.turn_rad).rotate(self.shift_px) + next.shift_px,
            turn_rad: self.turn_rad + next.turn_rad,
        }
    }

    /// The way of the corner that moves farthest, pixels.
    pub fn largest_px(&self, width: usize, height: usize) -> f64 {
        let size = DVec2::new(width as f64, height as f64);
        let way = |x: f64, y: f64| {
            let corner = size * DVec2::new(x, y);
            self.of(corner, 0.5 * size).distance(corner)
        };
        way(0.0, 0.0).max(way(1.0, 0.0)).max(way(0.0, 1.0)).max(way(1.0, 1.0))
    }
}

/// A bracket in one view.
#[derive(Clone, Debug, Default)]
pub struct Aligned {
    /// The pictures, in the order given, in the view of the one of middle exposure. Values from 253 on are 255: noise
    /// and compression let saturated pixels come out a little lower, which a merge would take for a measured value.
    pub pictures: Vec<Rgb8Image>,
    /// Of each picture from that view; zero where nothing was moved.
    pub drifts: Vec<Drift>,
}

/// Finds how the pictures of a bracket moved against each other (a shift and a turn in the picture's plane, between
/// neighbours in exposure) and warps all into the view of the middle one, interpolating in linear light. Pictures
/// that cannot be told to have moved, or moved by less than 0.3 pixels, stay as they are, but for saturated ends.
pub fn align(pictures: &[&Rgb8Image], exposures: &[Exposure], response: &Response) -> Aligned {
    let mut order: Vec<usize> = (0..pictures.len().min(exposures.len())).collect();
    order.sort_by(|a, b| exposures[*a].effective_s().total_cmp(&exposures[*b].effective_s()));
    let mut drifts = vec![Drift::default(); pictures.len()];
    let middle = order.len() / 2;
    let mut follow = |from: usize, to: usize| {
        let step = drift(pictures[from], pictures[to]).unwrap_or_default();
        drifts[to] = drifts[from].then(&step);
    };
    (middle..order.len().saturating_sub(1)).for_each(|k| follow(order[k], order[k + 1]));
    (1..=middle).rev().filter(|k| *k < order.len()).for_each(|k| follow(order[k], order[k - 1]));
    let light = LinearLight::new(response);
    let warped = pictures.iter().zip(&mut drifts).map(|(picture, drift)| {
        if drift.largest_px(picture.width(), picture.height()) < LEAST_PX {
            *drift = Drift::default();
        }
        warp(picture, drift, &light)
    });
    let pictures = warped.collect();
    Aligned { pictures, drifts }
}

/// The picture as the reference's camera would have taken it; beyond its border the outermost pixels go on.
fn warp(picture: &Rgb8Image, drift: &Drift, light: &LinearLight) -> Rgb8Image {
    let (width, height) = (picture.width(), picture.height());
    let size = DVec2::new(width as f64, height as f64);
    let moved = *drift != Drift::default();
    let mut out = picture.clone();
    out.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            if moved {
                let at = drift.of(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), 0.5 * size);
                let at = at.clamp(DVec2::splat(0.5), size - 0.5);
                *pixel = sample(picture, fixed(at), Some(light)).unwrap_or(*pixel);
            }
            *pixel = pixel.map(|z| if z >= SATURATED { 255 } else { z });
        }
    });
    out
}

/// One channel, 8 bits.
struct GrayPicture {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl GrayPicture {
    fn of(picture: &Rgb8Image) -> Self {
        let gray =
            |p: &[u8; 3]| ((54 * u32::from(p[0]) + 183 * u32::from(p[1]) + 19 * u32::from(p[2])) >> 8) as u8;
        Self {
            width: picture.width(),
            height: picture.height(),
            values: picture.pixels().iter().map(gray).collect(),
        }
    }

    fn half(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| u32::from(self.values[y * self.width + x]);
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            ((at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4) as u8
        };
        Self { width, height, values: (0..width * height).map(mean).collect() }
    }

    /// The value below which a share of the pixels lies.
    fn value_of_rank(&self, rank: f64) -> u8 {
        let mut counts = [0usize; 256];
        self.values.iter().for_each(|z| counts[usize::from(*z)] += 1);
        let mut left = (rank * self.values.len() as f64) as usize;
        for (z, count) in counts.into_iter().enumerate() {
            if left < count {
                return z as u8;
            }
            left -= count;
        }
        255
    }
}

/// How `picture` moved against `reference`; `None` where they differ in size or share too little to tell.
///
/// Coarse: both are cut at the value of one rank (which no response changes), and the shift at which the two halves
/// differ least is followed from small to full size. Fine: in each window the shift of largest correlation between the
/// gradients of ln(8 + value), to a part of a pixel; then a shift and a turn by least squares with Cauchy weights.
pub fn drift(reference: &Rgb8Image, picture: &Rgb8Image) -> Option<Drift> {
    if (reference.width(), reference.height()) != (picture.width(), picture.height()) {
        return None;
    }
    let (a, b) = (GrayPicture::of(reference), GrayPicture::of(picture));
    if a.width.min(a.height) < COARSEST {
        return None;
    }
    let (cx, cy) = coarse_shift(&a, &b);
    let middle = 0.5 * DVec2::new(a.width as f64, a.height as f64);
    fit(&window_shifts(&a, &b, cx, cy), middle)
}

fn coarse_shift(a: &GrayPicture, b: &GrayPicture) -> (i32, i32) {
    // How far from both ends of the scale a rank lies in the picture where it lies worse.
    let exposed = |rank: f64| {
        let room = |z: u8| z.min(255 - z);
        room(a.value_of_rank(rank)).min(room(b.value_of_rank(rank)))
    };
    let rank = RANKS.into_iter().max_by_key(|rank| exposed(*rank)).unwrap_or(0.5);
    let mut levels = vec![(a.half(), b.half())];
    while levels.len() < MOST_HALVINGS
        && levels.last().is_some_and(|(a, _)| a.width.min(a.height) >= 2 * COARSEST)
    {
        let (a, b) = &levels[levels.len() - 1];
        levels.push((a.half(), b.half()));
    }
    let (mut x, mut y) = (0, 0);
    for (k, (a, b)) in levels.iter().rev().enumerate() {
        (x, y) = (2 * x, 2 * y);
        let step = if k == 0 { FIRST_STEP } else { 1 };
        let (cut_a, cut_b) = (a.value_of_rank(rank), b.value_of_rank(rank));
        let best = (-step..=step)
            .flat_map(|dy| (-step..=step).map(move |dx| (dx, dy)))
            .map(|(dx, dy)| (mismatch(a, b, cut_a, cut_b, x + dx, y + dy), dx.abs() + dy.abs(), dx, dy))
            .min_by(|p, q| p.0.total_cmp(&q.0).then(p.1.cmp(&q.1)));
        if let Some((_, _, dx, dy)) = best {
            (x, y) = (x + dx, y + dy);
        }
    }
    (2 * x, 2 * y)
}

/// Share of the pixels that lie on different sides of the cuts.
fn mismatch(a: &GrayPicture, b: &GrayPicture, cut_a: u8, cut_b: u8, dx: i32, dy: i32) -> f64 {
    let (width, height) = (a.width as i32, a.height as i32);
    let (mut differ, mut all) = (0u32, 0u32);
    for y in (-dy).max(0)..(height - dy).min(height) {
        let row_a = &a.values[(y * width) as usize..((y + 1) * width) as usize];
        let row_b = &b.values[((y + dy) * width) as usize..((y + dy + 1) * width) as usize];
        for x in (-dx).max(0)..(width - dx).min(width) {
            let (p, q) = (row_a[x as usize], row_b[(x + dx) as usize]);
            // Values at the cut itself are noise.
            if p.abs_diff(cut_a) > 1 && q.abs_diff(cut_b) > 1 {
                all += 1;
                differ += u32::from((p > cut_a) != (q > cut_b));
            }
        }
    }
    if all > 0 { f64::from(differ) / f64::from(all) } else { 1.0 }
}

/// Gradients of ln(8 + value); zero where a value is black or saturated.
fn gradients(gray: &GrayPicture) -> Vec<[f32; 2]> {
    let logs: [f32; 256] = std::array::from_fn(|z| (8.0 + z as f32).ln());
    let (width, height) = (gray.width, gray.height);
    let mut out = vec![[0.0; 2]; width * height];
    let usable = |z: u8| (3..=250).contains(&z);
    out.par_chunks_mut(width).enumerate().skip(1).take(height.saturating_sub(2)).for_each(|(y, row)| {
        for (x, slot) in row.iter_mut().enumerate().skip(1).take(width.saturating_sub(2)) {
            let i = y * width + x;
            let near = [i - 1, i + 1, i - width, i + width].map(|i| gray.values[i]);
            if near.iter().all(|z| usable(*z)) {
                let [l, r, u, d] = near.map(|z| logs[usize::from(z)]);
                *slot = [r - l, d - u];
            }
        }
    });
    out
}

/// (middle of the window, its shift) of all windows that tell both directions.
fn window_shifts(a: &GrayPicture, b: &GrayPicture, cx: i32, cy: i32) -> Vec<(DVec2, DVec2)> {
    let (width, height) = (a.width as i32, a.height as i32);
    let side = (a.width.max(a.height) / WINDOWS).max(16) as i32;
    let (of_a, of_b) = (gradients(a), gradients(b));
    let margin = REACH + 1;
    let windows: Vec<(i32, i32)> = (0..height / side)
        .flat_map(|j| (0..width / side).map(move |i| (i * side, j * side)))
        .filter(|(x, y)| {
            // The window and all its shifts lie in both pictures.
            let (low_x, low_y) = (x + cx.min(0) - margin, y + cy.min(0) - margin);
            let (high_x, high_y) = (x + side + cx.max(0) + margin, y + side + cy.max(0) + margin);
            low_x >= 0 && low_y >= 0 && high_x <= width && high_y <= height
        })
        .collect();
    let correlation = |x0: i32, y0: i32, dx: i32, dy: i32| {
        let (mut ab, mut aa, mut bb) = (0.0f64, 0.0f64, 0.0f64);
        for y in y0..y0 + side {
            let from_a = (y * width + x0) as usize;
            let from_b = ((y + dy) * width + x0 + dx) as usize;
            let rows = of_a[from_a..from_a + side as usize].iter().zip(&of_b[from_b..from_b + side as usize]);
            let (mut row_ab, mut row_aa, mut row_bb) = (0.0f32, 0.0f32, 0.0f32);
            for (p, q) in rows {
                row_ab += p[0] * q[0] + p[1] * q[1];
                row_aa += p[0] * p[0] + p[1] * p[1];
                row_bb += q[0] * q[0] + q[1] * q[1];
            }
            (ab, aa, bb) = (ab + f64::from(row_ab), aa + f64::from(row_aa), bb + f64::from(row_bb));
        }
        if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
    };
    windows
        .par_iter()
        .filter_map(|&(x0, y0)| {
            let (mut best, mut at) = (f64::NEG_INFINITY, (0, 0));
            for dy in -REACH..=REACH {
                for dx in -REACH..=REACH {
                    let found = correlation(x0, y0, cx + dx, cy + dy);
                    if found > best {
                        (best, at) = (found, (dx, dy));
                    }
                }
            }
            if best < LEAST_CORRELATION || at.0.abs() == REACH || at.1.abs() == REACH {
                return None;
            }
            let (dx, dy) = (cx + at.0, cy + at.1);
            let part = |low: f64, high: f64| {
                let curvature = 2.0 * best - low - high;
                (curvature > 2.0 * LEAST_CURVATURE).then(|| 0.5 * (high - low) / curvature)
            };
            let sub_x = part(correlation(x0, y0, dx - 1, dy), correlation(x0, y0, dx + 1, dy))?;
            let sub_y = part(correlation(x0, y0, dx, dy - 1), correlation(x0, y0, dx, dy + 1))?;
            let middle = DVec2::new(f64::from(x0), f64::from(y0)) + 0.5 * f64::from(side);
            Some((middle, DVec2::new(f64::from(dx) + sub_x, f64::from(dy) + sub_y)))
        })
        .collect()
}

/// Shift and turn from the windows; `None` where too few agree within a pixel.
fn fit(found: &[(DVec2, DVec2)], middle: DVec2) -> Option<Drift> {
    if found.len() < FEWEST_WINDOWS {
        return None;
    }
    let median = |of: &dyn Fn(&DVec2) -> f64| {
        let mut all: Vec<f64> = found.iter().map(|(_, shift)| of(shift)).collect();
        all.sort_unstable_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let mut drift = Drift { shift_px: DVec2::new(median(&|s| s.x), median(&|s| s.y)), turn_rad: 0.0 };
    let off = |drift: &Drift, p: DVec2, shift: DVec2| p + shift - drift.of(p, middle);
    for _ in 0..20 {
        let mut normal = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for &(p, shift) in found {
            let residual = off(&drift, p, shift);
            let weight = 1.0 / (1.0 + residual.length_squared() / 0.09);
            let lever = p - middle;
            // d(position) = shift + turn x (-y, x), about the drift so far.
            for (row, e) in [([1.0, 0.0, -lever.y], residual.x), ([0.0, 1.0, lever.x], residual.y)] {
                for i in 0..3 {
                    (0..3).for_each(|j| normal[i][j] += weight * row[i] * row[j]);
                    right[i] += weight * row[i] * e;
                }
            }
        }
        let step = solve_positive(&normal, right)?;
        drift.shift_px += DVec2::new(step[0], step[1]);
        drift.turn_rad += step[2];
    }
    let agree = found.iter().filter(|(p, shift)| off(&drift, *p, *shift).length() < 1.0).count();
    (agree >= FEWEST_WINDOWS && 2 * agree >= found.len() && drift.shift_px.is_finite()).then_some(drift)
}

#[cfg(test)]
mod tests;
