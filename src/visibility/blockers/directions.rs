//! The rung `directions`: N fixed directions, each tested softly against every sphere (spec 7, DIR).
//!
//! Two small departures from the spec's sum (4 pi/N) sum_j v_j y(w_j): from each y_i, i > 0, its mean over the directions
//! is taken, which N directions leave of what is zero over the sphere (up to 1e-2 at N = 32, order 6); so V is exact where
//! nothing and where everything is blocked, and nothing pops when the last sphere goes. And it is summed as 1 - B.

use crate::{
    math::sh::{
        MAX_COEFFICIENTS, basis,
        cap::Cap,
        log_exp::whole,
        soft_directions::{Ramp, direction, softness},
    },
    model::blocker::BlockerSphere,
};
use glam::Vec3;

/// Directions that go side by side.
const BLOCK: usize = 8;
/// Blocks at most.
const BLOCKS: usize = 256 / BLOCK;

/// What depends on N and the order alone.
#[derive(Clone, Debug, Default)]
pub struct Directions {
    count: usize,
    order: usize,
    softness: f32,
    least_sine: f32,
    /// Directions in blocks: x, y, z. Beyond the last there are copies without weight.
    blocks: Vec<[[f32; BLOCK]; 3]>,
    /// `[i * blocks + block]`: (4 pi/N) (y_i(w_j) - mean of y_i over all j, for i > 0).
    basis: Vec<[f32; BLOCK]>,
}

/// How much of each direction is open, for one receiver.
pub struct Open {
    /// v_j; only `blocks` of them have been written.
    v: [[f32; BLOCK]; BLOCKS],
    /// The blocks where a sphere may hide something.
    touched: [bool; BLOCKS],
}

impl Directions {
    /// For `count` directions (32 to 256) and an order; keeps what is there when both are as before.
    pub fn prepare(&mut self, count: usize, order: usize) {
        if (self.count, self.order) == (count, order) {
            return;
        }
        (self.count, self.order) = (count, order);
        let h = softness(count);
        (self.softness, self.least_sine) = (h as f32, (0.5 * h).sin() as f32);
        let blocks = count.div_ceil(BLOCK);
        self.blocks.clear();
        self.blocks.resize(blocks, [[0.0; BLOCK]; 3]);
        self.basis.clear();
        self.basis.resize(blocks * order * order, [0.0; BLOCK]);
        let solid_angle = 4.0 * std::f64::consts::PI / count as f64;
        let mut y = [0.0; MAX_COEFFICIENTS];
        let mut means = [0.0; MAX_COEFFICIENTS];
        for j in 0..count {
            basis::evaluate(order, direction(j, count), &mut y);
            for (mean, y) in means.iter_mut().zip(y).skip(1) {
                *mean += y / count as f64;
            }
        }
        for j in 0..blocks * BLOCK {
            let (block, lane) = (j / BLOCK, j % BLOCK);
            let d = direction(j.min(count - 1), count);
            for (out, d) in self.blocks[block].iter_mut().zip(d) {
                out[lane] = d as f32;
            }
            basis::evaluate(order, d, &mut y);
            for (i, (y, mean)) in y.iter().zip(means).enumerate().take(order * order) {
                let weight = if j < count { solid_angle } else { 0.0 };
                self.basis[i * blocks + block][lane] = (weight * (y - mean)) as f32;
            }
        }
    }

    /// Blocks of directions.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// The weights (4 pi/N) y_i(w_j), without their mean, of a coefficient, block by block.
    pub fn basis(&self, coefficient: usize) -> &[[f32; BLOCK]] {
        let blocks = self.blocks();
        self.basis.get(coefficient * blocks..(coefficient + 1) * blocks).unwrap_or(&[])
    }

    /// Tests all directions of one receiver; `None` where no sphere hides anything.
    #[inline]
    pub fn open(
        &self,
        spheres: &[BlockerSphere],
        point: Vec3,
        normal: Vec3,
        body: Option<u32>,
    ) -> Option<Open> {
        let mut open = Open { v: [[1.0; BLOCK]; BLOCKS], touched: [false; BLOCKS] };
        let mut any = false;
        for sphere in spheres {
            let to = sphere.centre_world - point;
            // Negated, so that what is not a number does not count.
            if Some(sphere.body) == body || !(to.dot(normal) > -sphere.radius_m || to == Vec3::ZERO) {
                continue;
            }
            let Some(cap) = Cap::of_sphere(to.to_array(), sphere.radius_m, normal.to_array()) else {
                continue;
            };
            let ramp = Ramp::of_cap(&cap, self.softness, self.least_sine);
            // v < 1 where w.axis > reach.
            let reach = (ramp.threshold - 1.0) / ramp.slope;
            for block in self.reached(cap.axis[2], reach) {
                any = true;
                open.touched[block] = true;
                let [xs, ys, zs] = &self.blocks[block];
                for (lane, v) in open.v[block].iter_mut().enumerate() {
                    *v *= ramp.at([xs[lane], ys[lane], zs[lane]]);
                }
            }
        }
        any.then_some(open)
    }

    /// The blocks with directions within a cone about an axis of height `axis_z`; `reach` is the cosine of its half
    /// angle. Directions run down in z in equal steps.
    #[inline]
    fn reached(&self, axis_z: f32, reach: f32) -> std::ops::Range<usize> {
        let cosine = reach.clamp(-1.0, 1.0);
        let sines = ((1.0 - axis_z * axis_z).max(0.0) * (1.0 - cosine * cosine)).sqrt();
        let top = if axis_z >= cosine { 1.0 } else { axis_z * cosine + sines };
        let bottom = if axis_z <= -cosine { -1.0 } else { axis_z * cosine - sines };
        // z_j = 1 - (2j+1)/N; one more on either side for rounding.
        let half = 0.5 * self.count as f32;
        let first = ((1.0 - top) * half - 2.0).max(0.0) as usize;
        let last = ((1.0 - bottom) * half + 2.0).max(0.0) as usize;
        let blocks = self.blocks();
        (first / BLOCK).min(blocks)..(last / BLOCK + 1).min(blocks)
    }

    /// V at one receiver.
    pub fn visibility(
        &self,
        spheres: &[BlockerSphere],
        order: usize,
        point: Vec3,
        normal: Vec3,
        body: Option<u32>,
        out: &mut [f32; 36],
    ) {
        out.fill(0.0);
        out[0] = whole();
        let Some(open) = self.open(spheres, point, normal, body) else { return };
        for (i, out) in out.iter_mut().enumerate().take(order * order) {
            *out -= open.blocked(self.basis(i));
        }
        out[0] = out[0].max(0.0);
    }
}

impl Open {
    /// sum_j (1 - v_j) weight_j over blocks of weights, in a fixed order.
    #[inline]
    pub fn blocked(&self, weights: &[[f32; BLOCK]]) -> f32 {
        let mut sums = [0.0; BLOCK];
        for ((v, weights), touched) in self.v.iter().zip(weights).zip(&self.touched) {
            if !touched {
                continue;
            }
            for ((sum, v), weight) in sums.iter_mut().zip(v).zip(weights) {
                *sum += (1.0 - v) * weight;
            }
        }
        let [a, b, c, d, e, f, g, h] = sums;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}
