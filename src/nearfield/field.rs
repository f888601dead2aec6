//! A room made ready: its sources, what each sends to every vertex, and the shafts between them (Sections 4 to 6 of
//! [Gib03]). Nothing here depends on the camera or on what moves.

use super::{
    error::RoomError,
    octree::Octree,
    packed::{BLOCK, BlockSums, PackedRow, Transfers, unpack},
    sets::{budget_threshold, source_set},
    shaft::Aabb,
    shafts::ShaftHierarchy,
    sums::NodeSums,
    transfer::{SourceOutline, Statics},
};
use crate::{
    math::color,
    model::room::{Patch, PatchVertex, Room, RoomPatches},
    sources::tree::SourceTree,
};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Share of the progress that the transfers take.
const TRANSFERS_SHARE: f32 = 0.8;

/// In the tree over sources, patches stand this share of the room's diagonal behind themselves: so those of different
/// walls part early, though they adjoin.
const APART: f32 = 0.2;

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
    /// As in [Gib03]: 70 % of the power, and 2 %; one ray each.
    fn default() -> Self {
        Self { power_share: 0.7, rays_side: 1, neglected: 0.02 }
    }
}

/// A source: a patch of the set, in the source tree's own order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Index of the patch.
    pub patch: u32,
    /// Where its shadow is drawn from: its centroid, world frame, metres.
    pub centre_world: Vec3,
    /// Unit vector away from its front, world frame.
    pub normal_world: Vec3,
    /// Its radiance, linear RGB.
    pub radiance_rgb: [f32; 3],
    /// Its luminance.
    pub luminance: f32,
}

/// What was built.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldReport {
    /// Patches.
    pub patches: usize,
    /// Vertices.
    pub vertices: usize,
    /// Faces left out.
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
    /// All shafts.
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
    pub sources: Vec<Source>,
    /// The tree over them.
    pub source_tree: SourceTree,
    /// Box of each node of the source tree.
    pub source_boxes: Vec<Aabb>,
    /// Patches that reflect; the octree's items are indices into it.
    pub receivers: Vec<u32>,
    /// The tree over them.
    pub octree: Octree,
    /// The shafts.
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
        check(how)?;
        let all = &patches.patches;
        let set = source_set(all, f64::from(how.power_share));
        if set.patches.is_empty() {
            return Err(RoomError::NoLight { patches: all.len() });
        }
        let reflects = |p: &Patch| p.reflectance_rgb.iter().any(|c| *c > 0.0);
        let receivers: Vec<u32> = (0..all.len() as u32).filter(|&i| reflects(&all[i as usize])).collect();
        if receivers.is_empty() {
            return Err(RoomError::NoReceivers { patches: all.len() });
        }
        let bounds = Aabb::around(patches.vertices.iter().map(|v| v.position_world));
        let apart = APART * bounds.diagonal();
        let place = |i: &u32| all[*i as usize].centre_world - all[*i as usize].normal_world * apart;
        let places: Vec<Vec3> = set.patches.iter().map(place).collect();
        let power = |i: &u32| color::luminance(all[*i as usize].radiance_rgb) * all[*i as usize].area_m2;
        let powers: Vec<f32> = set.patches.iter().map(power).collect();
        let source_tree = SourceTree::build(&places, &powers);
        let sources: Vec<Source> =
            source_tree.order().iter().map(|&i| source(all, set.patches[i as usize])).collect();
        let scatters_m2 = sources.iter().map(|s| scatter_m2(&patches, s)).collect();
        let source_boxes = node_boxes(&source_tree, &sources, &patches);
        let boxes: Vec<Aabb> = receivers.iter().map(|&i| patch_box(&patches, i)).collect();
        let octree = Octree::build(&boxes);

        let receiving = receiving_vertices(&patches, &receivers);
        let statics = Statics::new(room);
        let done = AtomicUsize::new(0);
        let rows: Vec<(PackedRow, Vec<u16>)> = sources
            .par_iter()
            .enumerate()
            .map_init(
                || vec![0.0f32; patches.vertices.len()],
                |dense, (index, source)| {
                    let patch = &all[source.patch as usize];
                    let outline = SourceOutline::new(&patches, patch, index as u32);
                    for (i, (slot, vertex)) in dense.iter_mut().zip(&patches.vertices).enumerate() {
                        *slot = if receiving[i] {
                            let (at, normal) = (vertex.gather_world, vertex.normal_world);
                            outline.transfer(&statics, at, normal, i as u32, how.rays_side)
                        } else {
                            0.0
                        };
                    }
                    let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
                    progress(TRANSFERS_SHARE * finished as f32 / sources.len() as f32);
                    let sums = NodeSums::of_source(&patches, &receivers, &octree, dense);
                    (PackedRow::from_dense(dense), sums)
                },
            )
            .collect();
        let (rows, row_sums): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        let transfers = Transfers::of(&rows);
        drop(rows);
        let sums = NodeSums::of(&patches, &receivers, &octree, &row_sums);
        drop(row_sums);

        let mut kept_rgb = vec![[0.0f32; 3]; patches.vertices.len()];
        let mut planes: BlockSums = BlockSums::default();
        planes.want(&(0..patches.vertices.len() as u32).collect::<Vec<_>>(), patches.vertices.len());
        transfers.add_to(sources.iter().map(|s| s.radiance_rgb).enumerate(), &mut planes);
        planes.take(&mut kept_rgb);
        let rest = rest_of_light(&patches, &set.patches, &receiving, &statics);
        let gathered_rgb: Vec<[f32; 3]> = kept_rgb
            .iter()
            .zip(&rest)
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
        Ok(field)
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

