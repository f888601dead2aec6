//! The light from photographs of mirror balls, against ray-traced truth (the reference's F5).
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::DVec3;
use halflight::hdr::merge_bracket::merge_bracket;
use halflight::hdr::response::{ResponseOrigin, SolveOptions, solve};
use halflight::light::{
    project_sh::project_sh,
    split::{SplitOptions, split},
    unwrap_ball::unwrap_ball,
};
use halflight::math::{lens::Lens, pose::Pose};
use halflight::model::{
    estimate::LightFlags,
    frame::Exposure,
    image::{HdrImage, Image, Rgb8Image},
    light::{RadianceSamples, SplitLight},
    response::Response,
    rig::MirrorBall,
};
use serde_json::Value;
use std::path::Path;
use support::wanted;

const CASES: [&str; 4] = ["overcast_city", "room_windows", "studio_lamps", "sun_beach"];

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn rgb(value: &Value) -> [f64; 3] {
    std::array::from_fn(|k| number(&value[k]))
}

struct Case {
    json: Value,
    lens: Lens,
    pose: Pose,
    ball: MirrorBall,
}

fn load(shared: &Path, name: &str) -> Case {
    let file = shared.join(format!("reference/f5_{name}/case.json"));
    let json: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    let camera = &json["camera"];
    let size = |key: &str| camera[key].as_u64().unwrap() as u32;
    let lens = Lens::pinhole(
        size("width"),
        size("height"),
        number(&camera["fx"]),
        number(&camera["fy"]),
        number(&camera["cx"]),
        number(&camera["cy"]),
    );
    let rows = &camera["world_from_camera"];
    let pose = Pose::from_rows(std::array::from_fn(|i| std::array::from_fn(|j| number(&rows[i][j]))));
    let mirror = &json["geometry"][1];
    let ball = MirrorBall {
        surface_radius_m: None,
        centre_world: DVec3::from_array(rgb(&mirror["center"])),
        radius_m: number(&mirror["radius"]),
        reflectance_rgb: [1.0; 3],
    };
    Case { json, lens, pose, ball }
}

fn linear(shared: &Path, name: &str) -> HdrImage {
    use exr::prelude::read_first_rgba_layer_from_file;
    let file = shared.join(format!("reference/f5_{name}/hdr.exr"));
    let image = read_first_rgba_layer_from_file(
        file,
        |size, _| Image::filled(size.width(), size.height(), [0.0_f32; 3]),
        |image, at, (r, g, b, _): (f32, f32, f32, f32)| *image.at_mut(at.x(), at.y()) = [r, g, b],
    )
    .unwrap();
    let radiance = image.layer_data.channel_data.pixels;
    let flags = Image::filled(radiance.width(), radiance.height(), 0);
    HdrImage { radiance, flags }
}

/// The three photographs, merged; with `calibrate` through the response that they themselves tell. Their scale they do
/// not: each channel's is that of the given table at 128.
fn merged(shared: &Path, case: &Case, calibrate: bool) -> HdrImage {
    let photographs = &case.json["photographs"];
    let scale = number(&photographs["exposure_scale"]);
    let mut pictures: Vec<Rgb8Image> = Vec::new();
    let mut exposures = Vec::new();
    for exposure in photographs["exposures"].as_array().unwrap() {
        let file = shared.join("reference").join(exposure["file"].as_str().unwrap());
        let picture = image::open(file).unwrap().into_rgb8();
        let pixels = picture.pixels().map(|p| p.0).collect();
        pictures
            .push(Image::from_pixels(picture.width() as usize, picture.height() as usize, pixels).unwrap());
        // The scale belongs to the response; here it rides on the gain.
        exposures.push(Exposure { time_s: number(&exposure["exposure_time_s"]), gain: scale });
    }
    let table = &photographs["response_table"];
    let log: [[f32; 256]; 3] =
        std::array::from_fn(|c| std::array::from_fn(|z| number(&table[c][z]).max(1e-6).ln() as f32));
    let mut out = HdrImage::default();
    let borrowed: Vec<&Rgb8Image> = pictures.iter().collect();
    let mut response = Response::new(log).unwrap();
    if calibrate {
        let scale = log.map(|g| f64::from(g[128]));
        let options = SolveOptions { log_exposure_at_128: scale, ..SolveOptions::default() };
        let solved = solve(&borrowed, &exposures, &options);
        assert!(matches!(solved.origin, ResponseOrigin::Solved { .. }), "{:?}", solved.origin);
        response = solved.response;
    }
    merge_bracket(&borrowed, &exposures, &response, &mut out).unwrap();
    out
}

