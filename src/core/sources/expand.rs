//! Chooses at most n nodes of trees of sources that together stand for all marked leaves (Section 8 of [Gib03], as
//! corrected: leaves are final, nodes with a single marked child are passed through, and a node counts what its marked
//! leaves send and no more). Trees of far and of near light share one n.

use super::tree::{SourceTree, TreeNode};
use glam::Vec3;
use std::cmp::Ordering;

/// By what the next node to split is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priority {
    /// By the error that splitting it removes: a penumbra drawn as an edge is wrong by the square of the light times its
    /// width (see `cut`).
    #[default]
    ErrorRemoved,
    /// By its light, as in [Gib03].
    Transfer,
}

/// How many nodes are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WantedNodes {
    /// So many at least, where there are as many.
    pub least: usize,
    /// Never more.
    pub most: usize,
    /// Between the two: until [`Expander::left_rad`] is at most this, radians.
    pub left_rad: f32,
}

impl WantedNodes {
    /// As many as `count`, whatever is left.
    pub const fn exactly(count: usize) -> Self {
        Self { least: count, most: count, left_rad: f32::INFINITY }
    }
}

/// How much longer a node stays split than it would be split anew, so that two of nearly equal priority do not take
/// turns from frame to frame.
const HELD: f64 = 2.0;
/// A number of nodes stays enough until so much more is left, so that it does not change back and forth.
const ENOUGH_HELD: f64 = 1.2;
/// Where there are too few for all trees, a tree that was represented stays so until another sends this many times its light.
const TREE_HELD: f64 = 1.25;
/// A node's centre moves when another leaf would be this much better.
const CENTRE_HELD: f32 = 0.8;

/// One tree and what this frame says of its leaves, in the tree's own order.
#[derive(Clone, Copy, Debug)]
pub struct Marked<'a> {
    /// Whose leaves are marked.
    pub tree: &'a SourceTree,
    /// Light that each leaf sends to where shadows fall (irradiance, luminance); 0 for leaves that are not marked.
    pub light: &'a [f32],
    /// Unit vector towards each leaf, seen from what hides it.
    pub towards: &'a [Vec3],
    /// Whether the tree is the same as in the frame before; else nothing is held for its sake.
    pub lasting: bool,
}

/// A chosen node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// Index into the list of trees.
    pub tree: u32,
    /// Node of that tree: its marked leaves are represented.
    pub node: u32,
    /// Sum of its marked leaves' light.
    pub light: f32,
    /// Root mean square angle of its marked leaves to their mean direction, radians.
    pub extent_rad: f32,
    /// The leaf (in the tree's own order) from whose place its shadow is drawn: the strongest of those near the middle.
    pub centre: u32,
}

/// Sums over a node's marked leaves.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    light: f64,
    /// Light times direction.
    moment: [f64; 3],
    marked: u32,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.light += other.light;
        self.moment.iter_mut().zip(other.moment).for_each(|(a, b)| *a += b);
        self.marked += other.marked;
    }

    /// Root mean square chord to the mean direction.
    fn extent(&self) -> f64 {
        if self.marked < 2 || self.light <= 0.0 {
            return 0.0;
        }
        let mean: f64 = self.moment.iter().map(|m| (m / self.light).powi(2)).sum();
        (1.0 - mean).max(0.0).sqrt()
    }

    fn error(&self) -> f64 {
        self.light * self.light * self.extent()
    }
}

#[derive(Clone, Debug, Default)]
struct TreeState {
    sums: Vec<Sums>,
    /// The frame in which the node was last split.
    split: Vec<u32>,
    /// The node's centre, and the frame it was chosen in.
    centres: Vec<(u32, u32)>,
    /// The frame in which the tree was last represented.
    represented: u32,
}

#[derive(Clone, Copy, Debug)]
struct OpenNode {
    tree: u32,
    node: u32,
    priority: f64,
}

/// Chooses; keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Expander {
    frame: u32,
    trees: Vec<TreeState>,
    open: Vec<OpenNode>,
    chosen: Vec<Chosen>,
    left_rad: f64,
}

