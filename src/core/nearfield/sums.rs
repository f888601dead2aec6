//! Transfers summed over receivers, up the octree (Section 6 of [Gib03]): what a source sends to each node.

use super::{
    octree::Octree,
    packed::{pack, unpack},
};
use crate::{
    math::widest::widest,
    model::{
        keep::as_bytes,
        room::{RoomPatch, RoomPatches},
    },
};
use serde::{Deserialize, Serialize};

/// For each node of the octree and each source the mean of T over the node's receivers, by their area.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeSums {
    sources: usize,
    /// Area of each node's receivers, square metres.
    areas_m2: Vec<f32>,
    /// Node by node, one for each source.
    #[serde(with = "as_bytes")]
    means: Vec<u16>,
}

impl NodeSums {
    /// From each source's sums (of [`NodeSums::of_source`]), in the order of sources.
    pub fn of(patches: &RoomPatches, receivers: &[u32], octree: &Octree, rows: &[Vec<u16>]) -> Self {
        let nodes = octree.nodes().len();
        let mut areas_m2 = vec![0.0; nodes];
        up(octree, &mut areas_m2, |items| {
            items.iter().map(|&i| patches.patches[receivers[i as usize] as usize].area_m2).sum()
        });
        let mut means = vec![0; nodes * rows.len()];
        for (source, row) in rows.iter().enumerate() {
            for (node, code) in row.iter().enumerate() {
                means[node * rows.len() + source] = *code;
            }
        }
        Self { sources: rows.len(), areas_m2, means }
    }

    /// One source's mean over each node, from its T at every vertex.
    pub fn of_source(patches: &RoomPatches, receivers: &[u32], octree: &Octree, dense: &[f32]) -> Vec<u16> {
        let nodes = octree.nodes().len();
        let (mut sums, mut areas) = (vec![0.0f32; nodes], vec![0.0f32; nodes]);
        let patch = |i: u32| -> &RoomPatch { &patches.patches[receivers[i as usize] as usize] };
        let mean = |p: &RoomPatch| {
            p.corners().iter().map(|&v| dense[v as usize]).sum::<f32>() / p.corners().len() as f32
        };
        up(octree, &mut sums, |items| items.iter().map(|&i| patch(i).area_m2 * mean(patch(i))).sum());
        up(octree, &mut areas, |items| items.iter().map(|&i| patch(i).area_m2).sum());
        sums.iter().zip(&areas).map(|(sum, area)| if *area > 0.0 { pack(sum / area) } else { 0 }).collect()
    }

    /// Whether its parts fit together, for so many sources and nodes: what was read from a file may be anything.
    pub fn is_sound(&self, sources: usize, nodes: usize) -> bool {
        self.sources == sources
            && self.areas_m2.len() == nodes
            && Some(self.means.len()) == nodes.checked_mul(sources)
    }

    /// Area of a node's receivers, square metres.
    pub fn area_m2(&self, node: usize) -> f32 {
        self.areas_m2[node]
    }

    /// Adds to each source's entry the integral of T over a node's receivers, square metres.
    pub fn add_to(&self, node: usize, out: &mut [f32]) {
        let means = &self.means[node * self.sources..(node + 1) * self.sources];
        let area = self.areas_m2[node];
        widest(|| {
            for (out, code) in out.iter_mut().zip(means) {
                *out += area * unpack(*code);
            }
        });
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.areas_m2) + size_of_val(&*self.means)
    }
}

/// Fills in leaves from their items, and other nodes from their children.
fn up(octree: &Octree, out: &mut [f32], leaf: impl Fn(&[u32]) -> f32) {
    for (i, node) in octree.nodes().iter().enumerate().rev() {
        let first = node.children as usize;
        out[i] = if node.is_leaf() {
            leaf(octree.items(node))
        } else {
            out[first..first + node.child_count as usize].iter().sum()
        };
    }
}

#[cfg(test)]
mod tests {
    use crate::nearfield::fixture;

    #[test]
    fn a_node_holds_what_its_patches_get() {
        let mut room = fixture::room();
        room.surfaces[0] = fixture::walls(0.05);
        let field = fixture::field(&room, 220, &fixture::ALL);
        let mut got = vec![0.0; field.sources.len()];
        let nodes = field.octree.nodes();
        for (index, node) in nodes.iter().enumerate().step_by(7) {
            got.fill(0.0);
            field.sums().add_to(index, &mut got);
            let mut want = vec![0.0f32; field.sources.len()];
            for &item in field.octree.items(node) {
                let patch = &field.patches.patches[field.receivers[item as usize] as usize];
                for (source, sum) in want.iter_mut().enumerate() {
                    let at = |v: &u32| field.transfers().at(source, *v as usize);
                    *sum += patch.area_m2 * patch.corners().iter().map(at).sum::<f32>()
                        / patch.corners().len() as f32;
                }
            }
            for (got, want) in got.iter().zip(want) {
                // The means are rounded, and so is what they are held against: 1 in 4096 each.
                assert!((got - want).abs() <= want / 2040.0, "{got} {want}");
            }
        }
    }
}
