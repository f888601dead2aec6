//! Samples a second of `reference::trace` on the ray-traced reference cases, against the renderer that made them.

use halflight::assets::case;
use halflight::reference::{TraceSettings, trace};
use std::{path::PathBuf, time::Instant};

/// Mitsuba 3.9.1, `scalar_rgb`, direct light, one emitter sample a camera sample, on two cores of the machine that made the
/// reference: from its slowest to its fastest case, millions of samples a second.
const PEER_MSAMPLES_S: [f64; 2] = [0.69, 1.14];
const RUNS: usize = 3;
/// Every third pixel of every third row, 128 samples each: 700,000 samples.
const SETTINGS: TraceSettings =
    TraceSettings { samples: 128, samples_a_pass: 64, bounces: 0, seed: 0, step_px: 3, shadow_noise: None };

/// Prints the figures.
pub fn run() {
    let shared = std::env::var_os("HALFLIGHT_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    println!(
        "truth: direct light, with and without the objects at once, {cores} cores, millions of samples a second"
    );
    for (id, image) in [
        ("f1_overcast_city_one_b", "with"),
        ("f1_sun_beach_figure20", "with"),
        ("f2_room_windows", "beauty"),
        ("f3_ceiling_light", "obj_raised"),
        ("f4_sun45", "beauty"),
        ("f5_sun_beach", "hdr"),
    ] {
        let scene = case::load(&shared.join("reference").join(id)).and_then(|c| c.trace_scene(Some(image)));
        let scene = match scene {
            Ok(scene) => scene,
            Err(error) => {
                println!("  SKIPPED {id}: {error}");
                continue;
            }
        };
        let mut best = f64::INFINITY;
        for _ in 0..RUNS {
            let start = Instant::now();
            let traced = trace(&scene, &SETTINGS, &|_| ()).expect("a sound scene");
            let samples = f64::from(traced.samples) * traced.with().pixels().len() as f64;
            best = best.min(start.elapsed().as_secs_f64() / samples);
        }
        let speed = 1e-6 / best;
        println!(
            "  {id:<26}{speed:8.2}   ours / Mitsuba's {:.1} to {:.1} (two cores: {} to {})",
            speed / PEER_MSAMPLES_S[1],
            speed / PEER_MSAMPLES_S[0],
            PEER_MSAMPLES_S[0],
            PEER_MSAMPLES_S[1]
        );
    }
}