impl Expander {
    /// What the last choice leaves: how wide the nodes are, root mean square from their middle, as their mean by light.
    /// Radians, seen from what hides them. Penumbras are off by so much at most.
    pub fn left_rad(&self) -> f32 {
        self.left_rad as f32
    }

    /// What the last call gave.
    pub fn chosen(&self) -> &[Chosen] {
        &self.chosen
    }

    /// Chooses at most `wanted.most` nodes; every marked leaf lies below exactly one of them, unless there are more trees with
    /// marked leaves than that: then the trees of most light are kept
    /// (those of the frame before until another sends 1.25 times their light), and the others hide nothing. Fewer come where
    /// nothing is left to split.
    /// Order: by tree, then by node. Leaves without positive, finite light or a finite direction are not marked.
    pub fn expand(&mut self, trees: &[Marked<'_>], wanted: WantedNodes, by: Priority) -> &[Chosen] {
        let count = wanted.most.max(wanted.least);
        let before = self.chosen.len();
        self.frame = self.frame.wrapping_add(1).max(2);
        self.trees.resize_with(trees.len().max(self.trees.len()), TreeState::default);
        self.open.clear();
        for (index, marked) in trees.iter().enumerate() {
            let state = &mut self.trees[index];
            state.sum(marked);
            let nodes = marked.tree.nodes().len();
            if !marked.lasting || state.split.len() != nodes {
                state.split.clear();
                state.split.resize(nodes, 0);
                state.centres.clear();
                state.centres.resize(nodes, (0, 0));
                state.represented = 0;
            }
            if state.sums.first().is_some_and(|root| root.marked > 0) {
                let node = state.pass_through(marked.tree, 0);
                self.open.push(OpenNode { tree: index as u32, node, priority: 0.0 });
            }
        }
        if self.open.len() > count {
            let light = |o: &OpenNode| {
                let state = &self.trees[o.tree as usize];
                let held = state.represented == self.frame.wrapping_sub(1);
                state.sums[o.node as usize].light * if held { TREE_HELD } else { 1.0 }
            };
            self.open.sort_unstable_by(|a, b| light(b).total_cmp(&light(a)).then(a.tree.cmp(&b.tree)));
            self.open.truncate(count);
        }
        for i in 0..self.open.len() {
            self.trees[self.open[i].tree as usize].represented = self.frame;
            self.open[i].priority = self.priority(trees, self.open[i], by);
        }
        while self.open.len() < count {
            if self.open.len() >= wanted.least && self.is_enough(f64::from(wanted.left_rad), before) {
                break;
            }
            let best = self.open.iter().enumerate().max_by(|(i, a), (j, b)| {
                // Of equals the earlier one.
                a.priority.total_cmp(&b.priority).then(j.cmp(i))
            });
            let Some((at, open)) = best.filter(|(_, o)| o.priority > 0.0) else { break };
            let open = *open;
            let tree = trees[open.tree as usize].tree;
            let state = &mut self.trees[open.tree as usize];
            state.split[open.node as usize] = self.frame;
            let children = tree.nodes()[open.node as usize].children;
            let [left, right] = [0, 1].map(|k| state.pass_through(tree, children + k));
            for (slot, node) in [(at, left), (self.open.len(), right)] {
                let mut child = OpenNode { tree: open.tree, node, priority: 0.0 };
                child.priority = self.priority(trees, child, by);
                if slot < self.open.len() {
                    self.open[slot] = child;
                } else {
                    self.open.push(child);
                }
            }
        }
        self.left_rad = self.left();
        self.open.sort_unstable_by_key(|o| (o.tree, o.node));
        self.chosen.clear();
        for i in 0..self.open.len() {
            let OpenNode { tree, node, .. } = self.open[i];
            let state = &mut self.trees[tree as usize];
            let centre = state.centre(&trees[tree as usize], node, self.frame);
            let sums = &state.sums[node as usize];
            let (light, extent_rad) = (sums.light as f32, sums.extent() as f32);
            self.chosen.push(Chosen { tree, node, light, extent_rad, centre });
        }
        &self.chosen
    }

    /// Whether the open nodes are enough: with the number of the frame before a little more may be left, with fewer less.
    fn is_enough(&self, left_rad: f64, before: usize) -> bool {
        let held = match self.open.len().cmp(&before) {
            Ordering::Less => 1.0 / ENOUGH_HELD,
            Ordering::Equal => ENOUGH_HELD,
            Ordering::Greater => 1.0,
        };
        self.left() <= left_rad * held
    }

    fn left(&self) -> f64 {
        let (mut light, mut width) = (0.0, 0.0);
        for open in &self.open {
            let sums = &self.trees[open.tree as usize].sums[open.node as usize];
            light += sums.light;
            width += sums.light * sums.extent();
        }
        if light > 0.0 { width / light } else { 0.0 }
    }

    fn priority(&self, trees: &[Marked<'_>], open: OpenNode, by: Priority) -> f64 {
        let state = &self.trees[open.tree as usize];
        let sums = &state.sums[open.node as usize];
        if sums.marked < 2 {
            return 0.0;
        }
        let children = trees[open.tree as usize].tree.nodes()[open.node as usize].children as usize;
        let own = match by {
            Priority::Transfer => sums.light,
            Priority::ErrorRemoved => {
                let parts: f64 = state.sums[children..children + 2].iter().map(Sums::error).sum();
                // Leaves in one direction are still several: least, but not nothing.
                (sums.error() - parts).max(1e-9 * sums.light * sums.light)
            }
        };
        let held = state.split[open.node as usize] == self.frame.wrapping_sub(1);
        if held { own * HELD } else { own }
    }
}

impl TreeState {
    fn sum(&mut self, marked: &Marked<'_>) {
        let nodes = marked.tree.nodes();
        self.sums.clear();
        self.sums.resize(nodes.len(), Sums::default());
        for (i, node) in nodes.iter().enumerate().rev() {
            if node.is_leaf() {
                let leaf = node.begin as usize;
                let light = marked.light.get(leaf).copied().unwrap_or(0.0);
                let towards = marked.towards.get(leaf).copied().unwrap_or(Vec3::NAN);
                if light > 0.0 && light.is_finite() && towards.is_finite() {
                    let light = f64::from(light);
                    let moment = towards.as_dvec3().to_array().map(|c| c * light);
                    self.sums[i] = Sums { light, moment, marked: 1 };
                }
            } else {
                let children = node.children as usize;
                let mut sums = self.sums[children];
                sums.add(&self.sums[children + 1]);
                self.sums[i] = sums;
            }
        }
    }

    /// Down from a marked node while only one of its children is marked.
    fn pass_through(&self, tree: &SourceTree, mut node: u32) -> u32 {
        loop {
            let children = tree.nodes()[node as usize].children;
            if children == 0 {
                return node;
            }
            let marked = [0, 1].map(|k| self.sums[(children + k) as usize].marked > 0);
            node = match marked {
                [true, false] => children,
                [false, true] => children + 1,
                _ => return node,
            };
        }
    }

    /// The marked leaf from which a node's shadow is drawn: the one whose light, times a bell about the middle of the
    /// node as wide as a third of the node, is most.
    fn centre(&mut self, marked: &Marked<'_>, node: u32, frame: u32) -> u32 {
        let sums = &self.sums[node as usize];
        let middle = Vec3::from_array(sums.moment.map(|m| (m / sums.light) as f32));
        let width = (sums.extent() as f32 / 3.0).max(1e-4);
        let score = |leaf: u32| {
            let leaf = leaf as usize;
            let (Some(&light), Some(&towards)) = (marked.light.get(leaf), marked.towards.get(leaf)) else {
                return 0.0;
            };
            let off = towards.distance_squared(middle) / (width * width);
            if light > 0.0 && off.is_finite() { light / (1.0 + off) } else { 0.0 }
        };
        let TreeNode { begin, end, .. } = marked.tree.nodes()[node as usize];
        let mut best = (begin, 0.0);
        for leaf in begin..end {
            let score = score(leaf);
            if score > best.1 {
                best = (leaf, score);
            }
        }
        let (before, when) = self.centres[node as usize];
        let kept = when == frame.wrapping_sub(1) && score(before) >= CENTRE_HELD * best.1;
        let centre = if kept { before } else { best.0 };
        self.centres[node as usize] = (centre, frame);
        centre
    }
}

#[cfg(test)]
mod tests;
