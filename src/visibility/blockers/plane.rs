//! Receivers that share a normal and a transfer row: a plane.

use super::{Blockers, LANES, gather, unblocked};
use crate::{math::sh::MAX_COEFFICIENTS, model::blocker::Rung};
use glam::Vec3;

/// What all points of a plane share, made by [`Blockers::plane`]. Keeps its memory.
#[derive(Clone, Debug)]
pub struct Plane {
    normal: Vec3,
    body: Option<u32>,
    transfer: [[f32; 3]; 36],
    unblocked: [f32; 3],
    /// W_j = (4 pi/N) sum_i t_i y_i(w_j) in blocks, each channel.
    weights: [Vec<[f32; 8]>; 3],
}

impl Default for Plane {
    fn default() -> Self {
        Self {
            normal: Vec3::Z,
            body: None,
            transfer: [[0.0; 3]; MAX_COEFFICIENTS],
            unblocked: [0.0; 3],
            weights: [const { Vec::new() }; 3],
        }
    }
}

impl Plane {
    /// The soft light where nothing blocks: t_0 sqrt(4 pi), each channel.
    pub fn unblocked(&self) -> [f32; 3] {
        self.unblocked
    }
}

impl Blockers {
    /// Prepares a plane of unit normal `normal` (world) and transfer row `transfer` (as for [`Blockers::shade`]) for these
    /// blockers; to be made anew after each [`Blockers::prepare`].
    pub fn plane(&self, normal: Vec3, body: Option<u32>, transfer: &[[f32; 3]; 36], plane: &mut Plane) {
        (plane.normal, plane.body, plane.transfer) = (normal, body, *transfer);
        plane.unblocked = unblocked(transfer);
        for (channel, weights) in plane.weights.iter_mut().enumerate() {
            weights.clear();
            if self.rung != Rung::Directions {
                continue;
            }
            weights.resize(self.directions.blocks(), [0.0; 8]);
            for (i, t) in transfer.iter().enumerate().take(self.order * self.order) {
                for (weights, y) in weights.iter_mut().zip(self.directions.basis(i)) {
                    for (weight, y) in weights.iter_mut().zip(y) {
                        *weight += t[channel] * y;
                    }
                }
            }
        }
    }

    /// The soft light that reaches points of a plane (world frame, metres) past the spheres, each channel; exactly
    /// [`Plane::unblocked`] where nothing blocks. Gives what [`Blockers::shade`] gives, for `directions` up to rounding,
    /// at a fraction of the time. The shorter list says how many points there are.
    pub fn shade_plane(&self, plane: &Plane, points_world: &[Vec3], out: &mut [[f32; 3]]) {
        if self.rung == Rung::Directions {
            for (point, out) in points_world.iter().zip(out) {
                *out = plane.unblocked;
                if let Some(open) = self.directions.open(&self.spheres, *point, plane.normal, plane.body) {
                    for (out, weights) in out.iter_mut().zip(&plane.weights) {
                        *out -= open.blocked(weights);
                    }
                }
            }
            return;
        }
        let normals = [plane.normal; LANES];
        for (points, out) in points_world.chunks(LANES).zip(out.chunks_mut(LANES)) {
            let last = points.len() - 1;
            let points: [Vec3; LANES] = std::array::from_fn(|lane| points[lane.min(last)]);
            let v = self.lanes(&points, &normals, plane.body);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = gather(self.order, &plane.transfer, &v.map(|v| v.0[lane]));
            }
        }
    }
}
