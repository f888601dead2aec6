//! A room made ready: its sources, what each sends to every vertex, and the shafts between them (Sections 4 to 6 of
//! [Gib03]). Nothing here depends on the camera or on what moves.

use super::{
    error::RoomError,
    octree::Octree,
    packed::{BLOCK, BlockSums, Transfers, unpack},
    sent::{Ends, Sent, SentInput},
    sets::budget_threshold,
    shaft::Aabb,
    shafts::ShaftHierarchy,
    sums::NodeSums,
};
use crate::{
    math::color,
    model::room::{Room, RoomPatches},
    sources::tree::SourceTree,
};
use rayon::prelude::*;

pub use super::sent::SendingPatch;

/// Share of the progress that `Sent::find` takes.
const SENT_SHARE: f32 = 0.8;

/// What is spent on a room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preparation {
    /// Share of the power of all patches that the source set has, above 0 and at most 1.
    pub power_share: f32,
    /// Rays from a vertex to a source patch: this squared, 1 to 8.
    pub rays_side: u32,
    /// Share of each vertex's light that shafts may neglect, 0 to 0.5.
    pub neglected: f32,
}

impl Default for Preparation {
    /// As in [Gib03]: 70 % of the power; one ray each. Of each vertex's light 0.5 % may be neglected in place of its 2 %,
    /// which were about 0.6 % of a shadow's light on the reference's F3, for hardly a byte more.
    fn default() -> Self {
        Self { power_share: 0.7, rays_side: 1, neglected: 0.005 }
    }
}

/// Sizes of what was built, and what it leaves out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldReport {
    /// Patches that the room was divided into.
    pub patches: usize,
    /// Corners of patches, at which light is gathered.
    pub vertices: usize,
    /// Faces of the room that became no patch.
    pub dropped_faces: usize,
    /// Patches that reflect: receivers.
    pub receivers: usize,
    /// Receivers of which no corner gets any light: unlit corners, or faces that look the wrong way.
    pub unlit_receivers: usize,
    /// Sources in the set.
    pub sources: usize,
    /// Patches that shine and are left out of the set.
    pub sources_left_out: usize,
    /// Share of the power of all patches that the set has.
    pub power_share: f32,
    /// Share of the light at the vertices that the sources left out send, in the mean over all that get light: as much of
    /// a shadow may be missing...
    pub lost_mean: f32,
    /// ...and where it is worst.
    pub lost_worst: f32,
    /// Share of the light that shafts neglect, at the vertex where it is worst; at most what was allowed.
    pub neglected_worst: f32,
    /// Shafts between single sources and leaves of receivers.
    pub leaf_shafts: usize,
    /// Shafts of all levels, those of leaves included.
    pub shafts: usize,
    /// Bytes of the shafts.
    pub shaft_bytes: usize,
    /// Bytes of the transfers.
    pub transfer_bytes: usize,
    /// Bytes of all that the room made ready holds, these included.
    pub bytes: usize,
}

/// The room made ready.
pub struct NearField {
    /// The room's patches and vertices.
    pub patches: RoomPatches,
    /// The source set, in the tree's own order.
    pub sources: Vec<SendingPatch>,
    /// The tree over them.
    pub source_tree: SourceTree,
    /// Box of each node of the source tree.
    pub source_boxes: Vec<Aabb>,
    /// Patches that reflect; the octree's items are indices into it.
    pub receivers: Vec<u32>,
    /// The tree over them.
    pub octree: Octree,
    /// Shafts from nodes of the source tree to nodes of the octree.
    pub shafts: ShaftHierarchy,
    /// For each vertex the sum over all patches of L F V: times the diffuse reflectance it is the radiance that leaves
    /// there (the model's own, for the ratio form).
    pub gathered_rgb: Vec<[f32; 3]>,
    /// The same over the source set alone.
    pub kept_rgb: Vec<[f32; 3]>,
    transfers: Transfers,
    sums: NodeSums,
    scatters_m2: Vec<[f32; 6]>,
    report: FieldReport,
}

