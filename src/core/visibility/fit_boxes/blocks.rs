//! A piece cut into blocks along its flat sides, and the boxes that are put together of them.

use super::pieces::{Piece, PieceFrame, across};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// Where the longest extent is cut at least, from fine to coarse: the finest that is not too much work.
const FINENESS: [f32; 5] = [32.0, 24.0, 16.0, 12.0, 8.0];
/// Boxes that may be looked at for each one that is taken.
const MOST_WORK: usize = 3_000_000;
/// Flat sides along an axis that are cut at.
const MOST_CUTS: usize = 16;
/// Places in a block, along each side, where it is looked at: off the diagonals along which sides are split in triangles.
const PLACES: [[f32; 2]; 3] = [[0.1831, 0.2229], [0.5137, 0.5473], [0.8419, 0.8713]];
/// A box that adds less than this share of the piece is not worth it.
const LEAST_GAIN: f32 = 0.01;
/// What covering again costs, against what covering empty space does.
const AGAIN: f32 = 0.5;

/// Blocks with sides along a frame.
pub struct Blocks {
    /// Where they begin and end along each axis.
    cuts: [Vec<f32>; 3],
    /// Of each block: its volume, of a sheet its area; the full part of it; the part of that in no box yet.
    size: Vec<f32>,
    full: Vec<f32>,
    rest: Vec<f32>,
    /// Whether a box covers it.
    covered: Vec<bool>,
}

impl Blocks {
    /// Along its flat sides, and between these as finely as is not too much work.
    pub fn cut(piece: &Piece, frame: &PieceFrame, is_sheet: bool) -> Self {
        let sides: [Vec<f32>; 3] = std::array::from_fn(|axis| sides_along(piece, frame, axis));
        let mut cuts: [Vec<f32>; 3] = Default::default();
        for fineness in FINENESS {
            let step = (frame.high - frame.low).max_element() / fineness;
            cuts = sides.each_ref().map(|sides| divided(sides, step));
            if is_sheet {
                cuts[2] = vec![frame.low.z, frame.low.z];
            }
            let [nx, ny, nz] = cuts.each_ref().map(|cuts| cuts.len());
            if nx * (ny * ny / 2) * (nz * nz / 2).max(1) <= MOST_WORK {
                break;
            }
        }
        let [nx, ny, nz] = cuts.each_ref().map(|cuts| cuts.len() - 1);
        let mut blocks =
            Self { cuts, size: Vec::new(), full: Vec::new(), rest: Vec::new(), covered: Vec::new() };
        for k in 0..nz {
            let deep = if is_sheet { 1.0 } else { blocks.length(2, k) };
            for j in 0..ny {
                for i in 0..nx {
                    blocks.size.push(blocks.length(0, i) * blocks.length(1, j) * deep);
                }
            }
        }
        blocks.full = vec![0.0; blocks.size.len()];
        blocks.covered = vec![false; blocks.size.len()];
        blocks.fill(piece, frame, is_sheet);
        blocks.rest.clone_from(&blocks.full);
        blocks
    }

    fn length(&self, axis: usize, at: usize) -> f32 {
        self.cuts[axis][at + 1] - self.cuts[axis][at]
    }

    fn counts(&self) -> [usize; 3] {
        self.cuts.each_ref().map(|cuts| cuts.len() - 1)
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.counts();
        i + nx * (j + ny * k)
    }

