use super::*;
use proptest::prelude::*;

const CASE: &str = r#"{
  "id": "a", "family": "F4",
  "camera": {"model": "pinhole", "width": 4, "height": 3, "fx": 5.0, "fy": 5, "cx": 2, "cy": 1.5,
    "pixel_centre_offset": 0.5,
    "world_from_camera": [[1,0,0,0.5],[0,-1,0,0],[0,0,-1,2],[0,0,0,1]]},
  "geometry": [
    {"name": "plane", "role": "receiver", "shape": "plane_z0", "half_extent": 10, "material": "m"},
    {"name": "box", "role": "object", "shape": "box", "center": [0,0,1], "half_size": [1,2,1], "yaw_deg": 90,
     "material": "m"},
    {"name": "ball", "role": "object", "shape": "sphere", "center": [0,0,4], "radius": 0.5, "material": "mirror"}],
  "materials": {"m": {"type": "lambert", "albedo": [0.5,0.5,0.5]},
    "mirror": {"type": "mirror", "reflectance": [1,1,1]}},
  "emitters": [{"name": "sun", "type": "directional", "to_light": [0,0,1], "irradiance_perpendicular": [1,2,3]},
    {"type": "environment", "file": "env/a.exr"}],
  "alternative_sun": {"name": "sun_disc", "type": "disc", "center": [0,0,9], "normal": [0,0,-1], "radius": 1,
    "radiance": [1,1,1]},
  "images": {"beauty": {"file": "a/beauty.exr"}, "bare": {"file": "a/bare.exr", "objects": []},
    "ball": {"file": "a/ball.exr", "objects": ["ball"], "emitters": ["sun_disc"]}}
}"#;

fn read(text: &str) -> Result<Case, AssetError> {
    file::parse(Path::new("ref/a/case.json"), text)
}

#[test]
fn names_choose_objects_and_emitters() {
    let case = read(CASE).unwrap();
    assert_eq!(case.world_from_camera.transform(DVec3::Z), DVec3::new(0.5, 0.0, 1.0));
    assert_eq!(case.image("beauty").unwrap().file, Path::new("ref/a/beauty.exr"));
    let scene = case.scene(None).unwrap();
    assert_eq!((scene.objects.len(), scene.surfaces.len()), (2, 1));
    let corner = scene.objects[0].world_from_object.transform_point3(Vec3::new(1.0, 2.0, 1.0));
    assert!((corner - Vec3::new(-2.0, 1.0, 2.0)).length() < 1e-6, "{corner}");
    assert!(scene.objects.iter().all(|o| o.openness.len() == o.mesh.positions.len()));
    assert!(case.scene(Some("bare")).unwrap().objects.is_empty());
    assert_eq!(case.objects(Some("ball")).unwrap()[0].name, "ball");
    assert_eq!(case.spheres(Some("ball")).unwrap(), [(DVec3::new(0.0, 0.0, 4.0), 0.5)]);
    assert_eq!(case.emitters(Some("ball")).unwrap()[0].name.as_deref(), Some("sun_disc"));
    assert_eq!(case.emitters(None).unwrap().len(), 2);
    let error = case.scene(Some("missing")).unwrap_err().to_string();
    assert!(error.contains("missing") && error.contains("ball, bare, beauty"), "{error}");
}

#[test]
fn mistakes_are_named_all_at_once() {
    let bad = CASE
        .replace("\"fx\": 5.0", "\"fx\": -5.0")
        .replace("\"radius\": 0.5", "\"radius\": 0")
        .replace("[0,-1,0,0]", "[0,1,0,0]")
        .replace("\"material\": \"mirror\"", "\"material\": \"glass\"")
        .replace("\"objects\": [\"ball\"]", "\"objects\": [\"cat\"]");
    let error = read(&bad).unwrap_err().to_string();
    for part in ["camera.fx = -5", "geometry ball.radius = 0", "world_from_camera", "glass", "cat"] {
        assert!(error.contains(part), "{part} in {error}");
    }
    for (key, part) in
        [("\"camera\"", "camera"), ("\"half_extent\"", "half_extent"), ("\"images\"", "images")]
    {
        let error = read(&CASE.replace(key, "\"other\"")).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("case.json"), "{error}");
    }
    assert!(read("").is_err());
}

proptest! {
    #[test]
    fn cut_and_changed_files_never_panic(keep in 0.0f64..1.1, at in any::<prop::sample::Index>(), to in "[0-9a-z\\[\\]{}\",.-]{0,3}") {
        let mut text: String = CASE.chars().take((CASE.len() as f64 * keep) as usize).collect();
        let at = if text.is_empty() { 0 } else { at.index(text.len()) };
        text.replace_range(at..(at + to.len()).min(text.len()), &to);
        if let Ok(case) = read(&text) {
            let _ = case.objects(Some("ball"));
        }
    }
}
