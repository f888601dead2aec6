//! The marked sources as at most n lights, each with one hard shadow (Section 8 of [Gib03]).

use super::{field::NearField, marks::Marks, packed::BlockSums, shaft::Aabb};
use crate::{
    math::solve::symmetric_eigen,
    sources::expand::{Chosen, Expander, Marked, Priority, WantedNodes},
    visibility::point_maps::SeenPart,
};
use glam::{DVec3, Vec3};

/// A light that stands for the marked sources below a node of the source tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Representative {
    /// Node of the source tree; only its marked leaves count.
    pub node: u32,
    /// The source in the middle of them, whose place the shadow is drawn from: an index into [`NearField::sources`].
    pub source: u32,
    /// That place, world frame, metres.
    pub centre_world: Vec3,
    /// Unit vector away from the front of the patch there: it sends nothing behind.
    pub normal_world: Vec3,
    /// Mean place of its sources by the light they send, world frame, metres.
    pub middle_world: Vec3,
    /// Half axes of an even parallelogram about the middle that is as wide as its sources are spread: what its penumbra
    /// comes from. Longer one first, at right angles.
    pub half_axes_world: [Vec3; 2],
    /// Mean irradiance (luminance) that it sends to the marked receivers.
    pub light: f32,
    /// Root mean square angle of its sources, seen from the objects, radians.
    pub extent_rad: f32,
    /// Whether its place lies within the box of an object: a shadow map with one frustum cannot be drawn from there.
    pub inside: bool,
}

/// Chooses representatives; keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Representatives {
    expander: Expander,
    light: Vec<f32>,
    towards: Vec<Vec3>,
    /// One over each marked source's distance, 1/m.
    nearness: Vec<f32>,
    /// Whether all leaves below a node of the octree are marked.
    whole: Vec<bool>,
    sums: BlockSums,
    /// For each source along which its light's places are told: luminance, times its place along both half axes, times the
    /// squares of these.
    shapes: BlockSums<5>,
    shape: Vec<[f32; 5]>,
    eye: Vec3,
    near: Vec<Representative>,
    far: Vec<Chosen>,
}

impl Representatives {
    /// Cuts the marked sources into as many lights as `wanted`, together with a tree of far light (such as the compact
    /// lights' texels, or a room's suns, `sun_sources`) where one is given: both share the count by what it gains, and their
    /// light must be in one unit, irradiance in luminance. A single light for both goes to the tree that sends more
    /// ([`Expander::expand`]); objects hide nothing of the other then. `objects` are the boxes given to [`Marks::mark`].
    ///
    /// The light of a marked source is the mean over the receivers of the marked leaves, by their area, of pi L T.
    pub fn choose(
        &mut self,
        field: &NearField,
        marks: &Marks,
        objects: &[Aabb],
        far: Option<Marked<'_>>,
        wanted: WantedNodes,
        by: Priority,
    ) {
        let around = objects.iter().filter(|b| b.is_sound()).fold(Aabb::EMPTY, |sum, b| sum.join(b));
        let eye = around.centre();
        self.eye = eye;
        self.light.clear();
        self.light.resize(field.sources.len(), 0.0);
        let area_m2 = self.receive(field, marks);
        let scale = if area_m2 > 0.0 { std::f32::consts::PI / area_m2 } else { 0.0 };
        self.towards.resize(field.sources.len(), Vec3::Z);
        self.nearness.resize(field.sources.len(), 0.0);
        for (index, (light, source)) in self.light.iter_mut().zip(&field.sources).enumerate() {
            if !marks.has_source(index) {
                *light = 0.0;
                continue;
            }
            // A marked source is never left out, however faint.
            *light = (*light * source.luminance * scale).max(f32::MIN_POSITIVE);
            let to = source.centre_world - eye;
            self.towards[index] = to.normalize_or(Vec3::Z);
            self.nearness[index] = 1.0 / to.length().max(1e-3);
        }
        let near =
            Marked { tree: &field.source_tree, light: &self.light, towards: &self.towards, lasting: true };
        let both = [near, far.unwrap_or(near)];
        let trees = if far.is_some() { &both[..] } else { &both[..1] };
        self.near.clear();
        self.far.clear();
        self.expander.expand(trees, wanted, by);
        for chosen in self.expander.chosen() {
            if chosen.tree == 1 {
                self.far.push(*chosen);
                continue;
            }
            let source = &field.sources[chosen.centre as usize];
            let (middle_world, half_axes_world) = self.spread(field, chosen.node, eye);
            self.near.push(Representative {
                node: chosen.node,
                source: chosen.centre,
                centre_world: source.centre_world,
                normal_world: source.normal_world,
                middle_world,
                half_axes_world,
                light: chosen.light,
                extent_rad: chosen.extent_rad,
                inside: objects.iter().any(|b| b.contains(source.centre_world)),
            });
        }
    }

