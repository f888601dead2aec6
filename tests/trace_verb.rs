//! `halflight trace`: the camera, the light and the things of `halflight render`, and the verb as a program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::assets::{case, pictures, scene};
use halflight::engine::cpu::CpuEngine;
use halflight::lab::HOST;
use halflight::lab::still::{
    of_scene,
    traced::{LightOf, of_still},
};
use halflight::math::color::gray;
use halflight::model::{image::RadianceImage, quality::Quality};
use halflight::reference::{TraceSettings, Traced, trace};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder of its own that is gone when it goes out of scope.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-trace-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
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
lens = { width = 96, height = 72, fx = 96.0, fy = 96.0, cx = 47.0, cy = 37.0, distortion = [-0.1, 0.02, 0.001, 0.0, 0.0] }
position = [0.02, -0.6, 0.5]
look_at = [0.0, 0.0, 0.02]
[[surface]]
shape = "plane"
half_extent = 3.0
[[object]]
shape = "sphere"
radius_m = 0.08
position = [0.0, 0.0, 0.0]
material = { kind = "lambert", albedo_rgb = [0.6, 0.5, 0.4] }
"#;

/// What the product draws of a scene, and what is traced of it.
fn both(folder: &Folder, light: &str, how: &TraceSettings) -> (RadianceImage, Traced) {
    let file = scene::parse(&folder.file("scene.toml"), &format!("{SCENE}{light}")).unwrap();
    let quality = Quality { shadow_maps: 32, ..Quality::default() };
    let mut engine = CpuEngine::new(None).unwrap();
    let still = of_scene(&file, &mut engine, &quality, &HOST, &mut Vec::new()).unwrap();
    let drawn = still.draw(&mut engine, &quality, Some(1.0), 0).unwrap();
    let scene = of_still(LightOf::File(&file), &still, &quality).unwrap();
    (drawn.radiance, trace(&scene, how, &|_| ()).unwrap())
}

fn settings(samples: u32) -> TraceSettings {
    TraceSettings { samples, samples_a_pass: 32, ..TraceSettings::default() }
}

#[test]
fn stated_light_gives_the_same_picture() {
    let folder = Folder::new("stated");
    let light =
        "[light]\nconstant = [0.3, 0.4, 0.5]\nto_light = [0.5, 0.2, 0.8]\nirradiance_rgb = [3.0, 2.8, 2.4]\n";
    let (drawn, traced) = both(&folder, light, &settings(64));
    let (with, ratio, coverage) = (traced.with(), traced.ratio(), traced.coverage());
    let (mut open, mut object, mut lit) = (0.0f64, [0.0f64; 2], 0);
    for i in 0..with.pixels().len() {
        let (a, b) = (gray(drawn.pixels()[i].map(f64::from)), gray(with.pixels()[i].map(f64::from)));
        let cover = coverage.pixels()[i];
        if cover == 1.0 {
            object[0] += (a - b) * (a - b);
            object[1] += b * b;
        } else if cover == 0.0 && gray(ratio.pixels()[i]) > 0.995 {
            // Nothing there but the surface: spheres of the product take up to 0.5 % more or less of its soft light.
            open = open.max((a / b - 1.0).abs());
            lit += 1;
        }
    }
    assert!(lit > 2000 && open < 0.02, "{lit} open pixels, {open}");
    // The object's own shading, the half that the surface lights too: measured 0.03.
    let object = (object[0] / object[1]).sqrt();
    assert!(object < 0.06, "{object}");
}

/// Middle of the shadow, by what is missing of the surface's light, where the object is not.
fn shadow_middle(picture: &RadianceImage, without: &RadianceImage, coverage: &[f32]) -> [f64; 2] {
    let mut sums = [0.0f64; 3];
    for (i, cover) in coverage.iter().enumerate() {
        let lost = 1.0 - gray(picture.pixels()[i].map(f64::from)) / gray(without.pixels()[i].map(f64::from));
        if *cover == 0.0 && lost > 0.2 {
            let (x, y) = ((i % picture.width()) as f64, (i / picture.width()) as f64);
            sums = [sums[0] + lost * x, sums[1] + lost * y, sums[2] + lost];
        }
    }
    assert!(sums[2] > 5.0, "no shadow");
    [sums[0] / sums[2], sums[1] / sums[2]]
}

