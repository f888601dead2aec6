//! The shadow on the pouf against a photographed one: the mirror ball's own. A black sphere of the ball's size, put where
//! the ball was, must darken the photograph without the ball where and about as much as the ball did.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{Affine3A, DVec3, Vec3};
use halflight::assets::{pictures, scene, shapes};
use halflight::cli::render::of_scene;
use halflight::engine::cpu::CpuEngine;
use halflight::math::color::{gray, srgb_decode};
use halflight::model::{
    animation::Figure,
    image::Rgb8Image,
    quality::{Quality, SplitKind},
    scene::{Material, VirtualObject},
};
use std::path::Path;

/// Cells of 2 cm on the pouf's top, from -18 to +18 cm.
const SIDE: usize = 19;
type Cells = [[f64; SIDE]; SIDE];

fn linear_gray(picture: &Rgb8Image, i: usize) -> f64 {
    gray(picture.pixels()[i].map(|c| srgb_decode(f64::from(c) / 255.0)))
}

/// Means over 3 x 3 cells: the cloth's pattern and the noise are finer.
fn smooth(cells: &Cells) -> Cells {
    let mut out = [[0.0; SIDE]; SIDE];
    for (y, row) in out.iter_mut().enumerate() {
        for (x, cell) in row.iter_mut().enumerate() {
            let mut count = 0.0;
            for v in y.saturating_sub(1)..(y + 2).min(SIDE) {
                for u in x.saturating_sub(1)..(x + 2).min(SIDE) {
                    *cell += cells[v][u];
                    count += 1.0;
                }
            }
            *cell /= count;
        }
    }
    out
}

/// Where the glass stands, hides the pouf, or throws its caustics; and the edge behind it, where the two photographs
/// differ by what they show beyond.
fn is_clear(x: usize, y: usize) -> bool {
    let around_glass = (6..=13).contains(&x) && (8..=15).contains(&y);
    !around_glass && y < 15
}

fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let mean = pairs.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / n, s.1 + p.1 / n));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in pairs {
        let (dx, dy) = (x - mean.0, y - mean.1);
        (xx, yy, xy) = (xx + dx * dx, yy + dy * dy, xy + dx * dy);
    }
    xy / (xx * yy).sqrt()
}

#[test]
fn the_shadow_on_the_pouf_is_the_balls() {
    let Some(shared) = support::shared("the_shadow_on_the_pouf_is_the_balls") else { return };
    let mut file = scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/real/ola.toml")).unwrap();
    let ball = file.ball.unwrap();
    let place = Affine3A::from_translation(ball.centre_world.as_vec3());
    file.scene.objects = vec![VirtualObject {
        name: "ball".into(),
        mesh: shapes::icosphere(ball.radius_m, 4),
        material: Material::Lambert { albedo_rgb: [0.0; 3] },
        world_from_object: place,
        openness: Vec::new(),
    }];
    let whole = std::iter::once((Vec3::ZERO, ball.radius_m as f32));
    file.scene.figures = vec![Figure::still("ball".into(), 0, place, whole)];
    let camera = file.camera.clone().unwrap();
    let camera_from_world = camera.world_from_camera.inverse();
    let width = camera.lens.width as usize;

    // Mean over a cell of what a picture holds at the pixels of 5 x 5 points in it.
    let cells = |of: &dyn Fn(usize) -> f64| -> Cells {
        std::array::from_fn(|iy| {
            std::array::from_fn(|ix| {
                let mut sum = 0.0;
                for k in 0..25 {
                    let at = |i: usize, k: usize| 0.02 * (i as f64 - 9.0) + 0.004 * (k as f64 - 2.0);
                    let p = DVec3::new(at(ix, k % 5), at(iy, k / 5), 0.0);
                    let px = camera.lens.project(camera_from_world.transform(p)).unwrap();
                    sum += of(px.y as usize * width + px.x as usize) / 25.0;
                }
                sum
            })
        })
    };
    // Both photographs are exposed 1/40 s.
    let folder = shared.join("data/mirrorball");
    let without = pictures::load_rgb8(&folder.join("ola_raw0.jpg")).unwrap();
    let with = pictures::load_rgb8(&folder.join("ola_raw2.jpg")).unwrap();
    let (dark, lit) = (cells(&|i| linear_gray(&with, i)), cells(&|i| linear_gray(&without, i)));
    let real = smooth(&std::array::from_fn(|y| std::array::from_fn(|x| dark[y][x] / lit[y][x])));

    let measure = |split: SplitKind, shadow_maps: usize| {
        let quality = Quality { split, shadow_maps, ..Quality::default() };
        let mut engine = CpuEngine::new(None).unwrap();
        let still = of_scene(&file, &mut engine, &quality, &mut Vec::new()).unwrap();
        let drawn = still.draw(&mut engine, &quality, None, 0).unwrap();
        let ratio = |i: usize| {
            f64::from(gray(drawn.radiance.pixels()[i]) / gray(still.background.radiance.pixels()[i]))
        };
        let ours = smooth(&cells(&ratio));
        let mut pairs = Vec::new();
        for y in 0..SIDE {
            for x in (0..SIDE).filter(|&x| is_clear(x, y)) {
                pairs.push((ours[y][x], real[y][x]));
            }
        }
        let squares: f64 = pairs.iter().map(|(a, b)| (a - b).powi(2)).sum();
        let rmse = (squares / pairs.len() as f64).sqrt();
        // The core of the real shadow, and what it leaves alone.
        let mean = |inside: &dyn Fn(f64) -> bool| {
            let some: Vec<&(f64, f64)> = pairs.iter().filter(|p| inside(p.1)).collect();
            let n = some.len() as f64;
            (some.iter().map(|p| p.0).sum::<f64>() / n, some.iter().map(|p| p.1).sum::<f64>() / n)
        };
        let (core, open) = (mean(&|real| real < 0.85), mean(&|real| real > 0.96));
        let found = correlation(&pairs);
        println!(
            "{:8} {shadow_maps:2} maps: correlation {found:5.2}, RMSE {rmse:.3}; in the real shadow's core {:.3} (real {:.3}), \
             outside of it {:.3} (real {:.3})",
            split.name(),
            core.0,
            core.1,
            open.0,
            open.1
        );
        (found, rmse, core, open)
    };
    let (found, rmse, core, open) = measure(SplitKind::Compact, Quality::default().shadow_maps);
    let many = measure(SplitKind::Compact, 32);
    let (paper, none) = (measure(SplitKind::Paper, 1), measure(SplitKind::Sh, 1));
    // Measured 0.78 and 0.89 with 8 and 32 maps, RMSE 0.057 and 0.055, against 0.41 and 0.078 by net flux (whose hard
    // shadow lies elsewhere), 0.28 and 0.080 without lights.
    assert!(found > 0.7 && many.0 > 0.8, "correlation {found}, {}", many.0);
    assert!(paper.0 < 0.6 * found && none.0 < 0.6 * found, "{} {}", paper.0, none.0);
    assert!(rmse < 0.065 && rmse < 0.8 * paper.1 && rmse < 0.8 * none.1, "RMSE {rmse}");
    // The shadow is there, and nowhere else. It is half as deep as the real one (0.89 for 0.80). Lamps saturated in the
    // shortest photograph are only known from below, and the glass under the ball throws a shadow of its own; a response
    // solved from the pictures in place of sRGB changes nothing (0.90).
    assert!(core.0 < 0.92 && open.0 > 0.96, "{core:?} {open:?}");
}
