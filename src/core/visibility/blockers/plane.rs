//! Receivers that share a normal and a transfer row: a plane.

use super::{Blockers, LANES, caps::lanes_of, gather, unblocked};
use crate::{
    math::sh::{MAX_COEFFICIENTS, lanes::Lane},
    model::blocker::Rung,
};
use glam::Vec3;

/// What all points of a plane share, made by [`Blockers::plane`]. Keeps its memory.
#[derive(Clone, Debug)]
pub struct BlockedPlane {
    normal: Vec3,
    body: Option<u32>,
    transfer: [[f32; 3]; 36],
    unblocked: [f32; 3],
    /// W_j = (4 pi/N) sum_i t_i y_i(w_j), each channel.
    pub(super) weights: Vec<[f32; 3]>,
}

impl Default for BlockedPlane {
    fn default() -> Self {
        Self {
            normal: Vec3::Z,
            body: None,
            transfer: [[0.0; 3]; MAX_COEFFICIENTS],
            unblocked: [0.0; 3],
            weights: Vec::new(),
        }
    }
}

impl BlockedPlane {
    /// Unit, world frame.
    pub fn normal(&self) -> Vec3 {
        self.normal
    }

    /// What is taken, each channel, for each direction that is wholly blocked (rung `directions`), else for each
    /// coefficient of 1 - V.
    pub fn terms(&self) -> &[[f32; 3]] {
        if self.weights.is_empty() { &self.transfer } else { &self.weights }
    }

    /// The soft light where nothing blocks: t_0 sqrt(4 pi), each channel.
    pub fn unblocked(&self) -> [f32; 3] {
        self.unblocked
    }
}

impl Blockers {
    /// Prepares a plane of unit normal `normal` (world) and transfer row `transfer` (as for [`Blockers::shade`]) for these
    /// blockers; to be made anew after each [`Blockers::prepare`].
    pub fn plane(
        &self,
        normal: Vec3,
        body: Option<u32>,
        transfer: &[[f32; 3]; 36],
        plane: &mut BlockedPlane,
    ) {
        (plane.normal, plane.body, plane.transfer) = (normal, body, *transfer);
        plane.unblocked = unblocked(transfer);
        plane.weights.clear();
        if self.rung == Rung::Directions {
            let rows = self.directions.basis().iter();
            plane.weights.extend(rows.map(|row| gather(self.order, transfer, row)));
        }
    }

    /// The soft light that reaches points of a plane (world frame, metres) past the spheres, each channel; exactly
    /// [`BlockedPlane::unblocked`] where nothing blocks. Gives what [`Blockers::shade`] gives, for `directions` up to rounding,
    /// at a fraction of the time. The shorter list says how many points there are.
    pub fn shade_plane(&self, plane: &BlockedPlane, points_world: &[Vec3], out: &mut [[f32; 3]]) {
        let normals = [plane.normal; LANES];
        for (points, out) in points_world.chunks(LANES).zip(out.chunks_mut(LANES)) {
            let last = points.len() - 1;
            let points: [Vec3; LANES] = std::array::from_fn(|lane| points[lane.min(last)]);
            let mut sums = [Lane::splat(0.0); 3];
            if self.rung == Rung::Directions {
                let (points, normals) = (lanes_of(&points), lanes_of(&normals));
                let both = (self.others(plane.body), self.other_boxes(plane.body));
                if let Some(open) = self.directions.open(both, &points, &normals) {
                    open.add_blocked(&plane.weights, 3, &mut sums);
                }
                sums = std::array::from_fn(|c| Lane::splat(plane.unblocked[c]) - sums[c]);
            } else {
                let v = self.lanes(&points, &normals, plane.body);
                for (v, row) in v.iter().zip(&plane.transfer).take(self.order * self.order) {
                    for (sum, t) in sums.iter_mut().zip(row) {
                        *sum += *v * *t;
                    }
                }
            }
            for (lane, out) in out.iter_mut().enumerate() {
                *out = sums.map(|sum| sum.0[lane]);
            }
        }
    }
}
