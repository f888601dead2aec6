use super::*;
use crate::animate::posed::Posed;
use crate::model::{animation::Playing, scene::Scene};
use glam::{Quat, Vec3};
use proptest::prelude::*;
use serde_json::{Value, json};

/// A .glb in the making: accessors are added one by one.
#[derive(Default)]
struct Glb {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Glb {
    fn add(&mut self, bytes: Vec<u8>, component: u32, kind: &str, count: usize, normalized: bool) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()}));
        self.binary.extend(bytes);
        let view = self.views.len() - 1;
        self.accessors.push(json!({"bufferView": view, "componentType": component, "count": count,
            "type": kind, "normalized": normalized, "min": [-9.0, -9.0, -9.0], "max": [9.0, 9.0, 9.0]}));
        if kind != "VEC3" {
            let accessor = self.accessors.last_mut().unwrap().as_object_mut().unwrap();
            accessor.remove("min");
            accessor.remove("max");
        }
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, rows: &[&[f32]]) -> usize {
        let bytes = rows.iter().flat_map(|row| row.iter().flat_map(|x| x.to_le_bytes())).collect();
        self.add(bytes, 5126, kind, rows.len(), false)
    }

    fn finish(&mut self, mut document: Value) -> Vec<u8> {
        let own = document.as_object_mut().unwrap();
        own.insert("asset".into(), json!({"version": "2.0"}));
        own.insert("accessors".into(), json!(self.accessors));
        own.insert("bufferViews".into(), json!(self.views));
        own.insert("buffers".into(), json!([{"byteLength": self.binary.len()}]));
        let mut json = document.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut glb = b"glTF\x02\0\0\0".to_vec();
        glb.extend((28 + json.len() as u32 + self.binary.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.binary)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend(chunk);
        }
        glb
    }
}

/// How a test's model differs from the plain one.
struct Variant {
    joints: Option<Vec<u8>>,
    /// Rows of weights, and their type: 5121, 5123 or 5126.
    weights: Option<(u32, Vec<[f32; 4]>)>,
    triangles: Vec<u16>,
    path: &'static str,
    interpolation: &'static str,
    times: Vec<f32>,
    values: Vec<Vec<f32>>,
    sampler: usize,
    node: usize,
    matrix: Option<[f32; 16]>,
}

impl Default for Variant {
    fn default() -> Self {
        let turned = Quat::from_rotation_z(1.0).to_array().to_vec();
        Self {
            joints: Some(vec![0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0]),
            weights: Some((5126, vec![[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0]])),
            triangles: vec![0, 1, 2],
            path: "rotation",
            interpolation: "LINEAR",
            times: vec![0.0, 1.0],
            values: vec![vec![0.0, 0.0, 0.0, 1.0], turned],
            sampler: 0,
            node: 1,
            matrix: None,
        }
    }
}

