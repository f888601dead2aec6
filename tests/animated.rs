//! Figures that move in the bundled recording, through the daemon's own pipeline; and that nothing pops.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::Vec3;
use halflight::animate::posed::Posed;
use halflight::assets::{scene, spheres};
use halflight::compose::{shade_object::LightTerms, soft_shadow};
use halflight::config::settings::Settings;
use halflight::daemon::{host::Host, prepare::prepare};
use halflight::model::{
    blocker::Rung,
    light::{Lights, RadianceSh},
    time::Timestamp,
};
use halflight::visibility::blockers::Blockers;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Runs some frames with a scene; pictures of the last two, and how many were relit.
fn run(scene: &Path, frames: usize) -> (Vec<Vec<[f32; 3]>>, usize) {
    let settings = Settings {
        camera: format!("replay:{}", root().join("tests/recordings/desk.mcap").display()),
        scene_file: scene.display().to_string(),
        ..Settings::default()
    };
    let mut prepared = prepare(&settings, &Host::default()).unwrap();
    let (mut pictures, mut relit) = (Vec::new(), 0);
    for _ in 0..frames {
        let frame = prepared.source.next(Timestamp(i64::MAX)).unwrap();
        let outcome = prepared.pipeline.frame(&frame).unwrap();
        relit += usize::from(!outcome.shown.is_passed_through());
        let picture = &prepared.pipeline.picture().radiance;
        assert!(picture.pixels().iter().flatten().all(|c| c.is_finite() && *c >= 0.0));
        pictures.push(picture.pixels().to_vec());
    }
    (pictures.split_off(frames - 2), relit)
}

/// Share of pixels where two pictures differ by more than a tenth.
fn changed(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let apart = |(a, b): &(&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > 0.1 * a[c].max(b[c]));
    a.iter().zip(b).filter(apart).count() as f64 / a.len() as f64
}

/// A scene with one object, as text.
fn scene_with(name: &str, object: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("halflight-animated-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(format!("{name}.toml"));
    let table = "[[surface]]\nname = \"table\"\nshape = \"plane\"\nhalf_extent = 0.6\n\n[[object]]\n";
    std::fs::write(&path, format!("{table}{object}")).unwrap();
    path
}

#[test]
fn the_walker_walks_on_the_table() {
    let walker = root().join("tests/scenes/walker.toml");
    let (with, relit) = run(&walker, 8);
    assert!(relit >= 5, "{relit} of 8 frames relit");
    // Against the same frames with nothing virtual: the figure, and its shadow.
    let nothing = scene_with(
        "nothing",
        "name = \"far\"\nshape = \"sphere\"\nradius_m = 0.01\nposition = [5.0, 5.0, 0.0]\n",
    );
    let (without, _) = run(&nothing, 8);
    let share = changed(&with[1], &without[1]);
    println!("{:.1} % of the pixels are the figure's or its shadow's", 100.0 * share);
    assert!((0.02..0.2).contains(&share), "{share}");
    let darker = with[1].iter().zip(&without[1]).filter(|(a, b)| a[1] < 0.8 * b[1]).count();
    assert!(darker > 1000, "{darker} pixels in its shadow");
}

#[test]
fn other_peoples_figures_walk_too() {
    let Some(shared) = support::shared("other_peoples_figures_walk_too") else { return };
    for (file, clip) in [("RobotExpressive.glb", "Walking"), ("Fox.glb", "Walk")] {
        let model = shared.join("data/models").join(file);
        let object = format!(
            "file = {:?}\nheight_m = 0.15\nanimation = {clip:?}\nspheres = 16\n\
             path = [[0.13, -0.09], [0.25, -0.07], [0.24, 0.08], [0.13, 0.14]]\npath_speed_m_s = 0.15\n",
            model.display().to_string()
        );
        let path = scene_with(clip, &object);
        let loaded = scene::load(&path).unwrap();
        let mut scene = loaded.scene.clone();
        spheres::fit_scene(&mut scene, None, &mut |_| ());
        assert!(scene.figures[0].spheres.len() >= 12, "{file}: {} spheres", scene.figures[0].spheres.len());
        let (pictures, relit) = run(&path, 6);
        assert!(relit >= 3, "{file}: {relit} of 6 frames relit");
        let share = changed(&pictures[0], &pictures[1]);
        assert!(share > 0.002, "{file} stands still: {share}");
    }
}

#[test]
fn a_static_receiver_does_not_see_the_figure_pop() {
    let mut scene = scene::load(&root().join("tests/scenes/walker.toml")).unwrap().scene;
    spheres::fit_scene(&mut scene, None, &mut |_| ());
    assert!(scene.figures[0].spheres.len() >= 12);
    let mut global = RadianceSh::zero(4);
    global.rgb[0] = [3.5; 3];
    global.rgb[2] = [1.0; 3];
    let light = LightTerms::of(&Lights::soft(global));
    let mut transfer = soft_shadow::Transfer::default();
    transfer.update(&light);
    let mut posed = Posed::new(&scene);
    let mut blockers = Blockers::new();
    // Points of the table under and around the way.
    let points: Vec<Vec3> = (0..64)
        .map(|k| Vec3::new(0.06 + 0.03 * (k % 8) as f32, -0.12 + 0.04 * (k / 8) as f32, 0.0))
        .collect();
    let whole = transfer.of_normal(Vec3::Z)[0][0] * (4.0 * std::f32::consts::PI).sqrt();
    let mut ratios = |t_s: f64, rung: Rung| -> Vec<f32> {
        posed.update(&scene, t_s);
        blockers.prepare(posed.spheres(), rung, 4, 128);
        points
            .iter()
            .map(|p| 1.0 - soft_shadow::taken(&blockers, &transfer, None, *p, Vec3::Z)[0] / whole)
            .collect()
    };
    // A tenth of a millimetre of the walk from step to step, over a tenth of a second.
    let (mut last, mut worst, mut range) = (ratios(0.0, Rung::Directions), 0.0f32, (1.0f32, 0.0f32));
    for step in 1..=120 {
        let now = ratios(f64::from(step) / 1200.0, Rung::Directions);
        for (a, b) in now.iter().zip(&last) {
            worst = worst.max((a - b).abs());
            range = (range.0.min(*a), range.1.max(*a));
        }
        last = now;
    }
    println!("largest step of a ratio: {worst:.5}, ratios within {range:?}");
    // Feet swing several times as fast as the body walks. Measured: 0.0008; a step of 8 bits is 0.004.
    assert!(worst < 0.0016, "{worst}");
    assert!(range.0 < 0.8 && range.1 <= 1.02, "{range:?}");
}
