//! glTF 2.0 models (.glb, .gltf) as virtual objects.
//!
//! # Frame
//! glTF is y up and looks along its +z; the objects are z up: (x, y, z) of the file becomes (x, -z, y). A model that is
//! upright in its own frame stands upright on z = 0, facing -y. Node transforms, skins at rest and the default
//! morph weights are applied to the vertices, so each object's own transform is the identity. Metres.
//!
//! # What is taken
//! Triangles, strips and fans; normals (flat ones where the file has none); vertex colours times the base colour
//! texture, sampled at the vertices, as tints; metallic-roughness materials as the nearest of ours (`material`).
//! Lights, cameras, transparency, normal and occlusion textures are passed over, and emission but for `room`. `load_figure` also takes the
//! nodes, skins and animations; animated morph weights are passed over (the default weights stay), with a warning.

mod accessor;
mod clips;
mod figure;
mod material;
mod pose;
mod primitive;
pub mod room;
mod skeleton;
mod source;
pub mod write;
pub mod write_room;

pub use figure::{DEFAULT_SPHERES, LoadedFigure, decode_figure, load_figure};

use super::error::{AssetError, read_file};
use super::names::UniqueNames;
use crate::{
    model::scene::{Mesh, VirtualObject},
    visibility::openness,
};
use glam::Affine3A;
use gltf::{Document, Semantic, mesh::Mode};
use primitive::{Bound, Hang};
use source::Source;
use std::{collections::BTreeMap, path::Path};

/// Most vertices of a model, all copies counted.
pub const MAX_VERTICES: usize = 8 << 20;
/// Most triangles of a model, all copies counted.
pub const MAX_TRIANGLES: usize = 2 << 20;
/// Most nodes of a model.
const MAX_NODES: usize = 1 << 16;

/// Loads a model: one object for each material in use, in order of the file's materials (without material last),
/// with openness from `openness::DEFAULT_RAYS` rays a vertex against the whole model. An object is named after the
/// file, and after its material where there are several.
///
/// # Errors
/// The file (or one it names) cannot be read, is damaged, needs an extension that is not known here, or holds no triangles.
pub fn load(file: &Path) -> Result<Vec<VirtualObject>, AssetError> {
    load_with(file, openness::DEFAULT_RAYS, &|_| ())
}

