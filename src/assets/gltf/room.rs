//! Models as known rooms: one part for each primitive of each node, with what it reflects and what it sends out.

use super::{MAX_NODES, MAX_TRIANGLES, accessor::floats, pose, primitive, source::Source, stated_triangles};
use crate::{error::AssetError, math::color::srgb_decode};
use glam::Vec3;
use gltf::{Primitive, Semantic, mesh::Mode};
use std::path::Path;

/// From this metalness on...
const MIRROR_METAL: f32 = 0.9;
/// ...and up to this roughness a part is a mirror, which reflects nothing diffusely.
const MIRROR_ROUGH: f32 = 0.1;
/// Largest radiance that a part may send out.
const MOST_EMITTED: f32 = 1e6;

/// A part of a room of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomPart {
    /// Node, and material where it has a name; not always unique.
    pub name: String,
    /// World frame, z up, metres; finite.
    pub positions_world: Vec<Vec3>,
    /// Counter-clockwise seen from the front; each has an area.
    pub triangles: Vec<[u32; 3]>,
    /// Base colour, linear, 0 to 1: factor times the mean of its texture (over the whole picture) and of the vertex
    /// colours. 0 for mirrors.
    pub reflectance_rgb: [f32; 3],
    /// Emissive factor times the mean of its texture times the strength of `KHR_materials_emissive_strength`.
    pub emitted_rgb: [f32; 3],
    /// Triangles left out because they have no area.
    pub without_area: usize,
}

/// The parts of a model's default scene, node transforms applied, in order of nodes and primitives; `file` names it in
/// errors and tells where other files are. A part without triangles that have an area is there, empty.
///
/// # Errors
/// The bytes are damaged, need an extension that is not known here, name what is not there, hold more than
/// `MAX_TRIANGLES`, or give a place or a radiance that is not finite (the node is named).
pub fn decode_parts(file: &Path, bytes: &[u8]) -> Result<Vec<RoomPart>, AssetError> {
    let mut source = Source::open(file, bytes)?;
    let document = source.document.clone();
    if document.nodes().len() > MAX_NODES {
        return Err(AssetError::new(file, "nodes")
            .value(document.nodes().len())
            .allowed(format!("at most {MAX_NODES}")));
    }
    let placed = pose::place(&source, &document)?;
    let shown = |index: usize| placed.get(index).and_then(Option::as_ref);
    let stated = stated_triangles(&document, &|index| shown(index).is_some());
    if stated > MAX_TRIANGLES {
        return Err(AssetError::new(file, "triangles")
            .value(stated)
            .allowed(format!("at most {MAX_TRIANGLES} in all")));
    }
    let mut parts = Vec::new();
    for node in document.nodes() {
        let (Some(mesh), Some(place)) = (node.mesh(), shown(node.index())) else { continue };
        let node_name =
            node.name().or(mesh.name()).map_or_else(|| format!("node {}", node.index()), str::to_owned);
        let weights = node.weights().or(mesh.weights()).unwrap_or(&[]).to_vec();
        for primitive in mesh.primitives() {
            let inside = |e: AssetError| {
                let (mesh, part) = (mesh.index(), primitive.index());
                e.inside(format!("nodes[{}] {node_name:?}, meshes[{mesh}].primitives[{part}]", node.index()))
            };
            let stated = triangles_of(&primitive);
            if stated == 0 {
                continue;
            }
            let read = primitive::read(&mut source, &primitive, place, &weights, None).map_err(inside)?;
            let (reflectance_rgb, emitted_rgb) = light_of(&mut source, &primitive).map_err(inside)?;
            let mesh = read.map(|part| part.mesh).unwrap_or_default();
            let name = match primitive.material().name() {
                Some(material) => format!("{node_name}/{material}"),
                None => node_name.clone(),
            };
            parts.push(RoomPart {
                name,
                without_area: stated.saturating_sub(mesh.triangles.len()),
                positions_world: mesh.positions,
                triangles: mesh.triangles,
                reflectance_rgb,
                emitted_rgb,
            });
        }
    }
    Ok(parts)
}

fn triangles_of(primitive: &Primitive) -> usize {
    let positions = || primitive.get(&Semantic::Positions).map_or(0, |a| a.count());
    let corners = primitive.indices().map_or_else(positions, |a| a.count());
    match primitive.mode() {
        Mode::Triangles => corners / 3,
        Mode::TriangleStrip | Mode::TriangleFan => corners.saturating_sub(2),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => 0,
    }
}

/// Diffuse reflectance and emitted radiance.
fn light_of(source: &mut Source, primitive: &Primitive) -> Result<([f32; 3], [f32; 3]), AssetError> {
    let material = primitive.material();
    let pbr = material.pbr_metallic_roughness();
    let is_stated = material.index().is_some();
    let is_mirror =
        is_stated && pbr.metallic_factor() >= MIRROR_METAL && pbr.roughness_factor() <= MIRROR_ROUGH;
    let factor = pbr.base_color_factor();
    let mut reflectance = if is_mirror { [0.0; 3] } else { [factor[0], factor[1], factor[2]] };
    if let Some(info) = pbr.base_color_texture() {
        multiply(&mut reflectance, texture_mean(source, &info)?);
    }
    if let Some(colours) = primitive.get(&Semantic::Colors(0)) {
        let rows: Vec<[f32; 4]> = floats(source, &colours, 1.0)?;
        let mut sum = [0.0f64; 3];
        rows.iter().for_each(|row| (0..3).for_each(|c| sum[c] += f64::from(row[c])));
        multiply(&mut reflectance, sum.map(|s| (s / rows.len().max(1) as f64) as f32));
    }
    let strength = material.emissive_strength().unwrap_or(1.0);
    let mut emitted = material.emissive_factor().map(|c| c * strength);
    if let Some(info) = material.emissive_texture() {
        multiply(&mut emitted, texture_mean(source, &info)?);
    }
    if emitted.iter().any(|c| !(0.0..=MOST_EMITTED).contains(c)) {
        return Err(AssetError::new(source.file, "emissiveFactor times emissiveStrength")
            .value(format!("{emitted:?}"))
            .allowed(format!("three numbers within 0 to {MOST_EMITTED}")));
    }
    Ok((reflectance.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 1.0 }), emitted))
}

fn multiply(rgb: &mut [f32; 3], by: [f32; 3]) {
    rgb.iter_mut().zip(by).for_each(|(c, by)| *c *= by);
}

/// Linear mean over all texels.
fn texture_mean(source: &mut Source, info: &gltf::texture::Info) -> Result<[f32; 3], AssetError> {
    let texture = source.document.as_json().textures.get(info.texture().index()).map(|t| t.source.value());
    let image = texture.ok_or_else(|| AssetError::new(source.file, "texture source").allowed("an image"))?;
    let picture = source.picture(image)?;
    let mut counts = [[0u64; 256]; 3];
    for texel in picture.pixels() {
        (0..3).for_each(|c| counts[c][usize::from(texel[c])] += 1);
    }
    let texels = picture.pixels().len().max(1) as f64;
    Ok(counts.map(|counts| {
        let values = counts.iter().enumerate();
        let sum: f64 = values.map(|(byte, n)| srgb_decode(byte as f64 / 255.0) * *n as f64).sum();
        (sum / texels) as f32
    }))
}
