use super::*;
use crate::model::scene::Material;
use glam::Vec3;
use proptest::prelude::*;

/// A triangle in a buffer of 3 positions, 3 normals and 3 indices; `more` is spliced into the description.
fn model(nodes: &str, material: &str, with_normals: bool) -> Vec<u8> {
    let positions = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0];
    let normals = [0f32, 0.0, 1.0].repeat(3);
    let mut binary: Vec<u8> = positions.iter().chain(&normals).flat_map(|x| x.to_le_bytes()).collect();
    binary.extend([0u16, 1, 2].iter().flat_map(|x| x.to_le_bytes()));
    let normal = if with_normals { r#","NORMAL":1"# } else { "" };
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":{nodes},
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0{normal}}},"indices":2{}}}]}}],
        "materials":[{material}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}},
        {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":2,"componentType":5123,"count":3,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":36}},
        {{"buffer":0,"byteOffset":72,"byteLength":6}}],"buffers":[{{"byteLength":78}}]}}"#,
        if material == "{}" { "" } else { r#","material":0"# },
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

fn read(bytes: &[u8]) -> Result<Vec<VirtualObject>, AssetError> {
    decode(Path::new("some.glb"), bytes)
}

const PLAIN: &str = r#"[{"mesh":0}]"#;

#[test]
fn y_up_becomes_z_up_and_node_transforms_apply() {
    let objects = read(&model(PLAIN, "{}", true)).unwrap();
    assert_eq!((objects.len(), objects[0].name.as_str()), (1, "some"));
    assert_eq!(objects[0].mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Z * 2.0]);
    assert_eq!(objects[0].mesh.normals, [Vec3::NEG_Y; 3]);
    // A parent that moves and a mirrored child: the triangle's front stays the side of its normal.
    let nodes = r#"[{"translation":[0,5,0],"children":[1]},{"mesh":0,"scale":[-2,1,1]}]"#;
    let mesh = &read(&model(nodes, "{}", true)).unwrap()[0].mesh;
    assert_eq!(mesh.positions[1], Vec3::new(-2.0, 0.0, 5.0));
    let [a, b, c] = mesh.triangles[0].map(|i| mesh.positions[i as usize]);
    assert!((b - a).cross(c - a).dot(mesh.normals[0]) > 0.0);
    assert_eq!(mesh.normals[0], Vec3::NEG_Y);
    // Normals that the file lacks are flat.
    assert_eq!(read(&model(PLAIN, "{}", false)).unwrap()[0].mesh.normals, [Vec3::NEG_Y; 3]);
}

#[test]
fn materials_become_the_nearest_of_ours() {
    let material = |m: f32, r: f32| {
        let json = format!(
            r#"{{"pbrMetallicRoughness":{{"baseColorFactor":[0.5,0.25,0.125,1],"metallicFactor":{m},"roughnessFactor":{r}}}}}"#
        );
        read(&model(PLAIN, &json, true)).unwrap()[0].material
    };
    let c = [0.5, 0.25, 0.125];
    assert_eq!(material(0.1, 0.9), Material::Lambert { albedo_rgb: c });
    assert_eq!(material(1.0, 0.05), Material::Mirror { reflectance_rgb: c });
    let Material::Phong { albedo_rgb, specular_rgb, exponent } = material(0.0, 0.5) else { panic!() };
    assert!((exponent - 30.0).abs() < 1e-3, "{exponent}");
    assert!((albedo_rgb[0] - 0.48).abs() < 1e-6 && (specular_rgb[0] - 0.04).abs() < 1e-6);
    assert!(matches!(material(1.0, 0.0), Material::Mirror { .. }));
    assert!(matches!(material(0.0, 0.0), Material::Phong { exponent: 2000.0, .. }));
}

#[test]
fn empty_and_impossible_models_say_what_is_wrong() {
    let empty = br#"{"asset":{"version":"2.0"}}"#;
    assert!(read(empty).unwrap_err().to_string().contains("triangles"));
    let scene = br#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"scene":0,"nodes":[{}]}"#;
    assert!(read(scene).unwrap_err().to_string().contains("some.glb: triangles"));
    for (nodes, part) in [
        (r#"[{"mesh":0,"children":[0]}]"#, "part of a tree"),
        (r#"[{"children":[1]},{"children":[0],"mesh":0}]"#, "part of a tree"),
        (r#"[{"children":[1,1]},{"mesh":0}]"#, "one node only"),
        (r#"[{"mesh":7}]"#, "description"),
        (r#"[{"mesh":0,"scale":[1e30,1e30,1e30],"translation":[1e38,1e38,1e38]}]"#, ""),
    ] {
        let result = read(&model(nodes, "{}", true));
        assert!(part.is_empty() || result.unwrap_err().to_string().contains(part), "{nodes}");
    }
    let uri = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"http://example.org/a.bin"}]}"#;
    assert!(read(uri).unwrap_err().to_string().contains("buffers[0].uri"));
    let short = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":9,"uri":"data:;base64,AAAA"}]}"#;
    assert!(read(short).unwrap_err().to_string().contains("byteLength = 9"));
    let count = model(PLAIN, "{}", true);
    let text = String::from_utf8_lossy(&count).replace("\"count\":3", "\"count\":9");
    assert!(read(text.as_bytes()).is_err());
    let need = br#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_x"],"extensionsRequired":["KHR_x"]}"#;
    assert!(read(need).is_err());
}

#[test]
fn a_position_accessor_that_does_not_exist_is_named() {
    let json = br#"{"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":9}}]}]}"#;
    let error = read(json).unwrap_err().to_string();
    assert!(
        error.contains("meshes[0].primitives[0].attributes = 9: must be an accessor, of which there are 0"),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn damaged_models_give_an_error_or_sound_meshes(
        keep in 0.0f64..1.3,
        flips in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), b'0'..=b'9']), 0..4),
    ) {
        let skin = r#"[{"mesh":0,"children":[1]},{"rotation":[0,0,0,1]}]"#;
        let material = r#"{"pbrMetallicRoughness":{"metallicFactor":0.3,"roughnessFactor":0.2}}"#;
        let mut bytes = model(skin, material, true);
        let length = ((bytes.len() as f64 * keep) as usize).min(bytes.len());
        bytes.truncate(length);
        for (index, byte) in flips {
            if !bytes.is_empty() {
                let at = index.index(bytes.len());
                bytes[at] = byte;
            }
        }
        if let Ok(objects) = read(&bytes) {
            for object in objects {
                let n = object.mesh.positions.len();
                prop_assert!(object.mesh.normals.len() == n && object.mesh.tints_rgb.len() == n);
                prop_assert!(object.mesh.positions.iter().all(|p| p.is_finite()));
                prop_assert!(object.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
                prop_assert!(object.mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
            }
        }
    }
}
