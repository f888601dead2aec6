//! A lasting binary tree over sources (Section 6 of [Gib03]: a KD-tree down to single sources). It is built once; each
//! frame marks some of its leaves, and `expand` chooses nodes of it.

use glam::Vec3;

/// A node: the leaves `begin..end` in the tree's own order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TreeNode {
    /// The node above; of the root itself.
    pub parent: u32,
    /// The first of two neighbouring children; 0 where the node is a single leaf.
    pub children: u32,
    /// First leaf.
    pub begin: u32,
    /// One past the last leaf.
    pub end: u32,
}

impl TreeNode {
    /// Whether it is a single leaf.
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }
}

/// The tree. The root is node 0; children come after their parents, so that a walk from the last node to the first
/// meets children before parents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceTree {
    nodes: Vec<TreeNode>,
    order: Vec<u32>,
}

impl SourceTree {
    /// Builds the tree over sources at `places` (near: metres; far: unit vectors) with `weights` (any measure of power):
    /// each node is cut across its widest axis, at the median of the weight along it. Every source is a leaf. Of lists of
    /// different length the longer one's rest is passed over; weights that are not above zero count as none; places that
    /// are not finite come last. Equal input gives an equal tree.
    pub fn build(places: &[Vec3], weights: &[f32]) -> Self {
        let count = places.len().min(weights.len());
        let mut order: Vec<u32> = (0..count as u32).collect();
        if count == 0 {
            return Self::default();
        }
        let place = |i: u32| places[i as usize];
        let weight = |i: u32| f64::from(weights[i as usize]).max(0.0).min(f64::from(f32::MAX));
        let mut nodes = vec![TreeNode { parent: 0, children: 0, begin: 0, end: count as u32 }];
        let mut at = 0;
        while at < nodes.len() {
            let TreeNode { begin, end, .. } = nodes[at];
            if end - begin > 1 {
                let range = &mut order[begin as usize..end as usize];
                let axis = widest_axis(range, place);
                range.sort_unstable_by(|&a, &b| place(a)[axis].total_cmp(&place(b)[axis]).then(a.cmp(&b)));
                let middle = begin + median(range, weight) as u32;
                let children = nodes.len() as u32;
                nodes[at].children = children;
                let child = |begin, end| TreeNode { parent: at as u32, children: 0, begin, end };
                nodes.extend([child(begin, middle), child(middle, end)]);
            }
            at += 1;
        }
        Self { nodes, order }
    }

    /// All nodes, the root first.
    pub fn nodes(&self) -> &[TreeNode] {
        &self.nodes
    }

    /// The tree's own order of leaves: indices into the lists that it was built from.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// How many leaves.
    pub fn leaves(&self) -> usize {
        self.order.len()
    }
}

fn widest_axis(range: &[u32], place: impl Fn(u32) -> Vec3) -> usize {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for &i in range {
        (low, high) = (low.min(place(i)), high.max(place(i)));
    }
    let size = high - low;
    if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

/// How many of a sorted range come before its median by weight: at least one, and not all.
fn median(range: &[u32], weight: impl Fn(u32) -> f64) -> usize {
    let total: f64 = range.iter().map(|&i| weight(i)).sum();
    let mut below = 0.0;
    let mut cut = range.len() / 2;
    if total > 0.0 {
        cut = 0;
        for &i in range {
            // The leaf on the median goes to the side where it leaves the halves more equal.
            if below + 0.5 * weight(i) > 0.5 * total {
                break;
            }
            below += weight(i);
            cut += 1;
        }
    }
    cut.clamp(1, range.len() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_even_row_is_halved_down_to_single_leaves() {
        let places: Vec<Vec3> = (0..8).rev().map(|i| Vec3::new(0.5, i as f32, -1.0)).collect();
        let tree = SourceTree::build(&places, &[1.0; 8]);
        assert_eq!(tree.nodes().len(), 15);
        assert_eq!(tree.order(), [7, 6, 5, 4, 3, 2, 1, 0]);
        let sizes: Vec<u32> = tree.nodes().iter().map(|n| n.end - n.begin).collect();
        assert_eq!(sizes, [8, 4, 4, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1]);
    }

    #[test]
    fn a_strong_leaf_stands_alone_early() {
        let places: Vec<Vec3> = (0..9).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let mut weights = [1.0; 9];
        weights[3] = 100.0;
        let tree = SourceTree::build(&places, &weights);
        let depth = |leaf: u32| {
            let at = tree.order().iter().position(|&l| l == leaf).unwrap() as u32;
            let mut node = tree.nodes().iter().position(|n| n.is_leaf() && n.begin == at).unwrap();
            let mut depth = 0;
            while node != 0 {
                node = tree.nodes()[node].parent as usize;
                depth += 1;
            }
            depth
        };
        assert!(depth(3) <= 2 && depth(8) >= 3, "{} {}", depth(3), depth(8));
    }

    #[test]
    fn empty_and_single() {
        assert_eq!(SourceTree::build(&[], &[]).nodes(), []);
        let one = SourceTree::build(&[Vec3::ONE, Vec3::X], &[1.0]);
        assert!(one.nodes().len() == 1 && one.nodes()[0].is_leaf() && one.leaves() == 1);
    }

    proptest! {
        #[test]
        fn every_leaf_once_and_children_after_parents(
            leaves in prop::collection::vec((prop::array::uniform3(-1.0f32..1.0), prop::num::f32::ANY), 1..200)
        ) {
            let places: Vec<Vec3> = leaves.iter().map(|l| Vec3::from(l.0)).collect();
            let weights: Vec<f32> = leaves.iter().map(|l| l.1).collect();
            let tree = SourceTree::build(&places, &weights);
            prop_assert_eq!(tree.nodes().len(), 2 * leaves.len() - 1);
            let mut order = tree.order().to_vec();
            order.sort_unstable();
            prop_assert!(order.iter().enumerate().all(|(i, &l)| i == l as usize));
            for (i, node) in tree.nodes().iter().enumerate() {
                prop_assert_eq!(node.is_leaf(), node.end - node.begin == 1);
                if !node.is_leaf() {
                    let [left, right] = [0, 1].map(|k| tree.nodes()[node.children as usize + k]);
                    prop_assert!(node.children as usize > i);
                    prop_assert_eq!((left.begin, left.end, right.end), (node.begin, right.begin, node.end));
                    prop_assert!(left.parent == i as u32 && right.parent == i as u32);
                }
            }
        }
    }
}
