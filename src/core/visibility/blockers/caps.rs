//! Spheres as caps, for L receivers side by side.

use crate::{math::sh::lanes::Lane, model::blocker::BlockerSphere};
use glam::Vec3;

/// Spheres, the first of the list, whose caps are tested for lying in each other; further ones are taken as they are.
pub const MOST_TESTED: usize = 64;

/// Below this 1 - cos(half angle) a cap changes nothing that an f32 can show.
const SMALLEST: f32 = 1e-7;

/// Squared distances, in square metres, below which a receiver stands at the centre, and from which a sphere is too far.
const NEAR_FAR_M2: (f32, f32) = (1e-30, 1e30);

/// How far cos(angle) may fall short of cos(s2 - s1): rounding, so that equal caps count as lying in each other.
const TOUCHING: f32 = 5e-7;

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

/// Side by side.
pub fn lanes_of<const L: usize>(vectors: &[Vec3; L]) -> LaneVec<L> {
    [Lane(vectors.map(|v| v.x)), Lane(vectors.map(|v| v.y)), Lane(vectors.map(|v| v.z))]
}

#[inline(always)]
fn dot<const L: usize>(a: &LaneVec<L>, b: &LaneVec<L>) -> Lane<f32, L> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
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
        let centre = sphere.centre_world.to_array();
        let mut to = *points;
        for (to, centre) in to.iter_mut().zip(centre) {
            *to = Lane::splat(centre) - *to;
        }
        let horizon = -sphere.radius_m;
        let radius = dot(&to, normals).map(|height| if height > horizon { -horizon } else { 0.0 });
        if radius.0.iter().all(|radius| *radius == 0.0) {
            return None;
        }
        let square = dot(&to, &to);
        let (near, far) = NEAR_FAR_M2;
        let inverse = square.map(|square| 1.0 / square.sqrt());
        let mut axis = to.map(|v| v * inverse);
        let mut ratio = radius * inverse;
        if !square.0.iter().all(|square| *square > near && *square < far) {
            for lane in 0..L {
                if !(square.0[lane] > near && square.0[lane] < far) {
                    ratio.0[lane] = if square.0[lane] <= near { 1.0 } else { 0.0 };
                    for (axis, normal) in axis.iter_mut().zip(normals) {
                        axis.0[lane] = normal.0[lane];
                    }
                }
            }
        }
        let mut sine_squared = (ratio * ratio).at_most(1.0);
        let mut cosine = sine_squared.map(|r| (1.0 - r).sqrt());
        let mut q = sine_squared.zip(cosine, |r, c| r / (1.0 + c));
        let mut any = false;
        for lane in 0..L {
            let counts = q.0[lane] > SMALLEST;
            any |= counts;
            q.0[lane] = if counts { q.0[lane] } else { 0.0 };
            sine_squared.0[lane] = if counts { sine_squared.0[lane] } else { 0.0 };
            cosine.0[lane] = if counts { cosine.0[lane] } else { 1.0 };
        }
        any.then_some(Self { axis, sine_squared, cosine, q })
    }
}

/// Hides nothing any more with caps that lie in another: angle between the axes + s1 <= s2. Of equal ones the first
/// stays.
pub fn drop_contained<const L: usize>(caps: &mut [LaneCap<L>]) {
    let mut sines = [Lane::zero(); MOST_TESTED];
    for (sine, cap) in sines.iter_mut().zip(caps.iter()) {
        *sine = cap.sine_squared.sqrt();
    }
    // Not below 0 where one lies in the other: cos(angle) - cos(s2 - s1).
    let excess = |a: &LaneCap<L>, sine_a: &Lane<f32, L>, b: &LaneCap<L>, sine_b: &Lane<f32, L>| {
        dot(&a.axis, &b.axis) + Lane::splat(TOUCHING) - (a.cosine * b.cosine + *sine_a * *sine_b)
    };
    for j in 1..caps.len().min(MOST_TESTED) {
        let (before, rest) = caps.split_at_mut(j);
        let Some(second) = rest.first_mut() else { return };
        let mut largest = Lane::splat(-1.0);
        for (first, sine) in before.iter().zip(&sines) {
            let excess = excess(first, sine, second, &sines[j]);
            largest = largest.zip(excess, |a, b| if a > b { a } else { b });
        }
        // Hardly ever is one in another.
        if largest.0.iter().all(|largest| *largest < 0.0) {
            continue;
        }
        for (first, sine) in before.iter_mut().zip(&sines) {
            let excess = excess(first, sine, second, &sines[j]);
            for lane in 0..L {
                let (q1, q2) = (first.q.0[lane], second.q.0[lane]);
                let inside = excess.0[lane] >= 0.0;
                first.q.0[lane] = if inside & (q1 < q2) { 0.0 } else { q1 };
                second.q.0[lane] = if inside & (q1 >= q2) { 0.0 } else { q2 };
            }
        }
    }
}
