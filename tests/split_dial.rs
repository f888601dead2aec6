//! What the split alone costs (section 4b of the project's formulas): F1 of the reference, spheres with exact
//! visibility, n hard lights of the compact split with the rest in SH of order 4.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DVec2, Vec3};
use halflight::assets::{
    case::{self, Case, EmitterKind, ExactShape},
    pictures,
};
use halflight::compose::{shade_object::LightTerms, shade_surface, soft_shadow::Transfer};
use halflight::light::{
    compact::CompactSplit,
    maps,
    project_sh::project_sh,
    split::{SplitOptions, split},
};
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
                    ExactShape::Sphere { centre, radius } => Some((centre.as_vec3(), radius as f32)),
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

/// A case with every pixel of every `step`-th diagonal.
fn scene(shared: &std::path::Path, id: &str, step: usize) -> Scene {
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let EmitterKind::Environment { file } = &case.emitters[0].kind else { panic!() };
    let radiance = pictures::load_raw(file).unwrap();
    let mut samples = RadianceSamples::default();
    maps::samples_of_map(&EnvironmentMap { layout: MapLayout::Equirect, radiance }, &mut samples);
    // The plane hides the lower half.
    let up = samples.directions.iter().map(|d| d[2] > 0.0).collect::<Vec<_>>();
    let mut keep = up.iter();
    samples.directions.retain(|_| *keep.next().unwrap());
    let mut keep = up.iter();
    samples.radiance.retain(|_| *keep.next().unwrap());
    let picture = pictures::load_raw(&case.image("ratio").unwrap().file).unwrap();
    let mask = pictures::load_gray8(&case.image("mask_spheres").unwrap().file).unwrap();
    let (mut points, mut truth) = (Vec::new(), Vec::new());
    for (i, (rgb, &m)) in picture.pixels().iter().zip(mask.pixels()).enumerate() {
        let (x, y) = (i % 256, i / 256);
        let ratio = gray(*rgb);
        if m > 0 || ratio >= 0.93 || (x + y) % step > 0 {
            continue;
        }
        // 2 x 2 sub-pixels.
        for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            let ray = case
                .world_from_camera
                .rotate(case.lens.unproject(DVec2::new(x as f64 + dx, y as f64 + dy)).unwrap());
            let eye = case.world_from_camera.translation;
            points.push((eye + ray * (-eye.z / ray.z)).as_vec3());
        }
        truth.push(ratio);
    }
    Scene { samples, spheres: Spheres::of(&case), points, truth }
}

/// Root of the mean squared error over the mean of the truth; `got` has four values for each of `truth`.
fn error(got: &[f32], truth: &[f32]) -> f32 {
    let sum: f32 = got.chunks(4).zip(truth).map(|(g, t)| (g.iter().sum::<f32>() / 4.0 - t).powi(2)).sum();
    (sum / truth.len() as f32).sqrt() / (truth.iter().sum::<f32>() / truth.len() as f32)
}

/// Relative RMSE over the shadow for n = 1, 2, 4, 8, 16, 32, 64, as the project's formulas have it for a split by energy
/// times extent (section 4b).
const TABLE: [(&str, [f32; 7]); 4] = [
    ("f1_sun_beach_one", [0.26, 0.34, 0.31, 0.097, 0.093, 0.086, 0.086]),
    ("f1_studio_lamps_five", [2.4, 1.7, 0.56, 0.26, 0.12, 0.078, 0.060]),
    ("f1_room_windows_five", [0.056, 0.029, 0.020, 0.015, 0.012, 0.010, 0.009]),
    ("f1_overcast_city_figure20", [0.018, 0.016, 0.012, 0.012, 0.012, 0.011, 0.011]),
];
const MAPS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

#[test]
fn more_maps_mean_less_error_and_less_than_by_energy_times_extent() {
    let Some(shared) = support::shared("split_dial") else { return };
    println!("{:28}{}", "relative RMSE, maps:", MAPS.map(|n| format!("{n:7}")).concat());
    for (id, table) in TABLE {
        let scene = scene(&shared, id, 3);
        let total = project_sh(&scene.samples, 4);
        let mut split = CompactSplit::new();
        split.update(&scene.samples, 1.0, 0.0, true);
        let errors = MAPS
            .map(|n| error(&ratios(&split.lights(&total, n), &scene.spheres, &scene.points), &scene.truth));
        println!("{id:28}{}", errors.map(|e| format!("{e:7.3}")).concat());
        for ((n, e), known) in MAPS.iter().zip(errors).zip(table) {
            if [4, 16, 64].contains(n) {
                assert!(e <= known + 0.03, "{id}, {n} maps: {e}, known {known}");
            }
            if id == "f1_sun_beach_one" && *n <= 4 {
                assert!(e < known, "{id}, {n} maps: {e}, known {known}");
            }
        }
    }
}

