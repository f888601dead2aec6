//! Which triangle a ray meets first: a bounding volume hierarchy over triangles, built by binned surface-area
//! heuristic, in f32.
//!
//! # What is exact
//! * The triangle test shears space so that the ray is the z axis and takes signs of edge functions, again in f64
//!   where one is zero in f32. Neighbouring triangles see the same edge function, so a ray through their common
//!   edge meets at least one of them: no leaks between triangles. Both sides of a triangle count.
//! * The box test is widened by three roundings, so that it never loses what the triangle test would find.
//! * Nothing is pushed off surfaces: t_min and t_max are the caller's, exclusive. A ray that starts on a surface of
//!   size s needs t_min (or an offset) of about 1e-4 s, for the hit distance is good to a few f32 steps of the
//!   coordinates only.
//! * Of several triangles at exactly the same t the one with the lowest index wins. Building and tracing do not
//!   depend on threads.
//!
//! Triangles without area, with an index out of range or with a coordinate that is not finite are never met.

use glam::Vec3;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point is `origin + t * direction`.
    pub t: f32,
    /// Index into the triangles given to `build`.
    pub triangle: u32,
    /// Weights of the triangle's three corners; they sum to 1.
    pub barycentric: [f32; 3],
}

/// Triangles up to this many are a leaf without further ado.
const SMALL_LEAF: usize = 4;
/// A leaf larger than this is always split, if need be by count.
const LARGE_LEAF: usize = 16;
const BINS: usize = 16;
/// From this depth on nodes are halved by count, which bounds the depth.
const SAH_DEPTH: u32 = 40;
/// `SAH_DEPTH` levels and then at most 32 halvings of a u32 count; one node waits for each level.
const STACK: usize = 80;
/// Widens a box distance by the rounding of its subtraction, product and reciprocal: 2 gamma(3).
const BOX_PADDING: f32 = 1.0 + 2.0 * (3.0 * f32::EPSILON);

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    /// A leaf's first triangle, or an inner node's left child (the right one follows it).
    first: u32,
    high: Vec3,
    /// A leaf's triangles; 0 for an inner node.
    count: u32,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    corners: [Vec3; 3],
    index: u32,
}

/// The hierarchy; owns a copy of the triangles.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

impl Bvh {
    /// Builds the hierarchy over an indexed mesh. Triangles that cannot be met are left out (see the module).
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let mut items: Vec<Item> = Vec::with_capacity(triangles.len());
        for (index, corners) in triangles.iter().enumerate() {
            let corner = |i: u32| positions.get(i as usize).copied().filter(|p| p.is_finite());
            let [Some(a), Some(b), Some(c)] = corners.map(corner) else { continue };
            if (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3()).length_squared() == 0.0 {
                continue;
            }
            let bounds = Bounds { low: a.min(b).min(c), high: a.max(b).max(c) };
            let centre = bounds.low * 0.5 + bounds.high * 0.5;
            let triangle = Triangle { corners: [a, b, c], index: index as u32 };
            items.push(Item { bounds, centre, triangle });
        }
        let nodes = build_nodes(&mut items);
        Self { nodes, triangles: items.into_iter().map(|item| item.triangle).collect() }
    }

    /// Triangles that can be met.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// True where no triangle can be met.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The smallest box around all triangles: its low and high corner. `None` where there are none.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.nodes.first().map(|root| (root.low, root.high))
    }

    /// The nearest hit with t within (t_min, t_max), both sides. The direction need not be a unit vector: t counts
    /// in its length. `None` where there is no hit, or the ray is not finite or has no direction.
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<Hit> {
        self.walk::<false>(origin, direction, t_min, t_max)
    }

    /// Whether anything lies on the ray within (t_min, t_max). Agrees with `intersect`.
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> bool {
        self.walk::<true>(origin, direction, t_min, t_max).is_some()
    }

    fn walk<const ANY: bool>(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<Hit> {
        if self.nodes.is_empty() {
            return None;
        }
        let ray = Ray::new(origin, direction)?;
        let mut best: Option<Hit> = None;
        let mut limit = t_max;
        let mut stack = [0u32; STACK];
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let node = &self.nodes[stack[waiting] as usize];
            if ray.enters(node, t_min, limit).is_none() {
                continue;
            }
            if node.count > 0 {
                let first = node.first as usize;
                for triangle in &self.triangles[first..first + node.count as usize] {
                    let Some(hit) = ray.meets(triangle, t_min, t_max) else { continue };
                    if ANY {
                        return Some(hit);
                    }
                    let nearer = best.is_none_or(|b| (hit.t, hit.triangle) < (b.t, b.triangle));
                    if nearer {
                        limit = hit.t;
                        best = Some(hit);
                    }
                }
                continue;
            }
            // The nearer child is looked at first.
            let (left, right) = (node.first, node.first + 1);
            let enters = |child: u32| ray.enters(&self.nodes[child as usize], t_min, limit);
            let order = match (enters(left), enters(right)) {
                (None, None) => continue,
                (Some(_), None) => [None, Some(left)],
                (None, Some(_)) => [None, Some(right)],
                (Some(l), Some(r)) if l <= r => [Some(right), Some(left)],
                (Some(_), Some(_)) => [Some(left), Some(right)],
            };
            for child in order.into_iter().flatten() {
                stack[waiting] = child;
                waiting += 1;
            }
        }
        best
    }
}

