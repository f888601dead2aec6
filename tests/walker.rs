//! The project's own figure: made by code, kept as `tests/scenes/walker.glb`, and walking without sliding.
//! `UPDATE_EXPECT=1 cargo test --test walker` writes the file anew.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use glam::Vec3;
use halflight::animate::posed::Posed;
use halflight::assets::{gltf, walker};
use halflight::model::{
    animation::{Attachment, Playing},
    scene::Scene,
};
use std::path::Path;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/walker.glb");

fn bytes() -> Vec<u8> {
    let extras = serde_json::json!({
        "walk_speed_m_s": walker::WALK_SPEED_M_S,
        "note": "Made by src/assets/walker. The feet of the clip Walk do not slide at walk_speed_m_s.",
    });
    gltf::write::encode(&walker::walker(), extras).unwrap()
}

fn playing(clip: usize) -> Scene {
    let mut loaded = gltf::load_figure(Path::new(FILE), 0, &|_| ()).unwrap();
    loaded.figure.playing = Some(Playing { clip, from_s: 0.0, speed: 1.0, looped: true });
    Scene { objects: loaded.objects, figures: vec![loaded.figure], ..Scene::default() }
}

#[test]
fn the_file_is_what_the_code_makes() {
    let made = bytes();
    if std::env::var_os("UPDATE_EXPECT").is_some_and(|v| v == "1") {
        std::fs::write(FILE, &made).unwrap();
    }
    let kept = std::fs::read(FILE).unwrap();
    assert!(
        made == kept,
        "tests/scenes/walker.glb is not what the code makes: UPDATE_EXPECT=1 cargo test --test walker"
    );
    assert!(kept.len() < 300_000, "{}", kept.len());
}

#[test]
fn it_reads_back_as_it_was_made() {
    let made = walker::walker();
    let read = gltf::load_figure(Path::new(FILE), 0, &|_| ()).unwrap();
    assert_eq!(read.figure.clips, made.figure.clips);
    assert!(read.figure.skeleton.nodes.starts_with(&made.figure.skeleton.nodes));
    assert_eq!(read.figure.skeleton.joints, made.figure.skeleton.joints);
    assert!(made.figure.skeleton.joints.len() >= 14);
    let [
        Attachment::Skinned { bind_positions: a, joints: ja, weights: wa, .. },
        Attachment::Skinned { bind_positions: b, joints: jb, weights: wb, .. },
    ] = [&made.figure.parts[0].attachment, &read.figure.parts[0].attachment]
    else {
        panic!()
    };
    assert_eq!(a, b);
    for ((ja, wa), (jb, wb)) in ja.iter().zip(wa).zip(jb.iter().zip(wb)) {
        assert!((wa.iter().sum::<f32>() - 1.0).abs() < 1e-6 && (wb.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        for bone in 0..19u16 {
            let of = |joints: &[u16; 4], weights: &[f32; 4]| -> f32 {
                joints.iter().zip(weights).filter(|(j, _)| **j == bone).map(|(_, w)| w).sum()
            };
            assert!((of(ja, wa) - of(jb, wb)).abs() < 1e-6, "{ja:?} {wa:?} {jb:?} {wb:?}");
        }
    }
    let mesh = &read.objects[0].mesh;
    let high = mesh.positions.iter().fold(0.0f32, |h, p| h.max(p.z));
    assert!((0.195..0.205).contains(&high), "{high}");
    assert!(mesh.positions.iter().all(|p| p.z > -1e-6));
    assert_eq!(read.objects[0].mesh.triangles.len(), made.objects[0].mesh.triangles.len());
}

#[test]
fn its_surface_is_smooth_and_closed() {
    let mesh = &walker::walker().objects[0].mesh;
    let mut edges = std::collections::HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            *edges.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
        }
    }
    assert!(
        edges.iter().all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1)),
        "every edge twice, once each way"
    );
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        let face = (b - a).cross(c - a).normalize();
        for i in t {
            let cosine = face.dot(mesh.normals[*i as usize].normalize());
            assert!(cosine > 0.0, "{t:?}: {cosine}");
        }
    }
    // Six tubes and their like, all the right way out: the volume is that of a small person.
    let volume: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
            a.cross(b).dot(c) / 6.0
        })
        .sum();
    assert!((1.5e-4..2.5e-4).contains(&volume), "{volume}");
}

