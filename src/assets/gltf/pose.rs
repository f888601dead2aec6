//! Where each node stands: transforms down the tree, and skins at rest.

use super::{accessor::floats, source::Source};
use crate::error::AssetError;
use glam::{DMat4, DVec3, DVec4};
use gltf::{Document, Node};
use std::collections::{HashMap, hash_map::Entry};
use std::rc::Rc;

/// How a node's mesh is placed, from the file's mesh frame to our z-up frame.
pub enum MeshPlace {
    /// By one transform.
    Rigid(DMat4),
    /// By each vertex's weighted joints.
    Skinned(Rc<Vec<DMat4>>),
}

/// glTF's y up to our z up: (x, -z, y).
pub const Z_UP_FROM_Y_UP: DMat4 =
    DMat4::from_cols(DVec4::X, DVec4::Z, DVec4::new(0.0, -1.0, 0.0, 0.0), DVec4::W);

/// Places every node of the default scene (the first one, or all roots, where none is named); `None` for nodes
/// outside it.
pub fn place(source: &Source, document: &Document) -> Result<Vec<Option<MeshPlace>>, AssetError> {
    let nodes: Vec<Node> = document.nodes().collect();
    let mut parents: Vec<Option<usize>> = vec![None; nodes.len()];
    for node in &nodes {
        for child in node.children() {
            if parents[child.index()].replace(node.index()).is_some() {
                return Err(AssetError::new(source.file, format!("nodes[{}]", child.index()))
                    .allowed("the child of one node only"));
            }
        }
    }
    let locals: Vec<DMat4> = nodes.iter().map(local).collect();
    let mut world: Vec<Option<DMat4>> = vec![None; nodes.len()];
    // Roots first; a ring of nodes has no root and is never reached.
    let mut open: Vec<(usize, DMat4)> =
        (0..nodes.len()).filter(|&i| parents[i].is_none()).map(|i| (i, DMat4::IDENTITY)).collect();
    while let Some((index, above)) = open.pop() {
        let here = above * locals[index];
        world[index] = Some(here);
        open.extend(nodes[index].children().map(|child| (child.index(), here)));
    }
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let mut open: Vec<usize> = match scene {
        Some(scene) => scene.nodes().map(|node| node.index()).collect(),
        None => (0..nodes.len()).filter(|&i| parents[i].is_none()).collect(),
    };
    let mut out: Vec<Option<MeshPlace>> = (0..nodes.len()).map(|_| None).collect();
    let mut skins: HashMap<usize, Rc<Vec<DMat4>>> = HashMap::new();
    let mut visits = 0;
    while let Some(index) = open.pop() {
        visits += 1;
        if visits > nodes.len() {
            return Err(AssetError::new(source.file, "scene nodes").allowed("reached once each"));
        }
        let node = &nodes[index];
        open.extend(node.children().map(|child| child.index()));
        let Some(here) = world[index] else {
            return Err(AssetError::new(source.file, format!("nodes[{index}]")).allowed("part of a tree"));
        };
        if node.mesh().is_none() {
            continue;
        }
        out[index] = Some(match node.skin() {
            Some(skin) => {
                // Once for each skin, however many nodes share it.
                let known = skins.entry(skin.index());
                let matrices = match known {
                    Entry::Occupied(known) => Rc::clone(known.get()),
                    Entry::Vacant(free) => Rc::clone(free.insert(Rc::new(joints(source, &skin, &world)?))),
                };
                MeshPlace::Skinned(matrices)
            }
            None => MeshPlace::Rigid(Z_UP_FROM_Y_UP * here),
        });
    }
    Ok(out)
}

fn local(node: &Node) -> DMat4 {
    let columns = node.transform().matrix();
    DMat4::from_cols_array_2d(&columns.map(|column| column.map(f64::from)))
}

/// Matrices of a skin's joints in the nodes' own pose; the mesh node's transform does not count (glTF 2.0, 3.7.3.3).
fn joints(source: &Source, skin: &gltf::Skin, world: &[Option<DMat4>]) -> Result<Vec<DMat4>, AssetError> {
    let inverse_bind: Vec<[f32; 16]> = match skin.inverse_bind_matrices() {
        Some(accessor) => floats(source, &accessor, 0.0)?,
        None => Vec::new(),
    };
    let joint = |(k, node): (usize, Node)| {
        let wrong =
            |what: &str| AssetError::new(source.file, format!("skins[{}]", skin.index())).allowed(what);
        let here = world.get(node.index()).copied().flatten();
        let here = here.ok_or_else(|| wrong("of joints that are part of a tree"))?;
        let bind = match inverse_bind.get(k) {
            Some(m) => DMat4::from_cols_array(&m.map(f64::from)),
            None if inverse_bind.is_empty() => DMat4::IDENTITY,
            None => return Err(wrong("given an inverse bind matrix for every joint")),
        };
        Ok(Z_UP_FROM_Y_UP * here * bind)
    };
    skin.joints().enumerate().map(joint).collect()
}

/// A point through an affine matrix.
pub fn point(matrix: &DMat4, p: [f32; 3]) -> DVec3 {
    matrix.transform_point3(DVec3::from(p.map(f64::from)))
}

/// A normal through the cofactors of an affine matrix, turned so that it stays outside where the matrix mirrors.
pub fn normal(matrix: &DMat4, n: [f32; 3]) -> DVec3 {
    let (x, y, z) = (matrix.x_axis.truncate(), matrix.y_axis.truncate(), matrix.z_axis.truncate());
    let n = DVec3::from(n.map(f64::from));
    let turned = y.cross(z) * n.x + z.cross(x) * n.y + x.cross(y) * n.z;
    if x.dot(y.cross(z)) < 0.0 { -turned } else { turned }
}
