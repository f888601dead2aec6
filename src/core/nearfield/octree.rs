//! The octree over receivers (Section 6 of [Gib03]): broad and shallow, with a few patches in a leaf.

use super::shaft::Aabb;
use glam::Vec3;

/// Patches in a leaf at most, unless they cannot be told apart.
pub const LEAF_PATCHES: usize = 8;
/// Patches in one place are not divided for ever.
const DEEPEST: u32 = 16;

/// A node: items `begin..end` in the octree's own order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OctreeNode {
    /// Around all of its items.
    pub bounds: Aabb,
    /// First of its children, which stand together; 0 for a leaf.
    pub children: u32,
    /// How many children: 2 to 8, or 0.
    pub child_count: u32,
    /// First item, in the octree's own order.
    pub begin: u32,
    /// One past the last item.
    pub end: u32,
}

impl OctreeNode {
    /// Whether it has no children.
    pub fn is_leaf(&self) -> bool {
        self.child_count == 0
    }
}

/// The octree. The root is node 0; children come after their parents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Octree {
    nodes: Vec<OctreeNode>,
    order: Vec<u32>,
}

impl Octree {
    /// Over boxes: those of patches. Items are told apart by their boxes' middles. Equal input gives an equal tree.
    pub fn build(boxes: &[Aabb]) -> Self {
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        if order.is_empty() {
            return Self::default();
        }
        let node = |order: &[u32], begin: u32| {
            let bounds = order.iter().fold(Aabb::EMPTY, |b, &i| b.join(&boxes[i as usize]));
            let end = begin + order.len() as u32;
            OctreeNode { bounds, children: 0, child_count: 0, begin, end }
        };
        let mut nodes = vec![node(&order, 0)];
        let mut depths = vec![0u32];
        let mut at = 0;
        while at < nodes.len() {
            let OctreeNode { begin, end, .. } = nodes[at];
            let range = &mut order[begin as usize..end as usize];
            if range.len() > LEAF_PATCHES && depths[at] < DEEPEST {
                let middles = Aabb::around(range.iter().map(|&i| boxes[i as usize].centre()));
                let centre = middles.centre();
                let octant = |i: u32| octant(boxes[i as usize].centre(), centre);
                range.sort_unstable_by_key(|&i| (octant(i), i));
                nodes[at].children = nodes.len() as u32;
                let mut first = 0;
                while first < range.len() {
                    let which = octant(range[first]);
                    let count = range[first..].iter().take_while(|&&i| octant(i) == which).count();
                    nodes.push(node(&range[first..first + count], begin + first as u32));
                    depths.push(depths[at] + 1);
                    first += count;
                }
                nodes[at].child_count = nodes.len() as u32 - nodes[at].children;
            }
            at += 1;
        }
        Self { nodes, order }
    }

    /// All nodes, the root first.
    pub fn nodes(&self) -> &[OctreeNode] {
        &self.nodes
    }

    /// The items in the octree's own order: indices into the list that it was built from.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Indices of the boxes below a node.
    pub fn items(&self, node: &OctreeNode) -> &[u32] {
        &self.order[node.begin as usize..node.end as usize]
    }
}

fn octant(point: Vec3, centre: Vec3) -> u8 {
    u8::from(point.x > centre.x) | u8::from(point.y > centre.y) << 1 | u8::from(point.z > centre.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_item_once_and_within_its_nodes(
            items in prop::collection::vec((prop::array::uniform3(-3i8..3), 0.0f32..0.5), 0..300)
        ) {
            // On a coarse grid, so that many fall together.
            let boxes: Vec<Aabb> = items
                .iter()
                .map(|(at, size)| {
                    let low = Vec3::from(at.map(f32::from));
                    Aabb { low, high: low + *size }
                })
                .collect();
            let tree = Octree::build(&boxes);
            let mut order = tree.order().to_vec();
            order.sort_unstable();
            prop_assert!(order.iter().enumerate().all(|(i, &o)| i == o as usize) && order.len() == boxes.len());
            let mut in_leaves = 0;
            for (i, node) in tree.nodes().iter().enumerate() {
                for &item in tree.items(node) {
                    prop_assert_eq!(node.bounds.join(&boxes[item as usize]), node.bounds);
                }
                if node.is_leaf() {
                    in_leaves += tree.items(node).len();
                } else {
                    let children = &tree.nodes()[node.children as usize..][..node.child_count as usize];
                    prop_assert!(node.children as usize > i && children.len() <= 8);
                    prop_assert_eq!(children.first().map(|c| c.begin), Some(node.begin));
                    prop_assert_eq!(children.last().map(|c| c.end), Some(node.end));
                    prop_assert!(children.windows(2).all(|w| w[0].end == w[1].begin));
                    // Fewer than asked for only where they fall in one place.
                    prop_assert!(node.end - node.begin > LEAF_PATCHES as u32);
                }
            }
            prop_assert_eq!(in_leaves, boxes.len());
        }
    }

    #[test]
    fn a_grid_gets_full_leaves() {
        let boxes: Vec<Aabb> = (0..1024)
            .map(|i| {
                let low = Vec3::new((i % 32) as f32, (i / 32) as f32, 0.0);
                Aabb { low, high: low + Vec3::new(1.0, 1.0, 0.0) }
            })
            .collect();
        let tree = Octree::build(&boxes);
        let leaves: Vec<usize> =
            tree.nodes().iter().filter(|n| n.is_leaf()).map(|n| tree.items(n).len()).collect();
        assert!(leaves.iter().all(|&n| n == 4), "{leaves:?}");
    }
}
