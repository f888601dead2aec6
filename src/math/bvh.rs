//! Which shape a ray meets first: a tree of boxes with four children a node, over triangles or over spheres, in f32. Four
//! boxes, four triangles or four spheres are tested at once.
//!
//! # What is exact
//! * The triangle test shears space so that the ray is the z axis and takes signs of edge functions, again in f64
//!   where one is zero in f32. Neighbouring triangles see the same edge function, so a ray through their common
//!   edge meets at least one of them: no leaks between triangles. Both sides of a triangle count.
//! * Boxes are a little wider than what is in them, and their test by its roundings, so that it never loses what the triangle
//!   test would find.
//! * Nothing is pushed off surfaces: t_min and t_max are the caller's, exclusive. A ray that starts on a surface of
//!   size s needs t_min (or an offset) of about 1e-4 s, for the hit distance is good to a few f32 steps of the
//!   coordinates only.
//! * Of several shapes at exactly the same t the one with the lowest index wins: what is found does not depend on the tree.
//!   Building and tracing do not depend on threads.
//!
//! Triangles without area, with an index out of range or with a coordinate that is not finite are never met.

mod build;
mod shapes;

use glam::{Vec3, Vec4};
pub use shapes::{SphereBlock, TriangleBlock};

/// Levels of a tree at most (`build::SAH_DEPTH`, then halvings of a u32 count), times the three children that wait on each.
const STACK: usize = 3 * (build::SAH_DEPTH as usize + 32) + 1;
/// Widens a distance to a box by the roundings of its subtraction, product and reciprocal, on both sides of a comparison.
const BOX_PADDING: f32 = 4.0 * (3.0 * f32::EPSILON);
/// No child.
const NONE: u32 = u32::MAX;
/// Marks a child that is a block of shapes.
const LEAF: u32 = 1 << 31;

/// Where a ray meets a triangle of a [`Bvh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// The point is `origin + t * direction`.
    pub t: f32,
    /// Index into the triangles given to `build`.
    pub triangle: u32,
    /// Weights of the triangle's three corners; they sum to 1.
    pub barycentric: [f32; 3],
}

/// The tree over an indexed mesh; owns a copy of the triangles.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    tree: ShapeTree<TriangleBlock>,
}

impl Bvh {
    /// Builds the tree over an indexed mesh. Triangles that cannot be met are left out (see the module).
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let corner = |i: u32| positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
        Self { tree: ShapeTree::build(triangles.iter().map(|corners| corners.map(corner))) }
    }

    /// Triangles that can be met.
    pub fn len(&self) -> usize {
        self.tree.count
    }

    /// True where no triangle can be met.
    pub fn is_empty(&self) -> bool {
        self.tree.count == 0
    }

    /// The smallest box around all triangles: its low and high corner. `None` where there are none.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        (!self.is_empty()).then_some(self.tree.bounds)
    }

    /// The nearest hit with t within (t_min, t_max), both sides. The direction need not be a unit vector: t counts
    /// in its length. `None` where there is no hit, or the ray is not finite or has no direction.
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<TriangleHit> {
        let ShapeHit { t, shape, weights } =
            self.tree.nearest(&PreparedRay::new(origin, direction), t_min, t_max)?;
        Some(TriangleHit { t, triangle: shape, barycentric: weights })
    }

    /// Whether anything lies on the ray within (t_min, t_max). Agrees with `intersect`.
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> bool {
        self.tree.occluded(&PreparedRay::new(origin, direction), t_min, t_max)
    }
}

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// The point is `origin + t * direction`.
    pub t: f32,
    /// Index of the shape, as given to `build`.
    pub shape: u32,
    /// Weights of a triangle's three corners, which sum to 1; 0 for spheres.
    pub weights: [f32; 3],
}

/// A ray with what its tests need. The direction need not be a unit vector.
#[derive(Clone, Copy, Debug)]
pub struct PreparedRay {
    /// Where it begins.
    pub origin: Vec3,
    /// Where it goes.
    pub direction: Vec3,
    reciprocal: Vec3,
    /// For each axis 1 where the ray runs downwards: which of a box's sides it meets first.
    downwards: [usize; 3],
    /// Axes x, y, z of the frame in which the ray is the z axis; z is the direction's largest component.
    axes: [usize; 3],
    shear: Vec3,
}

impl PreparedRay {
    /// Prepares a ray; one that is not finite, or has no direction, meets nothing.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let size = direction.abs();
        let z = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let shear = Vec3::new(direction[x] / direction[z], direction[y] / direction[z], 1.0 / direction[z]);
        // A component that is zero would make 0 * inf = NaN where the origin lies in a face's plane.
        let tiny = |c: f32| if c.abs() < 1e-30 { 1e-30f32.copysign(c) } else { c };
        let reciprocal = Vec3::new(tiny(direction.x), tiny(direction.y), tiny(direction.z)).recip();
        let downwards = reciprocal.to_array().map(|c| usize::from(c < 0.0));
        Self { origin, direction, reciprocal, downwards, axes: [x, y, z], shear }
    }

    #[inline]
    fn is_sound(&self) -> bool {
        self.origin.is_finite() && self.direction.is_finite() && self.direction != Vec3::ZERO
    }
}

