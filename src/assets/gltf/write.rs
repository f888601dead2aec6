//! A figure as a .glb.

use super::LoadedFigure;
use crate::model::{
    animation::{Attachment, Interpolation, Moves},
    scene::Material,
};
use glam::{Mat4, Vec3};
use serde_json::{Value, json};

/// The binary chunk and its accessors.
#[derive(Default)]
pub(super) struct Chunk {
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
}

/// Name and numbers of an accessor of positions.
pub(super) const F32_TRIPLE: (&str, usize) = ("VEC3", 3);

const U8: u32 = 5121;
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;

impl Chunk {
    fn add(&mut self, bytes: Vec<u8>, component: u32, kind: &str, count: usize) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend(bytes);
        let view = self.views.len() - 1;
        self.accessors
            .push(json!({"bufferView": view, "componentType": component, "count": count, "type": kind}));
        self.accessors.len() - 1
    }

    pub(super) fn floats(&mut self, rows: impl IntoIterator<Item = f32>, kind: &str, size: usize) -> usize {
        let bytes: Vec<u8> = rows.into_iter().flat_map(f32::to_le_bytes).collect();
        let count = bytes.len() / 4 / size;
        self.add(bytes, F32, kind, count)
    }

    /// Indices as two bytes each where that suffices, else four.
    pub(super) fn indices(&mut self, list: &[u32]) -> usize {
        if list.iter().all(|&i| i < u32::from(u16::MAX)) {
            let bytes = list.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect();
            self.add(bytes, U16, "SCALAR", list.len())
        } else {
            self.add(list.iter().flat_map(|i| i.to_le_bytes()).collect(), U32, "SCALAR", list.len())
        }
    }

    fn normalised(&mut self, rows: impl IntoIterator<Item = f32>) -> usize {
        let bytes: Vec<u8> = rows.into_iter().map(|x| (x * 255.0).round().clamp(0.0, 255.0) as u8).collect();
        let count = bytes.len() / 4;
        let accessor = self.add(bytes, U8, "VEC4", count);
        self.accessors[accessor]["normalized"] = json!(true);
        accessor
    }
}

