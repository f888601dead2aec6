//! How much of the soft light spheres leave to a receiver: every rung of the accuracy ladder (Section 6.2 of [Now11],
//! spec 6 and 7). Shader functions of the same: `shaders/shared/blockers.wgsl`. Boxes stand for what is thin: whatever the
//! rung, V of the spheres is multiplied by what each leaves, and `directions` are tested against its faces.
//!
//! A frame calls [`Blockers::prepare`] once; then receivers ask from any number of threads. One receiver and a batch of
//! eight go through the same code, so results do not depend on how receivers are grouped.

mod boxes;
mod caps;
mod directions;
mod ladder;
mod plane;
mod shader_terms;
#[cfg(test)]
mod tests;

pub use crate::model::blocker::{SHADER_BOXES, SHADER_SPHERES};
pub use boxes::hidden as box_hidden;
pub use plane::BlockedPlane;
pub use shader_terms::{BlockerTables, BlockerTerms};

use crate::{
    math::sh::{
        MAX_COEFFICIENTS, MAX_ORDER,
        lanes::LaneSh,
        log_exp::{self, Tables, tables},
    },
    model::blocker::{BlockerBox, BlockerSphere, Rung},
};
use caps::lanes_of;
use directions::FixedDirections;
use glam::Vec3;

/// Receivers that are taken side by side. Sixteen make a product cheaper and all else dearer, and in a frame most of the
/// time is the caps': `linear` and `hybrid` at order 4 with 20 spheres took a tenth longer by sixteens.
pub const LANES: usize = 8;

/// Directions that the rung `directions` may test.
pub const DIRECTIONS: std::ops::RangeInclusive<usize> = 32..=256;

/// Everything of one frame's blockers that does not depend on the receiver, for one rung and order.
#[derive(Clone, Debug)]
pub struct Blockers {
    spheres: Vec<BlockerSphere>,
    boxes: Vec<BlockerBox>,
    rung: Rung,
    order: usize,
    tables: &'static Tables,
    directions: FixedDirections,
}

impl Default for Blockers {
    fn default() -> Self {
        Self::new()
    }
}

impl Blockers {
    /// No sphere, rung `linear`, order 2.
    pub fn new() -> Self {
        Self {
            spheres: Vec::new(),
            boxes: Vec::new(),
            rung: Rung::Linear,
            order: 2,
            tables: tables(2),
            directions: FixedDirections::default(),
        }
    }

    /// Takes over the spheres of a frame. Those without a finite centre or a finite radius above 0 hide nothing and are
    /// left out, as are those inside another sphere of their body (but for `directions`, where they do no harm).
    /// `order` is taken into 2..=6 and `directions` into [`DIRECTIONS`]. Memory is kept from frame to frame.
    pub fn prepare(&mut self, spheres: &[BlockerSphere], rung: Rung, order: usize, directions: usize) {
        self.rung = rung;
        self.order = order.clamp(2, MAX_ORDER);
        self.tables = tables(self.order);
        self.spheres.clear();
        self.boxes.clear();
        let sound =
            |s: &&BlockerSphere| s.centre_world.is_finite() && s.radius_m.is_finite() && s.radius_m > 0.0;
        for sphere in spheres.iter().filter(sound) {
            let within = |a: &BlockerSphere, b: &BlockerSphere| {
                a.body == b.body && a.centre_world.distance(b.centre_world) + a.radius_m <= b.radius_m
            };
            if rung != Rung::Directions {
                if self.spheres.iter().any(|other| within(sphere, other)) {
                    continue;
                }
                self.spheres.retain(|other| !within(other, sphere));
            }
            self.spheres.push(*sphere);
        }
        if rung == Rung::Directions {
            self.directions.prepare(directions.clamp(*DIRECTIONS.start(), *DIRECTIONS.end()), self.order);
        }
    }

    /// Takes over the boxes of a frame, after [`Blockers::prepare`], which forgets those of the last. What is not finite or
    /// has no area from any side is left out.
    pub fn add_boxes(&mut self, boxes: &[BlockerBox]) {
        self.boxes.extend(boxes.iter().filter(|b| b.is_sound()));
    }

    /// The rung in use.
    pub fn rung(&self) -> Rung {
        self.rung
    }

    /// The SH order in use, 2 to 6.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Spheres that count.
    pub fn spheres(&self) -> &[BlockerSphere] {
        &self.spheres
    }

    /// Boxes that count.
    pub fn boxes(&self) -> &[BlockerBox] {
        &self.boxes
    }

    /// Whether any sphere or box is not of this body.
    pub fn has_others(&self, body: u32) -> bool {
        self.spheres.iter().any(|s| s.body != body) || self.boxes.iter().any(|b| b.body != body)
    }

    /// What the rung `directions` tests: unit directions (world), h and sin(h/2) of their ramps, and the mean of each y_i,
    /// i > 0, over them. Of the last [`Blockers::prepare`] with that rung.
    pub fn directions(&self) -> (&[[f32; 3]], [f32; 2], &[f32]) {
        (self.directions.list(), self.directions.softness(), self.directions.means())
    }

