//! F2: mesh, ball and mirror ball on a plane under a distant environment, against ray-traced truth: not through a camera, a
//! recording or the pipeline; the picture of the place is shaded by the laboratory.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::assets::pictures;
use halflight::engine::cpu::CpuEngine;
use halflight::lab::case::{self, compare, of_case};
use halflight::model::{
    image::{Image, RadianceImage},
    quality::{Quality, SelfShadow},
};

/// Logarithm of gray, so that the sun's few pixels do not decide alone.
fn logarithms(picture: &RadianceImage) -> Vec<f64> {
    let gray = |p: &[f32; 3]| f64::from(0.3 * p[0] + 0.59 * p[1] + 0.11 * p[2]);
    picture.pixels().iter().map(|p| gray(p).max(1e-3).ln()).collect()
}

/// Bilinear between pixel centres.
fn at(values: &[f64], width: usize, x: f64, y: f64) -> f64 {
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    let pixel = |dx: usize, dy: usize| values[(top as usize + dy) * width + left as usize + dx];
    (1.0 - fy) * ((1.0 - fx) * pixel(0, 0) + fx * pixel(1, 0))
        + fy * ((1.0 - fx) * pixel(0, 1) + fx * pixel(1, 1))
}

/// The shift of `ours` that correlates best with `truth` over the pixels, and that correlation.
fn best_shift(ours: &[f64], truth: &[f64], width: usize, pixels: &[usize]) -> (f64, f64, f64) {
    let mut best = (0.0, 0.0, f64::NEG_INFINITY);
    for j in -8..=8 {
        for i in -8..=8 {
            let (dx, dy) = (0.25 * f64::from(i), 0.25 * f64::from(j));
            let pairs = pixels
                .iter()
                .map(|&p| (at(ours, width, (p % width) as f64 + dx, (p / width) as f64 + dy), truth[p]));
            let (mut a, mut b, mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (x, y) in pairs {
                (a, b, aa, bb, ab) = (a + x, b + y, aa + x * x, bb + y * y, ab + x * y);
            }
            let n = pixels.len() as f64;
            let correlation = (ab - a * b / n) / ((aa - a * a / n) * (bb - b * b / n)).sqrt();
            if correlation > best.2 {
                best = (dx, dy, correlation);
            }
        }
    }
    best
}

/// Pixels whose neighbours up to three away are wholly covered, too.
fn inside(mask: &Image<u8>) -> Vec<usize> {
    let (width, height) = (mask.width(), mask.height());
    (0..width * height)
        .filter(|i| {
            let (x, y) = (i % width, i / width);
            x >= 3
                && y >= 3
                && x + 3 < width
                && y + 3 < height
                && (y - 3..=y + 3).all(|v| (x - 3..=x + 3).all(|u| *mask.at(u, v) == 255))
        })
        .collect()
}

#[test]
fn f2_mirrors_show_the_place_where_it_is() {
    let Some(shared) = support::shared("f2_mirrors_show_the_place_where_it_is") else { return };
    for id in ["f2_sun_beach", "f2_room_windows"] {
        let case = case::load(&shared.join("reference").join(id)).unwrap();
        let quality = Quality::default();
        let still = of_case(&case, "beauty", &quality).unwrap();
        let drawn = still.draw(&mut CpuEngine::new(Some(2)).unwrap(), &quality, None, 0).unwrap();
        let truth = pictures::load_raw(&case.image("beauty").unwrap().file).unwrap();
        let mask = pictures::load_gray8(&case.image("mask_mirror").unwrap().file).unwrap();
        println!("{id} {}", compare(&case, "beauty", &still, &drawn).unwrap());
        let (ours, theirs) = (logarithms(&drawn.radiance), logarithms(&truth));
        let pixels = inside(&mask);
        assert!(pixels.len() > 200, "{}", pixels.len());
        let (dx, dy, correlation) = best_shift(&ours, &theirs, mask.width(), &pixels);
        let mut off: Vec<f64> = pixels.iter().map(|&p| (ours[p] - theirs[p]).abs()).collect();
        off.sort_by(f64::total_cmp);
        let median = off[off.len() / 2];
        println!("{id}: shift {dx}, {dy} px, correlation {correlation:.4}, median error {median:.4} in ln");
        assert!(dx.hypot(dy) < 1.0 && correlation > 0.8 && median < 0.1, "{id}");
    }
}

/// The matt ball and the bunny within 4 % of the true mean radiance with the settings as they are by default; the bunny
/// stands in its own soft shadow and that of its neighbours.
#[test]
fn f2_matt_objects_have_the_right_brightness() {
    let Some(shared) = support::shared("f2_matt_objects_have_the_right_brightness") else { return };
    for id in ["f2_sun_beach", "f2_room_windows"] {
        let case = case::load(&shared.join("reference").join(id)).unwrap();
        let mut of_bunny = Vec::new();
        let openness = Quality { self_shadow: SelfShadow::Openness, ..Quality::default() };
        for (what, quality) in [
            ("openness", openness),
            ("as by default", Quality::default()),
            ("order 6", Quality { sh_order: 6, ..Quality::default() }),
        ] {
            let still = of_case(&case, "beauty", &quality).unwrap();
            let drawn = still.draw(&mut CpuEngine::new(Some(2)).unwrap(), &quality, None, 0).unwrap();
            let compared = compare(&case, "beauty", &still, &drawn).unwrap();
            for mask in compared.masks.iter().filter(|m| m.name != "mask_mirror") {
                let (name, ratio, rmse) = (&mask.name, mask.mean_ratio, mask.relative_rmse);
                println!("{id} {what} {name}: mean {ratio:.4}, rmse {rmse:.4}");
                if name == "mask_ball" {
                    assert!((ratio - 1.0).abs() < 0.04, "{id}: {ratio}");
                } else {
                    of_bunny.push((ratio, rmse));
                }
            }
        }
        // Measured: 1.7 and 0.3 % off; by the openness 9.0 and 3.0 %.
        assert!((of_bunny[1].0 - 1.0).abs() < 0.025, "{id}: {of_bunny:?}");
        assert!(of_bunny[1].1 < of_bunny[0].1, "transfer is better than openness: {id}: {of_bunny:?}");
    }
}
