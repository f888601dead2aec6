//! Which shape a ray meets first: a tree of boxes with four children a node, over triangles or over spheres, in f32.
//!
//! Like `math::bvh` the triangle test leaks nowhere between triangles that share an edge (the edge function is the same
//! number from both sides, and zero counts as met). Four boxes, four triangles or four spheres are tested at once, which
//! makes it about twice as fast; nothing here depends on threads.

mod build;
mod leaves;

use glam::{Vec3, Vec4};
pub use leaves::{SphereBlock, TriangleBlock};

/// Levels of a tree at most, times the three children that wait on each.
const STACK: usize = 3 * 64 + 1;
/// Widens a box distance by the rounding of its subtraction, product and reciprocal: 2 gamma(3).
const BOX_PADDING: f32 = 1.0 + 2.0 * (3.0 * f32::EPSILON);
/// No child.
const NONE: u32 = u32::MAX;
/// Marks a child that is a block of shapes.
const LEAF: u32 = 1 << 31;

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point is `origin + t * direction`.
    pub t: f32,
    /// Index of the shape, as given to `build`.
    pub shape: u32,
    /// Weights of a triangle's second and third corner; 0 for spheres.
    pub weights: [f32; 2],
}

/// A ray with what its tests need. The direction need not be a unit vector.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
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

impl Ray {
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
        let inverse = 1.0 / direction[z];
        let shear = Vec3::new(direction[x] * inverse, direction[y] * inverse, inverse);
        // A component that is zero would make 0 * inf = NaN where the origin lies in a face's plane.
        let tiny = |c: f32| if c.abs() < 1e-30 { 1e-30f32.copysign(c) } else { c };
        let reciprocal = Vec3::new(tiny(direction.x), tiny(direction.y), tiny(direction.z)).recip();
        let downwards = reciprocal.to_array().map(|c| usize::from(c < 0.0));
        Self { origin, direction, reciprocal, downwards, axes: [x, y, z], shear }
    }
}

/// Four shapes that are tested at once.
pub trait Block: Sized + Copy + Send + Sync {
    /// What it is made of.
    type Shape: Copy;
    /// A box around one shape; `None` for one that no ray can meet.
    fn bounds(shape: &Self::Shape) -> Option<(Vec3, Vec3)>;
    /// Of one to four shapes with their indices.
    fn pack(shapes: &[(Self::Shape, u32)]) -> Self;
    /// The nearest with t in (t_min, t_max).
    fn meet(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit>;
}

/// Four children: their boxes side by side, and what they are.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Low sides, then high sides; of no child: infinity and its negative.
    sides: [[Vec4; 3]; 2],
    /// `NONE`, the index of a node, or `LEAF` and the index of a block.
    children: [u32; 4],
}

/// The tree.
#[derive(Clone, Debug)]
pub struct Caster<B> {
    nodes: Vec<Node>,
    blocks: Vec<B>,
}

impl<B> Default for Caster<B> {
    fn default() -> Self {
        Self { nodes: Vec::new(), blocks: Vec::new() }
    }
}

impl<B: Block> Caster<B> {
    /// The nearest hit with t within (t_min, t_max), from either side.
    #[inline]
    pub fn nearest(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit> {
        self.walk::<false>(ray, t_min, t_max)
    }

    /// Whether anything lies on the ray within (t_min, t_max).
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_min: f32, t_max: f32) -> bool {
        self.walk::<true>(ray, t_min, t_max).is_some()
    }

    fn walk<const ANY: bool>(&self, ray: &Ray, t_min: f32, t_max: f32) -> Option<Hit> {
        if self.nodes.is_empty() {
            return None;
        }
        let mut best: Option<Hit> = None;
        let mut limit = t_max;
        let mut stack = [(0u32, 0.0f32); STACK];
        stack[0] = (0, t_min);
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (child, entry) = stack[waiting];
            if entry > limit {
                continue;
            }
            if child & LEAF != 0 {
                let block = &self.blocks[(child & !LEAF) as usize];
                if let Some(hit) = block.meet(ray, t_min, limit) {
                    if ANY {
                        return Some(hit);
                    }
                    limit = hit.t;
                    best = Some(hit);
                }
                continue;
            }
            let node = &self.nodes[child as usize];
            let (near, mask) = node.enters(ray, t_min, limit);
            if mask == 0 {
                continue;
            }
            let from = waiting;
            for k in 0..4 {
                if mask >> k & 1 == 1 && waiting < STACK {
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

impl Node {
    /// Where the ray enters each child's box, and which of them it meets within [t_min, t_max], as bits.
    #[inline]
    fn enters(&self, ray: &Ray, t_min: f32, t_max: f32) -> (Vec4, u32) {
        let (mut near, mut far) = (Vec4::splat(t_min), Vec4::splat(t_max));
        for axis in 0..3 {
            let origin = Vec4::splat(ray.origin[axis]);
            let reciprocal = Vec4::splat(ray.reciprocal[axis]);
            let front = ray.downwards[axis];
            near = near.max((self.sides[front][axis] - origin) * reciprocal);
            far = far.min((self.sides[1 - front][axis] - origin) * reciprocal);
        }
        // Widened away from the box; distances before t_min do not matter.
        let mask = near.cmple(far * BOX_PADDING).bitmask();
        (near, mask)
    }
}

#[cfg(test)]
mod tests;
