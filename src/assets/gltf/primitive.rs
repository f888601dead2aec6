//! One primitive: its vertices posed, its triangles, its tints.

use super::{
    accessor::{floats, integers},
    finish,
    material::{Means, Texture},
    pose::{Place, normal, point},
    source::Source,
};
use crate::{assets::error::AssetError, model::scene::Mesh};
use glam::{DMat4, Vec3};
use gltf::{Primitive, Semantic, mesh::Mode};

/// What a primitive gives.
pub struct Part {
    /// Posed, z up.
    pub mesh: Mesh,
    /// For the material.
    pub means: Means,
}

/// Reads a primitive; `None` where it has no triangles to show (points, lines, no positions).
pub fn read(
    source: &mut Source,
    primitive: &Primitive,
    place: &Place,
    morph_weights: &[f32],
) -> Result<Option<Part>, AssetError> {
    let file = source.file;
    let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(None) };
    let mut positions: Vec<[f32; 3]> = floats(source, &positions, 0.0)?;
    let count = positions.len();
    let wrong = |key: &str| AssetError::new(file, key).allowed("as many as positions");
    let mut normals: Option<Vec<[f32; 3]>> =
        primitive.get(&Semantic::Normals).map(|a| floats(source, &a, 0.0)).transpose()?;
    if normals.as_ref().is_some_and(|n| n.len() != count) {
        return Err(wrong("NORMAL"));
    }
    for (target, &weight) in primitive.morph_targets().zip(morph_weights) {
        if weight == 0.0 {
            continue;
        }
        let deltas: Option<Vec<[f32; 3]>> =
            target.positions().map(|a| floats(source, &a, 0.0)).transpose()?;
        add(&mut positions, deltas, weight).ok_or_else(|| wrong("morph target POSITION"))?;
        let deltas = target.normals().map(|a| floats(source, &a, 0.0)).transpose()?;
        if let Some(normals) = &mut normals {
            add(normals, deltas, weight).ok_or_else(|| wrong("morph target NORMAL"))?;
        }
    }
    let triangles = triangles(source, primitive, count)?;
    if triangles.is_empty() {
        return Ok(None);
    }
    let matrices = match place {
        Place::Rigid(matrix) => Matrices::One(*matrix),
        Place::Skinned(joints) => Matrices::Each(blend(source, primitive, joints, count)?),
    };
    let mirrored = matches!(matrices, Matrices::One(m) if m.determinant() < 0.0);
    let mut mesh = Mesh::default();
    for (index, &position) in positions.iter().enumerate() {
        let matrix = matrices.of(index);
        let position = point(matrix, position).as_vec3();
        if !position.is_finite() {
            return Err(AssetError::new(file, format!("position of vertex {index}")).allowed("finite"));
        }
        mesh.positions.push(position);
        let turned = normals.as_ref().map(|n| normal(matrix, n[index]).normalize_or_zero().as_vec3());
        mesh.normals.push(turned.unwrap_or(Vec3::ZERO));
    }
    mesh.triangles =
        triangles.into_iter().map(|[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] }).collect();
    let means = tint(source, primitive, &mut mesh)?;
    let mesh = finish(mesh, normals.is_some());
    Ok((!mesh.triangles.is_empty()).then_some(Part { mesh, means }))
}

/// Adds weighted deltas; `None` where their number differs.
fn add(to: &mut [[f32; 3]], deltas: Option<Vec<[f32; 3]>>, weight: f32) -> Option<()> {
    let Some(deltas) = deltas else { return Some(()) };
    (deltas.len() == to.len()).then(|| {
        for (row, delta) in to.iter_mut().zip(deltas) {
            (0..3).for_each(|k| row[k] += weight * delta[k]);
        }
    })
}

enum Matrices {
    One(DMat4),
    Each(Vec<DMat4>),
}

impl Matrices {
    fn of(&self, vertex: usize) -> &DMat4 {
        match self {
            Self::One(matrix) => matrix,
            Self::Each(list) => &list[vertex],
        }
    }
}

