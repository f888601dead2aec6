//! Models that move: the objects together with their skeleton and clips.

use super::{build, clips, skeleton, source::Source, stem};
use crate::{
    error::{AssetError, read_file},
    model::{
        animation::{Attachment, Figure, FigurePart},
        scene::{Mesh, VirtualObject},
    },
    visibility::openness,
};
use glam::Affine3A;
use std::path::Path;

/// Spheres that stand for a body unless something else is said.
pub const DEFAULT_SPHERES: usize = 16;

/// A model that can move.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedFigure {
    /// As `load` gives them: at rest (the nodes' own transforms), one for each material.
    pub objects: Vec<VirtualObject>,
    /// Its parts count in `objects`; it rests, at the origin, without spheres.
    pub figure: Figure,
}

/// Loads a model with its skeleton: what `load_with` gives (a mesh without normals may have more vertices, where
/// vertices at one place hang on different joints), and how it moves.
///
/// A vertex keeps its four strongest joints, weights made to sum to 1; one without any weight hangs on its skin's first
/// joint. Openness is that of the pose at rest.
///
/// # Errors
/// As `load`; a mesh with a skin lacks joints or weights, or names a joint that its skin does not have; a node's matrix has
/// shear; keys that are not sound.
pub fn load_figure(
    file: &Path,
    rays: u32,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<LoadedFigure, AssetError> {
    let mut loaded = decode_figure(file, &read_file(file)?)?;
    let meshes: Vec<&Mesh> = loaded.objects.iter().map(|object| &object.mesh).collect();
    let open = openness::of_parts(&meshes, rays, progress);
    loaded.objects.iter_mut().zip(open).for_each(|(object, open)| object.openness = open);
    Ok(loaded)
}

/// `load_figure` from bytes, with openness 1; `file` names them in errors and tells where other files are.
///
/// # Errors
/// As `load_figure`.
pub fn decode_figure(file: &Path, bytes: &[u8]) -> Result<LoadedFigure, AssetError> {
    let mut source = Source::open(file, bytes)?;
    let document = source.document.clone();
    let skeleton = skeleton::load(&source, &document)?;
    let built = build(&mut source, &skeleton.hangs)?;
    let clips = clips::load(&source, &document, &skeleton.index_of)?;
    let mut objects = Vec::with_capacity(built.len());
    let mut parts = Vec::with_capacity(built.len());
    for (index, (object, bound)) in built.into_iter().enumerate() {
        objects.push(object);
        let attachment = Attachment::Skinned {
            bind_positions: bound.positions,
            bind_normals: bound.normals,
            joints: bound.joints,
            weights: bound.weights,
        };
        parts.push(FigurePart { object: index, attachment });
    }
    let figure = Figure {
        name: stem(file),
        skeleton: skeleton.skeleton,
        clips,
        parts,
        world_from_figure: Affine3A::IDENTITY,
        playing: None,
        walk: None,
        sphere_count: DEFAULT_SPHERES,
        spheres: Vec::new(),
        boxes: Vec::new(),
    };
    Ok(LoadedFigure { objects, figure })
}

#[cfg(test)]
mod tests;
