//! Rooms from files: what glTF gives, what is wrong with a room and how that is said, reflectance from a picture, the verb.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/room_model.rs"]
mod room_model;
mod support;

use glam::{DMat3, Vec3};
use halflight::{
    assets::{
        case,
        known_room::make_ready,
        pictures,
        room::{LoadedRoom, MOST_REFLECTED, decode_room, load_room},
        scene::{RoomLightSource, RoomSource},
    },
    math::sphere,
    model::{
        image::Image,
        light::{EnvironmentMap, MapLayout},
        room::{Face, Room},
    },
    nearfield::{
        error::RoomError,
        faces::Faces,
        prepare::{CameraPicture, KnownRoom, RoomLight, RoomSettings, prepare},
        probe::Probe,
    },
};
use proptest::prelude::*;
use room_model::{Part, glb, material, room};
use std::path::{Path, PathBuf};
use support::wanted;

fn decode(parts: &[Part]) -> Result<LoadedRoom, String> {
    decode_room(Path::new("room.glb"), &glb(parts, "", "")).map_err(|e| e.to_string())
}

/// A folder of this test's own, empty.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn a_model_becomes_a_room() {
    let LoadedRoom { room, soundness, notes } = decode(&room()).unwrap();
    let [walls, lamp] = &room.surfaces[..] else { panic!("{room:?}") };
    assert_eq!((&*walls.name, &*lamp.name), ("walls", "lamp"));
    // Twelve triangles are six quadrilaterals.
    assert!(walls.faces.len() == 6 && walls.faces.iter().all(|f| matches!(f, Face::Quad(_))), "{walls:?}");
    assert_eq!((walls.corners_world.len(), lamp.faces.len()), (8, 1));
    assert_eq!((walls.reflectance_rgb, walls.emitted_rgb), ([0.5; 3], [0.0; 3]));
    assert_eq!((lamp.reflectance_rgb, lamp.emitted_rgb), ([0.0; 3], [20.0; 3]));
    let (low, high) = walls
        .corners_world
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    assert_eq!((low, high), (Vec3::new(-2.0, -1.5, -0.75), Vec3::new(2.0, 1.5, 1.75)));
    // The rim of the lamp alone is open.
    assert_eq!((soundness.faces, soundness.open_edges, soundness.outward_share), (7, 4, 0.0));
    assert_eq!(notes.len(), 1);
    assert!(notes[0].starts_with("4 edges (2.00 m) belong to one face only"), "{notes:?}");
}

