//! Stills of scene files: the light stated, or read from a picture of the surroundings.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use glam::DVec3;
use halflight::assets::scene;
use halflight::engine::cpu::CpuEngine;
use halflight::lab::HOST;
use halflight::lab::still::{Drawn, Still, of_scene};
use halflight::model::quality::Quality;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// A folder of its own that is gone when it goes out of scope.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-still-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left in the system's temporary folder does no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const SCENE: &str = r#"
[camera]
lens = { width = 160, height = 120, fx = 160.0, fy = 160.0, cx = 80.0, cy = 60.0 }
position = [0.0, -0.6, 0.5]
look_at = [0.0, 0.0, 0.0]
[[surface]]
name = "table"
shape = "plane"
half_extent = 2.0
[[object]]
shape = "sphere"
radius_m = 0.05
position = [0.0, 0.0, 0.0]
material = { kind = "lambert", albedo_rgb = [0.5, 0.5, 0.5] }
"#;

const COLUMNS: usize = 64;
const ROWS: usize = 32;
const DIM: f32 = 0.1;
const BRIGHT: f32 = 200.0;

/// An equirectangular picture, dim but for one texel at (column, row).
fn write_map(file: &Path, column: usize, row: usize) {
    exr::prelude::write_rgb_file(file, COLUMNS, ROWS, |x, y| {
        let v = if (x, y) == (column, row) { BRIGHT } else { DIM };
        (v, 0.5 * v, 0.25 * v)
    })
    .unwrap();
}

fn still(folder: &Path, light: &str) -> (Still, Drawn) {
    let file = folder.join("scene.toml");
    std::fs::write(&file, format!("{SCENE}{light}")).unwrap();
    let file = scene::load(&file).unwrap();
    let (mut engine, quality) = (CpuEngine::new(Some(2)).unwrap(), Quality::default());
    let still = of_scene(&file, &mut engine, &quality, &HOST, &mut Vec::new()).unwrap();
    let drawn = still.draw(&mut engine, &quality, None, 0).unwrap();
    assert!(drawn.radiance.pixels().iter().flatten().all(|c| c.is_finite() && *c >= 0.0));
    (still, drawn)
}

#[test]
fn light_from_a_picture_of_the_surroundings() {
    let folder = Folder::new("map");
    // u = 0.75 is +y, row 0 straight up: the texel stands at 45 degrees over +y, and a little beside it.
    let (column, row) = (48, 8);
    write_map(&folder.0.join("room.exr"), column, row);
    let (theta, phi) =
        (PI * (row as f64 + 0.5) / ROWS as f64, 2.0 * PI * (column as f64 + 0.5) / COLUMNS as f64 - PI);
    for turn_deg in [0.0f64, 90.0] {
        let (still, drawn) = still(
            &folder.0,
            &format!("[light]\nfile = \"room.exr\"\nlayout = \"equirect\"\nrotation_deg = {turn_deg:.1}\n"),
        );
        // All that is hard, as one light: its mean direction and its sum.
        let (mut irradiance, mut moment) = ([0.0f64; 3], DVec3::ZERO);
        for light in still.light.hard.as_slice() {
            let rgb = light.irradiance_rgb.map(f64::from);
            moment += DVec3::from_array(light.to_light_world.map(f64::from)) * rgb[0];
            (0..3).for_each(|c| irradiance[c] += rgb[c]);
        }
        let phi = phi + turn_deg.to_radians();
        let want = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let got = moment.normalize();
        println!("{got} {want} {irradiance:?} {}", still.light.hard.as_slice().len());
        assert!(got.angle_between(want).to_degrees() < 0.05, "{got} instead of {want}");
        let side = |row: usize| (PI * row as f64 / ROWS as f64).cos();
        let solid_angle = (side(row) - side(row + 1)) * 2.0 * PI / COLUMNS as f64;
        for (c, tint) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            let want = f64::from(BRIGHT - DIM) * tint * solid_angle;
            let off = irradiance[c] / want - 1.0;
            assert!(off.abs() < 0.01, "channel {c}: E_d is {off:+.4} off");
        }
        // The sphere is drawn, and its shadow falls away from the light: the darkest of the table lies there.
        let changed = drawn
            .radiance
            .pixels()
            .iter()
            .zip(still.background.radiance.pixels())
            .filter(|(a, b)| (a[0] / b[0] - 1.0).abs() > 0.05)
            .count();
        assert!(changed > 300, "{changed} pixels");
        let seen = |p: DVec3| {
            let pixel = still.lens.project(still.world_from_camera.inverse().transform(p)).unwrap();
            let (x, y) = (pixel.x as usize, pixel.y as usize);
            drawn.radiance.at(x, y)[0] / still.background.radiance.at(x, y)[0]
        };
        // At 45 degrees the shadow's middle lies as far from the sphere's foot as its centre is high, 0.05 m; at 0.09 m it
        // is past the sphere's outline as the camera sees it.
        let away = -DVec3::new(want.x, want.y, 0.0).normalize() * 0.09;
        assert!(seen(away) < 0.5, "{turn_deg}: {}", seen(away));
        assert!((seen(-3.0 * away) - 1.0).abs() < 0.02, "{turn_deg}: {}", seen(-3.0 * away));
    }
}

