//! F1 of the reference: what every split, number of maps and rung costs, as a table, and what must hold of it. Not through a
//! camera, a recording or the pipeline: the light is the case's environment picture, halved and drawn by the product.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::engine::cpu::CpuEngine;
use halflight::lab::case::{self, compare, of_case};
use halflight::model::{
    blocker::Rung,
    quality::{Quality, SoftAt, SplitKind},
};
use std::path::Path;
use support::wanted;

/// Relative RMSE of the gray ratio where it is below 0.93 in truth and no sphere covers the pixel.
fn error(shared: &Path, id: &str, quality: &Quality) -> f64 {
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let still = of_case(&case, "ratio", quality).unwrap();
    let drawn = still.draw(&mut CpuEngine::new(Some(2)).unwrap(), quality, None, 0).unwrap();
    compare(&case, "ratio", &still, &drawn).unwrap().shadow.unwrap().relative_rmse
}

fn row(shared: &Path, id: &str, name: &str, columns: &[(&str, Quality)]) -> Vec<f64> {
    let errors: Vec<f64> = columns.iter().map(|(_, q)| error(shared, id, q)).collect();
    let cells: Vec<String> = columns.iter().zip(&errors).map(|((c, _), e)| format!("{c}: {e:.3}")).collect();
    println!("{id:27} {name:8} {}", cells.join("  "));
    errors
}

/// What the formulas' section 4b has for the paper's split over the plane. The rows of `wanted.tsv` for n = 4, 16 and 64
/// are its errors with exact visibility, and 0.03.
const KNOWN: [(&str, f64); 4] = [
    ("f1_sun_beach_one", 0.93),
    ("f1_studio_lamps_five", 2.06),
    ("f1_room_windows_five", 0.18),
    ("f1_overcast_city_figure20", 0.21),
];

#[test]
fn every_split_and_number_of_maps() {
    let Some(shared) = support::shared("every_split_and_number_of_maps") else { return };
    let compact = |shadow_maps| Quality { shadow_maps, ..Quality::default() };
    for (id, paper) in KNOWN {
        let maps = [("4", compact(4)), ("16", compact(16)), ("64", compact(64))];
        let short = &id[3..];
        for ((maps, _), error) in maps.iter().zip(row(&shared, id, "compact", &maps)) {
            wanted::hold(&format!("f1.{short}.compact.{maps}"), error);
        }
        let split = |split| Quality { split, ..Quality::default() };
        let others = [
            ("paper", split(SplitKind::Paper)),
            ("bounded", split(SplitKind::Bounded)),
            ("sh", split(SplitKind::Sh)),
        ];
        let errors = row(&shared, id, "split", &others);
        println!("{:36} paper's split over the plane, known: {paper}", "");
        // Within 20 % of the known column but for studio_lamps, which is 20.2 % below. Exact visibility of all light is
        // 18.1 % below it, ratios kept within 0 to 1 18.5 %, and with the product of soft light and lobe cut to order 4, as
        // Section 6.2 of [Now11] does, 20.5 % (tests/split_dial.rs). The shadow map has no part in it: 4096 texels make it
        // 20.16 %, one tap 20.15 %, eight taps 20.3 %. The column is what an error costs: less is not worse.
        wanted::hold(&format!("f1.{short}.paper"), errors[0] / paper - 1.0);
    }
    // Under a sun few maps do better than by energy times extent (0.34 at n = 2, 0.31 at n = 4).
    let few = [("1", compact(1)), ("2", compact(2))];
    for ((maps, _), error) in few.iter().zip(row(&shared, "f1_sun_beach_one", "compact", &few)) {
        wanted::hold(&format!("f1.sun_beach_one.compact.{maps}"), error);
    }
}

#[test]
fn every_rung() {
    let Some(shared) = support::shared("every_rung") else { return };
    for id in ["f1_room_windows_five", "f1_studio_lamps_five"] {
        let with = |rung| Quality { shadow_maps: 64, soft_step_px: 2, rung, ..Quality::default() };
        let columns = Rung::ALL.map(|rung| (rung.name(), with(rung)));
        let errors = row(&shared, id, "rung", &columns);
        // 256 directions stand for exact visibility.
        let best = Quality { directions: 256, ..with(Rung::Directions) };
        let exact = row(&shared, id, "rung", &[("directions 256", best)])[0];
        let hybrid = errors[Rung::ALL.iter().position(|r| *r == Rung::Hybrid).unwrap()];
        wanted::hold(&format!("f1.{}.hybrid", &id[3..]), hybrid - exact);
        assert!(errors.iter().all(|e| e.is_finite()));
    }
}

#[test]
fn coarser_soft_shadows() {
    let Some(shared) = support::shared("coarser_soft_shadows") else { return };
    for id in ["f1_room_windows_five", "f1_overcast_city_figure20"] {
        let with =
            |soft_step_px| Quality { soft_step_px, directions: 256, shadow_maps: 64, ..Quality::default() };
        let columns = [("every pixel", with(1)), ("every 2nd", with(2)), ("every 4th", with(4))];
        let errors = row(&shared, id, "step", &columns);
        // Measured: at most 0.004 apart.
        assert!(errors.iter().all(|e| (e - errors[0]).abs() < 0.008), "{id}: {errors:?}");
    }
}

/// At the vertices of a grid that is as fine as the distance to the nearest sphere asks, against every pixel.
#[test]
fn soft_shadows_at_vertices() {
    let Some(shared) = support::shared("soft_shadows_at_vertices") else { return };
    for id in ["f1_room_windows_five", "f1_overcast_city_figure20", "f1_studio_lamps_five"] {
        let with = |soft_at, soft_step_px| Quality {
            soft_at,
            soft_step_px,
            directions: 256,
            shadow_maps: 64,
            ..Quality::default()
        };
        let columns = [
            ("every pixel", with(SoftAt::Pixel, 1)),
            ("every 4th", with(SoftAt::Pixel, 4)),
            ("vertices", with(SoftAt::Vertex, 1)),
            ("vertices, every 4th", with(SoftAt::Vertex, 4)),
        ];
        let errors = row(&shared, id, "at", &columns);
        // Measured: at most 0.004 apart (every 4th pixel), 0.001 at vertices.
        assert!((errors[2] - errors[0]).abs() < 0.003, "{id}: {errors:?}");
        assert!(errors.iter().all(|e| (e - errors[0]).abs() < 0.006), "{id}: {errors:?}");
    }
}