    /// Finds how full the blocks are, along lines through the piece.
    fn fill(&mut self, piece: &Piece, frame: &PieceFrame, is_sheet: bool) {
        let [nx, ny, nz] = self.counts();
        let side = PLACES.len();
        let xs: Vec<f32> = places(&self.cuts[0], 0);
        let ys: Vec<f32> = places(&self.cuts[1], 1);
        let mut met: Vec<(u32, f32, i32)> = Vec::new();
        for triangle in &piece.triangles {
            let corners = triangle.map(|p| frame.of(p));
            let up = across(&corners).z;
            let (low, high) =
                (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
            if up.abs() <= f32::EPSILON * (high - low).length_squared() {
                continue;
            }
            for j in between(&ys, low.y, high.y) {
                for i in between(&xs, low.x, high.x) {
                    if let Some(depth) = depth_at(&corners, Vec2::new(xs[i], ys[j])) {
                        met.push(((j * xs.len() + i) as u32, depth, if up > 0.0 { -1 } else { 1 }));
                    }
                }
            }
        }
        met.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let share = 1.0 / (side * side) as f32;
        for line in met.chunk_by(|a, b| a.0 == b.0) {
            let (i, j) = (line[0].0 as usize % xs.len() / side, line[0].0 as usize / xs.len() / side);
            let area = share * self.length(0, i) * self.length(1, j);
            if is_sheet {
                let index = self.index([i, j, 0]);
                self.full[index] += area;
                continue;
            }
            // Of pieces of which not all triangles face outwards, every other meeting goes in.
            let is_sound = line.iter().map(|m| m.2).sum::<i32>() == 0;
            let mut winding = 0;
            for (n, ends) in line.windows(2).enumerate() {
                winding += ends[0].2;
                if if is_sound { winding == 0 } else { n % 2 == 1 } {
                    continue;
                }
                for k in 0..nz {
                    let begin = ends[0].1.max(self.cuts[2][k]);
                    let end = ends[1].1.min(self.cuts[2][k + 1]);
                    let index = i + nx * (j + ny * k);
                    self.full[index] += area * (end - begin).max(0.0);
                }
            }
        }
    }

    /// Puts boxes together, `most` at most, each given by its least and largest corner in the frame: always the one
    /// that covers most of what is in none, less what it covers besides.
    pub fn boxes(&mut self, most: usize) -> Vec<[Vec3; 2]> {
        let whole: f32 = self.full.iter().sum();
        let mut found = Vec::new();
        while found.len() < most {
            let Some((gain, ranges)) = self.best() else { break };
            if gain < LEAST_GAIN * whole {
                break;
            }
            for k in ranges[2].clone() {
                for j in ranges[1].clone() {
                    for i in ranges[0].clone() {
                        let index = self.index([i, j, k]);
                        self.rest[index] = 0.0;
                        self.covered[index] = true;
                    }
                }
            }
            let corner = |end: fn(&Range<usize>) -> usize| {
                Vec3::from(std::array::from_fn(|axis| self.cuts[axis][end(&ranges[axis])]))
            };
            found.push([corner(|range| range.start), corner(|range| range.end)]);
        }
        found
    }

    /// What is in no box, and what boxes cover that is empty, over what there is.
    pub fn shares(&self) -> (f64, f64) {
        let mut sums = [0.0f64; 3];
        for (index, &full) in self.full.iter().enumerate() {
            sums[0] += f64::from(full);
            sums[1] += f64::from(self.rest[index]);
            sums[2] += if self.covered[index] { f64::from(self.size[index] - full) } else { 0.0 };
        }
        (sums[1] / sums[0], sums[2] / sums[0])
    }

    /// The best box and what it gains: of each range across, the best run along the first axis.
    fn best(&self) -> Option<(f32, [Range<usize>; 3])> {
        let [nx, ny, nz] = self.counts();
        // Sums over j and k from 0 on, for each i.
        let mut sums = vec![0.0f32; nx * (ny + 1) * (nz + 1)];
        let at = |i: usize, j: usize, k: usize| i + nx * (j + (ny + 1) * k);
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    let index = self.index([i, j, k]);
                    let (size, full, rest) = (self.size[index], self.full[index], self.rest[index]);
                    let gain = rest - (size - full) - AGAIN * (full - rest);
                    sums[at(i, j + 1, k + 1)] =
                        gain + sums[at(i, j, k + 1)] + sums[at(i, j + 1, k)] - sums[at(i, j, k)];
                }
            }
        }
        let mut best: Option<(f32, [Range<usize>; 3])> = None;
        for k in 0..nz {
            for k_end in k + 1..=nz {
                for j in 0..ny {
                    for j_end in j + 1..=ny {
                        let (mut run, mut start) = (0.0f32, 0);
                        for i in 0..nx {
                            if run <= 0.0 {
                                (run, start) = (0.0, i);
                            }
                            run += sums[at(i, j_end, k_end)] - sums[at(i, j, k_end)] - sums[at(i, j_end, k)]
                                + sums[at(i, j, k)];
                            // By more than rounding, so that a box does not grow over nothing.
                            if best.as_ref().is_none_or(|(gain, _)| run > *gain * 1.000_01) && run > 0.0 {
                                best = Some((run, [start..i + 1, j..j_end, k..k_end]));
                            }
                        }
                    }
                }
            }
        }
        best
    }
}

