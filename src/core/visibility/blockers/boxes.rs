//! Boxes as receivers see them: at most three faces, each a rectangle whose solid angle is known exactly.
//!
//! With z the distance of a face's plane, (x, y) in it, tan t = x/z and h = y / sqrt(x^2 + y^2 + z^2), a rectangle's
//! solid angle is the integral of dt dh: t between two constants and h between two functions of t (the area of a sphere is
//! that of the cylinder around it). Nothing cancels however near or far the rectangle is, and the Gauss-Legendre rule in t
//! and h needs few nodes for harmonics.

use super::caps::LaneVec;
use crate::{
    math::sh::{
        MAX_COEFFICIENTS, MAX_ORDER, basis,
        lanes::{Lane, LaneSh, guard, nothing, product},
        log_exp::whole,
    },
    model::blocker::{BlockerBox, Rung},
};
use glam::Vec3;
use std::f32::consts::PI;

/// Squared distances, in square metres, from which a box is too far.
const FAR_M2: f32 = 1e30;
/// Nothing is divided by less.
const LEAST: f32 = 1e-30;
/// A side shorter than this share of the box's longest has two nodes, any other four.
const SHORT: f32 = 0.125;

/// Gauss-Legendre on 0 to 1: nodes and weights.
const TWO: [[f32; 2]; 2] = [[0.211_324_87, 0.5], [0.788_675_1, 0.5]];
const FOUR: [[f32; 2]; 4] = [
    [0.069_431_84, 0.173_927_42],
    [0.330_009_5, 0.326_072_58],
    [0.669_990_52, 0.326_072_58],
    [0.930_568_16, 0.173_927_42],
];

/// A hidden hemisphere, each band times sqrt(4 pi/(2l+1)): 2 pi P_l'(0)/(l(l+1)).
const HEMISPHERE: [f32; MAX_ORDER] = [2.0 * PI, PI, 0.0, -0.25 * PI, 0.0, 0.125 * PI];

/// A face as a receiver sees it.
#[derive(Clone, Copy, Debug)]
pub struct SeenFace {
    /// Unit: along its sides, and from the receiver straight to its plane.
    pub axes: [Vec3; 3],
    /// Where it begins and ends along the first two, from the receiver's foot in its plane, metres.
    pub low: [f32; 2],
    /// The ends.
    pub high: [f32; 2],
    /// How far its plane is, metres, above 0.
    pub depth: f32,
    /// Whether each side has few nodes.
    short: [bool; 2],
}

/// What a receiver sees of a box.
#[derive(Clone, Copy, Debug)]
pub enum SeenBox {
    /// It is wholly under the horizon, or not at a finite distance.
    Nothing,
    /// The receiver is in it: a hemisphere is hidden.
    Inside,
    /// Faces that look at the receiver; those under the horizon are left out.
    Faces([Option<SeenFace>; 3]),
}

/// What a receiver sees of a box.
pub fn seen(of: &BlockerBox, point_world: Vec3, normal: Vec3) -> SeenBox {
    let to = of.centre_world - point_world;
    let half = of.half_m.to_array();
    let at = of.axes_world.map(|axis| axis.dot(to));
    let up = of.axes_world.map(|axis| axis.dot(normal));
    // The height of what is highest of a part whose middle is at `at`.
    let height =
        |at: [f32; 3], half: [f32; 3]| -> f32 { (0..3).map(|k| at[k] * up[k] + half[k] * up[k].abs()).sum() };
    if !(height(at, half) > 0.0 && to.length_squared() < FAR_M2) {
        return SeenBox::Nothing;
    }
    if (0..3).all(|k| at[k].abs() <= half[k]) {
        return SeenBox::Inside;
    }
    let longest = of.half_m.max_element();
    SeenBox::Faces(std::array::from_fn(|k| {
        let depth = at[k].abs() - half[k];
        let (mut middle, mut flat) = (at, half);
        middle[k] = depth.copysign(at[k]);
        flat[k] = 0.0;
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        (depth > 0.0 && height(middle, flat) > 0.0).then(|| SeenFace {
            axes: [of.axes_world[i], of.axes_world[j], of.axes_world[k] * 1.0f32.copysign(at[k])],
            low: [at[i] - half[i], at[j] - half[j]],
            high: [at[i] + half[i], at[j] + half[j]],
            depth,
            short: [half[i] < SHORT * longest, half[j] < SHORT * longest],
        })
    }))
}

