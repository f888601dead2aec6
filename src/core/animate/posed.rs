//! A scene at one moment: where every vertex, every blocker sphere and every blocker box is.

use super::{clip, skin, walk};
use crate::model::{
    animation::{Attachment, BoundBox, Figure, FigurePart, Transform},
    blocker::{BlockerBox, BlockerSphere},
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
    boxes: Vec<BlockerBox>,
    /// What blocks soft light beside the boxes, and all that is around spheres and boxes.
    blocking: Vec<BlockerSphere>,
    around: Vec<BlockerSphere>,
    nodes: NodeBuffers,
    updated: bool,
}

/// Spheres whose centre is within so many of their radii of a box are part of what it stands for.
const NEAR: f32 = 0.5;

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
        for spheres in [&mut self.spheres, &mut self.blocking, &mut self.around] {
            spheres.clear();
        }
        self.boxes.clear();
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
            let world_from = |bound: &BoundBox| world_from_node.get(bound.node as usize);
            let boxes =
                figure.boxes.iter().filter_map(|bound| Some(placed(bound, world_from(bound)?, first)));
            self.boxes.extend(boxes.filter(BlockerBox::is_sound));
            if fits && figure.is_still() {
                continue;
            }
            for part in &figure.parts {
                self.deform(scene, part);
            }
        }
        self.sort_out();
        self.updated = true;
    }

    /// In the order of `Scene::objects`.
    pub fn objects(&self) -> &[PosedObject] {
        &self.objects
    }

    /// Of all figures, in their order: what mirrors and sharp gloss see of a body.
    pub fn spheres(&self) -> &[BlockerSphere] {
        &self.spheres
    }

    /// Boxes for the thin parts of all figures, in their order.
    pub fn boxes(&self) -> &[BlockerBox] {
        &self.boxes
    }

    /// The spheres that block soft light: all but those in place of which a box stands.
    pub fn blocking(&self) -> &[BlockerSphere] {
        &self.blocking
    }

    /// All spheres, and a sphere around each box: nothing that blocks soft light reaches out of them further than fitted
    /// spheres do.
    pub fn around(&self) -> &[BlockerSphere] {
        &self.around
    }

    /// A sphere whose centre a box of its body holds, or nearly, stands for what the box stands for.
    fn sort_out(&mut self) {
        let boxes = &self.boxes;
        let is_boxed = |sphere: &BlockerSphere| {
            let holds = |b: &BlockerBox| {
                b.body == sphere.body && b.holds(sphere.centre_world, NEAR * sphere.radius_m)
            };
            boxes.iter().any(holds)
        };
        self.blocking.extend(self.spheres.iter().filter(|sphere| !is_boxed(sphere)));
        self.around.extend(&self.spheres);
        self.around.extend(boxes.iter().map(BlockerBox::around));
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
        let (spheres, boxes) =
            scene.figures.iter().fold((0, 0), |(s, b), f| (s + f.spheres.len(), b + f.boxes.len()));
        self.spheres.reserve(spheres);
        self.blocking.reserve(spheres);
        self.boxes.reserve(boxes);
        self.around.reserve(spheres + boxes);
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

/// A bound box in the world. What a node shears stays a box: it is set upright along its first two axes.
fn placed(bound: &BoundBox, world_from_node: &Affine3A, body: u32) -> BlockerBox {
    let [x, y, z] = bound.axes_node.map(|axis| world_from_node.transform_vector3(axis));
    let lengths = Vec3::new(x.length(), y.length(), z.length());
    let x = x.normalize_or(Vec3::X);
    let y = (y - x * x.dot(y)).normalize_or(x.any_orthonormal_vector());
    BlockerBox {
        centre_world: world_from_node.transform_point3(bound.centre_node),
        axes_world: [x, y, x.cross(y)],
        half_m: bound.half_node * lengths,
        body,
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