    /// SH coefficients of the visibility V at a receiver: a point and a unit normal, world frame, metres. Spheres of the
    /// receiver's own `body` and spheres wholly under its horizon do not count. order^2 coefficients are written and the
    /// rest set to 0. Where nothing blocks V is exactly (sqrt(4 pi), 0, ..).
    ///
    /// V_0 is in [0, sqrt(4 pi)] and |V_{l>0}| <= sqrt(sqrt(4 pi) V_0 - V_0^2) up to rounding, whatever the spheres; the
    /// second up to a tenth with the rung `directions` where these are fewer than the coefficients (32 at order 6).
    pub fn visibility(&self, point_world: Vec3, normal: Vec3, body: Option<u32>, out: &mut [f32; 36]) {
        let v = self.lanes::<1>(&[point_world], &[normal], body);
        for (i, (out, v)) in out.iter_mut().zip(v).enumerate() {
            *out = if i < self.order * self.order { v.0[0] } else { 0.0 };
        }
    }

    /// [`Blockers::visibility`] of many receivers, eight at a time; `visit` is told the receiver's number and its V, in
    /// order. The shorter list says how many there are.
    pub fn visibility_many(
        &self,
        points_world: &[Vec3],
        normals: &[Vec3],
        body: Option<u32>,
        mut visit: impl FnMut(usize, &[f32; 36]),
    ) {
        let mut one = [0.0; MAX_COEFFICIENTS];
        let count = points_world.len().min(normals.len());
        for first in (0..count).step_by(LANES) {
            let size = (count - first).min(LANES);
            // The last one stands in for those that are missing.
            let of = |lane: usize| first + lane.min(size - 1);
            let points: [Vec3; LANES] = std::array::from_fn(|lane| points_world[of(lane)]);
            let normals: [Vec3; LANES] = std::array::from_fn(|lane| normals[of(lane)]);
            let v = self.lanes(&points, &normals, body);
            for lane in 0..size {
                for (one, v) in one.iter_mut().zip(&v).take(self.order * self.order) {
                    *one = v.0[lane];
                }
                visit(first + lane, &one);
            }
        }
    }

    /// The soft light that reaches a receiver past the spheres, and without them: sum_i t_i V_i for each channel, t the
    /// receiver's transfer row (M^{Lg} f+, Eq. 18 to 20 of [Now11]), and t_0 sqrt(4 pi). The first may be below 0, as
    /// truncated sums are: clamp the final shade.
    pub fn shade(
        &self,
        point_world: Vec3,
        normal: Vec3,
        body: Option<u32>,
        transfer: &[[f32; 3]; 36],
    ) -> ([f32; 3], [f32; 3]) {
        let mut v = [0.0; MAX_COEFFICIENTS];
        self.visibility(point_world, normal, body, &mut v);
        (gather(self.order, transfer, &v), unblocked(transfer))
    }

    /// The spheres that are not of a body.
    fn others(&self, body: Option<u32>) -> impl Iterator<Item = &BlockerSphere> {
        not_of(&self.spheres, body)
    }

    /// The boxes that are not of a body.
    fn other_boxes(&self, body: Option<u32>) -> impl Iterator<Item = &BlockerBox> {
        self.boxes.iter().filter(move |b| Some(b.body) != body)
    }

    /// V of L receivers.
    fn lanes<const L: usize>(
        &self,
        points: &[Vec3; L],
        normals: &[Vec3; L],
        body: Option<u32>,
    ) -> LaneSh<f32, L> {
        let (points, normals) = (&lanes_of(points), &lanes_of(normals));
        match self.order {
            2 => ladder::visibility::<2, L>(self, points, normals, body),
            3 => ladder::visibility::<3, L>(self, points, normals, body),
            4 => ladder::visibility::<4, L>(self, points, normals, body),
            5 => ladder::visibility::<5, L>(self, points, normals, body),
            _ => ladder::visibility::<6, L>(self, points, normals, body),
        }
    }
}

/// Those of some spheres that are not of a body.
fn not_of(spheres: &[BlockerSphere], body: Option<u32>) -> impl Iterator<Item = &BlockerSphere> {
    spheres.iter().filter(move |sphere| Some(sphere.body) != body)
}

/// sum_i t_i V_i for each channel.
fn gather(order: usize, transfer: &[[f32; 3]; 36], v: &[f32; 36]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (t, v) in transfer.iter().zip(v).take(order * order) {
        for (sum, t) in sum.iter_mut().zip(t) {
            *sum += t * v;
        }
    }
    sum
}

/// The sum where nothing blocks.
fn unblocked(transfer: &[[f32; 3]; 36]) -> [f32; 3] {
    transfer[0].map(|t| t * log_exp::whole::<f32>())
}
