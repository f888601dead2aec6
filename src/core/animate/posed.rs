//! A scene at one moment: where every vertex and every blocker sphere is.

use super::{clip, skin, walk};
use crate::model::{
    animation::{Attachment, Figure, FigurePart, Transform},
    blocker::BlockerSphere,
    scene::Scene,
};
use glam::{Affine3A, Vec3};

/// One object of the scene, in the world frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PosedObject {
    /// One for each vertex of its mesh, metres.
    pub positions_world: Vec<Vec3>,
    /// Unit normals, one for each vertex.
    pub normals_world: Vec<Vec3>,
    /// Whether the last update may have changed it.
    pub moved: bool,
    /// The body whose spheres stand for it: the same number as in `BlockerSphere::body`.
    pub body: u32,
}

/// Everything of one scene at one moment. Keeps its memory from update to update.
///
/// A body's number is the index of its figure's first object; an object without a figure is a body of its own.
#[derive(Clone, Debug, Default)]
pub struct Posed {
    objects: Vec<PosedObject>,
    spheres: Vec<BlockerSphere>,
    nodes: NodeBuffers,
    updated: bool,
}

/// Of the figure at hand.
#[derive(Clone, Debug, Default)]
struct NodeBuffers {
    locals: Vec<Transform>,
    world_from_node: Vec<Affine3A>,
    world_from_bind: Vec<Affine3A>,
}

impl Posed {
    /// Makes room for a scene and puts everything where it is at time 0; all objects count as moved.
    pub fn new(scene: &Scene) -> Self {
        let mut posed = Self::default();
        posed.update(scene, 0.0);
        posed
    }

    /// Puts everything where it is at time `t_s`, seconds since the scene's start; any time gives sound positions.
    /// Allocates only where the scene has other numbers of objects or vertices than before (everything then counts as
    /// moved); a scene that differs in another way needs a new `Posed`. Equal times give equal bits.
    pub fn update(&mut self, scene: &Scene, t_s: f64) {
        let fits = self.updated
            && self.objects.len() == scene.objects.len()
            && self.objects.iter().zip(&scene.objects).all(|(posed, object)| {
                posed.positions_world.len() == object.mesh.positions.len()
                    && posed.normals_world.len() == object.mesh.normals.len()
            });
        if !fits {
            self.set_up(scene);
        }
        self.spheres.clear();
        for object in &mut self.objects {
            object.moved = !fits;
        }
        for figure in &scene.figures {
            let world_from_node = self.nodes.pose(figure, t_s);
            let first = figure.parts.first().map_or(u32::MAX, |part| part.object as u32);
            self.spheres.extend(figure.spheres.iter().filter_map(|sphere| {
                let world_from_node = world_from_node.get(sphere.node as usize)?;
                let scale = world_from_node.matrix3.determinant().abs().cbrt();
                Some(BlockerSphere {
                    centre_world: world_from_node.transform_point3(sphere.centre_node),
                    radius_m: sphere.radius_node * scale,
                    body: first,
                })
            }));
            if fits && figure.is_still() {
                continue;
            }
            for part in &figure.parts {
                self.deform(scene, part);
            }
        }
        self.updated = true;
    }

    /// In the order of `Scene::objects`.
    pub fn objects(&self) -> &[PosedObject] {
        &self.objects
    }

    /// Of all figures, in their order.
    pub fn spheres(&self) -> &[BlockerSphere] {
        &self.spheres
    }

    /// Objects where the scene places them, each a body of its own unless a figure has it.
    fn set_up(&mut self, scene: &Scene) {
        self.objects.resize_with(scene.objects.len(), PosedObject::default);
        for (index, (posed, object)) in self.objects.iter_mut().zip(&scene.objects).enumerate() {
            posed.body = index as u32;
            posed.positions_world.resize(object.mesh.positions.len(), Vec3::ZERO);
            posed.normals_world.resize(object.mesh.normals.len(), Vec3::Z);
            let out = (&mut posed.positions_world[..], &mut posed.normals_world[..]);
            skin::move_rigidly(&object.mesh.positions, &object.mesh.normals, &object.world_from_object, out);
        }
        for figure in &scene.figures {
            let first = figure.parts.first().map_or(0, |part| part.object as u32);
            for part in &figure.parts {
                if let Some(object) = self.objects.get_mut(part.object) {
                    object.body = first;
                }
            }
        }
        // Room for the largest figure, so that later updates find it.
        let room = |of: fn(&Figure) -> usize| scene.figures.iter().map(of).max().unwrap_or(0);
        self.nodes.locals.reserve(room(|f| f.skeleton.nodes.len()));
        self.nodes.world_from_node.reserve(room(|f| f.skeleton.nodes.len()));
        self.nodes.world_from_bind.reserve(room(|f| f.skeleton.joints.len()));
        self.spheres.reserve(scene.figures.iter().map(|f| f.spheres.len()).sum());
    }

    fn deform(&mut self, scene: &Scene, part: &FigurePart) {
        let (Some(posed), Some(object)) = (self.objects.get_mut(part.object), scene.objects.get(part.object))
        else {
            return;
        };
        posed.moved = true;
        let out = (&mut posed.positions_world[..], &mut posed.normals_world[..]);
        let world_from_bind = &self.nodes.world_from_bind;
        match &part.attachment {
            Attachment::Rigid { joint } => {
                if let Some(matrix) = world_from_bind.get(*joint as usize) {
                    skin::move_rigidly(&object.mesh.positions, &object.mesh.normals, matrix, out);
                }
            }
            Attachment::Skinned { bind_positions, bind_normals, joints, weights } => {
                skin::deform(bind_positions, bind_normals, joints, weights, world_from_bind, out);
            }
        }
    }
}

impl NodeBuffers {
    /// Poses a figure; returns its nodes in the world.
    fn pose(&mut self, figure: &Figure, t_s: f64) -> &[Affine3A] {
        let skeleton = &figure.skeleton;
        let playing = figure.playing.and_then(|playing| {
            let clip = figure.clips.get(playing.clip)?;
            Some((clip, clip::clip_time(clip, &playing, t_s)))
        });
        clip::locals_at(skeleton, playing, &mut self.locals);
        let world_from_figure = world_from_figure_at(figure, t_s);
        let world_from_root = world_from_figure * skeleton.figure_from_root;
        clip::stack(skeleton, &world_from_root, &self.locals, &mut self.world_from_node);
        self.world_from_bind.clear();
        self.world_from_bind.extend(skeleton.joints.iter().map(|joint| {
            let node = self.world_from_node.get(joint.node as usize);
            node.copied().unwrap_or(world_from_root) * joint.node_from_bind
        }));
        &self.world_from_node
    }
}

/// Where a figure stands at a time: its place, and how far it has walked.
pub fn world_from_figure_at(figure: &Figure, t_s: f64) -> Affine3A {
    match &figure.walk {
        Some(walk) => walk::world_from_start(walk, t_s) * figure.world_from_figure,
        None => figure.world_from_figure,
    }
}

#[cfg(test)]
mod tests;