    /// Lights of the room, in order of the tree.
    pub fn near(&self) -> &[Representative] {
        &self.near
    }

    /// What the choice leaves undone ([`Expander::left_rad`]).
    pub fn left_rad(&self) -> f32 {
        self.expander.left_rad()
    }

    /// Nodes chosen of the far tree.
    pub fn far(&self) -> &[Chosen] {
        &self.far
    }

    /// What each near light sends to each vertex: sum over its marked sources of L T, linear RGB, light by light, each
    /// with an entry for every vertex of the room; right at the marked vertices, at others it may be zero. Times the
    /// vertex's diffuse reflectance it is the radiance L_xk that is to be taken away where the light is hidden; over
    /// [`NearField::gathered_rgb`] it is the share of it.
    pub fn light_rows(&mut self, field: &NearField, marks: &Marks, out: &mut Vec<[f32; 3]>) {
        let vertices = field.patches.vertices.len();
        out.resize(self.near.len() * vertices, [0.0; 3]);
        self.sums.want(marks.vertices(), vertices);
        for (light, row) in self.near.iter().zip(out.chunks_mut(vertices.max(1))) {
            let node = field.source_tree.nodes()[light.node as usize];
            let marked = (node.begin as usize..node.end as usize).filter(|&s| marks.has_source(s));
            field.transfers().add_to(marked.map(|s| (s, field.sources[s].radiance_rgb)), &mut self.sums);
            self.sums.take(row);
        }
    }

    /// Which part of each near light each vertex sees, as [`Representatives::light_rows`] lists what arrives there: the room
    /// itself hides the rest, and what is near sends more.
    pub fn light_parts(&mut self, field: &NearField, marks: &Marks, out: &mut Vec<SeenPart>) {
        let vertices = field.patches.vertices.len();
        out.resize(self.near.len() * vertices, SeenPart::WHOLE);
        self.shapes.want(marks.vertices(), vertices);
        self.shape.resize(vertices, [0.0; 5]);
        for (light, parts) in self.near.iter().zip(out.chunks_mut(vertices.max(1))) {
            let node = field.source_tree.nodes()[light.node as usize];
            let marked = (node.begin as usize..node.end as usize).filter(|&s| marks.has_source(s));
            // Sources at their directions from the objects, as `spread` has them.
            let distance_m = (light.middle_world - self.eye).length();
            let along = light.half_axes_world.map(|axis| axis / axis.length_squared().max(1e-12));
            let factors = marked.map(|s| {
                let off = self.eye + self.towards[s] * distance_m - light.middle_world;
                let [xx, xy, xz, yy, yz, zz] = field.source_scatters_m2()[s];
                let square = |v: Vec3| {
                    let [x, y, z] = (v * v).to_array();
                    x * xx + y * yy + z * zz + 2.0 * (v.x * v.y * xy + v.x * v.z * xz + v.y * v.z * yz)
                };
                let [a, b] = along.map(|v| off.dot(v));
                let [aa, bb] = [a * a + square(along[0]), b * b + square(along[1])];
                (s, [1.0, a, b, aa, bb].map(|f| f * field.sources[s].luminance))
            });
            field.transfers().add_to(factors, &mut self.shapes);
            self.shapes.take(&mut self.shape);
            for (part, [light, a, b, aa, bb]) in parts.iter_mut().zip(&self.shape) {
                if !(*light > 0.0) {
                    continue;
                }
                let [a, b, aa, bb] = [a, b, aa, bb].map(|sum| sum / light);
                // Even light over half a length h has the variance h^2 / 3.
                let half = [aa - a * a, bb - b * b].map(|v| (3.0 * v.max(0.0)).sqrt());
                *part = SeenPart::of([a, b], half);
            }
        }
    }