#[test]
fn nodes_place_and_turn_over_and_names_stay_apart() {
    let two = |name| Part { name, ..room().remove(1) };
    // Mirrored: the lamp still looks down.
    let bytes = glb(&[two("lamp"), two("lamp")], r#","scale":[-2,1,1],"translation":[0,-1,0]"#, "");
    let loaded = decode_room(Path::new("a.glb"), &bytes).unwrap();
    let names: Vec<&str> = loaded.room.surfaces.iter().map(|s| &*s.name).collect();
    assert_eq!(names, ["lamp", "lamp 2"]);
    let surface = &loaded.room.surfaces[0];
    let Face::Quad(quad) = surface.faces[0] else { panic!() };
    let [a, b, c, _] = quad.map(|i| surface.corners_world[i as usize]);
    assert!((b - a).cross(c - a).z < 0.0);
    assert!(surface.corners_world.iter().all(|p| (p.z - 0.74).abs() < 1e-6 && p.x <= 0.0), "{surface:?}");
}

#[test]
fn reflectance_is_the_mean_of_the_texture_and_bounded() {
    let folder = folder("room_texture");
    pictures::save_png(
        &folder.join("half.png"),
        &Image::from_pixels(2, 1, vec![[0u8, 0, 0], [255, 255, 0]]).unwrap(),
    )
    .unwrap();
    let mut parts = room();
    parts[0].material =
        r#"{"pbrMetallicRoughness":{"baseColorFactor":[0.8,1,1,1],"baseColorTexture":{"index":0}}}"#.into();
    parts[1].material = material(1.0, 0.0);
    let rest = r#","textures":[{"source":0}],"images":[{"uri":"half.png"}]"#;
    let file = folder.join("room.glb");
    std::fs::write(&file, glb(&parts, "", rest)).unwrap();
    let room = load_room(&file).unwrap().room;
    let got = room.surfaces[0].reflectance_rgb;
    for (got, want) in got.into_iter().zip([0.4, 0.5, 0.0]) {
        assert!((got - want).abs() < 1e-6, "{got} for {want}");
    }
    assert_eq!(room.surfaces[1].reflectance_rgb, [MOST_REFLECTED; 3]);
}

#[test]
fn open_edges_flipped_faces_and_faces_without_area_are_told() {
    let mut open = room();
    open[0].triangles.truncate(10);
    let loaded = decode(&open).unwrap();
    assert_eq!(loaded.soundness.open_edges, 8);

    let mut flipped = room();
    flipped[0].triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let loaded = decode(&flipped).unwrap();
    assert!(loaded.soundness.outward_share > 0.98, "{:?}", loaded.soundness);
    assert!(
        loaded.notes.iter().any(|n| n.contains("looks outwards") && n.contains("walls")),
        "{:?}",
        loaded.notes
    );
    // Nothing receives light then, and that is an error of the room, or all of it is unlit.
    let known = prepared(loaded.room, RoomLight::Given).unwrap();
    let report = known.field.report();
    assert_eq!(report.unlit_receivers, report.receivers);

    let mut thin = room();
    thin[0].triangles.extend([[0, 0, 1], [0, 1, 1]]);
    let loaded = decode(&thin).unwrap();
    assert_eq!((loaded.soundness.without_area, loaded.room.surfaces[0].faces.len()), (2, 6));
    assert!(loaded.notes.iter().any(|n| n.starts_with("2 faces without area are left out")));
}

#[test]
fn nothing_and_what_is_not_finite_are_errors() {
    let mut nothing = room();
    nothing.iter_mut().for_each(|p| p.triangles = vec![[0, 0, 1]]);
    let error = decode(&nothing).unwrap_err();
    assert!(error.contains("room.glb: faces that have an area = 0: must be at least 1"), "{error}");
    let mut broken = room();
    broken[1].corners[2][0] = f32::NAN;
    let error = decode(&broken).unwrap_err();
    assert!(error.contains("room.glb: nodes[1] \"lamp\"") && error.contains("finite"), "{error}");
    let mut glaring = room();
    glaring[1].material = material(0.0, 1e9);
    let error = decode(&glaring).unwrap_err();
    assert!(error.contains("nodes[1]") && error.contains("within 0 to 1000000"), "{error}");
    assert!(load_room(Path::new("/no/such/room.glb")).unwrap_err().to_string().contains("/no/such/room.glb"));
}

fn prepared(room: Room, light: RoomLight<'_>) -> Result<KnownRoom, RoomError> {
    let settings = RoomSettings { patch_m: Some(0.4), ..RoomSettings::default() };
    prepare(room, &settings, light, None, &|_| ())
}

fn probe(map: &EnvironmentMap, position_world: Vec3) -> RoomLight<'_> {
    RoomLight::Probe(Probe { map, world_from_map: DMat3::IDENTITY, position_world, factor_sun: true })
}

#[test]
fn a_room_without_light_is_an_error() {
    let mut dark = room();
    dark[1].material = material(0.5, 0.0);
    let room = decode(&dark).unwrap().room;
    let error = prepared(room.clone(), RoomLight::Given).err().unwrap().to_string();
    assert!(error.contains("has a radiance above zero"), "{error}");
    let black = EnvironmentMap { layout: MapLayout::Equirect, radiance: Image::filled(64, 32, [0.0; 3]) };
    let error = prepared(room.clone(), probe(&black, Vec3::ZERO)).err().unwrap().to_string();
    assert!(error.contains("has a radiance above zero"), "{error}");
    // Damaged texels are no light.
    let broken =
        EnvironmentMap { layout: MapLayout::Equirect, radiance: Image::filled(64, 32, [f32::NAN; 3]) };
    assert!(prepared(room.clone(), probe(&broken, Vec3::ZERO)).is_err());
    let grey = EnvironmentMap { layout: MapLayout::Equirect, radiance: Image::filled(64, 32, [1.0; 3]) };
    let known = prepared(room, probe(&grey, Vec3::ZERO)).unwrap();
    let seen = known.field.patches.patches.iter().filter(|p| p.seen);
    assert!(seen.clone().count() > 300 && seen.clone().all(|p| (p.radiance_rgb[0] - 1.0).abs() < 1e-5));
}