/// With what is below in the light: a matt plane of albedo 0.6 under its sky.
fn over_its_plane(mut scene: Scene) -> Scene {
    let mut sum = [0.0f32; 3];
    for (d, r) in scene.samples.directions.iter().zip(&scene.samples.radiance) {
        (0..3).for_each(|c| sum[c] += r[c] * d[2] * d[3]);
    }
    let [r, g, b] = sum.map(|e| 0.6 * e / std::f32::consts::PI);
    for k in 0..scene.samples.directions.len() {
        let [x, y, z, w] = scene.samples.directions[k];
        scene.samples.directions.push([x, y, -z, w]);
        scene.samples.radiance.push([r, g, b, 0.0]);
    }
    scene
}

/// The paper's split over the plane's own light, as the formulas' table has it.
const PAPER: [(&str, f32); 4] = [
    ("f1_sun_beach_one", 0.93),
    ("f1_studio_lamps_five", 2.06),
    ("f1_room_windows_five", 0.18),
    ("f1_overcast_city_figure20", 0.21),
];

#[test]
fn the_papers_split_costs_what_the_formulas_say() {
    let Some(shared) = support::shared("the_papers_split_costs_what_the_formulas_say") else { return };
    for (id, known) in PAPER {
        let scene = over_its_plane(scene(&shared, id, 3));
        let lights = split(&project_sh(&scene.samples, 4), &SplitOptions::default()).into();
        let e = error(&ratios(&lights, &scene.spheres, &scene.points), &scene.truth);
        println!("{id:28} paper {e:.3}, known {known}");
        assert!((e / known - 1.0).abs() < 0.2, "{id}: {e}, known {known}");
    }
}

/// Why the product is 20.2 % below the table's figure for the paper's split of studio_lamps (tests/f1_table.rs), where exact
/// visibility is 18.1 % below: the shadow map is not to blame (of 4096 texels, or with 1 to 8 taps, it moves the figure by
/// 0.2 % at most), but the paper's own Section 6.2, which cuts the product of soft light and lobe to the order of the light.
#[test]
fn cutting_the_soft_transfer_makes_the_papers_split_better_than_the_table() {
    let Some(shared) = support::shared("cutting_the_soft_transfer") else { return };
    let scene = over_its_plane(scene(&shared, "f1_studio_lamps_five", 1));
    let lights: Lights = split(&project_sh(&scene.samples, 4), &SplitOptions::default()).into();
    let exact = ratios(&lights, &scene.spheres, &scene.points);
    let clamped: Vec<f32> = exact.iter().map(|ratio| ratio.clamp(0.0, 1.0)).collect();
    // What the product takes at a point, with every sphere as it is.
    let terms = LightTerms::of(&lights);
    let mut transfer = Transfer::default();
    transfer.update(&terms);
    let row = transfer.of_normal(Vec3::Z);
    let whole = gray(shade_surface::whole(&terms, Vec3::Z));
    let count = 2 * DIRECTIONS;
    let blocked: Vec<(Vec3, f32)> = (0..count)
        .map(|j| {
            let z = 1.0 - 2.0 * (j as f32 + 0.5) / count as f32;
            let phi = std::f32::consts::PI * (1.0 + 5f32.sqrt()) * (j as f32 + 0.5);
            let r = (1.0 - z * z).sqrt();
            let w = Vec3::new(r * phi.cos(), r * phi.sin(), z);
            let mut y = [0.0f32; 36];
            evaluate(4, w.to_array(), &mut y);
            let radiated: f32 = row.iter().zip(&y[..16]).map(|(t, y)| gray(*t) * y).sum();
            (w, std::f32::consts::PI * radiated * 4.0 * std::f32::consts::PI / count as f32)
        })
        .collect();
    let sun = &lights.hard.as_slice()[0];
    let to_sun = Vec3::from(sun.to_light_world);
    let cut: Vec<f32> = scene
        .points
        .par_iter()
        .map(|&p| {
            let soft: f32 = blocked.iter().filter(|d| !scene.spheres.open(p, d.0)).map(|d| d.1).sum();
            let hard = if scene.spheres.open(p, to_sun) { 0.0 } else { gray(sun.irradiance_rgb) * to_sun.z };
            (1.0 - (soft.max(0.0) + hard) / whole).clamp(0.0, 1.0)
        })
        .collect();
    let [exact, clamped, cut] = [&exact, &clamped, &cut].map(|got| error(got, &scene.truth) / 2.06 - 1.0);
    println!("against 2.06: exact {exact:+.3}, within 0 to 1 {clamped:+.3}, cut to order 4 {cut:+.3}");
    // Measured: -0.181, -0.185, -0.205; the product lies between the last two.
    assert!((exact + 0.181).abs() < 0.004, "{exact}");
    assert!((clamped + 0.185).abs() < 0.004, "{clamped}");
    assert!((cut + 0.205).abs() < 0.004, "{cut}");
}