    /// Adds to each source's entry its T over the receivers of the marked leaves; their area, square metres.
    fn receive(&mut self, field: &NearField, marks: &Marks) -> f32 {
        let nodes = field.octree.nodes();
        self.whole.clear();
        self.whole.resize(nodes.len(), false);
        for &leaf in marks.leaves() {
            self.whole[leaf as usize] = true;
        }
        for (i, node) in nodes.iter().enumerate().rev().filter(|(_, n)| !n.is_leaf()) {
            let first = node.children as usize;
            self.whole[i] = self.whole[first..first + node.child_count as usize].iter().all(|w| *w);
        }
        let mut area_m2 = 0.0;
        for node in (0..nodes.len()).filter(|&n| self.whole[n]) {
            let above = field.shafts.receiver_parent(node as u32) as usize;
            // The node above stands for it.
            if node == 0 || !self.whole[above] {
                field.sums().add_to(node, &mut self.light);
                area_m2 += field.sums().area_m2(node);
            }
        }
        area_m2
    }

    /// Middle and half axes of the marked sources below a node, each as wide as its patch: by their directions from `eye`,
    /// at their mean distance, for the middle of places on several walls would lie in the open before them.
    fn spread(&self, field: &NearField, node: u32, eye: Vec3) -> (Vec3, [Vec3; 2]) {
        let node = field.source_tree.nodes()[node as usize];
        let (mut total, mut nearness, mut moment) = (0.0, 0.0, DVec3::ZERO);
        let (mut second, mut own) = ([0.0; 6], [0.0; 6]);
        for s in (node.begin as usize..node.end as usize).filter(|&s| self.light[s] > 0.0) {
            let light = f64::from(self.light[s]);
            let towards = self.towards[s].as_dvec3();
            total += light;
            nearness += light * f64::from(self.nearness[s]);
            moment += towards * light;
            let [x, y, z] = towards.to_array();
            let squares = [x * x, x * y, x * z, y * y, y * z, z * z];
            let scatter = &field.source_scatters_m2()[s];
            for k in 0..6 {
                second[k] += light * squares[k];
                own[k] += light * f64::from(scatter[k]);
            }
        }
        let (mean, nearness) = (moment / total, nearness / total);
        let middle = (eye.as_dvec3() + mean.normalize_or(DVec3::Z) / nearness).as_vec3();
        let [x, y, z] = mean.to_array();
        let squares = [x * x, x * y, x * z, y * y, y * z, z * z];
        let at = |k: usize| (second[k] / total - squares[k]) / (nearness * nearness) + own[k] / total;
        let scatter = [[at(0), at(1), at(2)], [at(1), at(3), at(4)], [at(2), at(4), at(5)]];
        let Some((values, vectors)) = symmetric_eigen(&scatter) else {
            return (middle, [Vec3::ZERO; 2]);
        };
        // Even light over half a length h has the variance h^2 / 3.
        let axis = |k: usize| (DVec3::from(vectors[k]) * (3.0 * values[k].max(0.0)).sqrt()).as_vec3();
        (middle, [axis(0), axis(1)])
    }
}

#[cfg(test)]
mod tests;
