//! Which sources and receivers moving objects may come between in a frame (Section 6.1 of [Gib03]).

use super::{
    field::NearField,
    shaft::{Aabb, shaft_interval},
};
use crate::{
    math::{lens::Lens, pose::Pose},
    model::room::RoomPatch,
};
use glam::{DVec2, DVec3, Vec3};

/// Which receivers a camera may see: the one part that depends on the view. What is hidden by other parts of the room
/// still counts as seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenReceivers {
    /// For each of [`NearField::receivers`].
    pub receivers: Vec<bool>,
    /// For each node of the octree: whether any of its receivers is seen.
    pub nodes: Vec<bool>,
    /// Where the camera is, and axis and half angle (radians) of the cone about its picture; `None`: all directions.
    eye: DVec3,
    cone: Option<(DVec3, f64)>,
}

impl SeenReceivers {
    /// Whether what a box contains may be in the picture, by its bounding sphere.
    pub fn may_see(&self, object: &Aabb) -> bool {
        let (to, radius) = (object.centre().as_dvec3() - self.eye, 0.5 * f64::from(object.diagonal()));
        self.cone.is_none_or(|(axis, angle)| reaches(&axis, angle, to, radius))
    }

    /// Looks anew; keeps its memory. A receiver counts where its front faces the camera and its bounding sphere reaches
    /// into the cone about the picture's middle that holds the whole picture; with a lens whose picture's border has no
    /// rays, the cone is all directions.
    pub fn look(&mut self, field: &NearField, lens: &Lens, world_from_camera: &Pose) {
        let eye = world_from_camera.translation;
        let (width, height) = (f64::from(lens.width), f64::from(lens.height));
        let axis = lens.unproject(DVec2::new(0.5 * width, 0.5 * height));
        // Widest at a corner, or half way along a side where the lens bends.
        let mut border = (0..8).map(|k| {
            let step = |k: i32| f64::from([0, 0, 0, 1, 2, 2, 2, 1][k as usize]) * 0.5;
            let at = DVec2::new(step(k) * width, step((k + 6) % 8) * height);
            Some(axis?.angle_between(lens.unproject(at)?))
        });
        let half_angle = border.try_fold(0.0f64, |most, angle| Some(most.max(angle?)));
        let cone = axis.map(|a| world_from_camera.rotate(a)).zip(half_angle);
        (self.eye, self.cone) = (eye, cone);
        self.receivers.clear();
        let patches = &field.patches;
        self.receivers.extend(field.receivers.iter().map(|&i| {
            let patch = &patches.patches[i as usize];
            let to = patch.centre_world.as_dvec3() - eye;
            let faces = patch.normal_world.as_dvec3().dot(to) < 0.0;
            faces && cone.is_none_or(|(axis, angle)| reaches(&axis, angle, to, radius(field, patch)))
        }));
        self.nodes.clear();
        self.nodes.resize(field.octree.nodes().len(), false);
        for (i, node) in field.octree.nodes().iter().enumerate().rev() {
            self.nodes[i] = if node.is_leaf() {
                field.octree.items(node).iter().any(|&item| self.receivers[item as usize])
            } else {
                let first = node.children as usize;
                self.nodes[first..first + node.child_count as usize].iter().any(|n| *n)
            };
        }
    }
}

fn radius(field: &NearField, patch: &RoomPatch) -> f64 {
    let (corners, count) = field.patches.outline_world(patch);
    corners[..count].iter().map(|c| c.distance(patch.centre_world)).fold(0.0, f32::max).into()
}

/// Whether a sphere reaches into a cone about a unit vector, both seen from the cone's tip.
fn reaches(axis: &DVec3, half_angle: f64, to: DVec3, radius: f64) -> bool {
    let distance = to.length();
    if !(distance > radius) {
        return true;
    }
    axis.angle_between(to) <= half_angle + (radius / distance).asin()
}

/// A shaft, and how many of the objects may reach into it.
#[derive(Clone, Copy, Debug)]
struct OpenShaft {
    source: u32,
    receiver: u32,
    candidates: u32,
}

/// What moving objects may hide in a frame; keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Marks {
    frame: u32,
    source_tags: Vec<u32>,
    leaf_tags: Vec<u32>,
    vertex_tags: Vec<u32>,
    sources: Vec<u32>,
    leaves: Vec<u32>,
    vertices: Vec<u32>,
    objects: Vec<Aabb>,
    /// Shafts to look at.
    stack: Vec<OpenShaft>,
    /// How many sources below each node of the source tree, and leaves below each of the octree, may still be marked.
    sources_left: Vec<u32>,
    leaves_left: Vec<u32>,
    tested: usize,
}