fn check(how: &Preparation) -> Result<(), RoomError> {
    let refuse =
        |setting, value: f64, allowed| Err(RoomError::Setting { setting, value: value.to_string(), allowed });
    if !(how.power_share > 0.0 && how.power_share <= 1.0) {
        return refuse("power_share", how.power_share.into(), "above 0 and at most 1");
    }
    if !(1..=8).contains(&how.rays_side) {
        return refuse("rays_side", how.rays_side.into(), "within 1 to 8");
    }
    if !(0.0..=0.5).contains(&how.neglected) {
        return refuse("neglected", how.neglected.into(), "within 0 to 0.5");
    }
    Ok(())
}

fn source(all: &[Patch], index: u32) -> Source {
    let patch = &all[index as usize];
    Source {
        patch: index,
        centre_world: patch.centre_world,
        normal_world: patch.normal_world,
        radiance_rgb: patch.radiance_rgb,
        luminance: color::luminance(patch.radiance_rgb),
    }
}

/// A parallelogram about its middle has the scatter of its sides over 12; a triangle's is that of its corners over 12.
fn scatter_m2(patches: &RoomPatches, source: &Source) -> [f32; 6] {
    let (corners, count) = patches.outline_world(&patches.patches[source.patch as usize]);
    let [a, b, c, d] = corners.map(|c| c.as_dvec3());
    let middle = source.centre_world.as_dvec3();
    let arms = if count == 4 {
        [(b - a + c - d) * 0.5, (d - a + c - b) * 0.5, glam::DVec3::ZERO]
    } else {
        [a - middle, b - middle, c - middle]
    };
    let sum = |i: usize, j: usize| (arms.iter().map(|v| v[i] * v[j]).sum::<f64>() / 12.0) as f32;
    [sum(0, 0), sum(0, 1), sum(0, 2), sum(1, 1), sum(1, 2), sum(2, 2)]
}

fn patch_box(patches: &RoomPatches, index: u32) -> Aabb {
    let (corners, count) = patches.outline_world(&patches.patches[index as usize]);
    Aabb::around(corners[..count].iter().copied())
}

fn node_boxes(tree: &SourceTree, sources: &[Source], patches: &RoomPatches) -> Vec<Aabb> {
    let mut boxes = vec![Aabb::EMPTY; tree.nodes().len()];
    for (i, node) in tree.nodes().iter().enumerate().rev() {
        boxes[i] = if node.is_leaf() {
            patch_box(patches, sources[node.begin as usize].patch)
        } else {
            boxes[node.children as usize].join(&boxes[node.children as usize + 1])
        };
    }
    boxes
}

fn receiving_vertices(patches: &RoomPatches, receivers: &[u32]) -> Vec<bool> {
    let mut receiving = vec![false; patches.vertices.len()];
    for &i in receivers {
        for &v in patches.patches[i as usize].corners() {
            receiving[v as usize] = true;
        }
    }
    receiving
}

/// What all patches outside of the set send to each vertex, by one ray each.
fn rest_of_light(patches: &RoomPatches, set: &[u32], receiving: &[bool], statics: &Statics) -> Vec<[f32; 3]> {
    let mut in_set = vec![false; patches.patches.len()];
    set.iter().for_each(|&i| in_set[i as usize] = true);
    let rest: Vec<(SourceOutline, [f32; 3])> = (patches.patches.iter().zip(&in_set))
        .filter(|(patch, in_set)| !**in_set && color::luminance(patch.radiance_rgb) > 0.0)
        .enumerate()
        .map(|(i, (patch, _))| (SourceOutline::new(patches, patch, i as u32), patch.radiance_rgb))
        .collect();
    let gather = |(index, vertex): (usize, &PatchVertex)| {
        let mut sum = [0.0f32; 3];
        if receiving[index] {
            for (outline, radiance) in &rest {
                let transfer =
                    outline.transfer(statics, vertex.gather_world, vertex.normal_world, index as u32, 1);
                sum.iter_mut().zip(radiance).for_each(|(sum, c)| *sum += c * transfer);
            }
        }
        sum
    };
    patches.vertices.par_iter().enumerate().map(gather).collect()
}

/// For each vertex the luminance from which on a source counts, and the largest share neglected anywhere.
fn thresholds(sources: &[Source], rows: &Transfers, receiving: &[bool], share: f64) -> (Vec<f32>, f32) {
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