impl SeenFace {
    /// Adds the integral of each y_i over its solid angle.
    fn add_hidden(&self, order: usize, out: &mut [f32; MAX_COEFFICIENTS]) {
        let nodes = |side: usize| if self.short[side] { &TWO[..] } else { &FOUR[..] };
        let z = self.depth;
        let first = self.low[0].atan2(z);
        let span = (z * (self.high[0] - self.low[0])).atan2(z * z + self.low[0] * self.high[0]);
        let mut y = [0.0f32; MAX_COEFFICIENTS];
        for [t, weight] in nodes(0) {
            let (sin, cos) = (first + t * span).sin_cos();
            let along = |y: f32| y * cos / (z * z + y * y * cos * cos).sqrt().max(LEAST);
            let (begin, end) = (along(self.low[1]), along(self.high[1]));
            for [u, weight_u] in nodes(1) {
                let h = begin + u * (end - begin);
                let across = (1.0 - h * h).max(0.0).sqrt();
                let direction =
                    self.axes[0] * (across * sin) + self.axes[1] * h + self.axes[2] * (across * cos);
                basis::evaluate(order, direction.to_array(), &mut y);
                let solid_angle = weight * weight_u * span * (end - begin);
                for (out, y) in out.iter_mut().zip(y).take(order * order) {
                    *out += solid_angle * y;
                }
            }
        }
    }
}

/// The integral of each y_i over what a box hides from a receiver; `None` where that is nothing.
pub fn hidden(
    of: &BlockerBox,
    order: usize,
    point_world: Vec3,
    normal: Vec3,
) -> Option<[f32; MAX_COEFFICIENTS]> {
    let mut out = [0.0; MAX_COEFFICIENTS];
    match seen(of, point_world, normal) {
        SeenBox::Nothing => return None,
        SeenBox::Inside => {
            basis::evaluate(order, normal.to_array(), &mut out);
            for (i, out) in out.iter_mut().enumerate().take(order * order) {
                *out *= HEMISPHERE[i.isqrt()];
            }
        }
        SeenBox::Faces(faces) => faces.iter().flatten().for_each(|face| face.add_hidden(order, &mut out)),
    }
    (out[0] > 0.0).then_some(out)
}

/// Takes what boxes hide from L receivers out of their V: by one product for each box, of `dc` by its mean.
pub fn take_out<'a, const N: usize, const L: usize>(
    boxes: impl Iterator<Item = &'a BlockerBox>,
    rung: Rung,
    points: &LaneVec<L>,
    normals: &LaneVec<L>,
    v: &mut LaneSh<f32, L>,
) {
    let of_lane = |vector: &LaneVec<L>, lane: usize| Vec3::from(vector.each_ref().map(|v| v.0[lane]));
    let order = if rung == Rung::Dc { 1 } else { N };
    for of in boxes {
        let mut open: LaneSh<f32, L> = nothing();
        let mut hides = [false; L];
        for lane in 0..L {
            let hidden = hidden(of, order, of_lane(points, lane), of_lane(normals, lane));
            hides[lane] = hidden.is_some();
            for (open, hidden) in open.iter_mut().zip(hidden.unwrap_or([0.0; MAX_COEFFICIENTS])) {
                open.0[lane] = -hidden;
            }
            open[0].0[lane] = (open[0].0[lane] + whole::<f32>()).max(0.0);
        }
        if !hides.contains(&true) {
            continue;
        }
        let mut both: LaneSh<f32, L> = nothing();
        if rung == Rung::Dc {
            both[0] = v[0] * open[0] * (1.0 / whole::<f32>());
        } else {
            product::<f32, N, L>(v, &open, &mut both);
            guard::<f32, N, L>(&mut both);
        }
        for (v, both) in v.iter_mut().zip(both).take(N * N) {
            *v = both.or(hides, *v);
        }
    }
}

/// A face as four planes through the receiver and its sides, softened for fixed directions.
#[derive(Clone, Copy)]
struct SoftFace<const L: usize> {
    /// Normals that point inwards over h: of the sides across x, then of those across y.
    sides: [LaneVec<L>; 4],
    /// Cosine of the angle between the normals of two sides that face each other.
    facing: [Lane<f32, L>; 2],
    /// How much all four are one plane: 1 close to the face.
    joined: Lane<f32, L>,
    /// 1, or 0 where there is no such face.
    is_seen: Lane<f32, L>,
    /// Whether any receiver sees it.
    any: bool,
}

/// What a box hides of each fixed direction, from L receivers.
pub struct SoftBox<const L: usize>([SoftFace<L>; 3]);

