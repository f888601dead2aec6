//! What the split alone costs (section 4b of the project's formulas): F1 of the reference, spheres with exact
//! visibility, n hard lights of the compact split with the rest in SH of order 4.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DVec2, Vec3};
use halflight::assets::{
    case::{self, Case, EmitterKind, Shape},
    pictures,
};
use halflight::light::{compact::CompactSplit, maps, project_sh::project_sh};
use halflight::math::sh::basis::evaluate;
use halflight::model::light::{EnvironmentMap, Lights, MapLayout, RadianceSamples};
use rayon::prelude::*;

const DIRECTIONS: usize = 600;

struct Spheres(Vec<(Vec3, f32)>);

impl Spheres {
    fn of(case: &Case) -> Self {
        Self(
            case.geometry
                .iter()
                .filter_map(|g| match g.shape {
                    Shape::Sphere { centre, radius } => Some((centre.as_vec3(), radius as f32)),
                    _ => None,
                })
                .collect(),
        )
    }
    fn open(&self, p: Vec3, w: Vec3) -> bool {
        self.0.iter().all(|&(c, r)| {
            let to = c - p;
            let along = to.dot(w);
            along <= 0.0 || to.length_squared() - along * along > r * r
        })
    }
}

const GRAY: [f32; 3] = [0.3, 0.59, 0.11];

fn gray(rgb: [f32; 3]) -> f32 {
    rgb.iter().zip(GRAY).map(|(c, g)| c * g).sum()
}

/// Gray ratio at points of the plane.
fn ratios(lights: &Lights, spheres: &Spheres, points: &[Vec3]) -> Vec<f32> {
    let mut soft = Vec::new();
    for j in 0..DIRECTIONS {
        let z = 1.0 - (j as f32 + 0.5) / DIRECTIONS as f32;
        let phi = std::f32::consts::PI * (1.0 + 5f32.sqrt()) * (j as f32 + 0.5);
        let r = (1.0 - z * z).sqrt();
        let w = Vec3::new(r * phi.cos(), r * phi.sin(), z);
        let mut y = [0.0f32; 36];
        evaluate(lights.global.order, w.to_array(), &mut y);
        let l: f32 = lights.global.rows().iter().zip(y).map(|(c, y)| gray(*c) * y).sum();
        soft.push((w, l * z * std::f32::consts::TAU / DIRECTIONS as f32));
    }
    let hard: Vec<(Vec3, f32)> = lights
        .hard
        .as_slice()
        .iter()
        .map(|h| (Vec3::from(h.to_light_world), gray(h.irradiance_rgb) * h.to_light_world[2].max(0.0)))
        .collect();
    let all: f32 = soft.iter().chain(&hard).map(|s| s.1).sum();
    points
        .par_iter()
        .map(|&p| soft.iter().chain(&hard).filter(|s| spheres.open(p, s.0)).map(|s| s.1).sum::<f32>() / all)
        .collect()
}

struct Scene {
    samples: RadianceSamples,
    spheres: Spheres,
    points: Vec<Vec3>,
    truth: Vec<f32>,
}

fn scene(shared: &std::path::Path, id: &str) -> Scene {
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let EmitterKind::Environment { file } = &case.emitters[0].kind else { panic!() };
    let radiance = pictures::load_raw(file).unwrap();
    let mut samples = RadianceSamples::default();
    maps::samples_of_map(&EnvironmentMap { layout: MapLayout::Equirect, radiance }, &mut samples);
    let picture = pictures::load_raw(&case.image("ratio").unwrap().file).unwrap();
    let mask = pictures::load_gray8(&case.image("mask_spheres").unwrap().file).unwrap();
    let (mut points, mut truth) = (Vec::new(), Vec::new());
    for (i, (rgb, &m)) in picture.pixels().iter().zip(mask.pixels()).enumerate() {
        let (x, y) = (i % 256, i / 256);
        let ratio = gray(*rgb);
        if m > 0 || ratio >= 0.93 || (x + y) % 3 > 0 {
            continue;
        }
        // 2 x 2 sub-pixels.
        for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            let ray = case.world_from_camera.rotate(case.lens.unproject(DVec2::new(x as f64 + dx, y as f64 + dy)).unwrap());
            let eye = case.world_from_camera.translation;
            points.push((eye + ray * (-eye.z / ray.z)).as_vec3());
        }
        truth.push(ratio);
    }
    Scene { samples, spheres: Spheres::of(&case), points, truth }
}

fn error_mean(got: &[f32], truth: &[f32]) -> f32 {
    let sum: f32 = got.chunks(4).zip(truth).map(|(g, t)| (g.iter().sum::<f32>() / 4.0 - t).powi(2)).sum();
    (sum / truth.len() as f32).sqrt() / (truth.iter().sum::<f32>() / truth.len() as f32)
}

fn error(got: &[f32], truth: &[f32]) -> f32 {
    let sum: f32 = got
        .chunks(4)
        .zip(truth)
        .map(|(g, t)| ((g.iter().sum::<f32>() / 4.0 - t) / t).powi(2))
        .sum();
    (sum / truth.len() as f32).sqrt()
}

#[test]
fn the_dial() {
    let Some(shared) = support::shared("the_dial") else { return };
    for id in ["f1_sun_beach_one", "f1_studio_lamps_five", "f1_room_windows_five", "f1_overcast_city_figure20", "f1_sun_beach_figure20", "f1_studio_lamps_overlap"] {
        for variant in 0..4 {
        let mut scene = scene(&shared, id);
        let mut up = RadianceSamples::default();
        let mut e = [0.0f32;3];
        for (d, r) in scene.samples.directions.iter().zip(&scene.samples.radiance) {
            if d[2] > 0.0 { up.directions.push(*d); up.radiance.push(*r); for c in 0..3 { e[c] += r[c]*d[3]*d[2]; } }
        }
        let n0 = up.directions.len();
        for i in 0..n0 {
            let d = up.directions[i]; let r = up.radiance[i];
            match variant { 0 => {}, 1 => { up.directions.push([d[0],d[1],-d[2],d[3]]); up.radiance.push(r); }
              2 => { up.directions.push([d[0],d[1],-d[2],d[3]]); up.radiance.push([0.6*e[0]/3.14159,0.6*e[1]/3.14159,0.6*e[2]/3.14159,0.0]); } _ => {} }
        }
        if variant != 0 { scene.samples = up; }
        print!("v{variant} ");
        let total = project_sh(&scene.samples, 4);
        let mut split = CompactSplit::new();
        split.update(&scene.samples, 1.0, 0.0, true);
        print!("{id:28}");
        for n in [0, 1, 2, 4, 8, 16, 32, 64] {
            let lights = split.lights(&total, n);
            let got = ratios(&lights, &scene.spheres, &scene.points);
            let e = error(&got, &scene.truth);
            print!(" {n}:{e:.3}/{:.3}", error_mean(&got, &scene.truth));
        }
        println!();
        }
    }
}
