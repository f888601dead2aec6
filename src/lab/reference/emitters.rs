//! Triangles that shine, and directions drawn towards them.
//!
//! Which triangle is drawn follows radiance times area over squared distance where there are few, and radiance times area
//! where there are many. The density of a direction counts all triangles that it meets, near or far, for any of them may
//! have been the one that gave it: then what is seen along the direction, whatever it is, over its density has the right
//! mean.

use crate::math::{
    bvh::{PreparedRay, ShapeTree, TriangleBlock},
    color::gray,
};
use glam::Vec3;

/// Up to so many triangles are weighed anew for every point.
const FEW: usize = 32;
/// From this extent on, about its solid angle, a triangle counts as near.
const NEAR: f32 = 0.3;
/// Triangles met one behind the other that are counted.
const MOST_MET: usize = 16;

/// A triangle that shines from its front.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    corner: Vec3,
    edge_u: Vec3,
    edge_v: Vec3,
    /// Unit, away from the front.
    normal: Vec3,
    area_m2: f32,
    gray: f32,
}

/// All of them.
#[derive(Debug, Default)]
pub struct Emitters {
    list: Vec<Emitter>,
    tree: ShapeTree<TriangleBlock>,
    /// Shares by radiance times area.
    shares: Vec<f32>,
    /// The same, cumulated.
    cumulated: Vec<f32>,
}

/// How likely each triangle is drawn from a point.
pub enum EmitterWeights {
    /// For each triangle its share; they sum to 1.
    Here([f32; FEW]),
    /// As `Emitters::shares`.
    Everywhere,
}

impl Emitters {
    /// Of triangles, counter-clockwise seen from the front, and their radiance.
    pub fn new(triangles: &[([Vec3; 3], [f32; 3])]) -> Self {
        let mut emitters = Self::default();
        for &([a, b, c], rgb) in triangles {
            let (edge_u, edge_v) = (b - a, c - a);
            let cross = edge_u.cross(edge_v);
            let (area_m2, normal, gray) = (0.5 * cross.length(), cross.normalize_or_zero(), gray(rgb));
            if area_m2 > 0.0 && area_m2.is_finite() && gray > 0.0 && gray.is_finite() {
                emitters.list.push(Emitter { corner: a, edge_u, edge_v, normal, area_m2, gray });
            }
        }
        let shape = |e: &Emitter| [e.corner, e.corner + e.edge_u, e.corner + e.edge_v];
        emitters.tree = ShapeTree::build(emitters.list.iter().map(shape));
        let total: f64 = emitters.list.iter().map(|e| f64::from(e.gray * e.area_m2)).sum();
        let mut sum = 0.0;
        for emitter in &emitters.list {
            let share = f64::from(emitter.gray * emitter.area_m2) / total;
            sum += share;
            emitters.shares.push(share as f32);
            emitters.cumulated.push(sum as f32);
        }
        emitters
    }

    /// Whether nothing shines.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Shares of the triangles as seen from a point of a surface, about how much light comes from them, in the unit of
    /// irradiance (0 where none can be seen), and the share of directions that the surface should draw itself: few, but where
    /// a triangle is so near that points spread over its area are a poor choice.
    #[inline]
    pub fn weigh(&self, point: Vec3, normal: Vec3) -> (EmitterWeights, f32, f32) {
        let mut weights = [0.0f32; FEW];
        let (mut sum, mut nearest) = (0.0, 0.0f32);
        if self.list.len() > FEW {
            let sum = self.list.iter().map(|e| e.gray * e.area_m2).sum::<f32>();
            return (EmitterWeights::Everywhere, sum, 0.5);
        }
        for (weight, emitter) in weights.iter_mut().zip(&self.list) {
            let to = emitter.corner - point;
            // From behind it is black, and below the horizon it is not seen.
            if emitter.normal.dot(to) >= 0.0 {
                continue;
            }
            let height = |p: Vec3| p.dot(normal);
            if height(to) <= 0.0 && height(to + emitter.edge_u) <= 0.0 && height(to + emitter.edge_v) <= 0.0 {
                continue;
            }
            let middle = to + (emitter.edge_u + emitter.edge_v) / 3.0;
            let extent = emitter.area_m2 / (middle.length_squared() + emitter.area_m2);
            *weight = emitter.gray * extent;
            sum += *weight;
            nearest = nearest.max(extent);
        }
        if sum > 0.0 {
            weights.iter_mut().for_each(|w| *w /= sum);
        }
        (EmitterWeights::Here(weights), sum, if nearest < NEAR { 0.125 } else { 0.5 })
    }

    /// A point on a triangle, drawn by the weights from two numbers in [0, 1); the point is spread evenly over its area.
    #[inline]
    pub fn draw(&self, weights: &EmitterWeights, numbers: [f32; 2]) -> Option<Vec3> {
        let (index, rest) = match weights {
            EmitterWeights::Here(list) => {
                let (mut index, mut left) = (None, numbers[0]);
                for (i, &weight) in list.iter().enumerate().take(self.list.len()) {
                    if weight > 0.0 {
                        index = Some((i, (left / weight).clamp(0.0, 1.0)));
                        if left < weight {
                            break;
                        }
                        left -= weight;
                    }
                }
                index?
            }
            EmitterWeights::Everywhere => {
                let at = self.cumulated.partition_point(|&c| c <= numbers[0]).min(self.list.len() - 1);
                let below = if at > 0 { self.cumulated[at - 1] } else { 0.0 };
                (at, ((numbers[0] - below) / self.shares[at]).clamp(0.0, 1.0))
            }
        };
        let emitter = &self.list[index];
        let root = rest.sqrt();
        Some(
            emitter.corner
                + emitter.edge_u * (root * (1.0 - numbers[1]))
                + emitter.edge_v * (root * numbers[1]),
        )
    }

