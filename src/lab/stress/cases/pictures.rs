//! Pictures of one pixel and of very many, and what half floats lose.

use crate::engine::{Bracket, Engine, EngineError};
use crate::model::{
    frame::Exposure,
    image::{HdrImage, Image},
    response::Response,
    scene::Scene,
};
use crate::nearfield::packed::{pack, unpack};
use crate::plan::Pass;
use crate::stress::{
    CaseBound, HardCase, Where, naive,
    stage::{StressStage, spheres, uniform},
};
use glam::Vec3;

/// The camera's picture alone, shown.
fn shown(background: f32, exposure_s: f64, size_px: [u32; 2]) -> StressStage {
    StressStage {
        background,
        exposure_s,
        size_px,
        display: true,
        ..StressStage::new(Scene::default(), uniform(0.0))
    }
}

/// The first 8-bit value of what is shown.
fn value(engine: &mut dyn Engine, stage: &StressStage) -> Result<f64, EngineError> {
    Ok(stage.draw(engine)?.display.pixels().first().map_or(f64::NAN, |p| f64::from(p[1])))
}

/// A picture in which every fourth pixel is brighter, by numbers that f32 does not hold in a large picture: how many
/// pixels of the merged one are another's.
fn exchanged(engine: &mut dyn Engine, width: usize, height: usize) -> Result<f64, EngineError> {
    let pixels = (0..width * height).map(|k| [if k % 4 == 3 { 200 } else { 100 }; 3]).collect();
    let picture = Image::from_pixels(width, height, pixels).unwrap_or_default();
    let mut out = HdrImage::default();
    let bracket = Bracket { pictures: &[&picture], exposures: &[Exposure { time_s: 0.01, gain: 1.0 }] };
    engine.merge_bracket(&bracket, &Response::srgb(), &mut out)?;
    let bright = |k: usize| out.radiance.pixels()[k][1] > 30.0;
    Ok((0..width * height).filter(|&k| bright(k) != (k % 4 == 3)).count() as f64)
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "a picture of one pixel",
        measures: "light that is left in it",
        formula: "u = x / (width - 1) = 0/0",
        runs: Where::Kernel(Pass::Composite),
        textbook: || f64::from(naive::column_share(0, 1)),
        ours: |engine| {
            let scene = spheres([(Vec3::new(0.0, 0.0, 0.1), 0.1)]);
            StressStage { size_px: [1, 1], ..StressStage::new(scene, uniform(1.0)) }.least_share(engine)
        },
        bound: CaseBound::SHARE,
    },
    HardCase {
        name: "a picture of 8192 x 4096",
        measures: "pixels that are another's after the merge",
        formula: "pixel number y width + x in f32: above 2^24 only even ones",
        runs: Where::Kernel(Pass::MergeBracket),
        textbook: || {
            let (width, height) = (8192, 4096);
            let row = |y| {
                (0..width).filter(move |&x| naive::pixel_number(x, y, width) as u32 != y * width + x).count()
            };
            (0..height).map(row).sum::<usize>() as f64
        },
        ours: |engine| exchanged(engine, 8192, 4096),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "sixteen texels of 5000",
        measures: "their mean",
        formula: "sum, then divide, in half floats: infinity",
        runs: Where::Kernel(Pass::ProjectSh),
        textbook: || f64::from(naive::running_sum_half([5000.0; 16]) / 16.0),
        ours: |engine| {
            use crate::stress::stage::{even_map, mean_radiance, measure};
            Ok(mean_radiance(&measure(engine, &even_map(4, 4, 5000.0))?.total))
        },
        bound: CaseBound::about(5000.0, 0.01),
    },
    HardCase {
        name: "a transfer of 1e-8",
        measures: "as it was packed into 16 bits, over itself",
        formula: "a half float of it: 0",
        runs: Where::Processor,
        textbook: || f64::from(naive::half(1e-8) / 1e-8),
        ours: |_| Ok(f64::from(unpack(pack(1e-8)) / 1e-8)),
        // 12 bits.
        bound: CaseBound::about(1.0, 2.5e-4),
    },
    HardCase {
        name: "a shadow on a pixel twice as bright as white",
        measures: "8-bit value where a sphere takes nine tenths",
        formula: "T(X) - T(X (1 - share)) light by light: 0 of a saturated value",
        runs: Where::Kernel(Pass::Tonemap),
        // Fifty lights that carry all of it, nine tenths of them hidden.
        textbook: || f64::from(naive::left_of_display(2.0, 0.02, 45)),
        ours: |engine| {
            let scene = spheres([(Vec3::new(0.0, 0.0, 0.1), 0.1)]);
            let stage =
                StressStage { background: 2.0, display: true, ..StressStage::new(scene, uniform(1.0)) };
            let picture = stage.draw(engine)?;
            Ok(picture.display.pixels().iter().map(|p| f64::from(p[1])).fold(255.0, f64::min))
        },
        // 2 x 0.03 to 2 x 0.15 of white through sRGB.
        bound: CaseBound::new(60.0, 160.0),
    },
    HardCase {
        name: "fifty lights that carry a tenth, taken from white",
        measures: "8-bit values that are taken (12 by sRGB)",
        formula: "S = T(X) - T(X (1 - 1/500)) of each, rounded: below a half",
        runs: Where::Kernel(Pass::Tonemap),
        textbook: || f64::from(naive::displayed(1.0) - naive::left_of_display(1.0, 0.002, 50)),
        ours: |engine| Ok(255.0 - value(engine, &shown(0.9, 1.0, [4, 4]))?),
        bound: CaseBound::about(12.0, 1.0),
    },
    HardCase {
        name: "what rounding left of no light, shown",
        measures: "8-bit value",
        formula: "255 (6e-8)^(1/2.2), a third of a step after two such",
        runs: Where::Kernel(Pass::Tonemap),
        textbook: || f64::from(255.0 * (3.0f32 * 6e-8).powf(1.0 / 2.2)),
        ours: |engine| value(engine, &shown(6e-8, 1.0, [4, 4])),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "light a million times too bright, shown",
        measures: "8-bit value",
        formula: "255 L^(1/2.2), then cut to 8 bits",
        runs: Where::Kernel(Pass::Tonemap),
        textbook: || f64::from((255.0 * 1e6f32.powf(1.0 / 2.2)) as u32 % 256),
        ours: |engine| value(engine, &shown(1e6, 1.0, [4, 4])),
        bound: CaseBound::exactly(255.0),
    },
    HardCase {
        name: "light times exposure beyond f32, shown",
        measures: "8-bit value",
        formula: "L t = infinity, infinity / (1 + infinity)",
        runs: Where::Kernel(Pass::Tonemap),
        textbook: || {
            let x = 1e30f32 * 1e20;
            f64::from(x / (1.0 + x))
        },
        ours: |engine| value(engine, &shown(1e30, 1e20, [4, 4])),
        bound: CaseBound::exactly(255.0),
    },
];
