//! The marked sources as at most n lights, each with one hard shadow (Section 8 of [Gib03]).

use super::{field::NearField, marks::Marks, shaft::Aabb};
use crate::{
    math::solve::symmetric_eigen,
    sources::expand::{Chosen, Expander, Marked, Priority},
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
    mask: Vec<f32>,
    near: Vec<Representative>,
    far: Vec<Chosen>,
}

impl Representatives {
    /// Cuts the marked sources into at most `count` lights, together with a tree of far light (such as the compact
    /// lights' texels) where one is given: both share the count by what it gains, and their light must be in one unit,
    /// irradiance in luminance. `objects` are the boxes given to [`Marks::mark`].
    ///
    /// The light of a marked source is the mean over the marked receivers' vertices of pi L T.
    pub fn choose(
        &mut self,
        field: &NearField,
        marks: &Marks,
        objects: &[Aabb],
        far: Option<Marked<'_>>,
        count: usize,
        by: Priority,
    ) {
        let around = objects.iter().filter(|b| b.is_sound()).fold(Aabb::EMPTY, |sum, b| sum.join(b));
        let eye = around.centre();
        self.mask.clear();
        self.mask.resize(field.patches.vertices.len(), 0.0);
        for &vertex in marks.vertices() {
            self.mask[vertex as usize] = 1.0;
        }
        let scale = std::f32::consts::PI / marks.vertices().len().max(1) as f32;
        self.light.clear();
        self.light.resize(field.sources.len(), 0.0);
        self.towards.clear();
        self.towards.extend(field.sources.iter().map(|s| (s.centre_world - eye).normalize_or(Vec3::Z)));
        for &source in marks.sources() {
            let sum = field.transfers()[source as usize].dot(&self.mask);
            let light = field.sources[source as usize].luminance * sum * scale;
            // A marked source is never left out, however faint.
            self.light[source as usize] = light.max(f32::MIN_POSITIVE);
        }
        let near =
            Marked { tree: &field.source_tree, light: &self.light, towards: &self.towards, lasting: true };
        let both = [near, far.unwrap_or(near)];
        let trees = if far.is_some() { &both[..] } else { &both[..1] };
        self.near.clear();
        self.far.clear();
        for chosen in self.expander.expand(trees, count, by) {
            if chosen.tree == 1 {
                self.far.push(*chosen);
                continue;
            }
            let source = &field.sources[chosen.centre as usize];
            let (middle_world, half_axes_world) = spread(field, chosen.node, &self.light, eye);
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

    /// Nodes chosen of the far tree.
    pub fn far(&self) -> &[Chosen] {
        &self.far
    }

    /// What each near light sends to each vertex: sum over its marked sources of L T, linear RGB, light by light, each
    /// with an entry for every vertex of the room. Times the vertex's diffuse reflectance it is the radiance L_xk that is
    /// to be taken away where the light is hidden; over [`NearField::gathered_rgb`] it is the share of it.
    pub fn light_rows(&self, field: &NearField, marks: &Marks, out: &mut Vec<[f32; 3]>) {
        let vertices = field.patches.vertices.len();
        out.clear();
        out.resize(self.near.len() * vertices, [0.0; 3]);
        for (light, row) in self.near.iter().zip(out.chunks_mut(vertices.max(1))) {
            let node = field.source_tree.nodes()[light.node as usize];
            for source in (node.begin as usize..node.end as usize).filter(|&s| marks.has_source(s)) {
                field.transfers()[source].add_to(field.sources[source].radiance_rgb, row);
            }
        }
    }
}

/// Middle and half axes of the marked sources below a node, each as wide as its patch: by their directions from `eye`, at
/// their mean distance, for the middle of places on several walls would lie in the open before them.
fn spread(field: &NearField, node: u32, light: &[f32], eye: Vec3) -> (Vec3, [Vec3; 2]) {
    let node = field.source_tree.nodes()[node as usize];
    let eye = eye.as_dvec3();
    let marked = || (node.begin as usize..node.end as usize).filter(|&s| light[s] > 0.0);
    let total: f64 = marked().map(|s| f64::from(light[s])).sum();
    let weight = |s: usize| f64::from(light[s]) / total;
    let real = |s: usize| field.sources[s].centre_world.as_dvec3();
    let nearness: f64 = marked().map(|s| weight(s) / real(s).distance(eye).max(1e-3)).sum();
    let place = |s: usize| eye + (real(s) - eye).normalize_or(DVec3::Z) / nearness;
    let mean: DVec3 = marked().map(|s| place(s) * weight(s)).sum();
    let middle = eye + (mean - eye).normalize_or(DVec3::Z) / nearness;
    let mut scatter = [[0.0; 3]; 3];
    let mut add = |v: DVec3, weight: f64| {
        for i in 0..3 {
            for j in 0..3 {
                scatter[i][j] += weight * v[i] * v[j];
            }
        }
    };
    for s in marked() {
        add(place(s) - mean, weight(s));
        // A parallelogram about its middle has the scatter of its sides over 12; a triangle's is nearly that of its
        // corners over 12.
        let (corners, count) =
            field.patches.outline_world(&field.patches.patches[field.sources[s].patch as usize]);
        let [a, b, c, d] = corners.map(|c| c.as_dvec3());
        if count == 4 {
            add((b - a + c - d) * 0.5, weight(s) / 12.0);
            add((d - a + c - b) * 0.5, weight(s) / 12.0);
        } else {
            [a, b, c].into_iter().for_each(|corner| add(corner - real(s), weight(s) / 12.0));
        }
    }
    let Some((values, vectors)) = symmetric_eigen(&scatter) else {
        return (middle.as_vec3(), [Vec3::ZERO; 2]);
    };
    // Even light over half a length h has the variance h^2 / 3.
    let axis = |k: usize| (DVec3::from(vectors[k]) * (3.0 * values[k].max(0.0)).sqrt()).as_vec3();
    (middle.as_vec3(), [axis(0), axis(1)])
}

#[cfg(test)]
mod tests;
