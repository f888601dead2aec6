//! The scene file: every key is understood, every mistake is named, no text makes the program panic.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::Vec3;
use halflight::assets::scene::{LightSource, RoomLightSource, load, parse};
use halflight::math::lens::Lens;
use halflight::model::{light::MapLayout, rig::Rig, scene::Material};
use halflight::nearfield::prepare::RoomSettings;
use proptest::prelude::*;
use std::path::Path;

const DESK: &str = include_str!("scenes/desk.toml");

const EVERY_KEY: &str = r#"
[camera]
lens = { width = 640, height = 480, fx = 650.0, fy = 651.0, cx = 320.0, cy = 240, distortion = [-0.2, 0.05, 0.001, 0.002, 0.01] }
position = [0.0, -0.6, 0.4]
look_at = [0.0, 0.0, 0.0]
up = [0, 0, 1]
pictures = ["a.jpg", "b.jpg"]
exposures_s = [0.01, 0.04]
response = "solve"
[light]
file = "room.hdr"
layout = "angular"
up = "y"
rotation_deg = 30.0
[room]
file = "room.glb"
light = "probe"
probe = "probe.hdr"
probe_position = [0, 0.5, 0.4]
layout = "cube"
up = "y"
rotation_deg = -90
sun = false
patch_m = 0.25
power_share = 0.9
neglected_share = 0.01
rays = 9
[ball]
centre = [-0.2, 0.04, 0.06]
radius_m = 0.06
reflectance_rgb = [0.9, 0.9, 0.8]
on_surface = false
[[tag]]
id = 3
side_m = 0.1
position = [0.5, 0.0, 0.0]
yaw_deg = 90.0
[[surface]]
name = "wall"
shape = "quad"
corners = [[0, 1, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1]]
receives_shadow = false
[[object]]
shape = "sphere"
radius_m = 0.1
position = [0.3, 0.2, 0.5]
scale = 2.0
material = { kind = "phong", albedo_rgb = [0.1, 0.2, 0.3], specular_rgb = [0.2, 0.2, 0.2], exponent = 40 }
[[object]]
shape = "box"
size = [0.2, 0.4, 0.6]
origin = "file"
yaw_deg = 90
material = { kind = "mirror", reflectance_rgb = [0.9, 0.9, 0.9] }
"#;

