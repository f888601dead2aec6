//! The rungs that multiply: `dc`, `linear`, `hybrid`, `squared`, `chain`, for L receivers side by side.

use super::{
    Blockers, boxes,
    caps::{LaneCap, LaneVec, MOST_TESTED, drop_contained},
    not_of,
};
use crate::{
    math::sh::{
        MAX_ORDER,
        lanes::{Lane, LaneSh, add_zonal, guard, nothing, product},
        log_exp::{self, LogTable, whole},
    },
    model::blocker::Rung,
};

/// V of L receivers; N is the order.
pub fn visibility<const N: usize, const L: usize>(
    blockers: &Blockers,
    points: &LaneVec<L>,
    normals: &LaneVec<L>,
    body: Option<u32>,
) -> LaneSh<f32, L> {
    if blockers.rung == Rung::Directions {
        let both = (blockers.others(body), blockers.other_boxes(body));
        return blockers.directions.visibility::<N, L>(both, points, normals);
    }
    let mut product_of = BlockerProduct::<N, L>::new(blockers);
    // Which ones are tested does not depend on what the receivers see, nor on how these are grouped.
    let (tested, further) = blockers.spheres.split_at(blockers.spheres.len().min(MOST_TESTED));
    let cap_of = |sphere| LaneCap::of_sphere(sphere, points, normals);
    let mut caps = [LaneCap::nothing(); MOST_TESTED];
    let mut kept = 0;
    for (slot, cap) in caps.iter_mut().zip(not_of(tested, body).filter_map(cap_of)) {
        *slot = cap;
        kept += 1;
    }
    drop_contained(&mut caps[..kept]);
    for cap in &caps[..kept] {
        product_of.add(cap);
    }
    for cap in not_of(further, body).filter_map(cap_of) {
        product_of.add(&cap);
    }
    let mut v = product_of.finish();
    boxes::take_out::<N, L>(blockers.other_boxes(body), blockers.rung, points, normals, &mut v);
    v
}

/// A product of visibilities that grows cap by cap.
struct BlockerProduct<'a, const N: usize, const L: usize> {
    blockers: &'a Blockers,
    any: bool,
    /// Of the logarithm's rungs the sum of logarithms, of `chain` V, of `dc` V_0 alone.
    sum: LaneSh<f32, L>,
}

impl<'a, const N: usize, const L: usize> BlockerProduct<'a, N, L> {
    fn new(blockers: &'a Blockers) -> Self {
        let mut sum = nothing();
        if matches!(blockers.rung, Rung::Dc | Rung::Chain) {
            sum[0] = Lane::splat(whole());
        }
        Self { blockers, any: false, sum }
    }

    #[inline]
    fn add(&mut self, cap: &LaneCap<L>) {
        self.any = true;
        match self.blockers.rung {
            Rung::Dc => {
                // (1 + c)/2 = 1 - q/2.
                let mean = Lane::splat(1.0) - cap.q * 0.5;
                self.sum[0] = self.sum[0] * mean;
            }
            Rung::Chain => {
                let mut next = nothing();
                add_zonal::<f32, N, L>(cap.axis, &visible::<N, L>(cap), &mut next);
                let mut both = nothing();
                product::<f32, N, L>(&self.sum, &next, &mut both);
                guard::<f32, N, L>(&mut both);
                // Truncated constants are not quite 1: where there is no cap nothing may change.
                let hides = cap.q.0.map(|q| q > 0.0);
                for (sum, both) in self.sum.iter_mut().zip(both).take(N * N) {
                    *sum = both.or(hides, *sum);
                }
            }
            _ => {
                let scaled = log_lanes::<N, L>(&self.blockers.tables.log, cap);
                add_zonal::<f32, N, L>(cap.axis, &scaled, &mut self.sum);
            }
        }
    }

    fn finish(self) -> LaneSh<f32, L> {
        let mut v = nothing();
        if !self.any {
            v[0] = Lane::splat(whole());
            return v;
        }
        match self.blockers.rung {
            Rung::Dc | Rung::Chain => return self.sum,
            Rung::Hybrid => {
                log_exp::hybrid::<f32, N, L>(&self.sum, &self.blockers.tables.response, true, &mut v);
            }
            Rung::Squared => log_exp::squared::<f32, N, L>(&self.sum, true, &mut v),
            _ => {
                log_exp::linear::<f32, N, L>(&self.sum, &self.blockers.tables.response, &mut v);
                guard::<f32, N, L>(&mut v);
            }
        }
        v
    }
}

/// The logarithms of caps, from the table.
#[inline(always)]
fn log_lanes<const N: usize, const L: usize>(
    table: &LogTable<f32>,
    cap: &LaneCap<L>,
) -> [Lane<f32, L>; MAX_ORDER] {
    let mut scaled = [Lane::zero(); MAX_ORDER];
    for lane in 0..L {
        let g = table.at(cap.q.0[lane]);
        for l in 0..N {
            scaled[l].0[lane] = g[l];
        }
    }
    scaled
}

/// What caps leave visible, each band times sqrt(4 pi/(2l+1)): 4 pi - 2 pi q, and -2 pi R P_l'(c)/(l(l+1)) (Eq. 23 of
/// [Now11], exact).
#[inline(always)]
fn visible<const N: usize, const L: usize>(cap: &LaneCap<L>) -> [Lane<f32, L>; MAX_ORDER] {
    use std::f32::consts::PI;
    let mut scaled = [Lane::zero(); MAX_ORDER];
    scaled[0] = Lane::splat(4.0 * PI) - cap.q * (2.0 * PI);
    // P_l'(c) by (l-1) P_l' = (2l-1) c P_{l-1}' - l P_{l-2}'.
    let (mut below, mut slope) = (Lane::zero(), Lane::splat(1.0));
    for l in 1..N {
        let band = l as f32;
        if l > 1 {
            let next = (cap.cosine * slope * (2.0 * band - 1.0) - below * band) * (1.0 / (band - 1.0));
            (below, slope) = (slope, next);
        }
        scaled[l] = cap.sine_squared * slope * (-2.0 * PI / (band * (band + 1.0)));
    }
    scaled
}