#[test]
fn a_probe_in_a_wall_is_an_error_that_names_the_file() {
    let folder = folder("room_probe");
    let (room_file, probe_file) = (folder.join("room.glb"), folder.join("grey.png"));
    std::fs::write(&room_file, glb(&room(), "", "")).unwrap();
    pictures::save_png(&probe_file, &Image::filled(32, 16, [128u8; 3])).unwrap();
    let ready = |z: f32, layout: MapLayout| {
        let light = RoomLightSource::Probe {
            file: probe_file.clone(),
            layout,
            y_up: false,
            rotation_deg: 0.0,
            position_world: Vec3::new(0.0, 0.0, z),
            factor_sun: true,
            rows: None,
        };
        let source = RoomSource { file: room_file.clone(), light, settings: RoomSettings::default() };
        make_ready(&source, None, &|_| ()).map(|r| r.known.report.probe.unwrap()).map_err(|e| e.to_string())
    };
    let report = ready(0.3, MapLayout::Equirect).unwrap();
    // But for what the lamp hides of the ceiling everything was seen; patches are many and small there.
    assert!(report.fronts > 0.999, "{report:?}");
    wanted::hold("room_input.filled", report.filled_patches as f64 / report.seen_patches as f64);
    let error = ready(-0.8, MapLayout::Equirect).unwrap_err();
    assert!(error.contains("room.glb") && error.contains("must be inside of the room"), "{error}");
    let error = ready(0.3, MapLayout::Cube).unwrap_err();
    assert!(error.contains("grey.png") && error.contains("32 x 16 pixels as Cube"), "{error}");
}

/// The room with a window a hand's width before one wall; from the origin the probe sees walls of 1, the window of 5, and in it a
/// sun of 1e4, 2.4 degrees wide.
fn sunny() -> (Room, EnvironmentMap, Vec3) {
    let mut parts = room();
    let window = [[-0.8, 0.2], [0.8, 0.2], [0.8, 1.5], [-0.8, 1.5]].map(|[y, z]| [-1.95, y, z]);
    parts[1] = Part {
        name: "window",
        corners: window.to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material: material(0.0, 0.0),
    };
    let room = decode(&parts).unwrap().room;
    let towards = Vec3::new(-1.8, 0.1, 0.8).normalize();
    let faces = Faces::of_room(&room);
    let mut picture = Image::filled(720, 360, [0.0f32; 3]);
    for y in 0..360 {
        for x in 0..720 {
            let (u, v) = ((x as f64 + 0.5) / 720.0, (y as f64 + 0.5) / 360.0);
            let d = sphere::equirect_direction(u, v).as_vec3();
            let surface = faces.first(Vec3::ZERO, d).unwrap().index;
            let in_sun = d.angle_between(towards) < 1.2f32.to_radians();
            *picture.at_mut(x, y) = if in_sun { [1e4; 3] } else { [[1.0; 3], [5.0; 3]][surface as usize] };
        }
    }
    (room, EnvironmentMap { layout: MapLayout::Equirect, radiance: picture }, towards)
}