impl<const L: usize> SoftBox<L> {
    /// `softness`: h of the directions. `None` where the box hides nothing from any of them.
    pub fn of(of: &BlockerBox, points: &LaneVec<L>, normals: &LaneVec<L>, softness: f32) -> Option<Self> {
        let zero = Lane::zero();
        // Sides that face each other with nothing between them: no direction is on the inner side of both.
        let none = SoftFace {
            sides: [[zero; 3]; 4],
            facing: [Lane::splat(-1.0); 2],
            joined: zero,
            is_seen: zero,
            any: false,
        };
        let mut faces = [none; 3];
        for lane in 0..L {
            let of_lane = |vector: &LaneVec<L>| Vec3::from(vector.each_ref().map(|v| v.0[lane]));
            match seen(of, of_lane(points), of_lane(normals)) {
                SeenBox::Nothing => {}
                SeenBox::Inside => faces[0].put_hemisphere(lane, of_lane(normals) / softness),
                SeenBox::Faces(list) => {
                    for (face, seen) in faces.iter_mut().zip(&list) {
                        if let Some(seen) = seen {
                            face.put(lane, seen, softness);
                        }
                    }
                }
            }
        }
        for face in &mut faces {
            face.any = face.is_seen.0.contains(&1.0);
        }
        faces.iter().any(|face| face.any).then_some(Self(faces))
    }

    /// The share of a direction that is hidden.
    #[inline(always)]
    pub fn at(&self, direction: [f32; 3]) -> Lane<f32, L> {
        let mut sum = Lane::zero();
        for face in self.0.iter().filter(|face| face.any) {
            face.add(direction, &mut sum);
        }
        sum.at_most(1.0)
    }
}

impl<const L: usize> SoftFace<L> {
    fn put(&mut self, lane: usize, seen: &SeenFace, softness: f32) {
        let z = seen.depth;
        let mut joined = 1.0;
        for side in 0..2 {
            let (low, high) = (seen.low[side], seen.high[side]);
            let lengths = [low, high].map(|x| (x * x + z * z).sqrt().max(LEAST));
            let inwards = [
                (seen.axes[side] * z - seen.axes[2] * low) / lengths[0],
                (seen.axes[2] * high - seen.axes[side] * z) / lengths[1],
            ];
            for (end, inwards) in inwards.into_iter().enumerate() {
                self.put_side(lane, 2 * side + end, inwards / softness);
            }
            self.facing[side].0[lane] = -(z * z + low * high) / (lengths[0] * lengths[1]);
            joined *= 0.5 * (high / lengths[1] - low / lengths[0]);
        }
        self.joined.0[lane] = joined;
        self.is_seen.0[lane] = 1.0;
    }

    fn put_hemisphere(&mut self, lane: usize, normal: Vec3) {
        for side in 0..4 {
            self.put_side(lane, side, normal);
        }
        let [across, along] = &mut self.facing;
        for one in [across, along, &mut self.joined, &mut self.is_seen] {
            one.0[lane] = 1.0;
        }
    }

    fn put_side(&mut self, lane: usize, side: usize, normal: Vec3) {
        for (slot, n) in self.sides[side].iter_mut().zip(normal.to_array()) {
            slot.0[lane] = n;
        }
    }

    #[inline(always)]
    fn add(&self, [x, y, z]: [f32; 3], sum: &mut Lane<f32, L>) {
        let inner = |side: usize| {
            let n = &self.sides[side];
            (n[0] * x + n[1] * y + n[2] * z + Lane::splat(0.5)).at_least(0.0).at_most(1.0)
        };
        let across = both(inner(0), inner(1), self.facing[0]);
        // Most directions are beside the box for all receivers of a batch.
        if across.0.iter().all(|share| *share == 0.0) {
            return;
        }
        let along = both(inner(2), inner(3), self.facing[1]);
        *sum += both(across, along, self.joined) * self.is_seen;
    }
}

/// The share of a direction's surroundings that is on the inner side of two edges, of the shares on that of each, and the
/// cosine of the angle between the edges' normals: the lesser where the edges are one, the product where they are at right
/// angles, what is left of both where they face each other.
#[inline(always)]
fn both<const L: usize>(a: Lane<f32, L>, b: Lane<f32, L>, cosine: Lane<f32, L>) -> Lane<f32, L> {
    let mut out = a;
    for lane in 0..L {
        let (a, b, cosine) = (a.0[lane], b.0[lane], cosine.0[lane]);
        let lesser = if a < b { a } else { b };
        let rest = a + b - 1.0;
        let rest = if rest > 0.0 { rest } else { 0.0 };
        let extreme = if cosine > 0.0 { lesser } else { rest };
        let size = cosine.abs();
        out.0[lane] = (1.0 - size) * (a * b) + size * extreme;
    }
    out
}

#[cfg(test)]
mod tests;