/// A triangle on two joints; the second one, child of the first (nodes 2 and 1: the child stands first in the file),
/// is moved by the clip "Turn".
fn model(variant: &Variant) -> Vec<u8> {
    let mut glb = Glb::default();
    let positions = glb.floats("VEC3", &[&[0.0, 0.0, 0.0], &[1.0, 0.0, 0.0], &[0.0, 2.0, 0.0]]);
    let indices: Vec<u8> = variant.triangles.iter().flat_map(|i| i.to_le_bytes()).collect();
    let indices = glb.add(indices, 5123, "SCALAR", variant.triangles.len(), false);
    let mut attributes = json!({"POSITION": positions});
    if let Some(joints) = &variant.joints {
        attributes["JOINTS_0"] = json!(glb.add(joints.clone(), 5121, "VEC4", 3, false));
    }
    if let Some((component, rows)) = &variant.weights {
        let all = rows.as_flattened();
        let bytes = match component {
            5121 => all.iter().map(|w| (w * 255.0).round() as u8).collect(),
            5123 => all.iter().flat_map(|w| ((w * 65535.0).round() as u16).to_le_bytes()).collect(),
            _ => all.iter().flat_map(|w| w.to_le_bytes()).collect(),
        };
        attributes["WEIGHTS_0"] = json!(glb.add(bytes, *component, "VEC4", 3, *component != 5126));
    }
    let times: Vec<&[f32]> = variant.times.chunks(1).collect();
    let input = glb.floats("SCALAR", &times);
    glb.accessors[input]["min"] = json!([variant.times.first().copied().unwrap_or(0.0)]);
    glb.accessors[input]["max"] = json!([variant.times.last().copied().unwrap_or(0.0)]);
    let kind = if variant.path == "rotation" { "VEC4" } else { "VEC3" };
    let rows: Vec<&[f32]> = variant.values.iter().map(Vec::as_slice).collect();
    let output = glb.floats(kind, &rows);
    let mut parent = json!({"name": "parent", "children": [1]});
    if let Some(matrix) = variant.matrix {
        parent["matrix"] = json!(matrix);
    }
    let target = json!({"node": variant.node, "path": variant.path});
    glb.finish(json!({
        "scene": 0, "scenes": [{"nodes": [0, 2]}],
        "nodes": [{"mesh": 0, "skin": 0}, {"name": "child", "translation": [1, 0, 0]}, parent],
        "skins": [{"joints": [2, 1]}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "animations": [{"name": "Turn", "channels": [{"sampler": variant.sampler, "target": target}],
            "samplers": [{"input": input, "output": output, "interpolation": variant.interpolation}]}],
    }))
}

fn read(bytes: &[u8]) -> Result<LoadedFigure, AssetError> {
    decode_figure(Path::new("some.glb"), bytes)
}

fn posed_at(bytes: &[u8], t: f64) -> Vec<Vec3> {
    let loaded = read(bytes).unwrap();
    let mut figure = loaded.figure;
    figure.playing = Some(Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: false });
    let scene = Scene { objects: loaded.objects, figures: vec![figure], ..Scene::default() };
    let mut posed = Posed::new(&scene);
    posed.update(&scene, t);
    posed.objects()[0].positions_world.clone()
}

fn wrong(variant: Variant) -> String {
    read(&model(&variant)).unwrap_err().to_string()
}

#[test]
fn all_interpolations_move_the_joint_as_the_standard_says() {
    // Vertex 1 at (1, 0, 0) hangs on the child alone, whose place at rest is (1, 0, 0): the child's translation plus
    // (1, 0, 0). y of the file is z of ours.
    let at = |interpolation, values: &[[f32; 3]], t| {
        let values = values.iter().map(|v| v.to_vec()).collect();
        let variant = Variant {
            path: "translation",
            interpolation,
            times: vec![0.0, 2.0],
            values,
            joints: Some(vec![0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]),
            ..Variant::default()
        };
        posed_at(&model(&variant), t)[1]
    };
    let (a, b) = ([1.0, 0.0, 0.0], [1.0, 8.0, 0.0]);
    assert!(at("STEP", &[a, b], 1.9).abs_diff_eq(Vec3::new(2.0, 0.0, 0.0), 1e-6));
    assert!(at("LINEAR", &[a, b], 0.5).abs_diff_eq(Vec3::new(2.0, 0.0, 2.0), 1e-6));
    // y = t^3: slopes 0 and 12 a second.
    let cubic = [[5.0; 3], a, [0.0; 3], [0.0, 12.0, 0.0], b, [5.0; 3]];
    for t in [0.5f32, 1.0, 1.5] {
        let found = at("CUBICSPLINE", &cubic, f64::from(t));
        assert!(found.abs_diff_eq(Vec3::new(2.0, 0.0, t.powi(3)), 2e-6), "{t}: {found}");
    }
}