impl Marks {
    /// Marks every source and every leaf of receivers between which the box of at least one object reaches; only
    /// receivers in the view count, where one is given. Boxes that are empty or not finite reach nowhere. An object that
    /// contains a source or a receiver reaches into its shafts.
    pub fn mark(&mut self, field: &NearField, objects: &[Aabb], view: Option<&SeenReceivers>) {
        self.begin(field, view);
        self.objects.clear();
        self.objects.extend(objects.iter().filter(|b| b.is_sound()));
        self.stack.clear();
        if !self.objects.is_empty() {
            self.open(field, view, 0, 0, self.objects.len() as u32);
        }
        let nodes = field.octree.nodes();
        while let Some(OpenShaft { source, receiver, candidates }) = self.stack.pop() {
            // All that it could mark is marked.
            if self.sources_left[source as usize] == 0 && self.leaves_left[receiver as usize] == 0 {
                continue;
            }
            let source_box = &field.source_boxes[source as usize];
            let receiver_box = &nodes[receiver as usize].bounds;
            let divides_source = field.shafts.divides_source(source, receiver);
            // Objects that reach in come first: children test those alone, and any order of them will do.
            let mut inside = 0;
            for i in 0..candidates as usize {
                self.tested += 1;
                if shaft_interval(source_box, receiver_box, &self.objects[i]).is_some() {
                    self.objects.swap(inside, i);
                    inside += 1;
                    if divides_source.is_none() {
                        break;
                    }
                }
            }
            if inside == 0 {
                continue;
            }
            match divides_source {
                Some(true) => {
                    let children = field.source_tree.nodes()[source as usize].children;
                    self.open(field, view, children, receiver, inside as u32);
                    self.open(field, view, children + 1, receiver, inside as u32);
                }
                Some(false) => {
                    let node = &nodes[receiver as usize];
                    for child in node.children..node.children + node.child_count {
                        self.open(field, view, source, child, inside as u32);
                    }
                }
                None => {
                    let leaf = field.source_tree.nodes()[source as usize].begin;
                    if tag(self.frame, leaf, &mut self.source_tags, &mut self.sources) {
                        let tree = field.source_tree.nodes();
                        count_down(&mut self.sources_left, source, |node| tree[node as usize].parent);
                    }
                    if tag(self.frame, receiver, &mut self.leaf_tags, &mut self.leaves) {
                        count_down(&mut self.leaves_left, receiver, |n| field.shafts.receiver_parent(n));
                    }
                }
            }
        }
        self.sources.sort_unstable();
        self.leaves.sort_unstable();
        for &leaf in &self.leaves {
            for &item in field.octree.items(&nodes[leaf as usize]) {
                if view.is_some_and(|v| !v.receivers.get(item as usize).is_some_and(|r| *r)) {
                    continue;
                }
                for &v in field.patches.patches[field.receivers[item as usize] as usize].corners() {
                    tag(self.frame, v, &mut self.vertex_tags, &mut self.vertices);
                }
            }
        }
        self.vertices.sort_unstable();
    }

    /// Puts a shaft on the list, where there is one and its receivers are seen.
    fn open(
        &mut self,
        field: &NearField,
        view: Option<&SeenReceivers>,
        source: u32,
        receiver: u32,
        candidates: u32,
    ) {
        let seen = view.is_none_or(|v| v.nodes.get(receiver as usize).is_some_and(|n| *n));
        if seen && field.shafts.has(source, receiver) {
            self.stack.push(OpenShaft { source, receiver, candidates });
        }
    }

    fn begin(&mut self, field: &NearField, view: Option<&SeenReceivers>) {
        let sizes = [field.sources.len(), field.octree.nodes().len(), field.patches.vertices.len()];
        let lists = [&mut self.source_tags, &mut self.leaf_tags, &mut self.vertex_tags];
        let afresh = self.frame == u32::MAX;
        for (list, size) in lists.into_iter().zip(sizes) {
            if afresh || list.len() != size {
                list.clear();
                list.resize(size, 0);
            }
        }
        self.frame = if afresh { 1 } else { self.frame + 1 };
        self.sources.clear();
        self.leaves.clear();
        self.vertices.clear();
        self.tested = 0;
        self.sources_left.clear();
        self.sources_left.extend_from_slice(field.shafts.source_leaves());
        self.leaves_left.clear();
        self.leaves_left.extend_from_slice(field.shafts.receiver_leaves());
        if let Some(view) = view {
            // Leaves that are not seen are never marked.
            for (i, node) in field.octree.nodes().iter().enumerate().rev() {
                let first = node.children as usize;
                if !view.nodes.get(i).is_some_and(|n| *n) {
                    self.leaves_left[i] = 0;
                } else if !node.is_leaf() {
                    let children = first..first + node.child_count as usize;
                    self.leaves_left[i] = self.leaves_left[children].iter().sum();
                }
            }
        }
    }

    /// Marked sources: indices into [`NearField::sources`], in order.
    pub fn sources(&self) -> &[u32] {
        &self.sources
    }

    /// Marked leaves of the octree: indices of nodes, in order.
    pub fn leaves(&self) -> &[u32] {
        &self.leaves
    }

    /// Corners of the marked receivers (of those in the view), in order: where light may be taken away.
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// Whether a source is marked in this frame.
    pub fn has_source(&self, source: usize) -> bool {
        self.source_tags.get(source).is_some_and(|t| *t == self.frame)
    }

    /// Whether a vertex is among the marked receivers' in this frame.
    pub fn has_vertex(&self, vertex: usize) -> bool {
        self.vertex_tags.get(vertex).is_some_and(|t| *t == self.frame)
    }

    /// How many tests of a box against a shaft the frame took.
    pub fn tested(&self) -> usize {
        self.tested
    }
}

/// Tags an entry in this frame; whether it was not yet.
fn tag(frame: u32, index: u32, tags: &mut [u32], list: &mut Vec<u32>) -> bool {
    let slot = &mut tags[index as usize];
    let new = *slot != frame;
    if new {
        *slot = frame;
        list.push(index);
    }
    new
}

/// One less for a leaf and all nodes above it.
fn count_down(left: &mut [u32], leaf: u32, parent: impl Fn(u32) -> u32) {
    let mut node = leaf;
    loop {
        left[node as usize] = left[node as usize].saturating_sub(1);
        if node == 0 {
            return;
        }
        node = parent(node);
    }
}

/// The smallest box around points, or `None` where none is finite.
pub fn bounds_world(points: impl IntoIterator<Item = Vec3>) -> Option<Aabb> {
    let found = Aabb::around(points.into_iter().filter(|p| p.is_finite()));
    found.is_sound().then_some(found)
}

#[cfg(test)]
mod tests;
