//! The light from mirror balls that no constant of the fit has seen: other environments, cameras, radii and surfaces
//! than the reference's F5, drawn by a renderer of the tests' own, with truth by summing the environment's texels.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/ball_scene.rs"]
mod ball_scene;
mod support;

use ball_scene::{BallScene, Environment};
use glam::DVec3;
use halflight::assets::pictures::load_radiance;
use halflight::light::{
    project_sh::project_sh,
    split::{SplitOptions, split},
    unwrap_ball::unwrap_ball,
};
use halflight::math::{lens::Lens, pose::Pose};
use halflight::model::{light::RadianceSamples, rig::MirrorBall};

struct Case {
    environment: &'static str,
    turn_texels: usize,
    eye: DVec3,
    radius_m: f64,
    albedo: DVec3,
}

/// Two environments that F5 has not, each twice; and one that it has, turned.
const CASES: [Case; 5] = [
    Case {
        environment: "rooitou_park_1k",
        turn_texels: 28,
        eye: DVec3::new(0.26, -0.36, 0.31),
        radius_m: 0.06,
        albedo: DVec3::new(0.5, 0.42, 0.35),
    },
    Case {
        environment: "rooitou_park_1k",
        turn_texels: 142,
        eye: DVec3::new(-0.1, -0.38, 0.45),
        radius_m: 0.035,
        albedo: DVec3::new(0.25, 0.3, 0.28),
    },
    Case {
        environment: "st_fagans_interior_1k",
        turn_texels: 203,
        eye: DVec3::new(-0.3, -0.22, 0.22),
        radius_m: 0.04,
        albedo: DVec3::new(0.7, 0.7, 0.68),
    },
    Case {
        environment: "st_fagans_interior_1k",
        turn_texels: 64,
        eye: DVec3::new(0.05, 0.5, 0.28),
        radius_m: 0.075,
        albedo: DVec3::new(0.45, 0.3, 0.2),
    },
    Case {
        environment: "potsdamer_platz_1k",
        turn_texels: 92,
        eye: DVec3::new(0.38, 0.2, 0.35),
        radius_m: 0.055,
        albedo: DVec3::new(0.3, 0.3, 0.34),
    },
];

const GRAY: DVec3 = DVec3::new(0.3, 0.59, 0.11);

#[test]
fn light_of_balls_never_seen() {
    let Some(shared) = support::shared("light_of_balls_never_seen") else { return };
    let mut directions_deg = Vec::new();
    for (index, case) in CASES.iter().enumerate() {
        let file = shared.join(format!("data/hdr/{}.hdr", case.environment));
        let environment = Environment::new(&load_radiance(&file).unwrap().hdr.radiance, case.turn_texels);
        let scene = BallScene { environment, radius_m: case.radius_m, albedo: case.albedo };
        let lens = Lens::pinhole(256, 192, 420.0, 420.0, 129.5, 94.0);
        let pose = Pose::look_at(case.eye, scene.centre() * 0.8, DVec3::Z);
        // Noise of 1 % at the radiance of white paper.
        let picture = scene.picture(&lens, &pose, 10_000.0, index as u64 + 1);
        let ball = MirrorBall {
            surface_radius_m: None,
            centre_world: scene.centre(),
            radius_m: case.radius_m,
            reflectance_rgb: [1.0; 3],
        };
        let mut samples = RadianceSamples::default();
        let flags = unwrap_ball(&picture, &lens, &pose, &ball, true, &mut samples).unwrap();
        let light = split(&project_sh(&samples, 4), &SplitOptions::default());
        let moments = scene.environment.moments(case.albedo);
        let gray: DVec3 = (0..3).map(|c| moments[c] * GRAY[c]).sum();
        let want = gray.normalize();
        let direct = light.direct.unwrap();
        let got = DVec3::from_array(direct.to_light_world.map(f64::from));
        let direction_deg = got.angle_between(want).to_degrees();
        let irradiance_percent: [f64; 3] = std::array::from_fn(|c| {
            100.0 * (f64::from(direct.irradiance_rgb[c]) / moments[c].dot(want) - 1.0)
        });
        println!(
            "{} turned {}: direction {direction_deg:.3} deg, E_d {irradiance_percent:.2?} %, anisotropy {:.2}, {flags:?}",
            case.environment,
            case.turn_texels,
            gray.length()
        );
        // The bound for F5, which nothing here was tuned to. Measured -0.1 to 1.2 %: the most in a room whose
        // light comes from everywhere (anisotropy 1.2 of pi).
        assert!(
            irradiance_percent.iter().all(|e| e.abs() < 3.0),
            "{} turned {}: E_d {irradiance_percent:.2?} %",
            case.environment,
            case.turn_texels
        );
        directions_deg.push(direction_deg);
    }
    // The same for the direction, from a linear picture: 1 degree, 0.5 in the median. Measured 0.06 to 0.55, and 0.98 on
    // the smallest ball: its 35 mm are 28 pixels, and the sun, all of it within one of them, stands low at its edge (in a
    // picture of twice the size 0.20).
    directions_deg.sort_by(f64::total_cmp);
    assert!(directions_deg[4] < 1.0 && directions_deg[2] < 0.5, "{directions_deg:?}");
}