#[test]
fn shadows_fall_where_the_product_has_them() {
    let folder = Folder::new("picture");
    let (columns, rows) = (64, 32);
    for (layout, up, column, row) in
        [("equirect", "z", 50, 9), ("equirect", "y", 20, 9), ("angular", "z", 40, 20)]
    {
        let size = if layout == "angular" { (64, 64) } else { (columns, rows) };
        let texels = (0..size.0 * size.1).map(|i| {
            let near = (i % size.0) / 2 == column / 2 && (i / size.0) / 2 == row / 2;
            if near { [60.0, 60.0, 50.0] } else { [0.3f32; 3] }
        });
        let map = RadianceImage::from_pixels(size.0, size.1, texels.collect()).unwrap();
        pictures::save_exr_f32(&folder.file("sky.exr"), &map).unwrap();
        let light = format!(
            "[light]\nfile = \"sky.exr\"\nlayout = \"{layout}\"\nup = \"{up}\"\nrotation_deg = 25.0\n"
        );
        let (drawn, traced) = both(&folder, &light, &settings(256));
        let without = traced.without();
        let coverage = traced.coverage();
        let truth = shadow_middle(&traced.with(), &without, coverage.pixels());
        let product = shadow_middle(&drawn, &without, coverage.pixels());
        let apart = (truth[0] - product[0]).hypot(truth[1] - product[1]);
        // Measured up to 1.9: hard maps stand for a light of 6 degrees. A map turned or mirrored moves it by tens.
        assert!(apart < 3.0, "{layout} {up}: {truth:?} and {product:?}");
    }
}

#[test]
fn a_room_named_in_a_scene_is_the_room_of_the_case() {
    let Some(shared) = support::shared("a_room_named_in_a_scene_is_the_room_of_the_case") else { return };
    let folder = shared.join("reference/f3_ceiling_light");
    let case = case::load(&folder).unwrap();
    let (lens, pose) = (case.lens, case.world_from_camera.to_rows());
    let text = format!(
        "[camera]\nlens = {{ width = {}, height = {}, fx = {:?}, fy = {:?}, cx = {:?}, cy = {:?} }}\nworld_from_camera = {pose:?}\n[room]\nfile = {:?}\npatch_m = 0.5\n",
        lens.width,
        lens.height,
        lens.fx,
        lens.fy,
        lens.cx,
        lens.cy,
        folder.display().to_string()
    );
    let file = scene::parse(Path::new("scene.toml"), &text).unwrap();
    let quality = Quality::default();
    let mut engine = CpuEngine::new(None).unwrap();
    let still = of_scene(&file, &mut engine, &quality, &HOST, &mut Vec::new()).unwrap();
    let how = TraceSettings { step_px: 8, ..settings(128) };
    let from_scene =
        trace(&of_still(LightOf::File(&file), &still, &quality).unwrap(), &how, &|_| ()).unwrap().without();
    let from_case = trace(&case.trace_scene(Some("noobj")).unwrap(), &how, &|_| ()).unwrap().without();
    // The same numbers meet the same bodies; the case's have their faces cut along the other diagonal in places.
    let (mut squares, mut sum) = (0.0f64, 0.0);
    for (a, b) in from_scene.pixels().as_flattened().iter().zip(from_case.pixels().as_flattened()) {
        squares += f64::from(a - b).powi(2);
        sum += f64::from(*b);
    }
    let count = from_case.pixels().len() as f64 * 3.0;
    let relative = (squares / count).sqrt() / (sum / count);
    assert!(relative < 0.05, "{relative}");
}