/// Where along a ray a hit counts.
#[derive(Clone, Copy, Debug)]
pub struct HitRange {
    /// Beyond it.
    pub t_min: f32,
    /// Before it.
    pub t_max: f32,
    /// And no farther than this, where something has been met already.
    pub nearest: f32,
}

/// Four shapes that are tested at once.
pub trait ShapeBlock: Sized + Copy + Send + Sync {
    /// What it is made of.
    type Shape: Copy;
    /// A box around one shape; `None` for one that no ray can meet.
    fn bounds(shape: &Self::Shape) -> Option<(Vec3, Vec3)>;
    /// Of one to four shapes with their indices.
    fn pack(shapes: &[(Self::Shape, u32)]) -> Self;
    /// The nearest within reach; of several at one distance that of the lowest index.
    fn meet(&self, ray: &PreparedRay, reach: &HitRange) -> Option<ShapeHit>;
}

/// Four children: their boxes side by side, and what they are.
#[derive(Clone, Copy, Debug)]
struct BoxNode {
    /// Low sides, then high sides; of no child: infinity and its negative.
    sides: [[Vec4; 3]; 2],
    /// `NONE`, the index of a node, or `LEAF` and the index of a block.
    children: [u32; 4],
}

/// The tree over shapes of one kind.
#[derive(Clone, Debug)]
pub struct ShapeTree<B> {
    nodes: Vec<BoxNode>,
    blocks: Vec<B>,
    /// Shapes that can be met.
    count: usize,
    /// Around all of them.
    bounds: (Vec3, Vec3),
}

impl<B> Default for ShapeTree<B> {
    fn default() -> Self {
        Self { nodes: Vec::new(), blocks: Vec::new(), count: 0, bounds: (Vec3::INFINITY, Vec3::NEG_INFINITY) }
    }
}

impl<B: ShapeBlock> ShapeTree<B> {
    /// The nearest hit with t within (t_min, t_max), from either side.
    #[inline]
    pub fn nearest(&self, ray: &PreparedRay, t_min: f32, t_max: f32) -> Option<ShapeHit> {
        self.walk::<false>(ray, t_min, t_max)
    }

    /// Whether anything lies on the ray within (t_min, t_max).
    #[inline]
    pub fn occluded(&self, ray: &PreparedRay, t_min: f32, t_max: f32) -> bool {
        self.walk::<true>(ray, t_min, t_max).is_some()
    }

    fn walk<const ANY: bool>(&self, ray: &PreparedRay, t_min: f32, t_max: f32) -> Option<ShapeHit> {
        if self.nodes.is_empty() || !ray.is_sound() {
            return None;
        }
        let mut best: Option<ShapeHit> = None;
        let mut reach = HitRange { t_min, t_max, nearest: t_max };
        let mut stack = [(0u32, 0.0f32); STACK];
        stack[0] = (0, t_min);
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (child, entry) = stack[waiting];
            if entry > widened(reach.nearest) {
                continue;
            }
            if child & LEAF != 0 {
                let block = &self.blocks[(child & !LEAF) as usize];
                let Some(hit) = block.meet(ray, &reach) else { continue };
                if ANY {
                    return Some(hit);
                }
                if best.is_none_or(|b| (hit.t, hit.shape) < (b.t, b.shape)) {
                    reach.nearest = hit.t;
                    best = Some(hit);
                }
                continue;
            }
            let node = &self.nodes[child as usize];
            let (near, mask) = node.enters(ray, t_min, reach.nearest);
            if mask == 0 {
                continue;
            }
            let from = waiting;
            for k in 0..4 {
                if mask >> k & 1 == 1 {
                    stack[waiting] = (node.children[k], near[k]);
                    waiting += 1;
                }
            }
            if !ANY && waiting - from > 1 {
                // The nearest on top; insertion, for there are four at most.
                for i in from + 1..waiting {
                    let mut at = i;
                    while at > from && stack[at - 1].1 < stack[at].1 {
                        stack.swap(at - 1, at);
                        at -= 1;
                    }
                }
            }
        }
        best
    }
}

/// A distance, with room for roundings.
#[inline]
fn widened(t: f32) -> f32 {
    t + t.abs() * BOX_PADDING
}

impl BoxNode {
    /// Where the ray enters each child's box, and which of them it meets within [t_min, t_max], as bits.
    #[inline]
    fn enters(&self, ray: &PreparedRay, t_min: f32, t_max: f32) -> (Vec4, u32) {
        let (mut near, mut far) = (Vec4::splat(t_min), Vec4::splat(t_max));
        for axis in 0..3 {
            let origin = Vec4::splat(ray.origin[axis]);
            let reciprocal = Vec4::splat(ray.reciprocal[axis]);
            let front = ray.downwards[axis];
            near = near.max((self.sides[front][axis] - origin) * reciprocal);
            far = far.min((self.sides[1 - front][axis] - origin) * reciprocal);
        }
        // An empty child's far side is minus infinity, its sum not a number: not met.
        let mask = near.cmple(far + far.abs() * BOX_PADDING).bitmask();
        (near, mask)
    }
}

#[cfg(test)]
mod shape_tests;
#[cfg(test)]
mod tests;
