//! What is wrong with a known room, or odd about what stands in it, through a scene file and `halflight render`: a clear error,
//! or a picture that is sound.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/room_model.rs"]
mod room_model;

use halflight::{
    assets::pictures,
    model::image::{Image, Rgb8Image},
};
use room_model::{Part, glb, material, room};
use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
    process::Command,
};

/// A folder of this test's own, empty.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A picture of plain grey, taken from (1, -1, 0.6) towards the room's middle; the floor is at -0.75, the lamp, 0.5 m a side,
/// under the ceiling at 1.74.
const CAMERA: &str = r#"
[camera]
lens = { width = 96, height = 72, fx = 70.0, fy = 70.0, cx = 48.0, cy = 36.0 }
position = [1.0, -1.0, 0.6]
look_at = [0.0, 0.0, -0.4]
pictures = ["grey.png"]
exposures_s = [1.0]
[room]
file = "room.glb"
patch_m = 0.4
"#;
const GREY: u8 = 160;

fn ball(name: &str, radius_m: f32, at: [f32; 3]) -> String {
    let [x, y, z] = at;
    format!(
        "[[object]]\nname = \"{name}\"\nshape = \"sphere\"\nradius_m = {radius_m:?}\nposition = [{x:?}, {y:?}, {z:?}]\n\
         material = {{ kind = \"lambert\", albedo_rgb = [0.5, 0.5, 0.5] }}\n"
    )
}

fn cube(name: &str, [x, y, z]: [f32; 3]) -> String {
    format!(
        "[[object]]\nname = \"{name}\"\nshape = \"box\"\nsize = [0.1, 0.1, 0.1]\nposition = [{x:?}, {y:?}, {z:?}]\n\
         material = {{ kind = \"lambert\", albedo_rgb = [0.5, 0.5, 0.5] }}\n"
    )
}

/// Runs `halflight render`; the picture where it succeeds, and what it says.
fn render(folder: &Path, parts: &[Part], light: &str, objects: &str) -> Result<(Rgb8Image, String), String> {
    std::fs::write(folder.join("room.glb"), glb(parts, "", "")).unwrap();
    std::fs::write(folder.join("scene.toml"), format!("{CAMERA}{light}\n{objects}")).unwrap();
    pictures::save_png(&folder.join("grey.png"), &Image::filled(96, 72, [GREY; 3])).unwrap();
    let out = folder.join("out.png");
    let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
    command.env("XDG_CACHE_HOME", folder.join("cache")).env_remove("RUST_LOG");
    command.arg("render").arg(folder.join("scene.toml")).arg("--out").arg(&out);
    let output = command.output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(!told.contains("panicked"), "{told}");
    if output.status.success() { Ok((pictures::load_rgb8(&out).unwrap(), told)) } else { Err(told) }
}

/// How many pixels are darker than the grey by more than rounding, and the mean of all.
fn darker(picture: &Rgb8Image) -> (usize, f64) {
    let all = picture.pixels();
    assert_eq!((picture.width(), picture.height()), (96, 72));
    let mean = all.iter().map(|p| f64::from(p[1])).sum::<f64>() / all.len() as f64;
    (all.iter().filter(|p| p[1] + 1 < GREY).count(), mean)
}

/// Under the lamp.
fn one_ball() -> String {
    ball("ball", 0.15, [0.1, 0.1, -0.5])
}

#[test]
fn a_sound_room_and_one_with_faces_without_area_are_drawn_alike() {
    let folder = folder("room_scene_sound");
    let (sound, _) = render(&folder, &room(), "", &one_ball()).unwrap();
    let (count, mean) = darker(&sound);
    println!("{count} pixels, mean {mean}");
    assert!(count > 200 && count < 2500 && mean > 100.0, "{count} {mean}");
    let mut thin = room();
    thin[0].triangles.extend([[0, 0, 1], [0, 1, 1]]);
    let (with_thin, told) = render(&folder, &thin, "", &one_ball()).unwrap();
    assert!(told.contains("2 faces without area are left out"), "{told}");
    assert_eq!(with_thin, sound);
}

#[test]
fn open_edges_are_told_and_drawn() {
    let folder = folder("room_scene_open");
    let mut open = room();
    // Without one wall; its light was never there.
    open[0].triangles.truncate(10);
    let (picture, told) = render(&folder, &open, "", &one_ball()).unwrap();
    assert!(told.contains("belong to one face only"), "{told}");
    let (count, mean) = darker(&picture);
    println!("{count} pixels, mean {mean}");
    assert!(count > 200 && mean > 100.0, "{count} {mean}");
}

