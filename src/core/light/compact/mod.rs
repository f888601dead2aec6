//! The directional half as up to four compact lights with their true extent, found in the picture of the
//! environment; the rest, smooth by construction, in SH (section 4b of the project's formulas). This goes beyond
//! [Now11], whose one directional light makes hard shadows under broad light.

mod find;
mod grid;

pub use find::{CAP_DEG, FADE_S, LEAST_SHARE, SWAP_S};
pub use grid::LightGrid;

use crate::math::sh::{MAX_COEFFICIENTS, basis::evaluate};
use crate::model::light::{HardLight, Lights, MAX_HARD_LIGHTS, RadianceSamples, RadianceSh};
use crate::sources::cut::{Cutter, FarRepresentative};
use find::Finder;
use glam::Vec3;

/// Finds compact lights, follows them, and cuts them into hard lights. Keeps its memory: nothing allocates in steady
/// state.
#[derive(Clone, Debug, Default)]
pub struct CompactSplit {
    grid: LightGrid,
    finder: Finder,
    cutter: Cutter,
}

impl CompactSplit {
    /// Nothing seen yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds no more than so many lights (1 to 4; 4 at the beginning); those beyond fade out.
    pub fn keep_at_most(&mut self, lights: usize) {
        self.finder.keep_at_most(lights);
    }

    /// Takes in radiance from weighted directions (world frame), with weight `alpha` against what was there, `dt_s`
    /// after the last; 1 forgets all that was. With `above_horizon` lights are only looked for at z > 0: what a
    /// surface below sends stays soft.
    pub fn update(&mut self, samples: &RadianceSamples, alpha: f64, dt_s: f64, above_horizon: bool) {
        self.grid.blend(samples, alpha as f32);
        self.finder.update(&self.grid, dt_s, above_horizon);
    }

    /// The light as it is shaded with: `total` (the same light in SH, filtered alike) without what at most `maps` hard
    /// lights stand for, and these. Flux is kept: that of the texels behind the hard lights and that of the soft half
    /// add up to the whole.
    pub fn lights(&mut self, total: &RadianceSh, maps: usize) -> Lights {
        let mut lights = Lights::soft(*total);
        let representatives = self.cutter.cut(self.finder.leaves(), maps.min(MAX_HARD_LIGHTS));
        for representative in representatives {
            lights.hard.push(hard(representative));
        }
        let is_represented = |root: u32| representatives.iter().any(|r| r.root == root);
        for (slot, light) in lights.compact.iter_mut().zip(self.finder.lights()) {
            *slot = light.filter(|l| is_represented(l.id));
        }
        let mut taken = [[0.0f64; 3]; MAX_COEFFICIENTS];
        let order = total.order;
        for leaf in self.finder.leaves().iter().filter(|l| is_represented(l.root)) {
            let mut y = [0.0f32; MAX_COEFFICIENTS];
            evaluate(order, leaf.at.to_array(), &mut y);
            for (row, y) in taken.iter_mut().zip(y).take(order * order) {
                for (sum, c) in row.iter_mut().zip(leaf.flux_rgb) {
                    *sum += f64::from(c) * f64::from(y);
                }
            }
        }
        for (row, taken) in lights.global.rgb.iter_mut().zip(taken) {
            for (c, t) in row.iter_mut().zip(taken) {
                *c = (f64::from(*c) - t) as f32;
            }
        }
        lights
    }

    /// The picture without what the hard lights of the last call of `lights` stand for: smooth, as weighted directions.
    pub fn left_over(&self, out: &mut RadianceSamples) {
        let represented = self.cutter.representatives();
        let leaves = self.finder.leaves().iter();
        let taken = leaves.filter(|l| represented.iter().any(|r| r.root == l.root));
        self.grid.left_over(taken.map(|leaf| (leaf.at, leaf.flux_rgb)), out);
    }
}

/// One hard light for the leaves of a representative.
///
/// Its direction is the median's, where a wide rim does not pull a sun's shadow off; its irradiance is that of the
/// leaves on a plane that faces their mean, |integral of L w|, which is a little less than their flux.
fn hard(representative: &FarRepresentative) -> HardLight {
    let facing = representative.mean.length();
    HardLight {
        to_light_world: representative.at.normalize_or(Vec3::Z).to_array(),
        irradiance_rgb: representative.flux_rgb.map(|c| c * facing),
        // The mean of unit vectors is shorter than 1 by half of their mean square angle.
        extent_rad: (2.0 * (1.0 - facing)).max(0.0).sqrt(),
    }
}

#[cfg(test)]
mod tests;