#[test]
fn weights_of_all_three_types_mean_the_same() {
    // Vertex 2 at (0, 2, 0) hangs a third on the child.
    let at = |component, third: f32| {
        let rows = vec![[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [1.0 - third, third, 0.0, 0.0]];
        posed_at(&model(&Variant { weights: Some((component, rows)), ..Variant::default() }), 1.0)[2]
    };
    let float = at(5126, 0.4);
    // 0.4 is 102 of 255 and 26214 of 65535 exactly.
    assert!(at(5121, 0.4).abs_diff_eq(float, 1e-6) && at(5123, 0.4).abs_diff_eq(float, 1e-6), "{float}");
    let (sine, cosine) = 1f32.sin_cos();
    let child = Vec3::new(1.0 - 2.0 * sine, 0.0, 2.0 * cosine);
    assert!(float.abs_diff_eq(Vec3::new(0.0, 0.0, 2.0) * 0.6 + child * 0.4, 1e-5), "{float}");
    // Weights that do not sum to 1 are made to: 4 and 1 are 0.8 and 0.2.
    let rows = vec![[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [4.0, 1.0, 0.0, 0.0]];
    let loud = posed_at(&model(&Variant { weights: Some((5126, rows)), ..Variant::default() }), 1.0)[2];
    assert!(loud.abs_diff_eq(Vec3::new(0.0, 0.0, 2.0) * 0.8 + child * 0.2, 1e-5), "{loud}");
    // Without any weight: on the first joint, which does not move.
    let none = vec![[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0; 4]];
    let none = posed_at(&model(&Variant { weights: Some((5126, none)), ..Variant::default() }), 1.0)[2];
    assert!(none.abs_diff_eq(Vec3::new(0.0, 0.0, 2.0), 1e-6), "{none}");
}

#[test]
fn the_skeleton_has_parents_first() {
    let figure = read(&model(&Variant::default())).unwrap().figure;
    let names: Vec<&str> = figure.skeleton.nodes.iter().map(|n| n.name.as_str()).collect();
    assert_eq!(names, ["", "parent", "child"]);
    assert!(figure.skeleton.nodes.iter().enumerate().all(|(i, n)| n.parent.is_none_or(|p| (p as usize) < i)));
    assert_eq!(figure.clips[0].name, "Turn");
    assert_eq!((figure.clips[0].start_s, figure.clips[0].duration_s), (0.0, 1.0));
}

#[test]
fn what_is_wrong_with_a_skin_or_a_clip_is_said() {
    let place = "some.glb: meshes[0].primitives[0], ";
    for (variant, words) in [
        (Variant { weights: None, ..Variant::default() }, "JOINTS_0, WEIGHTS_0: must be given"),
        (Variant { joints: None, ..Variant::default() }, "JOINTS_0, WEIGHTS_0: must be given"),
        (
            Variant { joints: Some(vec![0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0]), ..Variant::default() },
            "JOINTS_0 = 7: must be a joint of the skin",
        ),
        (
            Variant { weights: Some((5126, vec![[f32::INFINITY, 0.0, 0.0, 0.0]; 3])), ..Variant::default() },
            "must be a joint of the skin, with a finite weight",
        ),
    ] {
        let error = wrong(variant);
        assert!(error.contains(place) && error.contains(words), "{error}");
    }
    let place = "some.glb: animations[0].channels[0], ";
    for (times, values, words) in [
        (vec![0.0, 0.0], 2, "times: must be at least one, finite, from 0 on, each after the one before"),
        (vec![-1.0, 0.0], 2, "times: must be"),
        (vec![0.0, f32::INFINITY], 2, "times: must be"),
        (vec![0.0, 1.0, 2.0], 2, "values = 2: must be 3 for 3 times"),
    ] {
        let values = vec![vec![0.0, 0.0, 0.0, 1.0]; values];
        let error = wrong(Variant { times, values, ..Variant::default() });
        assert!(error.contains(place) && error.contains(words), "{error}");
    }
    let error = wrong(Variant { values: vec![vec![0.0; 4]; 2], ..Variant::default() });
    assert!(error.contains("rotations that are not zero"), "{error}");
    let error = wrong(Variant { sampler: 4, ..Variant::default() });
    assert!(error.contains("animations[0].channels[0].sampler = 4: must be one of its samplers"), "{error}");
    let error = wrong(Variant { node: 3, ..Variant::default() });
    assert!(error.contains("channels[0].target.node = 3: must be a node, of which there are 3"), "{error}");
    let error = wrong(Variant { interpolation: "LINEAL", ..Variant::default() });
    assert!(error.contains("samplers[0].interpolation: must be LINEAR, STEP or CUBICSPLINE"), "{error}");
    // Without a skeleton a skin without weights stays what it was: all of it on the first joint.
    let still =
        super::super::decode(Path::new("a.glb"), &model(&Variant { weights: None, ..Variant::default() }));
    assert_eq!(still.unwrap()[0].mesh.positions.len(), 3);
}

#[test]
fn triangles_without_area_go_and_too_many_are_refused_before_they_are_read() {
    let degenerate = Variant { triangles: vec![0, 1, 2, 0, 0, 1, 2, 2, 2], ..Variant::default() };
    let loaded = read(&model(&degenerate)).unwrap();
    assert_eq!(loaded.objects[0].mesh.triangles.len(), 1);
    let error = wrong(Variant { triangles: vec![0, 1, 1], ..Variant::default() });
    assert!(error.contains("triangles in the default scene = 0: must be at least 1"), "{error}");
    // Five million triangles in a few hundred bytes: an accessor without a view is all zero but for sparse parts.
    let mut glb = Glb::default();
    let positions = glb.floats("VEC3", &[&[0.0, 0.0, 0.0], &[1.0, 0.0, 0.0], &[0.0, 2.0, 0.0]]);
    glb.accessors
        .push(json!({"componentType": 5125, "count": 15_000_000, "type": "SCALAR", "sparse": {"count": 1,
        "indices": {"bufferView": 0, "componentType": 5121}, "values": {"bufferView": 0}}}));
    let bytes = glb.finish(json!({
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": positions}, "indices": 1}]}],
    }));
    assert!(bytes.len() < 1000);
    for error in [read(&bytes).unwrap_err(), super::super::decode(Path::new("some.glb"), &bytes).unwrap_err()]
    {
        assert_eq!(error.to_string(), "some.glb: triangles = 5000000: must be at most 2097152 in all");
    }
}

#[test]
fn matrices_are_taken_apart_and_shear_is_refused() {
    let with = |rows: [[f32; 4]; 4]| Variant {
        matrix: Some(rows.concat().try_into().unwrap()),
        ..Variant::default()
    };
    let last = [5.0, 6.0, 7.0, 1.0];
    let sheared = with([[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], last]);
    let error = wrong(sheared);
    assert!(error.contains("nodes[2].matrix: must be translation times rotation times scale"), "{error}");
    // Mirrored in x, stretched in y; the clip begins at rest. Vertex 1 hangs on the child at (1, 0, 0).
    let mirrored = with([[-2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], last]);
    let found = posed_at(&model(&mirrored), 0.0);
    assert!(found[0].abs_diff_eq(Vec3::new(5.0, -7.0, 6.0), 1e-5), "{}", found[0]);
    assert!(found[1].abs_diff_eq(Vec3::new(1.0, -7.0, 6.0), 1e-5), "{}", found[1]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn damaged_figures_give_an_error_or_a_sound_figure(
        flips in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), b'0'..=b'9']), 1..4),
        t in prop_oneof![any::<f64>(), 0.0..2.0],
    ) {
        let mut bytes = model(&Variant::default());
        for (index, byte) in flips {
            let at = index.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(loaded) = read(&bytes) {
            let mut figure = loaded.figure;
            let joints = figure.skeleton.joints.len();
            for part in &figure.parts {
                let Attachment::Skinned { bind_positions, bind_normals, joints: list, weights } = &part.attachment else {
                    unreachable!()
                };
                let n = loaded.objects[part.object].mesh.positions.len();
                prop_assert_eq!([bind_positions.len(), bind_normals.len(), list.len(), weights.len()], [n; 4]);
                prop_assert!(list.iter().flatten().all(|&j| (j as usize) < joints));
                prop_assert!(weights.iter().all(|w| (w.iter().sum::<f32>() - 1.0).abs() < 1e-6));
            }
            figure.playing = Some(Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: true });
            let scene = Scene { objects: loaded.objects, figures: vec![figure], ..Scene::default() };
            let mut posed = Posed::new(&scene);
            posed.update(&scene, t);
            for object in posed.objects() {
                prop_assert!(object.positions_world.iter().all(|p| p.is_finite()));
                prop_assert!(object.normals_world.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
            }
        }
    }
}