#[test]
fn faces_that_look_outwards_are_told_and_take_no_shadow() {
    let folder = folder("room_scene_flipped");
    let mut flipped = room();
    flipped[0].triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let (picture, told) = render(&folder, &flipped, "", &one_ball()).unwrap();
    assert!(told.contains("looks outwards") && told.contains("walls"), "{told}");
    // The object is there, and nothing of the place is taken.
    let (upright, _) = render(&folder, &room(), "", &one_ball()).unwrap();
    let (flipped, upright) = (darker(&picture).0, darker(&upright).0);
    println!("{flipped} for {upright} pixels");
    assert!(flipped < upright, "{flipped} for {upright}");
}

#[test]
fn a_probe_in_a_wall_is_an_error() {
    let folder = folder("room_scene_probe");
    pictures::save_png(&folder.join("probe.png"), &Image::filled(32, 16, [128u8; 3])).unwrap();
    let probe = |z: f32| {
        format!(
            "light = \"probe\"\nprobe = \"probe.png\"\nlayout = \"equirect\"\nprobe_position = [0.0, 0.0, {z:?}]"
        )
    };
    let (picture, _) = render(&folder, &room(), &probe(0.3), &one_ball()).unwrap();
    assert!(darker(&picture).0 > 100);
    for outside in [-0.8, 5.0] {
        let told = render(&folder, &room(), &probe(outside), &one_ball()).unwrap_err();
        assert!(told.contains("room.glb") && told.contains("must be inside of the room"), "{told}");
    }
}

#[test]
fn a_room_without_light_or_geometry_is_an_error() {
    let folder = folder("room_scene_dark");
    let mut dark = room();
    dark[1].material = material(0.5, 0.0);
    let told = render(&folder, &dark, "", &one_ball()).unwrap_err();
    assert!(told.contains("room.glb") && told.contains("has a radiance above zero"), "{told}");
    let mut nothing = room();
    nothing.iter_mut().for_each(|p| p.triangles = vec![[0, 0, 1]]);
    let told = render(&folder, &nothing, "", &one_ball()).unwrap_err();
    assert!(told.contains("room.glb: faces that have an area = 0: must be at least 1"), "{told}");
}

#[test]
fn an_object_around_the_lamp_takes_all_of_its_light() {
    let folder = folder("room_scene_lamp");
    let around = ball("shade", 0.5, [0.25, 0.25, 1.2]);
    let (picture, _) = render(&folder, &room(), "power_share = 1.0", &around).unwrap();
    let (count, mean) = darker(&picture);
    println!("{count} pixels, mean {mean}");
    // The lamp is the only light that is known of.
    assert!(count > 96 * 72 * 9 / 10 && mean < 0.2 * f64::from(GREY), "{count} {mean}");
}

#[test]
fn an_object_around_the_camera_is_drawn_from_within() {
    let folder = folder("room_scene_camera");
    let around = ball("shell", 0.3, [1.0, -1.0, 0.3]);
    let (picture, _) = render(&folder, &room(), "", &around).unwrap();
    // Nothing but its inner side, which no light reaches but what the grid of the room's light lets through.
    assert_eq!(darker(&picture).0, 96 * 72);
    // What stands outside is hidden by it, but throws its own shadow on the shell's light: nearly nothing.
    let with_other = format!("{around}{}", one_ball());
    let (both, _) = render(&folder, &room(), "", &with_other).unwrap();
    let apart = picture.pixels().iter().zip(both.pixels()).map(|(a, b)| a[1].abs_diff(b[1])).max().unwrap();
    println!("{:?}, {apart} apart", darker(&picture));
    assert!(apart <= 4, "{apart}");
}

#[test]
fn a_hundred_objects_are_drawn() {
    let folder = folder("room_scene_hundred");
    let mut objects = String::new();
    for i in 0..100 {
        let at = [-0.9 + 0.2 * (i % 10) as f32, -0.9 + 0.2 * (i / 10) as f32, -0.74];
        write!(objects, "{}", cube(&format!("cube {i}"), at)).unwrap();
    }
    let (picture, _) = render(&folder, &room(), "", &objects).unwrap();
    let one = render(&folder, &room(), "", &cube("cube", [-0.1, 0.1, -0.74])).unwrap().0;
    let (many, one) = (darker(&picture).0, darker(&one).0);
    println!("{many} for {one} pixels");
    assert!(one > 5 && many > 20 * one, "{many} for {one}");
}
