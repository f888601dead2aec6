//! Boxes, and the exact test whether a box reaches into the shaft between two others (Section 6 of [Gib03]).

use glam::Vec3;

/// An axis-aligned box, world frame, metres; flat ones and points are fine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Corner of the least coordinates.
    pub low: Vec3,
    /// Corner of the greatest coordinates.
    pub high: Vec3,
}

impl Aabb {
    /// A box that contains nothing; joined with another it gives that one.
    pub const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    /// The smallest box around points.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { low: b.low.min(p), high: b.high.max(p) })
    }

    /// The smallest box around two.
    pub fn join(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// The point half way between both corners.
    pub fn centre(&self) -> Vec3 {
        self.low.midpoint(self.high)
    }

    /// Length of the diagonal; 0 where it is empty.
    pub fn diagonal(&self) -> f32 {
        (self.high - self.low).max(Vec3::ZERO).length()
    }

    /// Whether a point lies in it, the border counting.
    pub fn contains(&self, point: Vec3) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }

    /// Whether all its corners are finite and in order.
    pub fn is_sound(&self) -> bool {
        self.low.is_finite() && self.high.is_finite() && self.low.cmple(self.high).all()
    }
}

/// Where the segments from `source` (t = 0) to `receiver` (t = 1) can meet `object`: the interval of t, or `None` where
/// no segment between the two boxes meets it. Exact: the convex hull of two boxes is the union over t of the boxes
/// (1 - t) source + t receiver, and each axis bounds t by two linear inequalities. An empty or unsound box meets nothing.
pub fn shaft_interval(source: &Aabb, receiver: &Aabb, object: &Aabb) -> Option<[f32; 2]> {
    let (mut first, mut last) = (0.0f32, 1.0f32);
    for axis in 0..3 {
        // Two numbers that are linear in t and must not be negative, by their values at both ends: how far the object's
        // high is above low(t), and high(t) above its low.
        let below = [object.high[axis] - source.low[axis], object.high[axis] - receiver.low[axis]];
        let above = [source.high[axis] - object.low[axis], receiver.high[axis] - object.low[axis]];
        for [a, b] in [below, above] {
            if a >= 0.0 && b >= 0.0 {
                continue;
            }
            if a >= 0.0 {
                last = last.min(a / (a - b));
            } else if b >= 0.0 {
                first = first.max(a / (a - b));
            } else {
                return None;
            }
        }
    }
    (first <= last).then_some([first, last])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxed(corner: [f32; 3], size: [f32; 3]) -> Aabb {
        let low = Vec3::from(corner);
        Aabb { low, high: low + Vec3::from(size) }
    }

    /// Whether the segments meet, with all boxes grown by `grow`: by a fine walk along t, which needs no inequality.
    fn brute(a: &Aabb, b: &Aabb, c: &Aabb, grow: f32) -> bool {
        (0..=2000).any(|i| {
            let t = i as f32 / 2000.0;
            let (low, high) = (a.low.lerp(b.low, t) - grow, a.high.lerp(b.high, t) + grow);
            low.cmple(c.high).all() && high.cmpge(c.low).all()
        })
    }

    #[test]
    fn points_and_flat_boxes() {
        let point = |x: f32, y: f32, z: f32| boxed([x, y, z], [0.0; 3]);
        let (a, b) = (point(0.0, 0.0, 0.0), point(2.0, 2.0, 0.0));
        assert_eq!(shaft_interval(&a, &b, &point(1.0, 1.0, 0.0)), Some([0.5, 0.5]));
        assert_eq!(shaft_interval(&a, &b, &point(1.0, 0.9, 0.0)), None);
        assert_eq!(shaft_interval(&a, &a, &a), Some([0.0, 1.0]));
        // A wall's own plane is part of its shafts.
        let wall = boxed([0.0, 0.0, 0.0], [1.0, 0.0, 1.0]);
        assert!(shaft_interval(&wall, &wall, &point(0.5, 0.0, 0.5)).is_some());
        assert!(shaft_interval(&wall, &wall, &point(0.5, -0.001, 0.5)).is_none());
        assert_eq!(shaft_interval(&a, &b, &Aabb::EMPTY), None);
        let nan = Aabb { low: Vec3::NAN, high: Vec3::NAN };
        assert_eq!(shaft_interval(&a, &b, &nan), None);
        assert!(!nan.is_sound() && !Aabb::EMPTY.is_sound() && a.is_sound());
    }

    proptest! {
        #[test]
        fn as_by_walking_along(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
            sizes in prop::array::uniform3(prop::array::uniform3(0.0f32..0.6)),
            flat in 0usize..9,
        ) {
            let mut sizes = sizes;
            sizes[flat / 3][flat % 3] = 0.0;
            let [a, b, c] = [0, 1, 2].map(|i| boxed(corners[i], sizes[i]));
            let met = shaft_interval(&a, &b, &c).is_some();
            // A step moves a box by at most 1/500 of its way of at most 2 along an axis.
            if brute(&a, &b, &c, 0.0) {
                prop_assert!(met);
            }
            if met {
                prop_assert!(brute(&a, &b, &c, 0.002));
            }
            prop_assert_eq!(met, shaft_interval(&b, &a, &c).is_some(), "the way back");
        }

        #[test]
        fn every_segment_that_is_met_is_found(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
            sizes in prop::array::uniform3(prop::array::uniform3(0.0f32..0.6)),
            ends in prop::array::uniform2(prop::array::uniform3(0.0f32..1.0)), t in 0.0f32..1.0,
        ) {
            let [a, b, c] = [0, 1, 2].map(|i| boxed(corners[i], sizes[i]));
            let within = |b: &Aabb, u: [f32; 3]| b.low + (b.high - b.low) * Vec3::from(u);
            let place = within(&a, ends[0]).lerp(within(&b, ends[1]), t);
            // The object moved to where the segment passes, by its middle.
            let moved = Aabb { low: place - (c.high - c.low) * 0.5 - 1e-6, high: place + (c.high - c.low) * 0.5 + 1e-6 };
            prop_assert!(shaft_interval(&a, &b, &moved).is_some());
        }
    }
}