/// Gray of the sphere's lower half over that of its upper half, in soft light alone.
fn undersides(folder: &Path, light: &str) -> f64 {
    let (still, drawn) = still(folder, light);
    let centre = DVec3::new(0.0, 0.0, 0.05);
    let camera_from_world = still.world_from_camera.inverse();
    let seen = |height: f64| {
        // The outline's left side, seen from -y: its normals look to -x and up or down.
        let at = centre + 0.049 * DVec3::new(-0.6, -0.6, height).normalize();
        let pixel = still.lens.project(camera_from_world.transform(at)).unwrap();
        f64::from(drawn.radiance.at(pixel.x as usize, pixel.y as usize)[0])
    };
    seen(-0.4) / seen(0.8)
}

#[test]
fn light_from_below_the_horizon_is_what_the_file_says() {
    let folder = Folder::new("below");
    // A uniform sky, stated and as a picture: below is everywhere as bright as above.
    exr::prelude::write_rgb_file(folder.0.join("sky.exr"), COLUMNS, ROWS, |_, _| (1.0f32, 1.0f32, 1.0f32))
        .unwrap();
    for light in ["constant = [1.0, 1.0, 1.0]", "file = \"sky.exr\""] {
        let of = |below: &str| undersides(&folder.0, &format!("[light]\n{light}\n{below}\n"));
        let (given, dark) = (of(""), of("below = \"dark\""));
        let (black, white) = (
            of("below = \"surface\"\nsurface_albedo_rgb = [0.0, 0.0, 0.0]"),
            of("below = \"surface\"\nsurface_albedo_rgb = [1.0, 1.0, 1.0]"),
        );
        println!("{light}: given {given:.3}, dark {dark:.3}, black {black:.3}, white {white:.3}");
        assert!((given - of("below = \"given\"")).abs() < 1e-6, "given is the default");
        assert!(dark < 0.8 * given, "{light}: {dark} {given}");
        assert!((black - dark).abs() < 0.01, "a black surface is dark: {black} {dark}");
        // A white one sends back what comes from above: as a second sky.
        assert!((white - given).abs() < 0.03, "{light}: {white} {given}");
    }
}

#[test]
fn a_scene_file_is_drawn_by_the_tool() {
    let folder = Folder::new("tool");
    let light =
        "[light]\nconstant = [0.3, 0.3, 0.3]\nto_light = [0.5, 0.2, 0.8]\nirradiance_rgb = [2.0, 1.9, 1.7]\n";
    let scene = folder.0.join("scene.toml");
    std::fs::write(&scene, format!("{SCENE}{light}")).unwrap();
    let render = |out: &str| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"))
            .args(["render", scene.to_str().unwrap(), "--json", "--digest", "--out"])
            .arg(folder.0.join(out))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()["digest"].clone()
    };
    let digest = render("still.png");
    assert_eq!(digest.as_str().map(str::len), Some(64));
    assert_eq!(digest, render("still.exr"));
    let picture = image::open(folder.0.join("still.png")).unwrap().into_rgb8();
    assert_eq!((picture.width(), picture.height()), (160, 120));
    // Lit, and not all of one colour.
    let values: std::collections::BTreeSet<u8> = picture.pixels().map(|p| p.0[1]).collect();
    assert!(values.len() > 30, "{}", values.len());
}