/// Writes a figure whose parts are all skinned: one mesh, a primitive for each part, tints and weights as bytes, keys as
/// they are. The same figure gives the same bytes. `extras` go under `asset`. Materials other than matt ones are written
/// as their matt part. `None` where a part hangs rigidly, or a list is not as long as the mesh's.
///
/// `decode_figure` reads it back: nodes, joints, clips and bind positions bit for bit, tints and weights to 1/255.
pub fn encode(loaded: &LoadedFigure, extras: Value) -> Option<Vec<u8>> {
    let skeleton = &loaded.figure.skeleton;
    let mut chunk = Chunk::default();
    let (mut primitives, mut materials) = (Vec::new(), Vec::new());
    for part in &loaded.figure.parts {
        let object = loaded.objects.get(part.object)?;
        let Attachment::Skinned { bind_positions, bind_normals, joints, weights } = &part.attachment else {
            return None;
        };
        let count = object.mesh.positions.len();
        if [bind_positions.len(), bind_normals.len(), joints.len(), weights.len()] != [count; 4]
            || object.mesh.tints_rgb.len() != count
        {
            return None;
        }
        let flat = |list: &[Vec3]| list.iter().flat_map(|p| p.to_array()).collect::<Vec<f32>>();
        let position = chunk.floats(flat(bind_positions), "VEC3", 3);
        let low = bind_positions.iter().copied().reduce(Vec3::min)?;
        let high = bind_positions.iter().copied().reduce(Vec3::max)?;
        chunk.accessors[position]["min"] = json!(low.to_array());
        chunk.accessors[position]["max"] = json!(high.to_array());
        let normal = chunk.floats(flat(bind_normals), "VEC3", 3);
        let tints = object.mesh.tints_rgb.iter().flat_map(|&[r, g, b]| [r, g, b, 1.0]);
        let colour = chunk.normalised(tints);
        let all = joints.as_flattened();
        let joint = if all.iter().all(|&j| j <= 255) {
            chunk.add(all.iter().map(|&j| j as u8).collect(), U8, "VEC4", count)
        } else {
            chunk.add(all.iter().flat_map(|j| j.to_le_bytes()).collect(), U16, "VEC4", count)
        };
        let weight = chunk.normalised(weights.as_flattened().iter().copied());
        let triangles = object.mesh.triangles.as_flattened();
        let indices = chunk.indices(triangles);
        let albedo_rgb = match object.material {
            Material::Lambert { albedo_rgb } | Material::Phong { albedo_rgb, .. } => albedo_rgb,
            Material::Mirror { reflectance_rgb } => reflectance_rgb,
        };
        let [r, g, b] = albedo_rgb;
        materials.push(json!({"name": object.name, "pbrMetallicRoughness":
            {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}}));
        primitives.push(json!({"attributes": {"POSITION": position, "NORMAL": normal, "COLOR_0": colour,
            "JOINTS_0": joint, "WEIGHTS_0": weight}, "indices": indices, "material": materials.len() - 1}));
    }
    let mut nodes: Vec<Value> = Vec::new();
    for (index, node) in skeleton.nodes.iter().enumerate() {
        let children: Vec<usize> =
            (0..skeleton.nodes.len()).filter(|&c| skeleton.nodes[c].parent == Some(index as u32)).collect();
        let mut value = json!({"name": node.name, "translation": node.rest.translation.to_array(),
            "rotation": node.rest.rotation.to_array(), "scale": node.rest.scale.to_array()});
        if !children.is_empty() {
            value["children"] = json!(children);
        }
        nodes.push(value);
    }
    let mut roots: Vec<usize> = (0..nodes.len()).filter(|&i| skeleton.nodes[i].parent.is_none()).collect();
    roots.push(nodes.len());
    nodes.push(json!({"name": loaded.figure.name, "mesh": 0, "skin": 0}));
    let binds = skeleton.joints.iter().flat_map(|j| Mat4::from(j.node_from_bind).to_cols_array());
    let binds = chunk.floats(binds, "MAT4", 16);
    let joints: Vec<u32> = skeleton.joints.iter().map(|joint| joint.node).collect();
    let animations: Vec<Value> = loaded.figure.clips.iter().map(|clip| animation(clip, &mut chunk)).collect();
    let mut document = json!({
        "asset": {"version": "2.0", "extras": extras},
        "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes,
        "meshes": [{"name": loaded.figure.name, "primitives": primitives}], "materials": materials,
        "skins": [{"inverseBindMatrices": binds, "joints": joints}],
        "accessors": chunk.accessors, "bufferViews": chunk.views, "buffers": [{"byteLength": chunk.bytes.len()}],
    });
    if !animations.is_empty() {
        document["animations"] = json!(animations);
    }
    Some(container(&document, chunk.bytes))
}

/// Channels with equal times share one accessor for them.
fn animation(clip: &crate::model::animation::Clip, chunk: &mut Chunk) -> Value {
    let mut known: Vec<(&[f32], usize)> = Vec::new();
    let (mut channels, mut samplers) = (Vec::new(), Vec::new());
    for channel in &clip.channels {
        let times = &channel.times_s[..];
        let input = match known.iter().find(|(known, _)| *known == times) {
            Some(&(_, input)) => input,
            None => {
                let input = chunk.floats(times.iter().copied(), "SCALAR", 1);
                chunk.accessors[input]["min"] = json!([times.first()]);
                chunk.accessors[input]["max"] = json!([times.last()]);
                known.push((times, input));
                input
            }
        };
        let (path, kind, size) = match channel.moves {
            Moves::Translation => ("translation", "VEC3", 3),
            Moves::Rotation => ("rotation", "VEC4", 4),
            Moves::Scale => ("scale", "VEC3", 3),
        };
        let output =
            chunk.floats(channel.values.iter().flat_map(|v| v.to_array().into_iter().take(size)), kind, size);
        let interpolation = match channel.interpolation {
            Interpolation::Step => "STEP",
            Interpolation::Linear => "LINEAR",
            Interpolation::CubicSpline => "CUBICSPLINE",
        };
        samplers.push(json!({"input": input, "output": output, "interpolation": interpolation}));
        channels.push(json!({"sampler": samplers.len() - 1, "target": {"node": channel.node, "path": path}}));
    }
    json!({"name": clip.name, "channels": channels, "samplers": samplers})
}

pub(super) fn container(document: &Value, mut binary: Vec<u8>) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, bytes) in [(b"JSON", json), (b"BIN\0", binary)] {
        glb.extend((bytes.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(bytes);
    }
    glb
}