impl NearField {
    /// Prepares `patches` of `room` (from `subdivide`); the room's own faces hide one another. `progress` is told the
    /// share done, 0 to 1, from several threads, in no strict order. The result does not depend on threads.
    ///
    /// # Errors
    /// A setting out of range, no patch with a radiance above zero, or none that reflects.
    pub fn build(
        room: &Room,
        patches: RoomPatches,
        how: &Preparation,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<Self, RoomError> {
        let ends = Ends::of(&patches, how)?;
        let input = SentInput { room, patches: &patches, ends: &ends, how };
        let sent = Sent::find(&input, &|share| progress(SENT_SHARE * share));
        Ok(Self::of(patches, ends, sent, how, progress))
    }

    /// As `build`, of what was found before for the same room, patches and settings.
    pub fn of(
        patches: RoomPatches,
        ends: Ends,
        sent: Sent,
        how: &Preparation,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Self {
        let Ends { set, sources, source_tree, source_boxes, scatters_m2, receivers, octree, receiving } =
            ends;
        let Sent { transfers, sums, rest_rgb } = sent;
        let mut kept_rgb = vec![[0.0f32; 3]; patches.vertices.len()];
        let mut planes: BlockSums = BlockSums::default();
        planes.want(&(0..patches.vertices.len() as u32).collect::<Vec<_>>(), patches.vertices.len());
        transfers.add_to(sources.iter().map(|s| s.radiance_rgb).enumerate(), &mut planes);
        planes.take(&mut kept_rgb);
        let gathered_rgb: Vec<[f32; 3]> = kept_rgb
            .iter()
            .zip(&rest_rgb)
            .map(|(kept, rest)| std::array::from_fn(|c| kept[c] + rest[c]))
            .collect();
        progress(0.9);

        let (thresholds, neglected_worst) =
            thresholds(&sources, &transfers, &receiving, f64::from(how.neglected));
        let leaf_vertices = leaf_vertices(&patches, &receivers, &octree);
        let kept = |leaf: usize, flags: &mut [bool]| {
            let luminance = sources[leaf].luminance;
            let mut counts = vec![false; thresholds.len()];
            for (first, codes) in transfers.blocks(leaf) {
                for ((count, threshold), code) in
                    counts[first..].iter_mut().zip(&thresholds[first..]).zip(codes)
                {
                    *count = *code > 0 && luminance * unpack(*code) >= *threshold;
                }
            }
            for (node, vertices) in &leaf_vertices {
                flags[*node] = vertices.iter().any(|&v| counts[v as usize]);
            }
        };
        let shafts = ShaftHierarchy::build(&source_tree, &source_boxes, &octree, &kept);
        let mut field = Self {
            patches,
            sources,
            source_tree,
            source_boxes,
            receivers,
            octree,
            shafts,
            gathered_rgb,
            kept_rgb,
            transfers,
            sums,
            scatters_m2,
            report: FieldReport::default(),
        };
        field.report = field.examine(set.left_out, set.power_share, neglected_worst);
        progress(1.0);
        field
    }

    /// T = F V of each source at every vertex, in the order of `sources`; in 16 bits, wrong by at most one in 4096.
    pub fn transfers(&self) -> &Transfers {
        &self.transfers
    }

    /// The same summed over the receivers of each node of the octree.
    pub fn sums(&self) -> &NodeSums {
        &self.sums
    }

    /// Mean square of each source's places about its middle: xx, xy, xz, yy, yz, zz, square metres.
    pub(super) fn source_scatters_m2(&self) -> &[[f32; 6]] {
        &self.scatters_m2
    }

    /// Bytes that the room made ready holds.
    pub fn bytes(&self) -> usize {
        let patches = size_of_val(&*self.patches.vertices) + size_of_val(&*self.patches.patches);
        let sources =
            size_of_val(&*self.sources) + size_of_val(&*self.source_boxes) + size_of_val(&*self.scatters_m2);
        let tree = size_of_val(self.source_tree.nodes()) + size_of_val(self.source_tree.order());
        let octree = size_of_val(self.octree.nodes()) + size_of_val(self.octree.order());
        let receivers = size_of_val(&*self.receivers);
        let light = size_of_val(&*self.gathered_rgb) + size_of_val(&*self.kept_rgb);
        let pairs = self.transfers.bytes() + self.sums.bytes() + self.shafts.bytes();
        patches + sources + tree + octree + receivers + light + pairs
    }

    /// What was built, and what it leaves out.
    pub fn report(&self) -> &FieldReport {
        &self.report
    }

    fn examine(&self, sources_left_out: usize, power_share: f32, neglected_worst: f32) -> FieldReport {
        let luminance = |rgb: &[f32; 3]| color::luminance(*rgb);
        let lost: Vec<f32> = (self.gathered_rgb.iter().zip(&self.kept_rgb))
            .filter(|(all, _)| luminance(all) > 0.0)
            .map(|(all, kept)| 1.0 - luminance(kept) / luminance(all))
            .collect();
        let unlit = |i: &&u32| {
            let patch = &self.patches.patches[**i as usize];
            patch.corners().iter().all(|&v| luminance(&self.gathered_rgb[v as usize]) <= 0.0)
        };
        FieldReport {
            patches: self.patches.patches.len(),
            vertices: self.patches.vertices.len(),
            dropped_faces: self.patches.dropped_faces,
            receivers: self.receivers.len(),
            unlit_receivers: self.receivers.iter().filter(unlit).count(),
            sources: self.sources.len(),
            sources_left_out,
            power_share,
            lost_mean: lost.iter().sum::<f32>() / lost.len().max(1) as f32,
            lost_worst: lost.iter().copied().fold(0.0, f32::max),
            neglected_worst,
            leaf_shafts: self.shafts.leaves(),
            shafts: self.shafts.len(),
            shaft_bytes: self.shafts.bytes(),
            transfer_bytes: self.transfers.bytes() + self.sums.bytes(),
            bytes: self.bytes(),
        }
    }
}

/// For each vertex the luminance from which on a source counts, and the largest share neglected anywhere.
fn thresholds(sources: &[SendingPatch], rows: &Transfers, receiving: &[bool], share: f64) -> (Vec<f32>, f32) {
    let of_block = |(block, receiving): (usize, &[bool])| {
        let mut light: Vec<Vec<f32>> = vec![Vec::with_capacity(sources.len()); receiving.len()];
        for (index, source) in sources.iter().enumerate() {
            let Some(codes) = rows.block(index, block) else { continue };
            for (values, code) in light.iter_mut().zip(codes).filter(|(_, code)| **code > 0) {
                values.push(source.luminance * unpack(*code));
            }
        }
        let mut found = Vec::with_capacity(receiving.len());
        for (values, receiving) in light.iter_mut().zip(receiving) {
            if !receiving {
                found.push((0.0, 0.0));
                continue;
            }
            let threshold = budget_threshold(values, share);
            let total: f32 = values.iter().sum();
            let below: f32 = values.iter().filter(|v| **v < threshold).sum();
            found.push((threshold, if total > 0.0 { below / total } else { 0.0 }));
        }
        found
    };
    let found: Vec<Vec<(f32, f32)>> = receiving.par_chunks(BLOCK).enumerate().map(of_block).collect();
    let worst = found.iter().flatten().map(|f| f.1).fold(0.0, f32::max);
    (found.into_iter().flatten().map(|f| f.0).collect(), worst)
}

/// Vertices of the patches in each leaf of the octree, each once.
fn leaf_vertices(patches: &RoomPatches, receivers: &[u32], octree: &Octree) -> Vec<(usize, Vec<u32>)> {
    let leaves = octree.nodes().iter().enumerate().filter(|(_, node)| node.is_leaf());
    leaves
        .map(|(index, node)| {
            let items = octree.items(node).iter();
            let mut vertices: Vec<u32> = items
                .flat_map(|&i| patches.patches[receivers[i as usize] as usize].corners().to_vec())
                .collect();
            vertices.sort_unstable();
            vertices.dedup();
            (index, vertices)
        })
        .collect()
}

#[cfg(test)]
mod tests;