/// A ray prepared for box and triangle tests.
struct Ray {
    origin: Vec3,
    reciprocal: Vec3,
    negative: [bool; 3],
    /// Axes: z is the direction's largest component, x and y keep the handedness.
    axes: [usize; 3],
    shear: Vec3,
}

impl Ray {
    fn new(origin: Vec3, direction: Vec3) -> Option<Self> {
        if !origin.is_finite() || !direction.is_finite() || direction == Vec3::ZERO {
            return None;
        }
        let size = direction.abs();
        let z = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let shear = Vec3::new(direction[x] / direction[z], direction[y] / direction[z], 1.0 / direction[z]);
        Some(Self {
            origin,
            reciprocal: direction.recip(),
            negative: [direction.x, direction.y, direction.z].map(|c| c.is_sign_negative()),
            axes: [x, y, z],
            shear,
        })
    }

    /// Where the ray enters a box within [t_min, t_max]. A zero times infinity (origin in a face's plane) gives
    /// NaN, which `max` and `min` pass over, so such a face does not bound the ray.
    fn enters(&self, node: &Node, t_min: f32, t_max: f32) -> Option<f32> {
        let (mut near, mut far) = (t_min, t_max);
        for axis in 0..3 {
            let (front, back) = if self.negative[axis] {
                (node.high[axis], node.low[axis])
            } else {
                (node.low[axis], node.high[axis])
            };
            let entry = (front - self.origin[axis]) * self.reciprocal[axis];
            let exit = (back - self.origin[axis]) * self.reciprocal[axis];
            // Widened away from the box, whatever the sign.
            near = near.max(if entry > 0.0 { entry / BOX_PADDING } else { entry * BOX_PADDING });
            far = far.min(if exit > 0.0 { exit * BOX_PADDING } else { exit / BOX_PADDING });
        }
        (near <= far).then_some(near)
    }

    /// The test of Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013), both sides.
    fn meets(&self, triangle: &Triangle, t_min: f32, t_max: f32) -> Option<Hit> {
        let [x, y, z] = self.axes;
        let corners = triangle.corners.map(|corner| corner - self.origin);
        let [a, b, c] =
            corners.map(|p| [p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z], self.shear.z * p[z]]);
        let mut u = c[0] * b[1] - c[1] * b[0];
        let mut v = a[0] * c[1] - a[1] * c[0];
        let mut w = b[0] * a[1] - b[1] * a[0];
        if u == 0.0 || v == 0.0 || w == 0.0 {
            let edge = |p: [f32; 3], q: [f32; 3]| {
                (f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])) as f32
            };
            (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        let barycentric = [u, v, w].map(|weight| weight / determinant);
        let t = barycentric[0] * a[2] + barycentric[1] * b[2] + barycentric[2] * c[2];
        (t > t_min && t < t_max).then_some(Hit { t, triangle: triangle.index, barycentric })
    }
}

#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

