//! The project's own figure: a small wooden person, 20 cm tall, made by rule. `tests/scenes/walker.glb` is its file.
//!
//! It stands on z = 0 and faces -y, with its left at +x. Its clip "Walk" is one pair of steps in `WALK_CYCLE_S`, in which
//! it gets `WALK_STRIDE_M` ahead: moved at `WALK_SPEED_M_S` along -y its feet do not slide. "Idle" breathes and looks
//! round. All lengths are rounded to micrometres, so that the file does not depend on the last digit of a sine.

mod body;
mod gait;

use super::gltf::{DEFAULT_SPHERES, LoadedFigure};
use crate::model::{
    animation::{Attachment, Figure, FigurePart, Joint, Skeleton, SkeletonNode, Transform},
    scene::{Material, VirtualObject},
};
use glam::{Affine3A, DQuat, DVec3, Quat, Vec3};

/// Duration of "Walk".
pub const WALK_CYCLE_S: f64 = 0.8;
/// How far one cycle of "Walk" goes.
pub const WALK_STRIDE_M: f64 = 0.1;
/// The speed at which the feet of "Walk" do not slide.
pub const WALK_SPEED_M_S: f64 = WALK_STRIDE_M / WALK_CYCLE_S;

/// The bones, parents first. Left ones stand before right ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bone {
    Hips,
    Spine,
    Chest,
    Neck,
    Head,
    UpperArmL,
    ForearmL,
    HandL,
    UpperArmR,
    ForearmR,
    HandR,
    ThighL,
    ShinL,
    FootL,
    ToeL,
    ThighR,
    ShinR,
    FootR,
    ToeR,
}

/// Names, parents and places of the joints at rest; z up, metres, `Bone` as index.
const BONES: [(&str, Option<usize>, [f64; 3]); 19] = [
    ("Hips", None, [0.0, 0.0, 0.098]),
    ("Spine", Some(0), [0.0, 0.0, 0.110]),
    ("Chest", Some(1), [0.0, 0.0, 0.126]),
    ("Neck", Some(2), [0.0, 0.001, 0.152]),
    ("Head", Some(3), [0.0, 0.001, 0.161]),
    ("UpperArm.L", Some(2), [0.027, 0.0, 0.1445]),
    ("Forearm.L", Some(5), [0.0395, 0.001, 0.116]),
    ("Hand.L", Some(6), [0.0455, -0.002, 0.088]),
    ("UpperArm.R", Some(2), [-0.027, 0.0, 0.1445]),
    ("Forearm.R", Some(8), [-0.0395, 0.001, 0.116]),
    ("Hand.R", Some(9), [-0.0455, -0.002, 0.088]),
    ("Thigh.L", Some(0), [0.0135, 0.0, 0.094]),
    ("Shin.L", Some(11), [0.0135, 0.0, 0.052]),
    ("Foot.L", Some(12), [0.0135, 0.0, 0.013]),
    ("Toe.L", Some(13), [0.0135, -0.015, 0.004]),
    ("Thigh.R", Some(0), [-0.0135, 0.0, 0.094]),
    ("Shin.R", Some(15), [-0.0135, 0.0, 0.052]),
    ("Foot.R", Some(16), [-0.0135, 0.0, 0.013]),
    ("Toe.R", Some(17), [-0.0135, -0.015, 0.004]),
];

impl Bone {
    /// Where its joint is at rest.
    fn place(self) -> DVec3 {
        DVec3::from(BONES[self as usize].2)
    }
}

/// Rounded to millionths.
fn rounded(x: f64) -> f32 {
    ((x * 1e6).round() / 1e6) as f32
}

/// From z up to the y up of glTF.
fn y_up(p: DVec3) -> Vec3 {
    Vec3::new(rounded(p.x), rounded(p.z), rounded(-p.y))
}

/// The same for a rotation.
fn y_up_turn(q: DQuat) -> Quat {
    let q = if q.w < 0.0 { -q } else { q };
    Quat::from_xyzw(rounded(q.x), rounded(q.z), rounded(-q.y), rounded(q.w))
}

/// The whole figure, at rest, with its clips; openness 1.
pub fn walker() -> LoadedFigure {
    let body = body::body();
    let nodes = BONES
        .iter()
        .map(|&(name, parent, place)| {
            let above = parent.map_or(DVec3::ZERO, |p| DVec3::from(BONES[p].2));
            let translation = y_up(DVec3::from(place) - above);
            let rest = Transform { translation, ..Transform::IDENTITY };
            SkeletonNode { name: name.into(), parent: parent.map(|p| p as u32), rest }
        })
        .collect();
    let joint = |(node, &(_, _, place)): (usize, &(_, _, [f64; 3]))| Joint {
        node: node as u32,
        node_from_bind: Affine3A::from_translation(y_up(-DVec3::from(place))),
    };
    let skeleton = Skeleton {
        nodes,
        joints: BONES.iter().enumerate().map(joint).collect(),
        figure_from_root: Affine3A::from_cols(
            Vec3::X.into(),
            Vec3::Z.into(),
            Vec3::NEG_Y.into(),
            Vec3::ZERO.into(),
        ),
    };
    let to_y_up = |list: &[Vec3]| list.iter().map(|p| Vec3::new(p.x, p.z, -p.y)).collect();
    let attachment = Attachment::Skinned {
        bind_positions: to_y_up(&body.mesh.positions),
        bind_normals: to_y_up(&body.mesh.normals),
        joints: body.joints,
        weights: body.weights,
    };
    let object = VirtualObject {
        name: "walker".into(),
        openness: vec![1.0; body.mesh.positions.len()],
        mesh: body.mesh,
        material: Material::Lambert { albedo_rgb: [1.0; 3] },
        world_from_object: Affine3A::IDENTITY,
    };
    let figure = Figure {
        name: "walker".into(),
        skeleton,
        clips: vec![gait::walk(), gait::idle()],
        parts: vec![FigurePart { object: 0, attachment }],
        world_from_figure: Affine3A::IDENTITY,
        playing: None,
        walk: None,
        sphere_count: DEFAULT_SPHERES,
        spheres: Vec::new(),
        boxes: Vec::new(),
    };
    LoadedFigure { objects: vec![object], figure }
}