#[test]
fn feet_stay_on_the_ground_and_do_not_slide() {
    let scene = playing(0);
    assert_eq!(scene.figures[0].clips[0].name, "Walk");
    let mut posed = Posed::new(&scene);
    let (steps, cycle) = (160u32, walker::WALK_CYCLE_S);
    let dt = cycle / f64::from(steps);
    let mut last: Option<Vec<Vec3>> = None;
    let (mut lowest, mut sum, mut count) = (f32::INFINITY, 0.0f64, 0u32);
    let (mut slowest, mut fastest) = (f64::INFINITY, 0.0f64);
    for step in 0..=steps {
        posed.update(&scene, f64::from(step) * dt);
        let now = &posed.objects()[0].positions_world;
        let ground = now.iter().fold(f32::INFINITY, |low, p| low.min(p.z));
        lowest = lowest.min(ground);
        assert!(ground < 0.0015, "a foot is always down: {step} {ground}");
        if let Some(last) = &last {
            // What touches the ground before and after moves back as fast as the figure goes ahead.
            let moved: Vec<f64> = last
                .iter()
                .zip(now)
                .filter(|(a, b)| a.z < 4e-4 && b.z < 4e-4)
                .map(|(a, b)| f64::from(b.y - a.y) / dt)
                .collect();
            if !moved.is_empty() {
                let mean = moved.iter().sum::<f64>() / moved.len() as f64;
                (slowest, fastest) = (slowest.min(mean), fastest.max(mean));
                sum += mean;
                count += 1;
            }
        }
        last = Some(now.clone());
    }
    let mean = sum / f64::from(count);
    println!("lowest {lowest} m, soles at {mean} m/s ({slowest} to {fastest}) in {count} of {steps}");
    assert!(lowest >= -1e-3, "{lowest}");
    assert!(count > steps * 8 / 10, "{count}");
    assert!((mean / walker::WALK_SPEED_M_S - 1.0).abs() < 0.1, "{mean}");
    // It begins again without a jump.
    posed.update(&scene, 0.0);
    let start = posed.objects()[0].positions_world.clone();
    posed.update(&scene, cycle * (1.0 - 1e-7));
    let gap = start
        .iter()
        .zip(&posed.objects()[0].positions_world)
        .map(|(a, b)| a.distance(*b))
        .fold(0.0, f32::max);
    assert!(gap < 1e-5, "{gap}");
}

#[test]
fn idle_stands_still_on_both_feet() {
    let scene = playing(1);
    assert_eq!(scene.figures[0].clips[1].name, "Idle");
    let mut posed = Posed::new(&scene);
    let soles = |posed: &Posed| -> Vec<Vec3> {
        let all = &posed.objects()[0].positions_world;
        scene.objects[0]
            .mesh
            .positions
            .iter()
            .zip(all)
            .filter(|(rest, _)| rest.z == 0.0)
            .map(|(_, p)| *p)
            .collect()
    };
    let mut farthest = 0.0f32;
    let start = posed.objects()[0].positions_world.clone();
    for step in 0..64 {
        posed.update(&scene, f64::from(step) * 0.05);
        for (sole, rest) in
            soles(&posed).iter().zip(scene.objects[0].mesh.positions.iter().filter(|p| p.z == 0.0))
        {
            assert!(sole.distance(*rest) < 3e-4, "{step}: {sole} {rest}");
        }
        let all = posed.objects()[0].positions_world.iter().zip(&start);
        farthest = farthest.max(all.map(|(a, b)| a.distance(*b)).fold(0.0, f32::max));
    }
    assert!((0.001..0.03).contains(&farthest), "{farthest}");
}

#[test]
fn it_walks_round_the_table_clear_of_ball_and_tag() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/walker.toml");
    let mut scene = halflight::assets::scene::load(Path::new(file)).unwrap().scene;
    halflight::assets::spheres::fit_scene(&mut scene, None, &mut |_| ());
    assert!((scene.figures[0].spheres.len() == 20) && scene.surfaces.iter().any(|s| s.receives_shadow));
    let walk = scene.figures[0].walk.clone().unwrap();
    assert_eq!(walk.speed_m_s, walker::WALK_SPEED_M_S);
    // As the synthetic room of the bundled recording has them.
    let (ball, ball_radius) = (Vec3::new(-0.20, 0.04, 0.06), 0.06);
    let round = halflight::animate::walk::length_m(&walk) / walk.speed_m_s;
    let mut posed = Posed::new(&scene);
    for step in 0..150 {
        posed.update(&scene, f64::from(step) * round / 150.0);
        for p in &posed.objects()[0].positions_world {
            assert!(p.distance(ball) > ball_radius + 0.1, "{step}: {p}");
            assert!(p.x.abs().max(p.y.abs()) > 0.055, "not above the tag, {step}: {p}");
            assert!(p.truncate().length() < 0.4 && (-1e-3..0.21).contains(&p.z), "{step}: {p}");
        }
        for sphere in posed.spheres() {
            assert!(
                sphere.body == posed.objects()[0].body && (0.003..0.04).contains(&sphere.radius_m),
                "{sphere:?}"
            );
            assert!(sphere.centre_world.z > 0.0 && sphere.centre_world.z < 0.2, "{sphere:?}");
        }
    }
    for t in [-7.0, 1e-9, 12_345.678, 1e12, f64::MAX, f64::INFINITY, f64::NAN] {
        posed.update(&scene, t);
        assert!(posed.objects()[0].positions_world.iter().all(|p| p.is_finite() && p.length() < 1.0), "{t}");
    }
}
