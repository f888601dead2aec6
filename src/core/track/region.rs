//! Parts of a picture in which a tag is looked for.

use glam::{DVec2, IVec2};

/// Below this side a tag (10 cells with its white rim) cannot be told from noise.
pub const MIN_SIDE_PX: usize = 12;

/// A rectangle of whole pixels: columns x..x+width, rows y..y+height. Parts outside the picture are ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Columns.
    pub width: i32,
    /// Rows.
    pub height: i32,
}

impl Region {
    /// The smallest region that holds all points with a margin on every side; `None` for no or non-finite points.
    pub fn around(points_px: &[DVec2], margin_px: f64) -> Option<Self> {
        let mut low = DVec2::INFINITY;
        let mut high = DVec2::NEG_INFINITY;
        for &p in points_px {
            if !p.is_finite() {
                return None;
            }
            low = low.min(p);
            high = high.max(p);
        }
        if low.x > high.x {
            return None;
        }
        let limit = DVec2::splat(1e8);
        let low = (low - margin_px).floor().clamp(-limit, limit).as_ivec2();
        let high = (high + margin_px).ceil().clamp(-limit, limit).as_ivec2();
        Some(Self { x: low.x, y: low.y, width: high.x - low.x, height: high.y - low.y })
    }

    /// The part inside a picture; `None` where nothing (or less than a tag could show) is left.
    pub fn within(self, width: usize, height: usize) -> Option<Self> {
        let low = IVec2::new(self.x, self.y).max(IVec2::ZERO);
        let high = IVec2::new(self.x.saturating_add(self.width), self.y.saturating_add(self.height))
            .min(IVec2::new(width as i32, height as i32));
        let size = high - low;
        (size.min_element() >= MIN_SIDE_PX as i32).then_some(Self {
            x: low.x,
            y: low.y,
            width: size.x,
            height: size.y,
        })
    }

    /// The smallest region that holds both, if they overlap.
    pub fn joined(self, other: Self) -> Option<Self> {
        let apart = self.x >= other.x + other.width
            || other.x >= self.x + self.width
            || self.y >= other.y + other.height
            || other.y >= self.y + self.height;
        if apart {
            return None;
        }
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Some(Self { x, y, width: right - x, height: bottom - y })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_join_and_stay_within_the_picture() {
        let a = Region { x: 10, y: 10, width: 20, height: 20 };
        let b = Region { x: 25, y: 5, width: 10, height: 10 };
        assert_eq!(a.joined(b), Some(Region { x: 10, y: 5, width: 25, height: 25 }));
        assert_eq!(a.joined(Region { x: 30, ..b }), None);
        let huge = Region { x: i32::MIN, y: i32::MIN, width: i32::MAX, height: i32::MAX };
        assert_eq!(huge.within(640, 480), None);
        let all = Region { x: -5, y: -5, width: 5000, height: 5000 };
        assert_eq!(all.within(640, 480), Some(Region { x: 0, y: 0, width: 640, height: 480 }));
        assert_eq!(Region::around(&[], 3.0), None);
        assert_eq!(Region::around(&[DVec2::NAN], 3.0), None);
        assert!(Region::around(&[DVec2::splat(1e300)], 3.0).is_some());
    }
}