fn bounds(object: &halflight::model::scene::VirtualObject) -> (Vec3, Vec3) {
    let points = object.mesh.positions.iter().map(|&p| object.world_from_object.transform_point3(p));
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

#[test]
fn every_key_is_understood() {
    let scene = parse(Path::new("folder/all.toml"), EVERY_KEY).unwrap();
    let camera = scene.camera.as_ref().unwrap();
    assert_eq!((camera.lens.width, camera.lens.fy, camera.lens.cy), (640, 651.0, 240.0));
    assert_eq!(camera.pictures.files[1], Path::new("folder/b.jpg"));
    assert_eq!(camera.pictures.exposures_s, [0.01, 0.04]);
    let forward = camera.world_from_camera.rotate(glam::DVec3::Z);
    assert!(forward.abs_diff_eq(glam::DVec3::new(0.0, 0.6, -0.4).normalize(), 1e-12));
    let LightSource::File { layout, y_up, rotation_deg, .. } = &scene.light else {
        panic!("{:?}", scene.light)
    };
    assert_eq!((*layout, *y_up, *rotation_deg), (MapLayout::Angular, true, 30.0));
    assert!(!scene.ball_on_surface);
    // The tag lies flat with its picture up: its z goes down, and 90 degrees turn its x to +y.
    let tag = &scene.tags[0];
    assert!(tag.world_from_tag.rotate(glam::DVec3::Z).abs_diff_eq(-glam::DVec3::Z, 1e-12));
    assert!(tag.world_from_tag.rotate(glam::DVec3::X).abs_diff_eq(glam::DVec3::Y, 1e-12));
    let [sphere, cuboid] = &scene.scene.objects[..] else { panic!() };
    let (low, high) = bounds(sphere);
    assert!(
        low.abs_diff_eq(Vec3::new(0.1, 0.0, 0.5), 2e-3) && high.abs_diff_eq(Vec3::new(0.5, 0.4, 0.9), 2e-3),
        "{low} {high}"
    );
    assert!(matches!(sphere.material, Material::Phong { exponent: 40.0, .. }));
    assert_eq!(sphere.openness.len(), sphere.mesh.positions.len());
    let (low, high) = bounds(cuboid);
    assert!(
        low.abs_diff_eq(Vec3::new(-0.2, -0.1, -0.3), 1e-6)
            && high.abs_diff_eq(Vec3::new(0.2, 0.1, 0.3), 1e-6)
    );
    assert!(!scene.scene.surfaces[0].receives_shadow);
}

#[test]
fn light_from_below_is_understood() {
    use halflight::light::below::BelowHorizon;
    let below = |keys: &str| {
        let text = format!("[light]\nconstant = [1, 1, 1]\n{keys}");
        parse(Path::new("below.toml"), &text).map(|file| file.light_below)
    };
    assert_eq!(below("").unwrap(), BelowHorizon::AsGiven);
    assert_eq!(below("below = \"dark\"").unwrap(), BelowHorizon::Dark);
    let surface = |albedo_rgb| BelowHorizon::Surface { albedo_rgb };
    assert_eq!(below("below = \"surface\"").unwrap(), surface([0.5; 3]));
    let stated = below("below = \"surface\"\nsurface_albedo_rgb = [0.1, 0.2, 0.3]").unwrap();
    assert_eq!(stated, surface([0.1, 0.2, 0.3]));
    let wrong = |keys: &str| below(keys).unwrap_err().to_string();
    assert!(wrong("below = \"sand\"").contains("light.below = \"sand\": must be one of \"given\""));
    assert!(wrong("surface_albedo_rgb = [0.1, 0.2, 0.3]").contains("light.surface_albedo_rgb"));
}

#[test]
fn a_room_is_understood() {
    let room = parse(Path::new("folder/all.toml"), EVERY_KEY).unwrap().room.unwrap();
    assert_eq!(room.file, Path::new("folder/room.glb"));
    let RoomLightSource::Probe { file, layout, y_up, rotation_deg, position_world, factor_sun, rows: None } =
        &room.light
    else {
        panic!("{:?}", room.light)
    };
    assert_eq!(file, Path::new("folder/probe.hdr"));
    assert_eq!((*layout, *y_up, *rotation_deg, *factor_sun), (MapLayout::Cube, true, -90.0, false));
    assert_eq!(*position_world, Vec3::new(0.0, 0.5, 0.4));
    let how = room.settings.preparation;
    assert_eq!((room.settings.patch_m, how.power_share), (Some(0.25), 0.9));
    assert_eq!((how.neglected, how.rays_side), (0.01, 3));
    let plain = parse(Path::new("all.toml"), "[room]\nfile = \"a.glb\"").unwrap().room.unwrap();
    assert_eq!((plain.light, plain.settings), (RoomLightSource::Given, RoomSettings::default()));
}

#[test]
fn all_mistakes_of_a_room_are_told_at_once() {
    let text = "[room]\nlight = \"probe\"\npatch_m = 0\nrays = 5\npower_share = 1.5\nprob = \"a.hdr\"";
    let error = parse(Path::new("bad.toml"), text).unwrap_err().to_string();
    for words in [
        "room.file: must be given",
        "room.probe: must be given: light is \"probe\"",
        "room.probe_position: must be given",
        "room.patch_m = 0: must be a number within 0.005..=10",
        "room.rays = 5: must be the square of a whole number",
        "room.power_share = 1.5: must be a number above 0, at most 1",
        "room.prob = \"a.hdr\": must be a known key (did you mean probe?)",
    ] {
        assert!(error.contains(words), "{words}\nis not in\n{error}");
    }
    let error = parse(Path::new("bad.toml"), "[room]\nfile = \"a\"\nsun = true").unwrap_err().to_string();
    assert!(error.contains("room.sun = true: must be left out where light is not"), "{error}");
}

#[test]
fn all_mistakes_are_told_at_once() {
    let text = EVERY_KEY
        .replace("side_m = 0.1", "side_m = -1")
        .replace("rotation_deg", "rotation_degree")
        .replace("kind = \"mirror\"", "kind = \"glass\"")
        .replace("exposures_s = [0.01, 0.04]", "exposures_s = [0.01]");
    let error = parse(Path::new("bad.toml"), &text).unwrap_err().to_string();
    for words in [
        "bad.toml:35:10: tag[0].side_m = -1: must be a number within 0.001..=10",
        "light.rotation_degree = 30.0: must be a known key (did you mean rotation_deg?)",
        "object[1].material.kind = \"glass\": must be one of \"lambert\", \"phong\", \"mirror\"",
        "camera.exposures_s = [0.01]: must be",
    ] {
        assert!(error.contains(words), "{words}\nis not in\n{error}");
    }
}

/// A type that is wrong, a number out of range, an unknown key, a missing one, and text that is no TOML.
#[test]
fn mistakes_say_their_line_and_column() {
    let text = "[camera]\nlens = { width = 640, height = 480, fx = \"ü\", fy = 1.0, cx = 0, cy = 0 }\n\n\
                [[tag]]\n  id = 3\n  side_m = 20.50 # metres\n[[object]]\nshape = \"box\"\n\
                size = [ 0.1,\n  0.2 ]\nyaw_dge = 1\n[ball]\ncentre = [0, 0, 0]\n";
    let error = parse(Path::new("bad.toml"), text).unwrap_err().to_string();
    let expected = [
        "bad.toml:2:42: camera.lens.fx = \"ü\": must be a number within 0.001..=1000000, in pixels",
        "bad.toml:6:12: tag[0].side_m = 20.50: must be a number within 0.001..=10",
        "bad.toml:9:8: object[0].size = [ 0.1, 0.2 ]: must be three numbers above 0",
        "bad.toml:11:1: object[0].yaw_dge = 1: must be a known key (did you mean yaw_deg?)",
        "bad.toml:12:1: ball.radius_m: must be given: a number within 0.001..=10",
    ];
    assert_eq!(error.lines().collect::<Vec<_>>(), expected);
    let error = parse(Path::new("bad.toml"), "[ball]\nradius_m = = 3\n").unwrap_err().to_string();
    assert!(error.starts_with("bad.toml:2:12: is not valid TOML ("), "{error}");
    // A key that nothing resembles.
    let error = parse(Path::new("bad.toml"), "[room]\nfile = \"a.glb\"\nxyzzy = 1").unwrap_err().to_string();
    assert!(error.starts_with("bad.toml:3:1: room.xyzzy = 1: must be one of file, light, probe"), "{error}");
}

#[test]
fn files_that_are_missing_are_named() {
    let text = "[[object]]\nfile = \"nowhere.glb\"\n[[surface]]\nfile = \"nowhere.obj\"\n";
    let error = parse(Path::new("x.toml"), text).unwrap_err().to_string();
    assert!(error.contains("nowhere.glb") && error.contains("nowhere.obj"), "{error}");
}

#[test]
fn the_rig_needs_a_lens_from_somewhere() {
    let scene = parse(Path::new("desk.toml"), DESK).unwrap();
    assert!(scene.rig_over(None).unwrap_err().to_string().contains("camera"));
    let lens = Lens::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0);
    let device = Rig { lens, tags: Vec::new(), ball: None };
    assert_eq!(scene.rig_over(Some(device.clone())).unwrap(), device);
    let all = parse(Path::new("all.toml"), EVERY_KEY).unwrap();
    let rig = all.rig_over(Some(device)).unwrap();
    assert_eq!((rig.lens.fx, rig.tags[0].id, rig.ball.unwrap().radius_m), (650.0, 3, 0.06));
    assert_eq!(all.scene_with_ball(rig.ball.as_ref()).surfaces.len(), all.scene.surfaces.len() + 1);
}

