//! Spheres as caps, for L receivers side by side.

use crate::{math::sh::lanes::Lane, model::blocker::BlockerSphere};
use glam::Vec3;

/// Caps that are tested for lying in each other; further ones are taken as they are.
pub const MOST_TESTED: usize = 64;

/// Below this 1 - cos(half angle) a cap changes nothing that an f32 can show.
const SMALLEST: f32 = 1e-7;

/// Points or directions of L receivers.
pub type LaneVec<const L: usize> = [Lane<f32, L>; 3];

/// One cap of each receiver.
#[derive(Clone, Copy)]
pub struct LaneCap<const L: usize> {
    /// Unit vector towards the sphere.
    pub axis: LaneVec<L>,
    /// R = sin^2 of the half angle.
    pub sine_squared: Lane<f32, L>,
    /// c.
    pub cosine: Lane<f32, L>,
    /// q = 1 - c: 0 where nothing is hidden.
    pub q: Lane<f32, L>,
}

impl<const L: usize> LaneCap<L> {
    /// Nothing hidden.
    pub fn nothing() -> Self {
        let zero = Lane::zero();
        Self { axis: [zero; 3], sine_squared: zero, cosine: Lane::splat(1.0), q: zero }
    }

    /// The cap that a sphere hides from each receiver; `None` where it hides nothing from any: wholly under the horizon
    /// (n.(C-x) <= -r), too small, or not at a finite distance. From inside a hemisphere is hidden, from the very centre
    /// the one about the normal.
    #[inline(always)]
    pub fn of_sphere(sphere: &BlockerSphere, points: &LaneVec<L>, normals: &LaneVec<L>) -> Option<Self> {
        let radius = sphere.radius_m;
        let centre = sphere.centre_world.to_array();
        let to: LaneVec<L> = std::array::from_fn(|k| Lane::splat(centre[k]) - points[k]);
        let square = to[0] * to[0] + to[1] * to[1] + to[2] * to[2];
        let height = to[0] * normals[0] + to[1] * normals[1] + to[2] * normals[2];
        let apart: [bool; L] = square.0.map(|d2| d2 > f32::MIN_POSITIVE);
        let near: [bool; L] = std::array::from_fn(|lane| {
            (height.0[lane] > -radius || !apart[lane]) && square.0[lane] <= f32::MAX
        });
        let one = Lane::splat(1.0);
        let inverse = square.or(apart, one).map(|d2| 1.0 / d2);
        let root = inverse.sqrt();
        let axis = std::array::from_fn(|k| (to[k] * root).or(apart, normals[k]));
        let ratio = Lane::splat(radius) * root;
        let sine_squared = (ratio * ratio).at_most(1.0).or(apart, one);
        let cosine = (one - sine_squared).sqrt();
        let q = sine_squared.zip(cosine, |r, c| r / (1.0 + c));
        let counts: [bool; L] = std::array::from_fn(|lane| near[lane] && q.0[lane] > SMALLEST);
        if !counts.contains(&true) {
            return None;
        }
        let zero = Lane::zero();
        Some(Self {
            axis: axis.map(|v| v.or(counts, zero)),
            sine_squared: sine_squared.or(counts, zero),
            cosine: cosine.or(counts, one),
            q: q.or(counts, zero),
        })
    }
}

/// Side by side.
pub fn lanes_of<const L: usize>(vectors: &[Vec3; L]) -> LaneVec<L> {
    [Lane(vectors.map(|v| v.x)), Lane(vectors.map(|v| v.y)), Lane(vectors.map(|v| v.z))]
}

/// Hides nothing any more with caps that lie in another: angle between the axes + s1 <= s2. Of equal ones the first
/// stays.
pub fn drop_contained<const L: usize>(caps: &mut [LaneCap<L>]) {
    let mut sines = [Lane::zero(); MOST_TESTED];
    for (sine, cap) in sines.iter_mut().zip(caps.iter()) {
        *sine = cap.sine_squared.sqrt();
    }
    let count = caps.len().min(MOST_TESTED);
    for j in 1..count {
        let (before, rest) = caps.split_at_mut(j);
        let second = &mut rest[0];
        for (first, sine) in before.iter_mut().zip(&sines) {
            let [a, b] = [first.axis, second.axis];
            let along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            // cos(s2 - s1)
            let needed = first.cosine * second.cosine + *sine * sines[j];
            for lane in 0..L {
                let inside = along.0[lane] >= needed.0[lane];
                let (q1, q2) = (first.q.0[lane], second.q.0[lane]);
                first.q.0[lane] = if inside & (q1 < q2) { 0.0 } else { q1 };
                second.q.0[lane] = if inside & (q1 >= q2) { 0.0 } else { q2 };
            }
        }
    }
}