#[test]
fn the_sun_behind_a_window_shines_in() {
    let (room, map, towards) = sunny();
    let split = prepared(room.clone(), probe(&map, Vec3::ZERO)).unwrap();
    let [sun] = &split.suns[..] else { panic!("{:?}", split.suns) };
    assert_eq!((&sun.apertures[..], &*split.room.surfaces[1].name), (&[1][..], "window"));
    assert!(towards.angle_between(Vec3::from(sun.to_light_world)) < 2e-3);
    // 1e4 over a disc of 1.2 degrees less the window's own light; 5 % for whole texels at its rim.
    let want = (1e4 - 5.0) * std::f32::consts::TAU * (1.0 - 1.2f32.to_radians().cos());
    assert!((sun.irradiance_rgb[0] / want - 1.0).abs() < 0.05, "{} of {want}", sun.irradiance_rgb[0]);
    let windows = |known: &KnownRoom| {
        let own = known.field.patches.patches.iter().filter(|p| p.surface == 1);
        own.map(|p| p.radiance_rgb[0]).fold((f32::INFINITY, 0.0f32), |(l, h), r| (l.min(r), h.max(r)))
    };
    let (least, most) = windows(&split);
    assert!(least > 4.0 && most < 5.01, "{least} to {most}");
    // Corners in the sun get all of it, the others nothing.
    let mut lit = 0;
    for (vertex, got) in split.field.patches.vertices.iter().zip(&split.sun_rgb) {
        let cosine = vertex.normal_world.dot(Vec3::from(sun.to_light_world));
        let all = sun.irradiance_rgb[0] * cosine / std::f32::consts::PI;
        assert!(got[0] == 0.0 || (got[0] / all - 1.0).abs() < 1e-5);
        lit += usize::from(got[0] > 0.0);
    }
    assert!(lit > 10 && lit < split.sun_rgb.len() / 4, "{lit} of {}", split.sun_rgb.len());
    // All light of before is there; as part of the window it would have shone everywhere.
    let RoomLight::Probe(split_probe) = probe(&map, Vec3::ZERO) else { panic!() };
    let whole = prepared(room, RoomLight::Probe(Probe { factor_sun: false, ..split_probe })).unwrap();
    assert!(whole.suns.is_empty() && windows(&whole).1 > 100.0);
    let (before, after) = (whole.report.probe.unwrap(), split.report.probe.unwrap());
    for c in 0..3 {
        let sum = after.patch_flux_rgb[c] + f64::from(sun.irradiance_rgb[c]);
        assert!((sum / before.patch_flux_rgb[c] - 1.0).abs() < 1e-5, "{c}: {sum}");
    }
}

/// Measured: differences of measured albedos from the case's, over these: 0.0094 in the mean and 0.096 at worst, 0.0123 and
/// 0.204. A tenth more, for neither noise nor platform plays a part. The worst ones are patches that a shadow's edge crosses
/// between corners of like light.
const F3: [(&str, f32, f32); 2] =
    [("f3_ceiling_light", 0.0104, 0.106), ("f3_window_ceiling_patch", 0.0136, 0.225)];

#[test]
fn albedos_of_a_rendered_room_are_read_off_its_picture() {
    let Some(shared) = support::shared("albedos_of_a_rendered_room") else { return };
    for (id, most_mean, most) in F3 {
        let case = case::load(&shared.join("reference").join(id)).unwrap();
        let truth = case.room();
        let picture = pictures::load_radiance(&case.image("noobj").unwrap().file).unwrap().hdr.radiance;
        let camera =
            CameraPicture { radiance: &picture, lens: case.lens, world_from_camera: case.world_from_camera };
        // What the file says of reflectance is not looked at, but for lamps.
        let mut room = truth.clone();
        room.surfaces
            .iter_mut()
            .filter(|s| s.reflectance_rgb != [0.0; 3])
            .for_each(|s| s.reflectance_rgb = [0.33; 3]);
        let mut settings = RoomSettings::default();
        settings.preparation.power_share = 1.0;
        let known = prepare(room, &settings, RoomLight::Given, Some(&camera), &|_| ()).unwrap();
        let report = known.report.reflectance.unwrap();
        let patches = &known.field.patches.patches;
        let (mut sum, mut worst, mut area) = (0.0f32, 0.0f32, 0.0f32);
        for (patch, measured) in patches.iter().zip(&known.reflectance_measured) {
            let want = truth.surfaces[patch.surface as usize].reflectance_rgb;
            for c in (0..3).filter(|_| *measured) {
                let off = (patch.reflectance_rgb[c] / want[c] - 1.0).abs();
                sum += off * patch.area_m2;
                area += patch.area_m2;
                worst = worst.max(off);
            }
            assert!(*measured || patch.reflectance_rgb != [0.33; 3] || report.as_given > 0);
        }
        let mean = sum / area;
        println!(
            "{id}: {report:?}; off by {:.2} % in the mean, {:.1} % at worst",
            100.0 * mean,
            100.0 * worst
        );
        assert!(report.measured > 100, "{report:?}");
        assert!(mean <= most_mean && worst <= most, "{id}: {mean} {worst}");
    }
}

