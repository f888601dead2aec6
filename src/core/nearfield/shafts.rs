//! The hierarchy of shafts between the tree of sources and the octree of receivers (Section 6 of [Gib03]).
//!
//! A pair of a source and a leaf of receivers is kept where at least one vertex of the leaf gets light from the source
//! that its budget does not neglect. Inner shafts exist where a pair below them does. (The rule as printed, which stops
//! at every shaft of less than 2 %, drops all light where it comes from more than 50 equal sources.)
//!
//! Where walls shine, most pairs exist: a bit for every pair of nodes takes a thirtieth of a list of shafts. The
//! hierarchy is how the two trees are walked down together.

use super::{octree::Octree, shaft::Aabb};
use crate::sources::tree::SourceTree;
use rayon::prelude::*;

/// Which shafts there are. The root is the pair of both roots; of a pair the larger node is divided.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShaftHierarchy {
    /// Words of the bits of one source node.
    words: usize,
    /// For each node of the source tree a bit for each node of the octree.
    bits: Vec<u64>,
    /// Squared diagonals of the nodes' boxes, or -1 for leaves, which cannot be divided.
    source_sizes: Vec<f32>,
    receiver_sizes: Vec<f32>,
    /// The octree's nodes above each node; of the root itself.
    receiver_parents: Vec<u32>,
    /// How many leaves below each node have a shaft.
    source_leaves: Vec<u32>,
    receiver_leaves: Vec<u32>,
    leaves: usize,
    shafts: usize,
}

impl ShaftHierarchy {
    /// Builds it. `kept` says for a source (in the tree's own order) which leaves of the octree it matters to: it sets
    /// their entries, by node, in the list it is given.
    pub fn build(
        sources: &SourceTree,
        source_boxes: &[Aabb],
        receivers: &Octree,
        kept: &(dyn Fn(usize, &mut [bool]) + Sync),
    ) -> Self {
        let nodes = receivers.nodes();
        if sources.leaves() == 0 || nodes.is_empty() {
            return Self::default();
        }
        let words = nodes.len().div_ceil(64);
        let mut out = Self { words, bits: pairs(sources, receivers, words, kept), ..Self::default() };
        let squared = |b: &Aabb| b.diagonal().powi(2);
        let of_source = sources.nodes().iter().zip(source_boxes);
        out.source_sizes = of_source.map(|(n, b)| if n.is_leaf() { -1.0 } else { squared(b) }).collect();
        out.receiver_sizes =
            nodes.iter().map(|n| if n.is_leaf() { -1.0 } else { squared(&n.bounds) }).collect();
        out.receiver_parents = vec![0; nodes.len()];
        for (i, node) in nodes.iter().enumerate() {
            let children = node.children as usize;
            out.receiver_parents[children..children + node.child_count as usize].fill(i as u32);
        }
        out.count(sources, receivers);
        out
    }

    /// Whether there is a shaft between two nodes.
    pub fn has(&self, source: u32, receiver: u32) -> bool {
        let at = source as usize * self.words + receiver as usize / 64;
        self.bits.get(at).is_some_and(|word| word >> (receiver % 64) & 1 == 1)
    }

    /// Which node of a shaft is divided: `Some(true)` the source, `Some(false)` the receiver, `None` for a leaf shaft.
    pub fn divides_source(&self, source: u32, receiver: u32) -> Option<bool> {
        let (s, r) = (self.source_sizes[source as usize], self.receiver_sizes[receiver as usize]);
        (s >= 0.0 || r >= 0.0).then_some(s >= r)
    }

    /// The node of the octree above one; of the root itself.
    pub fn receiver_parent(&self, receiver: u32) -> u32 {
        self.receiver_parents[receiver as usize]
    }

    /// For each node of the source tree, how many sources below it have a shaft.
    pub fn source_leaves(&self) -> &[u32] {
        &self.source_leaves
    }

    /// For each node of the octree, how many of its leaves have a shaft.
    pub fn receiver_leaves(&self) -> &[u32] {
        &self.receiver_leaves
    }

    /// How many shafts there are.
    pub fn len(&self) -> usize {
        self.shafts
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.shafts == 0
    }

    /// How many are leaves: pairs of a single source and a leaf of receivers.
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        let sizes = size_of_val(&*self.source_sizes) + size_of_val(&*self.receiver_sizes);
        let counts = [&self.receiver_parents, &self.source_leaves, &self.receiver_leaves];
        size_of_val(&*self.bits) + sizes + counts.iter().map(|list| size_of_val(&***list)).sum::<usize>()
    }

    fn count(&mut self, sources: &SourceTree, receivers: &Octree) {
        let nodes = receivers.nodes();
        self.source_leaves = vec![0; sources.nodes().len()];
        self.receiver_leaves = vec![0; nodes.len()];
        for (i, node) in sources.nodes().iter().enumerate().rev() {
            let children = node.children as usize;
            self.source_leaves[i] = if node.is_leaf() {
                u32::from(self.has(i as u32, 0))
            } else {
                self.source_leaves[children] + self.source_leaves[children + 1]
            };
        }
        for (i, node) in nodes.iter().enumerate().rev() {
            let children = node.children as usize;
            self.receiver_leaves[i] = if node.is_leaf() {
                u32::from(self.has(0, i as u32))
            } else {
                self.receiver_leaves[children..children + node.child_count as usize].iter().sum()
            };
        }
        let mut open = vec![(0u32, 0u32)];
        while let Some((source, receiver)) = open.pop() {
            if !self.has(source, receiver) {
                continue;
            }
            self.shafts += 1;
            match self.divides_source(source, receiver) {
                Some(true) => {
                    let children = sources.nodes()[source as usize].children;
                    open.extend([(children, receiver), (children + 1, receiver)]);
                }
                Some(false) => {
                    let node = nodes[receiver as usize];
                    open.extend((0..node.child_count).map(|k| (source, node.children + k)));
                }
                None => self.leaves += 1,
            }
        }
    }
}

/// A bit for each node of the octree, for each node of the source tree.
fn pairs(
    sources: &SourceTree,
    receivers: &Octree,
    words: usize,
    kept: &(dyn Fn(usize, &mut [bool]) + Sync),
) -> Vec<u64> {
    let nodes = receivers.nodes();
    let mut leaf_bits = vec![0u64; sources.leaves() * words];
    leaf_bits.par_chunks_mut(words).enumerate().for_each_init(
        || vec![false; nodes.len()],
        |flags, (leaf, bits)| {
            flags.fill(false);
            kept(leaf, flags);
            // A node matters where one of its children does.
            for (i, node) in nodes.iter().enumerate().rev() {
                if !node.is_leaf() {
                    let first = node.children as usize;
                    flags[i] = flags[first..first + node.child_count as usize].iter().any(|f| *f);
                }
            }
            for (i, _) in flags.iter().enumerate().filter(|(_, f)| **f) {
                bits[i / 64] |= 1 << (i % 64);
            }
        },
    );
    let mut bits = vec![0u64; sources.nodes().len() * words];
    for (i, node) in sources.nodes().iter().enumerate().rev() {
        for word in 0..words {
            bits[i * words + word] = if node.is_leaf() {
                leaf_bits[node.begin as usize * words + word]
            } else {
                let child = node.children as usize;
                bits[child * words + word] | bits[(child + 1) * words + word]
            };
        }
    }
    bits
}
