//! The hierarchy of shafts between the tree of sources and the octree of receivers (Section 6 of [Gib03]).
//!
//! A pair of a source and a leaf of receivers is kept where at least one vertex of the leaf gets light from the source
//! that its budget does not neglect. Inner shafts exist where a pair below them does. (The rule as printed, which stops
//! at every shaft of less than 2 %, drops all light where it comes from more than 50 equal sources.)

use super::{octree::Octree, shaft::Aabb};
use crate::sources::tree::SourceTree;

/// A shaft: a node of sources and a node of receivers. Eight bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaft {
    /// Node of the source tree.
    pub source: u16,
    /// Node of the octree.
    pub receiver: u16,
    /// First of its children; they end where the next shaft's begin.
    children: u32,
}

/// All shafts, the root first, level by level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShaftHierarchy {
    shafts: Vec<Shaft>,
    leaves: usize,
}

/// Which pairs matter: a bit for each node of the octree, for each node of the source tree.
struct Pairs {
    words: usize,
    bits: Vec<u64>,
}

impl Pairs {
    fn has(&self, source: u32, receiver: u32) -> bool {
        self.bits[source as usize * self.words + receiver as usize / 64] >> (receiver % 64) & 1 == 1
    }
}

impl ShaftHierarchy {
    /// Builds it. `kept` says for a source (in the tree's own order) which leaves of the octree it matters to: it sets
    /// their entries, by node, in the list it is given. Both trees have fewer than 65,536 nodes, else there are no shafts.
    pub fn build(
        sources: &SourceTree,
        source_boxes: &[Aabb],
        receivers: &Octree,
        kept: &(dyn Fn(usize, &mut [bool]) + Sync),
    ) -> Self {
        let limit = usize::from(u16::MAX);
        if sources.nodes().len() > limit || receivers.nodes().len() > limit || sources.leaves() == 0 {
            return Self::default();
        }
        let pairs = pairs(sources, receivers, kept);
        let mut out = Self::default();
        if receivers.nodes().is_empty() || !pairs.has(0, 0) {
            return out;
        }
        out.shafts.push(Shaft { source: 0, receiver: 0, children: 0 });
        let mut at = 0;
        while at < out.shafts.len() {
            let (source, receiver) = (u32::from(out.shafts[at].source), u32::from(out.shafts[at].receiver));
            out.shafts[at].children = out.shafts.len() as u32;
            let (s, r) = (&sources.nodes()[source as usize], &receivers.nodes()[receiver as usize]);
            let mut push = |source: u32, receiver: u32| {
                if pairs.has(source, receiver) {
                    out.shafts.push(Shaft { source: source as u16, receiver: receiver as u16, children: 0 });
                }
            };
            // The larger one is divided.
            let wider = source_boxes[source as usize].diagonal() >= r.bounds.diagonal();
            if !s.is_leaf() && (wider || r.is_leaf()) {
                push(s.children, receiver);
                push(s.children + 1, receiver);
            } else if !r.is_leaf() {
                (0..r.child_count).for_each(|k| push(source, r.children + k));
            } else {
                out.leaves += 1;
            }
            at += 1;
        }
        out.shafts.shrink_to_fit();
        out
    }

    /// All shafts.
    pub fn shafts(&self) -> &[Shaft] {
        &self.shafts
    }

    /// Indices of a shaft's children; empty for a leaf.
    pub fn children(&self, index: usize) -> std::ops::Range<u32> {
        let end = self.shafts.get(index + 1).map_or(self.shafts.len() as u32, |next| next.children);
        self.shafts[index].children..end
    }

    /// How many are leaves: pairs of a single source and a leaf of receivers.
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.shafts)
    }
}

fn pairs(sources: &SourceTree, receivers: &Octree, kept: &(dyn Fn(usize, &mut [bool]) + Sync)) -> Pairs {
    use rayon::prelude::*;
    let nodes = receivers.nodes();
    let words = nodes.len().div_ceil(64);
    let mut leaf_bits = vec![0u64; sources.leaves() * words];
    leaf_bits.par_chunks_mut(words.max(1)).enumerate().for_each_init(
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
    Pairs { words, bits }
}
