//! One primitive: its vertices posed, its triangles, its tints.

use super::{
    accessor::{floats, integers},
    material::{Means, Texture},
    pose::{MeshPlace, normal, point},
    source::Source,
};
use crate::{error::AssetError, model::scene::Mesh, normals::creased_from};
use glam::{DMat4, Vec3};
use gltf::{Primitive, Semantic, mesh::Mode};
use std::collections::HashMap;

/// What a primitive gives.
pub struct PrimitivePart {
    /// Posed, z up.
    pub mesh: Mesh,
    /// What its vertices tell of its material.
    pub means: Means,
    /// How the vertices follow their joints; empty unless `read` was told what they hang on.
    pub bound: Bound,
}

/// Which joints of the figure a node's mesh hangs on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hang {
    /// As a whole on one.
    Rigid {
        /// Index of the joint.
        joint: u16,
    },
    /// By the vertices' own weights on `count` joints from `first` on.
    Skinned {
        /// Index of the skin's first joint.
        first: u16,
        /// How many it has.
        count: u16,
    },
}

/// Vertices as they hang on joints: `model::animation::Attachment::Skinned` in the making.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bound {
    /// In the file's mesh frame.
    pub positions: Vec<Vec3>,
    /// There, not zero.
    pub normals: Vec<Vec3>,
    /// Indices of the figure's joints.
    pub joints: Vec<[u16; 4]>,
    /// Sum 1.
    pub weights: Vec<[f32; 4]>,
}

impl Bound {
    /// Adds the vertices of another primitive.
    pub fn append(&mut self, other: Self) {
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.joints.extend(other.joints);
        self.weights.extend(other.weights);
    }
}

/// Reads a primitive; `None` where it has no triangles to show (points, lines, no positions).
pub fn read(
    source: &mut Source,
    primitive: &Primitive,
    place: &MeshPlace,
    morph_weights: &[f32],
    hang: Option<&Hang>,
) -> Result<Option<PrimitivePart>, AssetError> {
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
        MeshPlace::Rigid(matrix) => Matrices::One(*matrix),
        MeshPlace::Skinned(joints) => Matrices::Each(blend(source, primitive, joints, count)?),
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
    let influences = hang.map(|hang| influences(source, primitive, hang, count)).transpose()?;
    // Vertices that hang differently stay apart.
    let kinds = influences.as_ref().map_or_else(Vec::new, |list| kinds(list));
    let (mesh, flat_from) = finish(mesh, normals.is_some(), &kinds);
    if mesh.triangles.is_empty() {
        return Ok(None);
    }
    let bound = influences.map_or_else(Bound::default, |influences| {
        bind(&mesh, &positions, normals.as_deref(), &influences, flat_from.as_deref(), mirrored)
    });
    Ok(Some(PrimitivePart { mesh, means, bound }))
}

/// Flat normals where a primitive has none or a broken one, and then the vertices that the new ones came from; triangles
/// without area go in any case.
fn finish(mesh: Mesh, has_normals: bool, kinds: &[u32]) -> (Mesh, Option<Vec<u32>>) {
    let unit: Option<Vec<_>> = mesh.normals.iter().map(|n| n.try_normalize()).collect();
    match unit {
        Some(normals) if has_normals => {
            let area = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
                (b - a).cross(c - a).length_squared() > 0.0
            };
            let triangles = mesh.triangles.iter().filter(|t| area(t)).copied().collect();
            (Mesh { normals, triangles, ..mesh }, None)
        }
        _ => {
            let (mesh, sources) = creased_from(&mesh, 0.0, kinds);
            (mesh, Some(sources))
        }
    }
}

/// What a vertex hangs on.
type Influence = ([u16; 4], [f32; 4]);

/// One number for each vertex, equal where the influences are.
fn kinds(influences: &[Influence]) -> Vec<u32> {
    let mut known = HashMap::new();
    let mut number = |(joints, weights): &Influence| {
        let next = known.len() as u32;
        *known.entry((*joints, weights.map(f32::to_bits))).or_insert(next)
    };
    influences.iter().map(&mut number).collect()
}