struct Errors {
    direction_deg: f64,
    irradiance_percent: [f64; 3],
    surface_percent: [f64; 3],
}

fn worst(percent: &[f64; 3]) -> f64 {
    percent.iter().fold(0.0, |most, p| p.abs().max(most))
}

impl Errors {
    fn hold(&self, photographs: &str) {
        wanted::hold(&format!("ball.{photographs}.direction"), self.direction_deg);
        wanted::hold(&format!("ball.{photographs}.irradiance"), worst(&self.irradiance_percent));
    }
}

fn measure(case: &Case, picture: &HdrImage) -> (Errors, LightFlags, SplitLight) {
    let mut samples = RadianceSamples::default();
    let flags = unwrap_ball(picture, &case.lens, &case.pose, &case.ball, true, &mut samples).unwrap();
    let whole: f64 = samples.directions.iter().map(|d| f64::from(d[3])).sum();
    assert!((whole / (4.0 * std::f64::consts::PI) - 1.0).abs() < 1e-5, "solid angles sum to {whole}");
    let light = split(&project_sh(&samples, 4), &SplitOptions::default());
    let direct = light.direct.unwrap();
    let truth = &case.json["light_truth"]["upper_hemisphere_plus_unshadowed_plane_below"];
    let want = DVec3::from_array(rgb(&truth["dominant_direction"]));
    let got = DVec3::from_array(direct.to_light_world.map(f64::from));
    let (want_irradiance, want_surface) = (rgb(&truth["E_d_rgb"]), rgb(&truth["plane_radiance_rgb"]));
    let below = samples.radiance.last().unwrap();
    let errors = Errors {
        direction_deg: got.angle_between(want).to_degrees(),
        irradiance_percent: std::array::from_fn(|c| {
            100.0 * (f64::from(direct.irradiance_rgb[c]) / want_irradiance[c] - 1.0)
        }),
        surface_percent: std::array::from_fn(|c| 100.0 * (f64::from(below[c]) / want_surface[c] - 1.0)),
    };
    (errors, flags, light)
}

#[test]
fn light_of_the_reference_balls_from_hdr() {
    let Some(shared) = support::shared("light_of_the_reference_balls_from_hdr") else { return };
    for name in CASES {
        let case = load(&shared, name);
        let (errors, flags, _) = measure(&case, &linear(&shared, name));
        println!(
            "{name}: direction {:.3} deg, E_d {:.2?} %, surface {:.3?} %, {flags:?}",
            errors.direction_deg, errors.irradiance_percent, errors.surface_percent
        );
        // Measured 0.03 to 0.25 degrees, 0.0 to 0.7 % and 0.002 to 0.062 %: the most with a sun inside one pixel.
        errors.hold("hdr");
        wanted::hold("ball.hdr.surface", worst(&errors.surface_percent));
        assert!(flags.filled_share < 0.03 && flags.saturated_texels == 0 && flags.not_finite_texels == 0);
    }
}

#[test]
fn light_of_the_reference_balls_from_photographs() {
    let Some(shared) = support::shared("light_of_the_reference_balls_from_photographs") else { return };
    for name in CASES {
        let case = load(&shared, name);
        let (errors, flags, _) = measure(&case, &merged(&shared, &case, false));
        println!(
            "{name}: direction {:.3} deg, E_d {:.2?} %, surface {:.3?} %, {flags:?}",
            errors.direction_deg, errors.irradiance_percent, errors.surface_percent
        );
        // The lamps and the sun are saturated in every exposure: their strength comes from their shadows.
        // Measured 0.10 to 0.22 degrees, and up to 2.3 % (red of the lamps).
        errors.hold("photographs");
    }
}

#[test]
fn light_of_the_reference_balls_from_photographs_that_calibrate_themselves() {
    let Some(shared) =
        support::shared("light_of_the_reference_balls_from_photographs_that_calibrate_themselves")
    else {
        return;
    };
    let mut directions_deg = Vec::new();
    for name in CASES {
        let case = load(&shared, name);
        let (errors, flags, _) = measure(&case, &merged(&shared, &case, true));
        println!(
            "{name}: direction {:.3} deg, E_d {:.2?} %, surface {:.3?} %, {flags:?}",
            errors.direction_deg, errors.irradiance_percent, errors.surface_percent
        );
        directions_deg.push(errors.direction_deg);
        // Measured 2.3 % at most (green under the overcast sky), 0.21 to 0.33 degrees.
        errors.hold("calibrated");
    }
    directions_deg.sort_by(f64::total_cmp);
    assert!(directions_deg[2] < 1.0, "the median of {directions_deg:?}");
}