/// Each vertex's joints, mixed by their weights (made to sum to 1).
fn blend(
    source: &Source,
    primitive: &Primitive,
    joints: &[DMat4],
    count: usize,
) -> Result<Vec<DMat4>, AssetError> {
    let mut sums = vec![(DMat4::ZERO, 0.0f64); count];
    for set in 0.. {
        let (Some(indices), Some(weights)) =
            (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)))
        else {
            break;
        };
        let indices: Vec<[u32; 4]> = integers(source, &indices)?;
        let weights: Vec<[f32; 4]> = floats(source, &weights, 0.0)?;
        if indices.len() != count || weights.len() != count {
            return Err(AssetError::new(source.file, format!("JOINTS_{set}, WEIGHTS_{set}"))
                .allowed("as many as positions"));
        }
        for (sum, (indices, weights)) in sums.iter_mut().zip(indices.iter().zip(&weights)) {
            for (&index, &weight) in indices.iter().zip(weights) {
                if weight == 0.0 {
                    continue;
                }
                let joint = joints.get(index as usize).filter(|_| weight.is_finite()).ok_or_else(|| {
                    AssetError::new(source.file, format!("JOINTS_{set}"))
                        .value(index)
                        .allowed("a joint of the skin, with a finite weight")
                })?;
                sum.0 += *joint * f64::from(weight);
                sum.1 += f64::from(weight);
            }
        }
    }
    // A vertex without weights hangs on the first joint.
    let first = joints.first().copied().unwrap_or(super::pose::Z_UP_FROM_Y_UP);
    Ok(sums
        .into_iter()
        .map(|(sum, weight)| if weight > 1e-6 { sum * (1.0 / weight) } else { first })
        .collect())
}

fn triangles(source: &Source, primitive: &Primitive, count: usize) -> Result<Vec<[u32; 3]>, AssetError> {
    let order: Vec<u32> = match primitive.indices() {
        Some(accessor) => integers::<1>(source, &accessor)?.into_iter().map(|[i]| i).collect(),
        None => (0..count as u32).collect(),
    };
    if let Some(beyond) = order.iter().find(|&&i| i as usize >= count) {
        return Err(AssetError::new(source.file, "vertex index")
            .value(beyond)
            .allowed(format!("below {count}")));
    }
    Ok(match primitive.mode() {
        Mode::Triangles => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        Mode::TriangleStrip => order
            .windows(3)
            .enumerate()
            .map(|(k, t)| if k % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] })
            .collect(),
        Mode::TriangleFan => order.windows(2).skip(1).map(|t| [order[0], t[0], t[1]]).collect(),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    })
}

/// Vertex colours times the base colour texture, and the means that the material needs.
fn tint(source: &mut Source, primitive: &Primitive, mesh: &mut Mesh) -> Result<Means, AssetError> {
    let count = mesh.positions.len();
    let pbr = primitive.material().pbr_metallic_roughness();
    let colours: Option<Vec<[f32; 4]>> =
        primitive.get(&Semantic::Colors(0)).map(|a| floats(source, &a, 1.0)).transpose()?;
    let base =
        pbr.base_color_texture().map(|info| Texture::open(source, primitive, &info, count)).transpose()?;
    let surface = pbr
        .metallic_roughness_texture()
        .map(|info| Texture::open(source, primitive, &info, count))
        .transpose()?;
    let mut means = Means::default();
    for vertex in 0..count {
        let mut tint = [1.0f32; 3];
        if let Some(colour) = colours.as_ref().and_then(|c| c.get(vertex)) {
            (0..3).for_each(|k| tint[k] *= colour[k]);
        }
        if let Some(base) = base.as_ref().and_then(Option::as_ref) {
            let texel = base.linear(vertex);
            (0..3).for_each(|k| tint[k] *= texel[k]);
        }
        let tint = tint.map(|t| if t.is_finite() { t.clamp(0.0, 1.0) } else { 1.0 });
        let rough_metal =
            surface.as_ref().and_then(Option::as_ref).map_or([1.0; 2], |s| s.rough_metal(vertex));
        means.count(tint, rough_metal);
        mesh.tints_rgb.push(tint);
    }
    Ok(means)
}