    /// The density with which `draw` gives a unit direction from a point, per steradian.
    #[inline]
    pub fn density(&self, weights: &EmitterWeights, point: Vec3, direction: Vec3) -> f32 {
        let ray = PreparedRay::new(point, direction);
        let (mut sum, mut from) = (0.0, 0.0);
        for _ in 0..MOST_MET {
            let Some(hit) = self.tree.nearest(&ray, from, f32::INFINITY) else { break };
            let index = hit.shape as usize;
            let emitter = &self.list[index];
            let share = match weights {
                EmitterWeights::Here(list) => list[index],
                EmitterWeights::Everywhere => self.shares[index],
            };
            let facing = emitter.normal.dot(direction).abs();
            if share > 0.0 && facing > 0.0 {
                sum += share * hit.t * hit.t / (facing * emitter.area_m2);
            }
            from = hit.t * (1.0 + 2.0 * f32::EPSILON) + f32::MIN_POSITIVE;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::sequence::Sequence;

    #[test]
    fn one_over_the_density_is_the_solid_angle_seen() {
        // Two squares of different radiance, one partly behind the other: the mean of 1 / density over directions
        // drawn is the solid angle of all that can be drawn.
        let square = |z: f32, half: f32, x: f32| {
            let at = |sx: f32, sy: f32| Vec3::new(x + sx * half, sy * half, z);
            let (a, b, c, d) = (at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0), at(1.0, -1.0));
            [([a, b, c], [1.0f32, 2.0, 1.0]), ([a, c, d], [1.0, 2.0, 1.0])]
        };
        let mut triangles = square(1.0, 0.5, 0.0).to_vec();
        triangles.extend(square(2.0, 0.5, 0.6).map(|(t, _)| (t, [9.0; 3])));
        // The same cut into 64 triangles, which are too many to be weighed for each point.
        let fine = triangles.iter().flat_map(|&([a, b, c], rgb)| {
            let at = move |i: u8, j: u8| a + (b - a) * (f32::from(i) / 4.0) + (c - a) * (f32::from(j) / 4.0);
            (0..4u8).flat_map(move |i| (0..4 - i).map(move |j| (i, j))).flat_map(move |(i, j)| {
                let lower = ([at(i, j), at(i + 1, j), at(i, j + 1)], rgb);
                let upper = ([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], rgb);
                std::iter::once(lower).chain((i + j < 3).then_some(upper))
            })
        });
        let fine: Vec<_> = fine.collect();
        assert_eq!(fine.len(), 64);
        for many in [&triangles, &fine] {
            let emitters = Emitters::new(many);
            let (weights, sum, _) = emitters.weigh(Vec3::ZERO, Vec3::Z);
            assert!(sum > 0.0);
            let (mut first, count) = (0.0f64, 1 << 14);
            for i in 0..count {
                let numbers = Sequence::new(3, 0, 0, i).pair(0);
                let Some(at) = emitters.draw(&weights, numbers) else { panic!("nothing drawn") };
                let density = emitters.density(&weights, Vec3::ZERO, at.normalize());
                first += 1.0 / f64::from(density) / f64::from(count);
            }
            // By exact triangles: the front one, and of the back one what lies beside it (midpoint sums of cells).
            let (mut exact, cells) = (0.0f64, 1500u16);
            for i in 0..cells {
                for j in 0..cells {
                    // The plane z = 1, x in [-0.5, 0.55], y in [-0.5, 0.5].
                    let x = -0.5 + 1.05 * (f64::from(i) + 0.5) / f64::from(cells);
                    let y = -0.5 + (f64::from(j) + 0.5) / f64::from(cells);
                    let back = (0.05..0.55).contains(&x) && y.abs() < 0.25;
                    if x < 0.5 || back {
                        let r2 = x * x + y * y + 1.0;
                        exact += 1.05 / f64::from(cells) / f64::from(cells) / (r2 * r2.sqrt());
                    }
                }
            }
            assert!((first / exact - 1.0).abs() < 3e-3, "{}: {first} instead of {exact}", many.len());
        }
    }

    #[test]
    fn what_cannot_be_seen_has_no_weight() {
        let up = [[Vec3::ZERO, Vec3::X, Vec3::Y]].map(|t| (t, [1.0; 3]));
        let emitters = Emitters::new(&up);
        assert_eq!(emitters.weigh(Vec3::NEG_Z, Vec3::Z).1, 0.0);
        assert_eq!(emitters.weigh(Vec3::Z, Vec3::Z).1, 0.0);
        assert!(emitters.weigh(Vec3::Z, Vec3::NEG_Z).1 > 0.0);
        let none = [([Vec3::ZERO; 3], [1.0; 3]), ([Vec3::ZERO, Vec3::X, Vec3::Y], [0.0; 3])];
        assert!(Emitters::new(&none).is_empty());
        let (weights, ..) = emitters.weigh(Vec3::NEG_Z, Vec3::Z);
        assert!(emitters.draw(&weights, [0.5; 2]).is_none());
    }
}