/// `load` with a number of openness rays (0: everything open) and progress of the openness, 0 to 1.
///
/// # Errors
/// As `load`.
pub fn load_with(
    file: &Path,
    rays: u32,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<Vec<VirtualObject>, AssetError> {
    let mut objects = decode(file, &read_file(file)?)?;
    let meshes: Vec<&Mesh> = objects.iter().map(|object| &object.mesh).collect();
    let open = openness::of_parts(&meshes, rays, progress);
    objects.iter_mut().zip(open).for_each(|(object, open)| object.openness = open);
    Ok(objects)
}

/// `load` from bytes, with openness 1; `file` names them in errors and tells where other files are.
///
/// # Errors
/// As `load`.
pub fn decode(file: &Path, bytes: &[u8]) -> Result<Vec<VirtualObject>, AssetError> {
    let mut source = Source::open(file, bytes)?;
    Ok(build(&mut source, &[])?.into_iter().map(|(object, _)| object).collect())
}

/// The objects, and how their vertices hang on joints where `hangs` (one for each node, or empty) says it for the
/// nodes that they come from.
fn build(source: &mut Source, hangs: &[Hang]) -> Result<Vec<(VirtualObject, Bound)>, AssetError> {
    let (file, document) = (source.file, source.document.clone());
    if document.nodes().len() > MAX_NODES {
        return Err(AssetError::new(file, "nodes")
            .value(document.nodes().len())
            .allowed(format!("at most {MAX_NODES}")));
    }
    let placed = pose::place(source, &document)?;
    let shown = |index: usize| placed.get(index).and_then(Option::as_ref);
    let triangles = stated_triangles(&document, &|index| shown(index).is_some());
    if triangles > MAX_TRIANGLES {
        return Err(AssetError::new(file, "triangles")
            .value(triangles)
            .allowed(format!("at most {MAX_TRIANGLES} in all")));
    }
    // Material index (without material last) to what it covers.
    let mut parts: BTreeMap<usize, (Mesh, material::Means, Bound)> = BTreeMap::new();
    let mut vertices = 0;
    for node in document.nodes() {
        let (Some(mesh), Some(place)) = (node.mesh(), shown(node.index())) else { continue };
        let weights = node.weights().or(mesh.weights()).unwrap_or(&[]).to_vec();
        for primitive in mesh.primitives() {
            let hang = hangs.get(node.index());
            let part = primitive::read(source, &primitive, place, &weights, hang);
            let part = part
                .map_err(|e| e.inside(format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index())));
            let Some(part) = part? else { continue };
            vertices += part.mesh.positions.len();
            if vertices > MAX_VERTICES {
                return Err(AssetError::new(file, "vertices").allowed(format!("at most {MAX_VERTICES}")));
            }
            let key = primitive.material().index().unwrap_or(usize::MAX);
            let (sum, means, bound) = parts.entry(key).or_default();
            append(sum, part.mesh);
            means.add(&part.means);
            bound.append(part.bound);
        }
    }
    if parts.is_empty() {
        return Err(AssetError::new(file, "triangles in the default scene").value(0).allowed("at least 1"));
    }
    let stem = stem(file);
    let several = parts.len() > 1;
    let mut objects: Vec<(VirtualObject, Bound)> = Vec::new();
    let mut names = UniqueNames::default();
    let materials: Vec<gltf::Material> = document.materials().collect();
    for (key, (mesh, means, bound)) in parts {
        let material = materials.get(key);
        let name = material.and_then(|m| m.name().map(str::to_owned));
        let name = name
            .unwrap_or_else(|| if key == usize::MAX { "plain".into() } else { format!("material {key}") });
        let name = names.give(if several { format!("{stem}/{name}") } else { stem.clone() });
        let openness = vec![1.0; mesh.positions.len()];
        let material = material::of(material, &means);
        let object = VirtualObject { name, mesh, material, world_from_object: Affine3A::IDENTITY, openness };
        objects.push((object, bound));
    }
    Ok(objects)
}

fn stem(file: &Path) -> String {
    file.file_stem().map_or_else(|| "model".into(), |s| s.to_string_lossy().into_owned())
}

/// How many triangles the shown nodes' accessors speak of, before any is read.
fn stated_triangles(document: &Document, shown: &dyn Fn(usize) -> bool) -> usize {
    let of_mesh = |mesh: &gltf::Mesh| {
        let of_primitive = |primitive: gltf::Primitive| {
            let positions = || primitive.get(&Semantic::Positions).map_or(0, |a| a.count());
            let corners = primitive.indices().map_or_else(positions, |a| a.count());
            match primitive.mode() {
                Mode::Triangles => corners / 3,
                Mode::TriangleStrip | Mode::TriangleFan => corners.saturating_sub(2),
                Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => 0,
            }
        };
        mesh.primitives().map(of_primitive).fold(0, usize::saturating_add)
    };
    let meshes: Vec<usize> = document.meshes().map(|mesh| of_mesh(&mesh)).collect();
    document
        .nodes()
        .filter(|node| shown(node.index()))
        .filter_map(|node| meshes.get(node.mesh()?.index()).copied())
        .fold(0, usize::saturating_add)
}

fn append(sum: &mut Mesh, part: Mesh) {
    let base = sum.positions.len() as u32;
    sum.positions.extend(part.positions);
    sum.normals.extend(part.normals);
    sum.tints_rgb.extend(part.tints_rgb);
    sum.triangles.extend(part.triangles.into_iter().map(|t| t.map(|i| i + base)));
}

#[cfg(test)]
mod tests;
