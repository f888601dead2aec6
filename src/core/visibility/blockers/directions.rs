//! The rung `directions`: N fixed directions, each tested softly against every sphere (spec 7, DIR), for L receivers
//! side by side.
//!
//! Three small departures from the spec's sum (4 pi/N) sum_j v_j y(w_j): caps narrower than a ramp are thinned so that they
//! hide their own solid angle in the mean (of a sphere of no size the ramp would take 1.5 % of the light). From each y_i, i > 0, its mean over the directions
//! is taken, which N directions leave of what is zero over the sphere; so V is exact where nothing and where everything
//! is blocked, and nothing pops when the last sphere goes. And it is summed as 1 - B.

use super::{
    boxes::SoftBox,
    caps::{LaneCap, LaneVec},
};
use crate::{
    math::{
        sh::{
            MAX_COEFFICIENTS, basis,
            lanes::{Lane, LaneSh, nothing},
            log_exp::whole,
            soft_directions::{Ramp, softness},
        },
        spiral,
    },
    model::blocker::{BlockerBox, BlockerSphere},
};
use std::ops::Range;

/// Directions at most.
const MOST: usize = 256;

/// What depends on N and the order alone.
#[derive(Clone, Debug, Default)]
pub struct FixedDirections {
    order: usize,
    softness: f32,
    least_sine: f32,
    directions: Vec<[f32; 3]>,
    /// Mean of each y_i over all j, for i > 0.
    means: Vec<f32>,
    /// `[j][i]`: (4 pi/N) (y_i(w_j) - mean of y_i over all j, for i > 0).
    basis: Vec<[f32; MAX_COEFFICIENTS]>,
}

/// How much of each direction is open to L receivers.
pub struct OpenDirections<const L: usize> {
    v: [Lane<f32, L>; MOST],
    /// Elsewhere v is 1.
    touched: Range<usize>,
}

impl FixedDirections {
    /// For `count` directions (32 to 256) and an order; keeps what is there when both are as before.
    pub fn prepare(&mut self, count: usize, order: usize) {
        let count = count.min(MOST);
        if (self.directions.len(), self.order) == (count, order) {
            return;
        }
        self.order = order;
        let h = softness(count);
        (self.softness, self.least_sine) = (h as f32, (0.5 * h).sin() as f32);
        let solid_angle = 4.0 * std::f64::consts::PI / count as f64;
        let mut y = [0.0; MAX_COEFFICIENTS];
        let mut means = [0.0; MAX_COEFFICIENTS];
        for j in 0..count {
            basis::evaluate(order, spiral::direction(j, count).to_array(), &mut y);
            for (mean, y) in means.iter_mut().zip(y).skip(1) {
                *mean += y / count as f64;
            }
        }
        self.directions.clear();
        self.means.clear();
        self.means.extend(means.iter().map(|mean| *mean as f32));
        self.basis.clear();
        for j in 0..count {
            let d = spiral::direction(j, count).to_array();
            basis::evaluate(order, d, &mut y);
            self.directions.push(d.map(|v| v as f32));
            self.basis.push(std::array::from_fn(|i| {
                if i < order * order { (solid_angle * (y[i] - means[i])) as f32 } else { 0.0 }
            }));
        }
    }

    /// w_j, unit.
    pub fn list(&self) -> &[[f32; 3]] {
        &self.directions
    }

    /// h and sin(h/2).
    pub fn softness(&self) -> [f32; 2] {
        [self.softness, self.least_sine]
    }

    /// Mean of each y_i over all directions, for i > 0.
    pub fn means(&self) -> &[f32] {
        &self.means
    }

    /// The weights (4 pi/N) y_i(w_j), without their mean, of each direction.
    pub fn basis(&self) -> &[[f32; MAX_COEFFICIENTS]] {
        &self.basis
    }