/// Where flat sides straight to an axis lie, and the ends, in order.
fn sides_along(piece: &Piece, frame: &PieceFrame, axis: usize) -> Vec<f32> {
    let (low, high) = (frame.low[axis], frame.high[axis]);
    let near = 1e-4 * (frame.high - frame.low).max_element();
    let mut sides: Vec<(f32, f32)> = Vec::new();
    for triangle in &piece.triangles {
        let normal = across(triangle);
        if normal.dot(frame.axes[axis]).abs() < 0.9995 * normal.length() {
            continue;
        }
        let at = triangle.iter().map(|p| frame.of(*p)[axis]).sum::<f32>() / 3.0;
        match sides.iter_mut().find(|side| (side.0 - at).abs() <= near) {
            Some(side) => side.1 += normal.length(),
            None => sides.push((at, normal.length())),
        }
    }
    sides.sort_by(|a, b| b.1.total_cmp(&a.1));
    sides.truncate(MOST_CUTS);
    let inner = sides.into_iter().map(|side| side.0).filter(|at| *at > low + near && *at < high - near);
    let mut cuts: Vec<f32> = inner.collect();
    cuts.extend([low, high]);
    cuts.sort_by(f32::total_cmp);
    cuts
}

/// The same with further cuts, `step` apart at most.
fn divided(sides: &[f32], step: f32) -> Vec<f32> {
    let mut cuts = vec![sides[0]];
    for ends in sides.windows(2) {
        let parts = ((ends[1] - ends[0]) / step).ceil().clamp(1.0, 64.0) as usize;
        let inner = (1..parts).map(|part| ends[0] + (ends[1] - ends[0]) * part as f32 / parts as f32);
        cuts.extend(inner);
        cuts.push(ends[1]);
    }
    cuts
}

/// Where lines go through blocks, in order.
fn places(cuts: &[f32], which: usize) -> Vec<f32> {
    let within = |ends: &[f32]| PLACES.map(|place| ends[0] + (ends[1] - ends[0]) * place[which]);
    cuts.windows(2).flat_map(within).collect()
}

/// Which of ordered numbers lie within two.
fn between(sorted: &[f32], low: f32, high: f32) -> Range<usize> {
    sorted.partition_point(|x| *x < low)..sorted.partition_point(|x| *x <= high)
}

/// Where a line along the last axis meets a triangle.
fn depth_at([a, b, c]: &[Vec3; 3], at: Vec2) -> Option<f32> {
    let edge = |from: &Vec3, to: &Vec3| (to.truncate() - from.truncate()).perp_dot(at - from.truncate());
    let weights = [edge(b, c), edge(c, a), edge(a, b)];
    let all = weights.iter().sum::<f32>();
    let is_within = weights.iter().all(|w| w * all >= 0.0) && all != 0.0;
    is_within.then(|| (weights[0] * a.z + weights[1] * b.z + weights[2] * c.z) / all)
}