fn run(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_halflight")).arg("trace").args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn a_cut_trace_goes_on_and_a_foreign_one_is_refused() {
    let folder = Folder::new("resume");
    let file = folder.file("scene.toml");
    let light =
        "[light]\nconstant = [0.3, 0.4, 0.5]\nto_light = [0.5, 0.2, 0.8]\nirradiance_rgb = [3.0, 2.8, 2.4]\n";
    std::fs::write(&file, format!("{SCENE}{light}")).unwrap();
    let file = file.display().to_string();
    let out = |name: &str| folder.file(name).display().to_string();
    let digest = |arguments: &[&str]| {
        let common = [&file, "--samples-a-pass", "8", "--step-px", "2", "--json", "--digest"];
        let (status, told, errors) = run(&[&common[..], arguments].concat());
        assert_eq!(status, 0, "{errors}");
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        (told["digest"].as_str().unwrap().to_owned(), told["noise"]["samples_a_pixel"].as_u64().unwrap())
    };
    let whole = digest(&["--out", &out("whole"), "--samples", "24", "--threads", "2"]);
    assert_eq!(whole.1, 24);
    let first = digest(&["--out", &out("cut"), "--samples", "8", "--threads", "1"]);
    assert_ne!(first.0, whole.0);
    assert_eq!(digest(&["--out", &out("cut"), "--samples", "24", "--resume"]), whole);
    for name in ["with.exr", "without.exr", "ratio.exr", "difference.exr", "ratio_error.exr", "with.png"] {
        assert!(folder.file("cut").join(name).is_file(), "no {name}");
    }
    let with = pictures::load_raw(&folder.file("cut/with.exr")).unwrap();
    assert_eq!((with.width(), with.height()), (48, 36));
    // Another scene or setting, and a file that was cut.
    let refused = |arguments: &[&str], words: &str| {
        let (status, _, errors) = run(arguments);
        assert!(status == 2 && errors.contains(words), "{status} {errors}");
    };
    let cut = out("cut");
    let again = [&file, "--out", &cut, "--samples-a-pass", "8", "--step-px", "2", "--resume"];
    refused(&[&again[..], &["--bounces", "1"]].concat(), "belongs to another scene or to other settings");
    let kept = folder.file("cut/trace.checkpoint");
    let bytes = std::fs::read(&kept).unwrap();
    std::fs::write(&kept, &bytes[..bytes.len() - 9]).unwrap();
    refused(&again, "it was cut");
    refused(&[&file, "--out", &cut], "is there already; --force replaces it");
    let other = out("other");
    refused(&[&file, "--out", &other, "--samples", "0"], "samples = 0: must be within");
    refused(&[&file, "--out", &other, "--image", "with"], "--image: belongs to reference cases");
    refused(&["none.toml", "--out", &other], "none.toml");
}

#[test]
fn the_noise_of_a_single_pass_is_not_known() {
    let folder = Folder::new("noise");
    let file = folder.file("scene.toml");
    let light = "[light]\nconstant = [0.3, 0.4, 0.5]\n";
    std::fs::write(&file, format!("{SCENE}{light}")).unwrap();
    let (file, out) = (file.display().to_string(), folder.file("out").display().to_string());
    let trace = |more: &[&str]| {
        let (status, told, errors) =
            run(&[&[file.as_str(), "--out", &out, "--force", "--step-px", "2"], more].concat());
        assert_eq!(status, 0, "{errors}");
        told
    };
    let one = trace(&["--samples", "16", "--samples-a-pass", "16"]);
    assert!(one.contains("16 samples a pixel") && one.contains("not known from a single pass"), "{one}");
    assert!(!one.contains("0.000 %"), "{one}");
    let json: serde_json::Value =
        serde_json::from_str(&trace(&["--samples", "16", "--samples-a-pass", "16", "--json"])).unwrap();
    assert!(json["noise"]["shadow_relative"].is_null() && json["noise"]["samples_a_pixel"] == 16, "{json}");
    // Left alone, 16 samples are 16, in passes enough to tell the noise.
    let told = trace(&["--samples", "16"]);
    assert!(told.contains("16 samples a pixel") && !told.contains("not known"), "{told}");
}
