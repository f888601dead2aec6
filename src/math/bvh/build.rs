//! Building the tree: ranges are split by binned surface-area heuristic until a node has four children.

use super::{BoxNode, LEAF, NONE, ShapeBlock, ShapeTree};
use glam::{Vec3, Vec4};

/// Shapes of a block.
const LANES: usize = 4;
const BINS: usize = 16;
/// From this depth on ranges are halved by count, which bounds the depth at this and the logarithm of the count.
pub(super) const SAH_DEPTH: u32 = 40;
/// A box is wider than what is in it by this share of its coordinates, and by this length at least: a ray within the plane of a
/// face then runs inside.
const ROOM: (f32, f32) = (f32::EPSILON, 1e-20);

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

    fn half_area(self) -> f32 {
        let size = (self.high - self.low).max(Vec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

#[derive(Clone, Copy)]
struct Item<S> {
    bounds: Bounds,
    centre: Vec3,
    shape: S,
    index: u32,
}

/// A run of items, and the box around them.
#[derive(Clone, Copy)]
struct Run {
    first: usize,
    count: usize,
    bounds: Bounds,
    depth: u32,
}

impl<B: ShapeBlock> ShapeTree<B> {
    /// Builds the tree; shapes that no ray can meet (not finite, without size) are left out. `shape` in hits counts all of
    /// them.
    pub fn build(shapes: impl Iterator<Item = B::Shape>) -> Self {
        let mut items: Vec<Item<B::Shape>> = Vec::with_capacity(shapes.size_hint().0);
        for (index, shape) in shapes.enumerate() {
            let Some((low, high)) = B::bounds(&shape) else { continue };
            let (bounds, centre) = (Bounds { low, high }, 0.5 * low + 0.5 * high);
            items.push(Item { bounds, centre, shape, index: index as u32 });
        }
        let mut tree = Self::default();
        if items.is_empty() {
            return tree;
        }
        let whole = Run { first: 0, count: items.len(), bounds: around(&items), depth: 0 };
        (tree.count, tree.bounds) = (items.len(), (whole.bounds.low, whole.bounds.high));
        tree.nodes.push(empty());
        let mut open = vec![(0usize, whole)];
        while let Some((at, run)) = open.pop() {
            let children = four(&mut items, run);
            for (k, child) in children.into_iter().enumerate() {
                for axis in 0..3 {
                    let [low, high] = [child.bounds.low[axis], child.bounds.high[axis]];
                    tree.nodes[at].sides[0][axis][k] = low - (low.abs() * ROOM.0).max(ROOM.1);
                    tree.nodes[at].sides[1][axis][k] = high + (high.abs() * ROOM.0).max(ROOM.1);
                }
                tree.nodes[at].children[k] = if child.count <= LANES {
                    tree.leaf(&items[child.first..child.first + child.count])
                } else {
                    tree.nodes.push(empty());
                    open.push((tree.nodes.len() - 1, child));
                    (tree.nodes.len() - 1) as u32
                };
            }
        }
        tree
    }

    fn leaf(&mut self, items: &[Item<B::Shape>]) -> u32 {
        let shapes: Vec<(B::Shape, u32)> = items.iter().map(|i| (i.shape, i.index)).collect();
        self.blocks.push(B::pack(&shapes));
        LEAF | (self.blocks.len() - 1) as u32
    }
}

fn empty() -> BoxNode {
    let nothing = [[Vec4::INFINITY; 3], [Vec4::NEG_INFINITY; 3]];
    BoxNode { sides: nothing, children: [NONE; 4] }
}

fn around<S>(items: &[Item<S>]) -> Bounds {
    items.iter().fold(Bounds::EMPTY, |sum, item| sum.join(item.bounds))
}

/// Splits a run into up to four, always the one whose box is largest.
fn four<S: Copy>(items: &mut [Item<S>], run: Run) -> Vec<Run> {
    let mut runs = vec![run];
    while runs.len() < 4 {
        let largest = (0..runs.len())
            .filter(|&i| runs[i].count > LANES)
            .max_by(|&i, &j| runs[i].bounds.half_area().total_cmp(&runs[j].bounds.half_area()));
        let Some(at) = largest else { break };
        let Run { first, count, depth, .. } = runs[at];
        let left = split(&mut items[first..first + count], depth);
        let part = |first: usize, count: usize| {
            let bounds = around(&items[first..first + count]);
            Run { first, count, bounds, depth: depth + 1 }
        };
        runs[at] = part(first, left);
        runs.push(part(first + left, count - left));
    }
    runs
}

/// Partitions the items in two parts, neither empty, and says how many are in the first.
fn split<S: Copy>(items: &mut [Item<S>], depth: u32) -> usize {
    let count = items.len();
    let start = Bounds::EMPTY;
    let centres = items.iter().fold(start, |sum, i| sum.join(Bounds { low: i.centre, high: i.centre }));
    let extent = centres.high - centres.low;
    let longest = (0..3).fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if depth >= SAH_DEPTH || !(extent[axis] > 0.0) || !extent[axis].is_finite() {
            continue;
        }
        let mut bins = [(Bounds::EMPTY, 0usize); BINS];
        for item in items.iter() {
            let bin = &mut bins[bin_of(item, axis, centres)];
            *bin = (bin.0.join(item.bounds), bin.1 + 1);
        }
        // Cost of the right side for each cut, then of the left side while walking up.
        let mut right = [(0.0f32, 0usize); BINS];
        let (mut sum, mut number) = (Bounds::EMPTY, 0);
        for cut in (1..BINS).rev() {
            sum = sum.join(bins[cut].0);
            number += bins[cut].1;
            right[cut] = (sum.half_area() * blocks(number), number);
        }
        let (mut sum, mut number) = (Bounds::EMPTY, 0);
        for cut in 1..BINS {
            sum = sum.join(bins[cut - 1].0);
            number += bins[cut - 1].1;
            if number == 0 || right[cut].1 == 0 {
                continue;
            }
            let cost = sum.half_area() * blocks(number) + right[cut].0;
            if best.is_none_or(|(lowest, ..)| cost < lowest) {
                best = Some((cost, axis, cut));
            }
        }
    }
    let Some((_, axis, cut)) = best else {
        items.select_nth_unstable_by(count / 2, |a, b| {
            a.centre[longest].total_cmp(&b.centre[longest]).then(a.index.cmp(&b.index))
        });
        return count / 2;
    };
    let mut front = 0;
    for at in 0..count {
        if bin_of(&items[at], axis, centres) < cut {
            items.swap(front, at);
            front += 1;
        }
    }
    front
}

/// Blocks that so many shapes fill.
fn blocks(count: usize) -> f32 {
    count.div_ceil(LANES) as f32
}

fn bin_of<S>(item: &Item<S>, axis: usize, centres: Bounds) -> usize {
    let share = (item.centre[axis] - centres.low[axis]) / (centres.high[axis] - centres.low[axis]);
    ((share * BINS as f32) as usize).min(BINS - 1)
}