#[test]
fn the_verb_writes_pictures_and_a_report() {
    let folder = folder("room_verb");
    let (room_file, out) = (folder.join("room.glb"), folder.join("out"));
    std::fs::write(&room_file, glb(&room(), "", "")).unwrap();
    let verb = |more: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"));
        command.args(["room", room_file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rows", "64"]);
        command.env("XDG_CACHE_HOME", folder.join("cache"));
        command.args(more).output().unwrap()
    };
    let run = verb(&["--json", "--digest"]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let report: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert!(report["patches"].as_u64().unwrap() <= 1500 && report["sources"].as_u64().unwrap() > 0);
    assert_eq!(report["open_edges"], 4);
    for name in ["radiance", "gathered", "reflectance", "known"] {
        let picture = pictures::load_rgb8(&out.join(format!("{name}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (128, 64));
        assert!(picture.pixels().iter().any(|p| p[1] > 60), "{name}");
    }
    assert!(out.join("room.json").is_file());
    // Kept: the same pictures again, with the cache, without it, and where it is damaged.
    let digest = run.stderr;
    let again = |more: &[&str]| {
        let run = verb(&[&["--json", "--digest"], more].concat());
        let report: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
        (report["from_cache"].as_bool().unwrap(), run.stderr)
    };
    assert_eq!(report["from_cache"], false);
    assert_eq!(again(&[]), (true, digest.clone()));
    assert_eq!(again(&["--fresh"]), (false, digest.clone()));
    let kept = std::fs::read_dir(folder.join("cache/halflight/transfers")).unwrap().next().unwrap();
    std::fs::write(kept.unwrap().path(), [0; 99]).unwrap();
    let (from_cache, told) = again(&[]);
    let told = String::from_utf8(told).unwrap();
    assert!(!from_cache && told.contains("made anew"), "{told}");
    assert!(told.ends_with(std::str::from_utf8(&digest).unwrap()), "{told}");
    assert_eq!(again(&[]), (true, digest));
    for (more, words) in [
        (&["--rows", "5"][..], "unexpected"),
        (&["--rays", "5"], "--rays: must be 1, 4, 9"),
        (&["--from", "1,2"], "--from: must be three numbers"),
        (&["--patch", "-1"], "room.patch_m = -1"),
    ] {
        let run = verb(more);
        let text = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.code() == Some(2), "{more:?}: {text}");
        assert!(words == "unexpected" || text.contains(words), "{more:?}: {text}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_rooms_give_an_error_or_a_sound_room(
        keep in 0.0f64..1.3,
        flips in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), b'0'..=b'9']), 0..4),
    ) {
        let mut bytes = glb(&room(), "", "");
        let length = ((bytes.len() as f64 * keep) as usize).min(bytes.len());
        bytes.truncate(length);
        for (index, byte) in flips {
            if !bytes.is_empty() {
                let at = index.index(bytes.len());
                bytes[at] = byte;
            }
        }
        if let Ok(loaded) = decode_room(Path::new("any.glb"), &bytes) {
            for surface in &loaded.room.surfaces {
                let n = surface.corners_world.len() as u32;
                prop_assert!(surface.corners_world.iter().all(|p| p.is_finite()));
                prop_assert!(surface.faces.iter().flat_map(|f| f.corners()).all(|&i| i < n));
                prop_assert!(surface.reflectance_rgb.iter().all(|c| (0.0..=MOST_REFLECTED).contains(c)));
                prop_assert!(surface.emitted_rgb.iter().all(|c| c.is_finite() && *c >= 0.0));
            }
            prop_assert!(loaded.soundness.faces > 0);
        }
    }

    #[test]
    fn any_bytes_are_judged(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = decode_room(Path::new("any.glb"), &bytes);
    }
}
