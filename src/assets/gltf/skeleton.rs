//! Nodes and skins as a skeleton.

use super::{accessor::floats, pose::Z_UP_FROM_Y_UP, primitive::Hang, source::Source};
use crate::{
    error::AssetError,
    model::animation::{Joint, Skeleton, SkeletonNode, Transform},
};
use glam::{Affine3A, Mat4, Quat, Vec3};
use gltf::Document;

/// A skeleton, and how the file's nodes are found in it.
pub struct Loaded {
    /// Nodes in a new order; joints of all skins in use one after the other, then one for each mesh without a skin.
    pub skeleton: Skeleton,
    /// Index in the skeleton for each node of the file; `None` for nodes that are not part of a tree.
    pub index_of: Vec<Option<u32>>,
    /// For each node of the file, what its mesh hangs on (nodes without a mesh: the first joint, unused).
    pub hangs: Vec<Hang>,
}

/// A matrix may differ from the product of its translation, rotation and scale by this share of its largest entry.
const SHEAR: f32 = 1e-3;

/// Reads the skeleton.
///
/// # Errors
/// A node's matrix is not translation times rotation times scale; a skin lacks inverse bind matrices, or names a node
/// that is not part of a tree; more than 65535 joints.
pub fn load(source: &Source, document: &Document) -> Result<Loaded, AssetError> {
    let count = document.nodes().len();
    let mut parents: Vec<Option<usize>> = vec![None; count];
    for node in document.nodes() {
        for child in node.children() {
            parents[child.index()] = Some(node.index());
        }
    }
    let nodes: Vec<gltf::Node> = document.nodes().collect();
    let mut index_of: Vec<Option<u32>> = vec![None; count];
    let mut out = Vec::with_capacity(count);
    // Roots first, in the file's order; each node's children after it.
    let mut open: Vec<usize> = (0..count).rev().filter(|&i| parents[i].is_none()).collect();
    while let Some(index) = open.pop() {
        if index_of[index].is_some() {
            continue;
        }
        index_of[index] = Some(out.len() as u32);
        let name = nodes[index].name().unwrap_or_default().to_owned();
        let parent = parents[index].and_then(|p| index_of[p]);
        out.push(SkeletonNode { name, parent, rest: rest(source, &nodes[index])? });
        let children: Vec<usize> = nodes[index].children().map(|child| child.index()).collect();
        open.extend(children.into_iter().rev());
    }
    let mut joints: Vec<Joint> = Vec::new();
    let first_of_skin = document
        .skins()
        .map(|skin| {
            let first = joints.len();
            joints.extend(skin_joints(source, &skin, &index_of)?);
            Ok((first, joints.len() - first))
        })
        .collect::<Result<Vec<_>, AssetError>>()?;
    let mut hangs = Vec::with_capacity(count);
    for node in &nodes {
        hangs.push(match (node.mesh(), node.skin(), index_of[node.index()]) {
            (Some(_), Some(skin), _) => {
                let (first, count) = first_of_skin[skin.index()];
                Hang::Skinned { first: first as u16, count: count as u16 }
            }
            (Some(_), None, Some(own)) => {
                joints.push(Joint { node: own, node_from_bind: Affine3A::IDENTITY });
                Hang::Rigid { joint: (joints.len() - 1) as u16 }
            }
            _ => Hang::Rigid { joint: 0 },
        });
    }
    if joints.len() > usize::from(u16::MAX) {
        return Err(AssetError::new(source.file, "joints of all skins, and meshes without a skin")
            .value(joints.len())
            .allowed(format!("at most {}", u16::MAX)));
    }
    let figure_from_root = Affine3A::from_mat4(Z_UP_FROM_Y_UP.as_mat4());
    let skeleton = Skeleton { nodes: out, joints, figure_from_root };
    Ok(Loaded { skeleton, index_of, hangs })
}

fn rest(source: &Source, node: &gltf::Node) -> Result<Transform, AssetError> {
    let transform = node.transform();
    let key = format!("nodes[{}]", node.index());
    let matrix = match transform {
        gltf::scene::Transform::Matrix { matrix } => Some(Mat4::from_cols_array_2d(&matrix)),
        gltf::scene::Transform::Decomposed { .. } => None,
    };
    let (translation, rotation, scale) = match matrix {
        // An axis without length has no direction: any rotation does.
        Some(matrix) => {
            let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
            let rotation = if rotation.is_finite() { rotation } else { Quat::IDENTITY };
            (translation, rotation, scale)
        }
        None => {
            let (t, r, s) = transform.decomposed();
            (Vec3::from(t), Quat::from_array(r), Vec3::from(s))
        }
    };
    let rest = Transform { translation, rotation: rotation.normalize(), scale };
    if !(translation.is_finite() && rest.rotation.is_finite() && scale.is_finite()) {
        return Err(AssetError::new(source.file, key)
            .allowed("a finite translation and scale, and a rotation that is not zero"));
    }
    if let Some(matrix) = matrix {
        let again = Mat4::from(rest.affine()).to_cols_array();
        let entries = matrix.to_cols_array();
        let largest = entries.iter().fold(0.0f32, |m, x| m.max(x.abs()));
        if entries.iter().zip(&again).any(|(a, b)| !((a - b).abs() <= SHEAR * largest)) {
            return Err(AssetError::new(source.file, format!("{key}.matrix"))
                .allowed("translation times rotation times scale, without shear"));
        }
    }
    Ok(rest)
}

fn skin_joints(
    source: &Source,
    skin: &gltf::Skin,
    index_of: &[Option<u32>],
) -> Result<Vec<Joint>, AssetError> {
    let wrong = |what: &str| AssetError::new(source.file, format!("skins[{}]", skin.index())).allowed(what);
    let inverse_bind: Option<Vec<[f32; 16]>> =
        skin.inverse_bind_matrices().map(|accessor| floats(source, &accessor, 0.0)).transpose()?;
    let joint = |(k, node): (usize, gltf::Node)| {
        let node = index_of.get(node.index()).copied().flatten();
        let node = node.ok_or_else(|| wrong("of joints that are part of a tree"))?;
        let node_from_bind = match &inverse_bind {
            None => Affine3A::IDENTITY,
            Some(list) => {
                let entries = list.get(k).filter(|m| m.iter().all(|x| x.is_finite()));
                let entries =
                    entries.ok_or_else(|| wrong("given a finite inverse bind matrix for every joint"))?;
                Affine3A::from_mat4(Mat4::from_cols_array(entries))
            }
        };
        Ok(Joint { node, node_from_bind })
    };
    skin.joints().enumerate().map(joint).collect()
}
