//! How a saturated light spreads over its pixels, from the edges of its shadow.

use super::{RELATIVE_NOISE, Solution, SurfaceFit};
use crate::light::{
    clipped::{ClippedLights, MOST_LIGHTS},
    split::GRAY_PAPER,
};

/// Most rounds in which the spread of a saturated light is sharpened.
const SHARPEN_ROUNDS: usize = 100;

impl SurfaceFit {
    /// Richardson-Lucy on the shadows, in gray: moves each light's missing radiance among its cells towards where the
    /// half shadows want it, until the misfit is no more than noise.
    pub(super) fn sharpen(&mut self, solutions: &[Solution; 3], clipped: &mut ClippedLights) {
        let cells = clipped.cells.len();
        let gray = GRAY_PAPER.map(f64::from);
        self.find_shares(solutions, clipped);
        self.share_before.clone_from(&self.share);
        let total: f64 = self.share.iter().sum();
        // How much of the lights each point in their shadow lacks, and the noise there.
        self.in_shadow.clear();
        self.shade.clear();
        let mut noise = 0.0;
        for (p, point) in self.points.iter().enumerate() {
            let hidden = &self.hidden[p * cells..(p + 1) * cells];
            if !hidden.iter().zip(&self.share).any(|(hidden, share)| *hidden > 0.0 && *share > 0.0) {
                continue;
            }
            let (mut unshaded, mut seen, mut sigma) = (0.0, 0.0, 0.0);
            for c in 0..3 {
                let lights: f64 = solutions[c].missing.iter().sum();
                unshaded += gray[c] * (solutions[c].reflection * self.irradiance[p][c] + lights);
                seen += gray[c] * point.radiance[c];
                sigma += gray[c] * solutions[c].noise;
            }
            noise += (RELATIVE_NOISE * sigma * seen).powi(2);
            self.in_shadow.push(p as u32);
            self.shade.push((unshaded - seen).max(0.0));
        }
        if total <= 0.0 || self.in_shadow.is_empty() {
            return;
        }
        // A little of everything keeps the ratios finite where there is hardly any shadow.
        let floor = 0.02 * total;
        self.reach.clear();
        self.reach.resize(cells, 0.0);
        for p in &self.in_shadow {
            let row = &self.hidden[*p as usize * cells..(*p as usize + 1) * cells];
            for (reach, hidden) in self.reach.iter_mut().zip(row) {
                *reach += f64::from(*hidden);
            }
        }
        for _ in 0..SHARPEN_ROUNDS {
            if self.round(floor) <= noise {
                break;
            }
            for ((share, next), reach) in self.share.iter_mut().zip(&self.next_share).zip(&self.reach) {
                if *reach > 0.0 {
                    *share *= next / reach;
                }
            }
        }
        for ((cell, share), before) in clipped.cells.iter_mut().zip(&self.share).zip(&self.share_before) {
            if *before > 0.0 {
                cell.density *= share / before;
            }
        }
    }

    /// What each cell adds to the lit surface, in gray, as it is now.
    fn find_shares(&mut self, solutions: &[Solution; 3], clipped: &ClippedLights) {
        self.share.clear();
        self.share.resize(clipped.cells.len(), 0.0);
        for c in 0..3 {
            let mut whole = [0.0; MOST_LIGHTS];
            for cell in &clipped.cells {
                whole[cell.light] += cell.density * cell.weight[c];
            }
            for (share, cell) in self.share.iter_mut().zip(&clipped.cells) {
                if whole[cell.light] > 0.0 {
                    let part = cell.density * cell.weight[c] / whole[cell.light];
                    *share += f64::from(GRAY_PAPER[c]) * part * solutions[c].missing[cell.light];
                }
            }
        }
    }

    /// Finds by how much each cell's share is to grow, times `reach`, and how far the shares are off the shadows: a sum of
    /// squares.
    fn round(&mut self, floor: f64) -> f64 {
        let cells = self.share.len();
        self.next_share.clear();
        self.next_share.resize(cells, 0.0);
        let mut misfit = 0.0;
        for (p, shade) in self.in_shadow.iter().zip(&self.shade) {
            let row = &self.hidden[*p as usize * cells..(*p as usize + 1) * cells];
            let model: f64 = row.iter().zip(&self.share).map(|(h, s)| f64::from(*h) * s).sum();
            misfit += (model - shade).powi(2);
            let ratio = (shade + floor) / (model + floor);
            for (next, hidden) in self.next_share.iter_mut().zip(row) {
                *next += f64::from(*hidden) * ratio;
            }
        }
        misfit
    }
}
