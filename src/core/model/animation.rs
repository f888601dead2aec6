//! Figures: virtual objects that move, and the spheres that stand for any body where it blocks soft light.

use glam::{Affine3A, Quat, Vec2, Vec3, Vec4};

/// Translation times rotation times scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// In the parent's frame and unit.
    pub translation: Vec3,
    /// Unit quaternion.
    pub rotation: Quat,
    /// Along the own axes.
    pub scale: Vec3,
}

impl Transform {
    /// Changes nothing.
    pub const IDENTITY: Self = Self { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE };

    /// The same as a matrix: parent from own frame.
    pub fn affine(&self) -> Affine3A {
        Affine3A::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// A node of a skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct SkeletonNode {
    /// As the file names it; may be empty.
    pub name: String,
    /// Index of its parent, always below its own; `None`: stands in the skeleton's root frame.
    pub parent: Option<u32>,
    /// Parent from node, where no clip moves it.
    pub rest: Transform,
}

/// What vertices hang on: a node, and how the vertices' bind frame lies in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Index of the node.
    pub node: u32,
    /// The node's frame from the frame of the bind positions ("inverse bind matrix").
    pub node_from_bind: Affine3A,
}

/// Nodes, and the joints of all skins one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// Parents before children.
    pub nodes: Vec<SkeletonNode>,
    /// What `FigurePart` counts in.
    pub joints: Vec<Joint>,
    /// The figure's frame (z up, faces -y) from the frame that root nodes stand in.
    pub figure_from_root: Affine3A,
}

/// Which part of a node's transform a channel moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moves {
    /// x, y, z.
    Translation,
    /// Unit quaternion x, y, z, w.
    Rotation,
    /// x, y, z.
    Scale,
}

/// How a channel passes between its keys (glTF 2.0, appendix C).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Holds each key until the next.
    Step,
    /// Straight; rotations on the shortest arc.
    Linear,
    /// Cubic Hermite.
    CubicSpline,
}

/// One moved property of one node.
#[derive(Clone, Debug, PartialEq)]
pub struct AnimationChannel {
    /// Index of the node.
    pub node: u32,
    /// Which property.
    pub moves: Moves,
    /// How.
    pub interpolation: Interpolation,
    /// Seconds, strictly rising, at least one.
    pub times_s: Vec<f32>,
    /// One for each time; for cubic splines three: slope in (a second), value, slope out (a second).
    pub values: Vec<Vec4>,
}

/// A movement.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Unique in its figure.
    pub name: String,
    /// Its first key, seconds.
    pub start_s: f32,
    /// From its first key to its last, seconds.
    pub duration_s: f32,
    /// At most one for each property of a node.
    pub channels: Vec<AnimationChannel>,
}

/// How the vertices of a part follow the skeleton.
#[derive(Clone, Debug, PartialEq)]
pub enum Attachment {
    /// The object's own mesh as it is, on one joint.
    Rigid {
        /// Index of the joint.
        joint: u16,
    },
    /// Each vertex on up to four joints. All lists are as long as the object's positions.
    Skinned {
        /// Positions in the bind frame of their joints.
        bind_positions: Vec<Vec3>,
        /// Normals there, not zero.
        bind_normals: Vec<Vec3>,
        /// Indices of joints.
        joints: Vec<[u16; 4]>,
        /// Not negative, sum 1.
        weights: Vec<[f32; 4]>,
    },
}

/// One object of the scene that belongs to a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct FigurePart {
    /// Index into `Scene::objects`.
    pub object: usize,
    /// How its vertices follow.
    pub attachment: Attachment,
}

/// A clip being played: at time t of the scene it shows its own time `from_s + speed * t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playing {
    /// Index of the clip.
    pub clip: usize,
    /// Seconds after the clip's first key that are shown at t = 0.
    pub from_s: f64,
    /// Seconds of the clip in a second; negative plays backwards.
    pub speed: f64,
    /// Begins again after its last key; else its last pose stays.
    pub looped: bool,
}

/// A piece of a walk: straight, or an arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Where it begins, world x and y, metres.
    pub start_world: Vec2,
    /// The way it goes there: angle from +x towards +y, radians.
    pub heading_rad: f32,
    /// Metres, above 0.
    pub length_m: f32,
    /// How far the heading turns along it, radians; 0: straight. The radius is length / turn.
    pub turn_rad: f32,
}

/// A closed walk on z = const.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// End to end, the last one meets the first.
    pub legs: Vec<Leg>,
    /// Speed, metres a second.
    pub speed_m_s: f64,
}

/// A sphere that stands for a piece of a body and moves with a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundSphere {
    /// Index of the node.
    pub node: u32,
    /// Centre in the node's frame.
    pub centre_node: Vec3,
    /// Radius in the node's unit; scales with the node (cube root of its volume's scale).
    pub radius_node: f32,
}

/// A box that stands for a thin part of a rigid piece of a body and moves with a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundBox {
    /// Index of the node.
    pub node: u32,
    /// Centre in the node's frame.
    pub centre_node: Vec3,
    /// Unit vectors at right angles to each other, in the node's frame.
    pub axes_node: [Vec3; 3],
    /// Half the extent along each, in the node's unit.
    pub half_node: Vec3,
}

/// A body: one or several objects of a scene with a skeleton (a static body has a single node), and its spheres.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Unique in its scene.
    pub name: String,
    /// Nodes and joints.
    pub skeleton: Skeleton,
    /// What it can do.
    pub clips: Vec<Clip>,
    /// The objects that it is made of; no object belongs to two figures.
    pub parts: Vec<FigurePart>,
    /// Places it; may scale evenly. With a `walk` this is how it stands at the world's origin, heading for +x.
    pub world_from_figure: Affine3A,
    /// What it does; `None`: rests.
    pub playing: Option<Playing>,
    /// Where it goes; `None`: stays.
    pub walk: Option<Walk>,
    /// How many spheres it should have.
    pub sphere_count: usize,
    /// Empty until fitted.
    pub spheres: Vec<BoundSphere>,
    /// They stand for its thin parts where it blocks soft light, in place of the spheres in them. Empty until fitted, and
    /// where nothing is thin.
    pub boxes: Vec<BoundBox>,
}

impl Figure {
    /// A body of one object that never moves. `spheres`: centres and radii in the object's frame.
    pub fn still(
        name: String,
        object: usize,
        world_from_object: Affine3A,
        spheres: impl Iterator<Item = (Vec3, f32)>,
    ) -> Self {
        let root = SkeletonNode { name: String::new(), parent: None, rest: Transform::IDENTITY };
        let joint = Joint { node: 0, node_from_bind: Affine3A::IDENTITY };
        let spheres: Vec<BoundSphere> = spheres
            .map(|(centre_node, radius_node)| BoundSphere { node: 0, centre_node, radius_node })
            .collect();
        Self {
            name,
            skeleton: Skeleton {
                nodes: vec![root],
                joints: vec![joint],
                figure_from_root: Affine3A::IDENTITY,
            },
            clips: Vec::new(),
            parts: vec![FigurePart { object, attachment: Attachment::Rigid { joint: 0 } }],
            world_from_figure: world_from_object,
            playing: None,
            walk: None,
            sphere_count: spheres.len(),
            spheres,
            boxes: Vec::new(),
        }
    }

    /// Whether it looks the same at any time.
    pub fn is_still(&self) -> bool {
        self.playing.is_none() && self.walk.is_none()
    }
}
