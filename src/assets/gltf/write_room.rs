//! A known room as a .glb.

use super::write::{Chunk, F32_TRIPLE, container};
use crate::model::room::{Face, Room};
use serde_json::{Value, json};

/// Writes a room: a node, a mesh and a material for each surface, quadrilaterals as two triangles, z up turned to glTF's y
/// up. What a surface sends out is written as emissive factor and strength. Surfaces without a face that has all its
/// corners are left out. `extras` go under `asset`.
pub fn encode_room(room: &Room, extras: Value) -> Vec<u8> {
    let mut chunk = Chunk::default();
    let (mut nodes, mut meshes, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    for surface in &room.surfaces {
        let count = surface.corners_world.len() as u32;
        let sound = |face: &&Face| face.corners().iter().all(|&i| i < count);
        let triangles: Vec<u32> = (surface.faces.iter().filter(sound))
            .flat_map(|face| {
                let list = face.corners();
                (1..list.len() - 1).flat_map(|k| [list[0], list[k], list[k + 1]]).collect::<Vec<_>>()
            })
            .collect();
        let turned: Vec<[f32; 3]> = surface.corners_world.iter().map(|p| [p.x, p.z, -p.y]).collect();
        if triangles.is_empty() {
            continue;
        }
        let ends = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
            std::array::from_fn(|c| turned.iter().map(|p| p[c]).reduce(pick).unwrap_or(0.0))
        };
        let (low, high) = (ends(f32::min), ends(f32::max));
        let position = chunk.floats(turned.iter().flatten().copied(), F32_TRIPLE.0, F32_TRIPLE.1);
        chunk.accessors[position]["min"] = json!(low);
        chunk.accessors[position]["max"] = json!(high);
        let indices = chunk.indices(&triangles);
        let [r, g, b] = surface.reflectance_rgb;
        let mut material = json!({"name": surface.name, "pbrMetallicRoughness":
            {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}});
        let strength = surface.emitted_rgb.iter().fold(0.0f32, |most, e| most.max(*e));
        if strength > 0.0 {
            material["emissiveFactor"] = json!(surface.emitted_rgb.map(|e| e / strength));
            let extension = json!({"emissiveStrength": strength});
            material["extensions"] = json!({"KHR_materials_emissive_strength": extension});
        }
        nodes.push(json!({"name": surface.name, "mesh": meshes.len()}));
        meshes.push(json!({"name": surface.name, "primitives": [
            {"attributes": {"POSITION": position}, "indices": indices, "material": materials.len()}]}));
        materials.push(material);
    }
    let roots: Vec<usize> = (0..nodes.len()).collect();
    let mut document = json!({
        "asset": {"version": "2.0", "extras": extras},
        "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes, "meshes": meshes, "materials": materials,
        "accessors": chunk.accessors, "bufferViews": chunk.views, "buffers": [{"byteLength": chunk.bytes.len()}],
    });
    if room.surfaces.iter().any(|s| s.emitted_rgb != [0.0; 3]) {
        document["extensionsUsed"] = json!(["KHR_materials_emissive_strength"]);
    }
    container(&document, chunk.bytes)
}