#[test]
fn objects_of_the_desk_stand_on_it() {
    let scene = load(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/desk.toml"))).unwrap();
    assert!(scene.scene.surfaces.iter().any(|s| s.receives_shadow));
    for object in &scene.scene.objects {
        let (low, high) = bounds(object);
        assert!(low.z.abs() < 1e-6 && high.z > 0.03, "{}: {low} {high}", object.name);
    }
}

#[test]
fn a_robot_is_as_high_as_asked() {
    let Some(shared) = support::shared("a_robot_is_as_high_as_asked") else { return };
    let file = shared.join("data/models/RobotExpressive.glb");
    let text = format!(
        "[[object]]\nfile = {:?}\nheight_m = 0.25\nposition = [0.1, 0.2, 0.0]\n",
        file.display().to_string()
    );
    let scene = parse(Path::new("robot.toml"), &text).unwrap();
    let (low, high) =
        scene.scene.objects.iter().map(bounds).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap();
    assert!(low.z.abs() < 1e-5 && (high.z - 0.25).abs() < 1e-5, "{low} {high}");
    let middle = (low + high) / 2.0;
    assert!((middle.truncate() - glam::Vec2::new(0.1, 0.2)).length() < 1e-5, "{middle}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_text_is_judged(text in "\\PC{0,200}") {
        let _ = parse(Path::new("any.toml"), &text);
    }

    #[test]
    fn any_change_is_judged(at in 0..EVERY_KEY.len(), with in "[-a-z0-9\\[\\]{}=\". ]{0,3}") {
        // Without openness rays this would be quicker; a broken text mostly fails before them.
        let text = EVERY_KEY.replace("\"sphere\"", "\"cone\"");
        if text.is_char_boundary(at.min(text.len())) {
            let at = at.min(text.len());
            let mut changed = text.clone();
            changed.insert_str(at, &with);
            prop_assert!(parse(Path::new("any.toml"), &changed).is_err());
        }
    }
}
