//! What every source of a room sends to every vertex, found by rays: the part of a known room that costs most, and that is
//! worth keeping from run to run. Nothing here depends on the camera or on what moves.

use super::{
    error::RoomError,
    field::Preparation,
    octree::Octree,
    packed::{PackedRow, Transfers},
    sets::{SourceSet, source_set},
    shaft::Aabb,
    sums::NodeSums,
    transfer::{SourceOutline, Statics},
};
use crate::{
    math::color,
    model::{
        keep::KeptInput,
        room::{Face, PatchVertex, Room, RoomPatch, RoomPatches},
    },
    sources::tree::SourceTree,
};
use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Share of the progress that the transfers of the set take.
const TRANSFERS_SHARE: f32 = 0.9;
/// In the tree over sources, patches stand this share of the room's diagonal behind themselves: so those of different
/// walls part early, though they adjoin.
const APART: f32 = 0.2;

/// A source: a patch of the set, in the source tree's own order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SendingPatch {
    /// Index of the patch.
    pub patch: u32,
    /// Where its shadow is drawn from: its centroid, world frame, metres.
    pub centre_world: Vec3,
    /// Unit vector away from its front, world frame.
    pub normal_world: Vec3,
    /// Its radiance, linear RGB.
    pub radiance_rgb: [f32; 3],
    /// Luminance of `radiance_rgb`.
    pub luminance: f32,
}

/// Both ends of the light's ways: sources and receivers, in their trees.
#[derive(Clone, Debug, PartialEq)]
pub struct Ends {
    /// Patches that count as sources.
    pub set: SourceSet,
    /// The same in the tree's own order.
    pub sources: Vec<SendingPatch>,
    /// The tree over them.
    pub source_tree: SourceTree,
    /// Box of each node of the source tree.
    pub source_boxes: Vec<Aabb>,
    /// Mean square of each source's places about its middle: xx, xy, xz, yy, yz, zz, square metres.
    pub scatters_m2: Vec<[f32; 6]>,
    /// Patches that reflect; the octree's items are indices into it.
    pub receivers: Vec<u32>,
    /// The tree over them.
    pub octree: Octree,
    /// For each vertex whether it belongs to a receiver.
    pub receiving: Vec<bool>,
}

impl Ends {
    /// Of a room's patches.
    ///
    /// # Errors
    /// A setting out of range, no patch with a radiance above zero, or none that reflects.
    pub fn of(patches: &RoomPatches, how: &Preparation) -> Result<Self, RoomError> {
        check(how)?;
        let all = &patches.patches;
        let set = source_set(all, f64::from(how.power_share));
        if set.patches.is_empty() {
            return Err(RoomError::NoLight { patches: all.len() });
        }
        let reflects = |p: &RoomPatch| p.reflectance_rgb.iter().any(|c| *c > 0.0);
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
        let sources: Vec<SendingPatch> =
            source_tree.order().iter().map(|&i| source(all, set.patches[i as usize])).collect();
        let scatters_m2 = sources.iter().map(|s| scatter_m2(patches, s)).collect();
        let source_boxes = node_boxes(&source_tree, &sources, patches);
        let boxes: Vec<Aabb> = receivers.iter().map(|&i| patch_box(patches, i)).collect();
        let octree = Octree::build(&boxes);

        let receiving = receiving_vertices(patches, &receivers);
        Ok(Self { set, sources, source_tree, source_boxes, scatters_m2, receivers, octree, receiving })
    }
}

/// What arrives where, as rays found it; a part of the field, and all of it that takes long.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sent {
    /// T = F V of each source at every vertex.
    pub transfers: Transfers,
    /// The same over the receivers of each node of the octree.
    pub sums: NodeSums,
    /// For each vertex the sum of L F V over all patches outside of the source set.
    pub rest_rgb: Vec<[f32; 3]>,
}

/// What [`Sent::find`] is given.
#[derive(Clone, Copy, Debug)]
pub struct SentInput<'a> {
    /// The room, whose faces hide one another.
    pub room: &'a Room,
    /// What the room was divided into, with its light.
    pub patches: &'a RoomPatches,
    /// Sources and receivers of these patches, which follow from them and from `how`.
    pub ends: &'a Ends,
    /// Share of the power and number of rays.
    pub how: &'a Preparation,
}

impl KeptInput for SentInput<'_> {
    const KIND: &'static str = "transfers";
    const VERSION: u32 = 2;
    type Output = Sent;

    fn hashed(&self) -> impl Serialize {
        let Preparation { power_share, rays_side, neglected: _ } = self.how;
        (what_hides(self.room), self.patches, power_share, rays_side)
    }

    fn accepts(&self, sent: &Sent) -> bool {
        let (sources, vertices) = (self.ends.sources.len(), self.patches.vertices.len());
        sent.transfers.is_sound(sources, vertices)
            && sent.sums.is_sound(sources, self.ends.octree.nodes().len())
            && sent.rest_rgb.len() == vertices
    }
}

/// A room as far as rays meet it: names and light change nothing.
pub(super) fn what_hides(room: &Room) -> Vec<(&[Vec3], &[Face])> {
    room.surfaces.iter().map(|s| (&s.corners_world[..], &s.faces[..])).collect()
}

impl Sent {
    /// Casts the rays; the room's own faces hide one another. `progress` is told the share done, 0 to 1, from several threads,
    /// in no strict order. The result does not depend on threads.
    pub fn find(input: &SentInput<'_>, progress: &(dyn Fn(f32) + Sync)) -> Self {
        let SentInput { room, patches, ends, how } = *input;
        let Ends { set, sources, receivers, octree, receiving, .. } = ends;
        let statics = Statics::new(room);
        let done = AtomicUsize::new(0);
        let rows: Vec<(PackedRow, Vec<u16>)> = sources
            .par_iter()
            .enumerate()
            .map_init(
                || vec![0.0f32; patches.vertices.len()],
                |dense, (index, source)| {
                    let patch = &patches.patches[source.patch as usize];
                    let outline = SourceOutline::new(patches, patch, index as u32);
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
                    let sums = NodeSums::of_source(patches, receivers, octree, dense);
                    (PackedRow::from_dense(dense), sums)
                },
            )
            .collect();
        let (rows, row_sums): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        let transfers = Transfers::of(&rows);
        drop(rows);
        let sums = NodeSums::of(patches, receivers, octree, &row_sums);
        drop(row_sums);
        let rest_rgb = rest_of_light(patches, &set.patches, receiving, &statics);
        progress(1.0);
        Self { transfers, sums, rest_rgb }
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

fn source(all: &[RoomPatch], index: u32) -> SendingPatch {
    let patch = &all[index as usize];
    SendingPatch {
        patch: index,
        centre_world: patch.centre_world,
        normal_world: patch.normal_world,
        radiance_rgb: patch.radiance_rgb,
        luminance: color::luminance(patch.radiance_rgb),
    }
}

/// A parallelogram about its middle has the scatter of its sides over 12; a triangle's is that of its corners over 12.
fn scatter_m2(patches: &RoomPatches, source: &SendingPatch) -> [f32; 6] {
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

fn node_boxes(tree: &SourceTree, sources: &[SendingPatch], patches: &RoomPatches) -> Vec<Aabb> {
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
