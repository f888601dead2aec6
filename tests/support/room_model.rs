//! Small models of rooms for tests, as .glb: z up here, y up in the file.

/// A part of a model: a node with a mesh of its own.
pub struct Part {
    /// The node's.
    pub name: &'static str,
    /// World frame, z up.
    pub corners: Vec<[f32; 3]>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// glTF's JSON.
    pub material: String,
}

/// Matt material of a grey, sending out `emitted`.
pub fn material(reflectance: f32, emitted: f32) -> String {
    let colour = if emitted > 0.0 { 1.0 } else { 0.0 };
    format!(
        r#"{{"pbrMetallicRoughness":{{"baseColorFactor":[{reflectance},{reflectance},{reflectance},1],"metallicFactor":0,"roughnessFactor":1}},
        "emissiveFactor":[{colour},{colour},{colour}],"extensions":{{"KHR_materials_emissive_strength":{{"emissiveStrength":{emitted}}}}}}}"#
    )
}

/// Sides of a box from `low` to `high` that look inwards, two triangles each.
pub fn inside(low: [f32; 3], high: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 0 { low[k] } else { high[k] });
    let sides: [[u32; 4]; 6] =
        [[2, 6, 4, 0], [5, 7, 3, 1], [4, 5, 1, 0], [3, 7, 6, 2], [1, 3, 2, 0], [6, 7, 5, 4]];
    let triangles = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

/// A room of 4 x 3 x 2.5 m and a lamp of half a metre under its ceiling.
pub fn room() -> Vec<Part> {
    let (corners, triangles) = inside([-2.0, -1.5, -0.75], [2.0, 1.5, 1.75]);
    let lamp = [[0.0, 0.0], [0.0, 0.5], [0.5, 0.5], [0.5, 0.0]].map(|[x, y]| [x, y, 1.74]);
    vec![
        Part { name: "walls", corners, triangles, material: material(0.5, 0.0) },
        Part {
            name: "lamp",
            corners: lamp.to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material: material(0.0, 20.0),
        },
    ]
}

/// The model; `nodes` is spliced into every node's description, `rest` into the document.
pub fn glb(parts: &[Part], nodes: &str, rest: &str) -> Vec<u8> {
    let (mut binary, mut views, mut accessors) = (Vec::<u8>::new(), Vec::new(), Vec::new());
    let (mut meshes, mut node_list) = (Vec::new(), Vec::new());
    let mut add = |bytes: Vec<u8>, kind: &str, component: u32, count: usize| {
        views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, binary.len(), bytes.len()));
        binary.extend(bytes);
        accessors.push(format!(
            r#"{{"bufferView":{},"componentType":{component},"count":{count},"type":"{kind}","min":[-9,-9,-9],"max":[9,9,9]}}"#,
            views.len() - 1
        ));
        if kind == "SCALAR" {
            let last = accessors.last_mut().unwrap();
            *last = last.replace(r#","min":[-9,-9,-9],"max":[9,9,9]"#, "");
        }
        accessors.len() - 1
    };
    for (index, part) in parts.iter().enumerate() {
        let floats = part.corners.iter().flat_map(|[x, y, z]| [*x, *z, -*y]);
        let position = add(floats.flat_map(f32::to_le_bytes).collect(), "VEC3", 5126, part.corners.len());
        let numbers: Vec<u8> = part.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
        let indices = add(numbers, "SCALAR", 5125, 3 * part.triangles.len());
        meshes.push(format!(
            r#"{{"primitives":[{{"attributes":{{"POSITION":{position}}},"indices":{indices},"material":{index}}}]}}"#
        ));
        node_list.push(format!(r#"{{"name":"{}","mesh":{index}{nodes}}}"#, part.name));
    }
    let materials: Vec<&str> = parts.iter().map(|p| &*p.material).collect();
    let scene: Vec<String> = (0..parts.len()).map(|i| i.to_string()).collect();
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_materials_emissive_strength"],"scene":0,"scenes":[{{"nodes":[{}]}}],
        "nodes":[{}],"meshes":[{}],"materials":[{}],"accessors":[{}],"bufferViews":[{}],"buffers":[{{"byteLength":{}}}]{rest}}}"#,
        scene.join(","),
        node_list.join(","),
        meshes.join(","),
        materials.join(","),
        accessors.join(","),
        views.join(","),
        binary.len()
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", binary)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    glb
}