impl Bounds {
    const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn half_area(self) -> f64 {
        let size = (self.high.as_dvec3() - self.low.as_dvec3()).max(glam::DVec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

#[derive(Clone, Copy)]
struct Item {
    bounds: Bounds,
    centre: Vec3,
    triangle: Triangle,
}

/// Sorts the items into leaves and returns the nodes, the root first.
fn build_nodes(items: &mut [Item]) -> Vec<Node> {
    let mut nodes = Vec::new();
    if items.is_empty() {
        return nodes;
    }
    let empty = Node { low: Vec3::ZERO, first: 0, high: Vec3::ZERO, count: 0 };
    nodes.push(empty);
    let mut open = vec![(0usize, 0usize, items.len(), 0u32)];
    while let Some((at, first, count, depth)) = open.pop() {
        let range = &mut items[first..first + count];
        let bounds = range.iter().fold(Bounds::EMPTY, |sum, item| sum.join(item.bounds));
        nodes[at] = Node { low: bounds.low, first: first as u32, high: bounds.high, count: count as u32 };
        let Some(left) = split(range, bounds, depth) else { continue };
        let children = nodes.len();
        nodes[at].first = children as u32;
        nodes[at].count = 0;
        nodes.extend([empty; 2]);
        open.push((children + 1, first + left, count - left, depth + 1));
        open.push((children, first, left, depth + 1));
    }
    nodes
}

/// Partitions the items in two and says how many are left; `None` where they are best left as a leaf.
fn split(items: &mut [Item], bounds: Bounds, depth: u32) -> Option<usize> {
    let count = items.len();
    if count <= SMALL_LEAF {
        return None;
    }
    let centres =
        items.iter().fold(Bounds::EMPTY, |sum, i| sum.join(Bounds { low: i.centre, high: i.centre }));
    let extent = centres.high - centres.low;
    let longest =
        [0, 1, 2].into_iter().fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
    let halve = |items: &mut [Item]| {
        items.select_nth_unstable_by(count / 2, |a, b| {
            let order = a.centre[longest].total_cmp(&b.centre[longest]);
            order.then(a.triangle.index.cmp(&b.triangle.index))
        });
        count / 2
    };
    if depth >= SAH_DEPTH {
        return Some(halve(items));
    }
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        if extent[axis] <= 0.0 || !extent[axis].is_finite() {
            continue;
        }
        let mut bins = [(Bounds::EMPTY, 0usize); BINS];
        for item in items.iter() {
            let bin = &mut bins[bin_of(item, axis, centres)];
            *bin = (bin.0.join(item.bounds), bin.1 + 1);
        }
        // Cost of the right side for each cut, then of the left side while walking up.
        let mut right_cost = [0.0f64; BINS];
        let (mut sum, mut number) = (Bounds::EMPTY, 0);
        for cut in (1..BINS).rev() {
            sum = sum.join(bins[cut].0);
            number += bins[cut].1;
            right_cost[cut] = if number > 0 { sum.half_area() * number as f64 } else { 0.0 };
        }
        let (mut sum, mut number) = (Bounds::EMPTY, 0);
        for cut in 1..BINS {
            sum = sum.join(bins[cut - 1].0);
            number += bins[cut - 1].1;
            if number == 0 || number == count {
                continue;
            }
            let cost = sum.half_area() * number as f64 + right_cost[cut];
            if best.is_none_or(|(lowest, ..)| cost < lowest) {
                best = Some((cost, axis, cut));
            }
        }
    }
    // Going one level down costs about as much as one triangle test.
    let leaf_cost = bounds.half_area() * (count as f64 - 1.0);
    match best {
        Some((cost, axis, cut)) if cost < leaf_cost || count > LARGE_LEAF => {
            Some(partition(items, |item| bin_of(item, axis, centres) < cut))
        }
        None if count > LARGE_LEAF => Some(halve(items)),
        _ => None,
    }
}

fn bin_of(item: &Item, axis: usize, centres: Bounds) -> usize {
    let share = (item.centre[axis] - centres.low[axis]) / (centres.high[axis] - centres.low[axis]);
    ((share * BINS as f32) as usize).min(BINS - 1)
}

/// Moves the items that are `left` to the front; returns how many.
fn partition(items: &mut [Item], left: impl Fn(&Item) -> bool) -> usize {
    let mut front = 0;
    for at in 0..items.len() {
        if left(&items[at]) {
            items.swap(front, at);
            front += 1;
        }
    }
    front
}

#[cfg(test)]
mod tests;