    /// Tests all directions that a sphere or a box may hide; `None` where none hides anything.
    // Always: only within the widest instructions does it have them.
    #[inline(always)]
    pub fn open<'a, const L: usize>(
        &self,
        (spheres, boxes): (impl Iterator<Item = &'a BlockerSphere>, impl Iterator<Item = &'a BlockerBox>),
        points: &LaneVec<L>,
        normals: &LaneVec<L>,
    ) -> Option<OpenDirections<L>> {
        let count = self.directions.len();
        let mut open = OpenDirections { v: [Lane::splat(1.0); MOST], touched: count..0 };
        for cap in spheres.filter_map(|sphere| LaneCap::of_sphere(sphere, points, normals)) {
            let mut ramp =
                Ramp::of_cap(cap.axis, cap.sine_squared, cap.cosine, self.softness, self.least_sine)
                    .thinned(cap.q);
            // Where a lane has no cap every direction is open: a cap of no extent would still have its ramp.
            for lane in 0..L {
                let hides = cap.q.0[lane] > 0.0;
                ramp.threshold.0[lane] = if hides { ramp.threshold.0[lane] } else { 1.0 };
                for axis in &mut ramp.scaled_axis {
                    axis.0[lane] = if hides { axis.0[lane] } else { 0.0 };
                }
            }
            let range = self.reached(&ramp, &cap);
            open.touched = open.touched.start.min(range.start)..open.touched.end.max(range.end);
            let tested = open.v.get_mut(range.clone()).into_iter().flatten();
            for (v, direction) in tested.zip(self.directions.get(range).into_iter().flatten()) {
                *v = *v * ramp.at(*direction);
            }
        }
        for soft in boxes.filter_map(|b| SoftBox::of(b, points, normals, self.softness)) {
            open.touched = 0..count;
            for (v, direction) in open.v.iter_mut().zip(&self.directions) {
                *v = *v * (Lane::splat(1.0) - soft.at(*direction));
            }
        }
        (open.touched.start < open.touched.end).then_some(open)
    }

    /// The directions that a ramp may hide from some lane: v < 1 where w.axis > (threshold - 1)/slope. They run down in z
    /// in equal steps.
    #[inline(always)]
    fn reached<const L: usize>(&self, ramp: &Ramp<f32, L>, cap: &LaneCap<L>) -> Range<usize> {
        let (mut highest, mut lowest) = (-1.0f32, 1.0f32);
        let one = Lane::splat(1.0);
        let cosine = (ramp.threshold - one).zip(ramp.slope, |a, b| a / b).at_least(-1.0).at_most(1.0);
        let z = cap.axis[2];
        let sines = ((one - z * z) * (one - cosine * cosine)).at_least(0.0).sqrt();
        for lane in 0..L {
            if cap.q.0[lane] > 0.0 {
                let (z, cosine, sines) = (z.0[lane], cosine.0[lane], sines.0[lane]);
                let top = if z >= cosine { 1.0 } else { z * cosine + sines };
                let bottom = if z <= -cosine { -1.0 } else { z * cosine - sines };
                highest = if top > highest { top } else { highest };
                lowest = if bottom < lowest { bottom } else { lowest };
            }
        }
        // z_j = 1 - (2j+1)/N; two more on either side for rounding.
        let count = self.directions.len();
        let half = 0.5 * count as f32;
        let first = ((1.0 - highest) * half - 2.0).max(0.0) as usize;
        let last = ((1.0 - lowest) * half + 2.0).max(0.0) as usize;
        first.min(count)..(last + 1).min(count)
    }

    /// V of L receivers.
    #[inline(always)]
    pub fn visibility<'a, const N: usize, const L: usize>(
        &self,
        both: (impl Iterator<Item = &'a BlockerSphere>, impl Iterator<Item = &'a BlockerBox>),
        points: &LaneVec<L>,
        normals: &LaneVec<L>,
    ) -> LaneSh<f32, L> {
        let mut v = nothing();
        if let Some(open) = self.open(both, points, normals) {
            open.add_blocked(&self.basis, N * N, &mut v);
        }
        for v in &mut v[..N * N] {
            *v = -*v;
        }
        v[0] = (v[0] + Lane::splat(whole())).at_least(0.0);
        v
    }
}

impl<const L: usize> OpenDirections<L> {
    /// Adds sum_j (1 - v_j) weights_j, direction after direction, to `count` sums.
    #[inline(always)]
    pub fn add_blocked<const W: usize>(&self, weights: &[[f32; W]], count: usize, sums: &mut [Lane<f32, L>]) {
        let range = self.touched.clone();
        let tested = self.v.get(range.clone()).into_iter().flatten();
        for (v, weights) in tested.zip(weights.get(range).into_iter().flatten()) {
            let blocked = Lane::splat(1.0) - *v;
            for (sum, weight) in sums.iter_mut().zip(weights).take(count) {
                *sum += blocked * *weight;
            }
        }
    }
}