/// The finished mesh's vertices as they hang. Flat normals are taken from the triangles of the bind positions.
fn bind(
    mesh: &Mesh,
    positions: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    influences: &[Influence],
    flat_from: Option<&[u32]>,
    mirrored: bool,
) -> Bound {
    let from = |vertex: usize| flat_from.map_or(vertex, |list| list[vertex] as usize);
    let count = mesh.positions.len();
    let mut bound = Bound {
        positions: (0..count).map(|v| Vec3::from(positions[from(v)])).collect(),
        normals: vec![Vec3::ZERO; count],
        joints: (0..count).map(|v| influences[from(v)].0).collect(),
        weights: (0..count).map(|v| influences[from(v)].1).collect(),
    };
    match (flat_from, normals) {
        (None, Some(normals)) => {
            bound.normals = normals.iter().map(|&n| Vec3::from(n).normalize_or(Vec3::Z)).collect();
        }
        _ => {
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|i| bound.positions[i as usize].as_dvec3());
                // A mirrored mesh's triangles have been turned over.
                let area = (b - a).cross(c - a) * if mirrored { -1.0 } else { 1.0 };
                let normal = area.normalize_or_zero().as_vec3();
                triangle.iter().for_each(|&i| bound.normals[i as usize] += normal);
            }
            bound.normals.iter_mut().for_each(|n| *n = n.normalize_or(Vec3::Z));
        }
    }
    bound
}

/// The up to four strongest joints of each vertex, their weights made to sum to 1. A vertex whose weights are all 0 hangs
/// on the skin's first joint.
fn influences(
    source: &Source,
    primitive: &Primitive,
    hang: &Hang,
    count: usize,
) -> Result<Vec<Influence>, AssetError> {
    let (first, joints) = match *hang {
        Hang::Rigid { joint } => return Ok(vec![([joint, 0, 0, 0], [1.0, 0.0, 0.0, 0.0]); count]),
        Hang::Skinned { first, count } => (first, count),
    };
    let given =
        primitive.get(&Semantic::Joints(0)).is_some() && primitive.get(&Semantic::Weights(0)).is_some();
    if !given {
        return Err(AssetError::new(source.file, "JOINTS_0, WEIGHTS_0")
            .allowed("given: the mesh is used with a skin"));
    }
    let mut strongest: Vec<[(u16, f32); 4]> = vec![[(first, 0.0); 4]; count];
    each_influence(source, primitive, count, |vertex, joint, weight| {
        if joint >= u32::from(joints) {
            return None;
        }
        let slots = &mut strongest[vertex];
        let weakest = (0..4).fold(0, |low, k| if slots[k].1 < slots[low].1 { k } else { low });
        if weight > slots[weakest].1 {
            slots[weakest] = (first + joint as u16, weight);
        }
        Some(())
    })?;
    Ok(strongest
        .into_iter()
        .map(|slots| {
            let sum: f64 = slots.iter().map(|(_, weight)| f64::from(*weight)).sum();
            if sum > 1e-6 {
                (slots.map(|(joint, _)| joint), slots.map(|(_, w)| (f64::from(w) / sum) as f32))
            } else {
                ([first; 4], [1.0, 0.0, 0.0, 0.0])
            }
        })
        .collect())
}

/// Calls `take(vertex, joint of the skin, weight)` for every weight that is not 0; `None` from it: no such joint.
fn each_influence(
    source: &Source,
    primitive: &Primitive,
    count: usize,
    mut take: impl FnMut(usize, u32, f32) -> Option<()>,
) -> Result<(), AssetError> {
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
        for (vertex, (indices, weights)) in indices.iter().zip(&weights).enumerate() {
            for (&index, &weight) in indices.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                Some(())
                    .filter(|()| weight.is_finite())
                    .and_then(|()| take(vertex, index, weight))
                    .ok_or_else(|| {
                        AssetError::new(source.file, format!("JOINTS_{set}"))
                            .value(index)
                            .allowed("a joint of the skin, with a finite weight")
                    })?;
            }
        }
    }
    Ok(())
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
    each_influence(source, primitive, count, |vertex, joint, weight| {
        let sum = &mut sums[vertex];
        sum.0 += *joints.get(joint as usize)? * f64::from(weight);
        sum.1 += f64::from(weight);
        Some(())
    })?;
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
