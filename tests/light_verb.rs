//! `halflight light` as a program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DVec2, DVec3};
use halflight::{
    assets::{case, pictures},
    light::place_ball,
    math::pose::Pose,
    model::image::RadianceImage,
};
use serde_json::Value;
use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// A folder for one test's files, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("halflight-light-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn exr(
        &self,
        name: &str,
        width: usize,
        height: usize,
        light: impl Fn(usize, usize) -> [f32; 3],
    ) -> String {
        let pixels = (0..width * height).map(|k| light(k % width, k / width)).collect();
        let file = self.file(name);
        pictures::save_exr_f32(&file, &RadianceImage::from_pixels(width, height, pixels).unwrap()).unwrap();
        file.display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Exit status, standard output, standard error.
fn light(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_halflight")).arg("light").args(arguments).output().unwrap();
    (
        output.status.code().unwrap(),
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

fn json(arguments: &[&str]) -> Value {
    let (status, out, errors) = light(&[arguments, &["--json"]].concat());
    assert_eq!(status, 0, "{errors}");
    serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}"))
}

fn vector(value: &Value) -> DVec3 {
    let numbers: Vec<f64> = value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    DVec3::from_slice(&numbers)
}

/// Refused with status 2 and a message that says all of these.
fn refused(arguments: &[&str], words: &[&str]) {
    let (status, out, errors) = light(arguments);
    assert_eq!(status, 2, "{arguments:?}: {out}{errors}");
    for word in words {
        assert!(errors.contains(word), "{arguments:?}: no {word:?} in {errors}");
    }
}

#[test]
fn json_has_its_keys_and_the_light_of_a_lamp() {
    let folder = Folder::new("json");
    // Only towards +y: u = 0.75.
    let lamp = folder.exr("lamp.exr", 64, 32, |x, y| {
        if (47..49).contains(&x) && (15..17).contains(&y) { [8.0, 4.0, 2.0] } else { [0.0; 3] }
    });
    let found = json(&[&lamp, "--as", "equirect", "--order", "3"]);
    let mut keys: Vec<&str> = found.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    let want =
        ["cone95_rad", "flags", "format", "irradiance_rgb", "order", "residual_sh_rgb", "sh_rgb", "to_light"];
    assert_eq!(keys, want);
    assert_eq!((found["order"].as_u64(), found["sh_rgb"].as_array().unwrap().len()), (Some(3), 9));
    assert_eq!(found["residual_sh_rgb"].as_array().unwrap().len(), 9);
    assert!(vector(&found["to_light"]).distance(DVec3::Y) < 1e-6);
    // Four texels of (2 pi / 64)(2 sin(pi/64) ...) sr: solid angle 4 * (pi/32)^2, nearly; E_d = L times it, a little
    // less for the lamp's extent.
    let omega = 4.0 * (std::f64::consts::PI / 32.0).powi(2);
    let irradiance = vector(&found["irradiance_rgb"]) / omega;
    assert!(irradiance.distance(DVec3::new(8.0, 4.0, 2.0)) < 0.05, "{irradiance}");
    assert_eq!(found["flags"]["texels"].as_u64(), Some(2048));
    // The same in words, and the same twice.
    let (status, text, _) = light(&[&lamp, "--as", "equirect", "--digest"]);
    assert!(
        status == 0 && text.contains("azimuth 90.00 deg") && text.contains("colour 1.000 0.500 0.250"),
        "{text}"
    );
    assert_eq!(light(&[&lamp, "--as", "equirect", "--digest", "--threads", "2"]).1, text);
    // Turned and mirrored.
    let turned = json(&[&lamp, "--as", "equirect", "--turn", "90"]);
    assert!(vector(&turned["to_light"]).distance(DVec3::NEG_X) < 1e-6);
    let mirrored = json(&[&lamp, "--as", "equirect", "--axes", "mirrored"]);
    assert!(vector(&mirrored["to_light"]).distance(DVec3::NEG_Y) < 1e-6);
}

/// Light from above in other programs' shapes: y is up there, and the signs are those that their shaders take.
#[test]
fn shapes_of_other_programs() {
    let folder = Folder::new("shapes");
    let sky = folder.exr("sky.exr", 64, 32, |_, y| if y < 16 { [2.0, 1.0, 0.5] } else { [0.0; 3] });
    let shape = |name: &str| -> Value {
        // A half space is broad: only the paper's split makes one lamp of it.
        let (status, out, errors) = light(&[&sky, "--as", "equirect", "--format", name, "--split", "paper"]);
        assert_eq!(status, 0, "{errors}");
        serde_json::from_str(&out).unwrap()
    };
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let up = |v: &Value| ["x", "y", "z"].map(|axis| v[axis].as_f64().unwrap());
    assert_eq!(shape("json"), json(&[&sky, "--as", "equirect"]));
    let [x, y, z] = up(&shape("webxr")["primaryLightDirection"]);
    assert!(y > 0.999_999 && x.abs() < 1e-5 && z.abs() < 1e-5);
    let web = shape("webxr");
    // Red of the main light: the net flux, 2 pi of a half space of radiance 2.
    let [red, green, _] = up(&web["primaryLightIntensity"]);
    assert!((red - 2.0 * std::f64::consts::PI).abs() < 0.02 && (red / green - 2.0).abs() < 1e-4, "{red}");
    assert_eq!(
        (web["primaryLightDirection"]["w"].as_f64(), web["primaryLightIntensity"]["w"].as_f64()),
        (Some(0.0), Some(1.0))
    );
    let ambient = numbers(&web["sphericalHarmonicsCoefficients"]);
    assert_eq!(ambient.len(), 27);

    let android = shape("android-xr");
    let valid = "XR_LIGHT_ESTIMATE_STATE_VALID_ANDROID";
    assert_eq!(android["XrLightEstimateANDROID"]["state"], valid);
    assert_eq!(android["XrLightEstimateANDROID"]["lastUpdatedTime"], 0);
    assert_eq!(android["XrDirectionalLightANDROID"]["state"], valid);
    assert!(up(&android["XrDirectionalLightANDROID"]["direction"])[1] > 0.999_999);
    let [total, rest] = android["XrSphericalHarmonicsANDROID"].as_array().unwrap().as_slice() else {
        panic!("{android}")
    };
    assert_eq!(total["kind"], "XR_SPHERICAL_HARMONICS_KIND_TOTAL_ANDROID");
    assert_eq!(rest["kind"], "XR_SPHERICAL_HARMONICS_KIND_AMBIENT_ANDROID");
    // Row 1 goes with -y there, with +y in WebXR: all of the light comes from above.
    let row = |harmonics: &Value, i: usize| numbers(&harmonics["coefficients"][i]);
    assert!(row(total, 1)[0] < -1.0 && row(total, 2)[0].abs() < 1e-5 && row(total, 3)[0].abs() < 1e-5);
    for c in 0..3 {
        assert!((row(rest, 1)[c] + ambient[3 + c]).abs() < 1e-6);
        assert!((row(rest, 6)[c] - ambient[18 + c]).abs() < 1e-6);
    }

    let three = shape("threejs");
    let children = three["object"]["children"].as_array().unwrap();
    assert_eq!(
        (children[0]["type"].as_str(), children[1]["type"].as_str()),
        (Some("LightProbe"), Some("DirectionalLight"))
    );
    assert_eq!(numbers(&children[0]["sh"]), ambient);
    let place = &numbers(&children[1]["matrix"])[12..15];
    assert!(place[1] > 0.999_999, "{place:?}");
    assert!((children[1]["intensity"].as_f64().unwrap() - red).abs() < 1e-6);
    // (1, 1/2, 1/4) in 8 bits through sRGB.
    assert_eq!(children[1]["color"].as_u64(), Some(0xff_bc_89));

    // Without a direction the main light is dark and straight above; told to be invalid it would take all else with it.
    let flat = folder.exr("flat.exr", 64, 32, |_, _| [1.0; 3]);
    let (_, out, _) = light(&[&flat, "--as", "equirect", "--format", "android-xr"]);
    let flat_android: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(flat_android["XrDirectionalLightANDROID"]["state"], valid);
    assert_eq!(up(&flat_android["XrDirectionalLightANDROID"]["intensity"]), [0.0; 3]);
    refused(&[&flat, "--as", "equirect", "--format", "xml"], &["--format", "android-xr", "webxr", "threejs"]);
}

#[test]
fn six_faces_one_cube() {
    let folder = Folder::new("faces");
    let faces: Vec<String> = ["px", "nx", "py", "ny", "pz", "nz"]
        .iter()
        .enumerate()
        .map(|(k, name)| {
            let bright = if k == 2 { 3.0 } else { 0.1 };
            folder.exr(&format!("{name}.exr"), 8, 8, |_, _| [bright; 3])
        })
        .collect();
    let six: Vec<&str> = faces.iter().map(String::as_str).collect();
    let to_light = |extra: &[&str]| vector(&json(&[&six, extra].concat())["to_light"]);
    assert!(to_light(&["--as", "cube"]).distance(DVec3::Y) < 1e-6);
    assert!(to_light(&["--as", "cube", "--axes", "y-up"]).distance(DVec3::Z) < 1e-6);
    refused(&[&six[..4], &["--as", "cube"]].concat(), &["4 pictures", "1 or 6", "+x -x +y -y +z -z"]);
    refused(&[six[0], "--as", "cube"], &["8 x 8", "six squares"]);
}

#[test]
fn the_picture_of_the_light_comes_back() {
    let folder = Folder::new("picture");
    let sky = folder.exr("sky.exr", 64, 32, |x, y| [x as f32, y as f32, 1.0]);
    let out = folder.file("out.exr").display().to_string();
    assert_eq!(light(&[&sky, "--as", "equirect", "--out", &out, "--out-height", "32"]).0, 0);
    let (a, b) = (pictures::load_raw(Path::new(&sky)).unwrap(), pictures::load_raw(Path::new(&out)).unwrap());
    for (a, b) in a.pixels().iter().flatten().zip(b.pixels().iter().flatten()) {
        // Weighed by an f32 solid angle and divided by it again.
        assert!((a - b).abs() <= 1e-5 * a, "{a} {b}");
    }
    let png = folder.file("out.png").display().to_string();
    assert_eq!(light(&[&sky, "--as", "equirect", "--out", &png]).0, 0);
    assert_eq!(pictures::load_rgb8(Path::new(&png)).unwrap().width(), 512);
}

#[test]
fn uniform_and_dark_pictures_have_no_direction() {
    let folder = Folder::new("uniform");
    let dark = folder.exr("dark.exr", 16, 16, |_, _| [0.0; 3]);
    let found = json(&[&dark, "--as", "angular"]);
    assert!(found["to_light"].is_null());
    assert!((found["cone95_rad"].as_f64().unwrap() - std::f64::consts::PI).abs() < 1e-6);
    assert_eq!(vector(&found["irradiance_rgb"]), DVec3::ZERO);
    let even = folder.exr("even.exr", 32, 16, |_, _| [1.0; 3]);
    assert!(json(&[&even, "--as", "equirect"])["to_light"].is_null());
    let order_one = json(&[&even, "--as", "equirect", "--order", "1"]);
    assert_eq!(order_one["sh_rgb"].as_array().unwrap().len(), 1);
}

#[test]
fn mistakes_are_named() {
    let folder = Folder::new("mistakes");
    let map = folder.exr("map.exr", 8, 6, |_, _| [1.0; 3]);
    let grey = folder.file("grey.png").display().to_string();
    let picture = halflight::model::image::Image::filled(40, 30, [90u8; 3]);
    pictures::save_png(Path::new(&grey), &picture).unwrap();
    refused(&[&map, "--as", "equirect"], &["map.exr", "8 x 6", "twice as wide"]);
    refused(&[&map, "--as", "angular"], &["8 x 6", "square"]);
    refused(&[&map, "--as", "ball"], &["--case, --camera or --focal"]);
    refused(&[&map, "--as", "equirect", "--ball-radius", "1"], &["--ball-radius", "--as ball"]);
    refused(&[&map, "--as", "equirect", "--times", "1"], &["map.exr", "linear already"]);
    refused(&[&map, "--as", "equirect", "--out", "x.bmp"], &["x.bmp", ".exr, .hdr or .png"]);
    refused(&[&map, "--as", "equirect", "--order", "7"], &["7", "1..=6"]);
    refused(&["--as", "equirect"], &["0 pictures"]);
    refused(&["/no/such.hdr", "--as", "angular"], &["/no/such.hdr"]);
    refused(&["/no/such.dds", "--as", "cube"], &["/no/such.dds"]);
    refused(&[&grey, &grey, "--as", "equirect", "--times", "1"], &["1 times for 2 pictures"]);
    refused(&[&grey, &grey, "--as", "equirect", "--times", "1,zero"], &["--times zero", "0.025 or 1/40"]);
    refused(&[&grey, "--as", "equirect", "--response", "/no/r.json"], &["--response /no/r.json"]);
    let ball = |extra: &[&str], words: &[&str]| {
        refused(&[&[grey.as_str(), "--as", "ball", "--focal", "50,50,20,15"], extra].concat(), words);
    };
    ball(&[], &["--ball-px"]);
    ball(&["--ball-px", "20,15,8"], &["--ball-radius"]);
    ball(&["--ball-px", "20,15,-8", "--ball-radius", "0.1"], &["--ball-px 20,15,-8", "R above 0"]);
    ball(&["--ball-px", "20,15", "--ball-radius", "0.1"], &["--ball-px 20,15", "three numbers"]);
    ball(&["--ball-px", "20,15,8", "--ball-radius", "-1"], &["--ball-radius -1", "above 0"]);
    ball(&["--ball-px", "20,15,8", "--ball-radius", "0.1", "--up", "0,0,0"], &["--up 0,0,0", "not all 0"]);
    ball(
        &["--ball-px", "20,15,8", "--ball-radius", "0.1", "--ball-reflectance", "1,1,2"],
        &["--ball-reflectance 1,1,2", "(0, 1]"],
    );
    ball(&["--ball-px", "900,15,8", "--ball-radius", "0.1"], &["not in the picture"]);
    ball(&["--turn", "4", "--ball-px", "20,15,8", "--ball-radius", "0.1"], &["--turn", "--up"]);
}

#[test]
fn the_reference_balls_give_their_light() {
    let Some(shared) = support::shared("light of the reference balls") else { return };
    for name in ["overcast_city", "room_windows", "studio_lamps", "sun_beach"] {
        let file = shared.join(format!("reference/f5_{name}"));
        let case = case::load(&file).unwrap();
        let truth = &case.light_truth.as_ref().unwrap().upper_hemisphere_plus_unshadowed_plane_below;
        let path = file.display().to_string();
        for photographs in [false, true] {
            let mut arguments = vec!["--as", "ball", "--case", path.as_str()];
            if photographs {
                arguments.push("--photographs");
            }
            let found = json(&arguments);
            let off = vector(&found["to_light"]).angle_between(truth.to_light_world);
            let cone = found["cone95_rad"].as_f64().unwrap();
            println!(
                "{name} photographs {photographs}: {:.3} deg, cone {:.2} deg",
                off.to_degrees(),
                cone.to_degrees()
            );
            // Measured: at most 0.25.
            assert!(off.to_degrees() < 0.4, "{name} {photographs}");
            assert!(off <= cone, "{name} {photographs}: off by {off}, cone {cone}");
        }
        // The same ball from its outline, without a pose: its direction in the camera's axes must be the same.
        let ball = case
            .geometry
            .iter()
            .find_map(|g| match g.shape {
                case::ExactShape::Sphere { centre, radius } => Some((centre, radius)),
                _ => None,
            })
            .unwrap();
        let camera_from_world = case.world_from_camera.inverse();
        let (outline, radius_px) = outline(&case.lens, camera_from_world.transform(ball.0), ball.1);
        let up = camera_from_world.rotate(DVec3::Z);
        let list = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let hdr = case.image("hdr").unwrap().file.display().to_string();
        let found = json(&[
            &hdr,
            "--as",
            "ball",
            "--focal",
            &list(&[case.lens.fx, case.lens.fy, case.lens.cx, case.lens.cy]),
            "--ball-px",
            &list(&[outline.x, outline.y, radius_px]),
            "--ball-radius",
            &ball.1.to_string(),
            "--up",
            &list(&up.to_array()),
            "--on-surface",
        ]);
        let centre = place_ball::centre_from_outline(&case.lens, outline, radius_px, ball.1).unwrap();
        let pose: Pose = place_ball::world_about_ball(centre, up, ball.1).unwrap();
        let in_camera = pose.inverse().rotate(vector(&found["to_light"]));
        let off = in_camera.angle_between(camera_from_world.rotate(truth.to_light_world));
        println!("{name} from its outline: {:.3} deg", off.to_degrees());
        // The outline is an ellipse; as a circle it places the ball a little wrong. Measured: at most 0.25.
        assert!(off.to_degrees() < 0.4, "{name}: {}", off.to_degrees());
    }
}

/// Middle and mean radius of a ball's outline, pixels.
fn outline(lens: &halflight::math::lens::Lens, centre: DVec3, radius: f64) -> (DVec2, f64) {
    let q = radius / centre.length();
    let axis = centre.normalize();
    let (a, b) = axis.any_orthonormal_pair();
    let points: Vec<DVec2> = (0..180)
        .map(|k| {
            let side = DVec2::from_angle(f64::from(k) * std::f64::consts::TAU / 180.0);
            let normal = axis * -q + (a * side.x + b * side.y) * (1.0 - q * q).sqrt();
            lens.project(centre + radius * normal).unwrap()
        })
        .collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
    let half = 0.5 * (high - low);
    (0.5 * (low + high), (half.x * half.y).sqrt())
}
