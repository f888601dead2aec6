//! Skinned models through time: known poses, sound clips, and what is wrong with a file is said.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::Vec3;
use halflight::animate::posed::Posed;
use halflight::assets::gltf::{self, LoadedFigure};
use halflight::model::animation::{Attachment, Playing};
use halflight::model::scene::Scene;
use std::path::Path;

fn open(shared: &Path, name: &str) -> LoadedFigure {
    gltf::load_figure(&shared.join("data/models").join(name), 0, &|_| ()).unwrap()
}

fn scene(loaded: LoadedFigure) -> Scene {
    Scene { objects: loaded.objects, figures: vec![loaded.figure], ..Scene::default() }
}

fn play(scene: &mut Scene, clip: usize) {
    scene.figures[0].playing = Some(Playing { clip, from_s: 0.0, speed: 1.0, looped: false });
}

fn bounds(posed: &Posed) -> (Vec3, Vec3) {
    let all = posed.objects().iter().flat_map(|o| &o.positions_world);
    all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)))
}

#[test]
fn the_simple_skin_bends_as_its_file_says() {
    let Some(shared) = support::shared("simple_skin") else { return };
    let mut scene = scene(open(&shared, "SimpleSkin.gltf"));
    play(&mut scene, 0);
    let mut posed = Posed::default();
    // The strip of two columns x = 0, 1 hangs on a joint at (0, 0) and one at (0, 1) of the file, both with the inverse
    // bind translation (-0.5, -1, 0); rows y = 0, 0.5, .. 2 have weights 0, 0.25, .. 1 of the second, which turns about z:
    // 0 degrees at 0 s, 90 at 1 s, -90 at 4 s; in between, at 0.5 s, by (0.383, 0.924) = 45.04 degrees.
    let half = 2.0 * f64::atan2(0.382_999_986_4, 0.924_000_024_8).to_degrees();
    for (t, degrees) in [(0.0, 0.0), (1.0, 90.0), (4.0, -90.0), (0.5, half), (1.2, 90.0), (9.0, 0.0)] {
        posed.update(&scene, t);
        let (sine, cosine) = f64::to_radians(degrees).sin_cos();
        let mut expected = Vec::new();
        for row in 0..5 {
            for x in [0.0, 1.0] {
                let (y, w) = (0.5 * f64::from(row), 0.25 * f64::from(row));
                let first = (x - 0.5, y);
                let (dx, dy) = (x - 0.5, y - 1.0);
                let second = (cosine * dx - sine * dy, 1.0 + sine * dx + cosine * dy);
                // y of the file is z of ours.
                expected.push(Vec3::new(
                    ((1.0 - w) * first.0 + w * second.0) as f32,
                    0.0,
                    ((1.0 - w) * first.1 + w * second.1) as f32,
                ));
            }
        }
        let object = &posed.objects()[0];
        assert_eq!(object.positions_world.len(), 10);
        let mut found: Vec<Vec3> = object.positions_world.clone();
        for point in expected {
            let nearest = (0..found.len())
                .min_by(|&a, &b| found[a].distance(point).total_cmp(&found[b].distance(point)))
                .unwrap();
            let nearest = found.swap_remove(nearest);
            assert!(nearest.abs_diff_eq(point, 2e-6), "{t} s: {nearest} {point}");
        }
        assert!(object.normals_world.iter().all(|n| n.abs_diff_eq(Vec3::NEG_Y, 1e-5)), "{t} s");
    }
}

#[test]
fn at_rest_the_figure_is_the_static_model() {
    let Some(shared) = support::shared("figures_at_rest") else { return };
    for name in ["SimpleSkin.gltf", "Fox.glb", "RobotExpressive.glb", "DamagedHelmet.glb"] {
        let loaded = open(&shared, name);
        let still = gltf::load_with(&shared.join("data/models").join(name), 0, &|_| ()).unwrap();
        let scene = scene(loaded);
        let posed = Posed::new(&scene);
        assert_eq!(still.len(), scene.objects.len());
        let (low, high) = bounds(&posed);
        let size = low.distance(high);
        for ((still, object), posed) in still.iter().zip(&scene.objects).zip(posed.objects()) {
            assert_eq!((still.name.as_str(), still.material), (object.name.as_str(), object.material));
            assert_eq!(still.mesh.triangles.len(), object.mesh.triangles.len());
            for (a, b) in still.mesh.triangles.iter().zip(&object.mesh.triangles) {
                for (&i, &j) in a.iter().zip(b) {
                    let (i, j) = (i as usize, j as usize);
                    assert_eq!(still.mesh.positions[i], object.mesh.positions[j]);
                    // f32 through a chain of nodes, one of which scales by 100: 2e-6 of the size measured.
                    let error = still.mesh.positions[i].distance(posed.positions_world[j]) / size;
                    assert!(error < 1e-5, "{name}: {error}");
                    // Flat normals of a bent surface are bent too (fox, where bones meet): 0.83 measured at worst.
                    let cosine = still.mesh.normals[i].dot(posed.normals_world[j]);
                    assert!(cosine > if name == "Fox.glb" { 0.5 } else { 0.999 }, "{name}: {cosine}");
                }
            }
        }
    }
}

#[test]
fn whole_clips_stay_sound() {
    let Some(shared) = support::shared("whole_clips") else { return };
    for (name, clips, joints_used) in
        [("Fox.glb", 3, 1), ("RobotExpressive.glb", 14, 1), ("SimpleSkin.gltf", 1, 2)]
    {
        let mut scene = scene(open(&shared, name));
        assert_eq!(scene.figures[0].clips.len(), clips);
        for part in &scene.figures[0].parts {
            let Attachment::Skinned { joints, weights, bind_normals, .. } = &part.attachment else {
                panic!()
            };
            let count = scene.figures[0].skeleton.joints.len() as u16;
            assert!(joints.iter().flatten().all(|&j| j < count), "{name}");
            for weights in weights {
                let sum: f32 = weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-6 && weights.iter().all(|w| (0.0..=1.0).contains(w)));
            }
            assert!(bind_normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4), "{name}");
        }
        let mut posed = Posed::new(&scene);
        let (low, high) = bounds(&posed);
        let size = low.distance(high);
        let rest: Vec<Vec<Vec3>> = posed.objects().iter().map(|o| o.positions_world.clone()).collect();
        for clip in 0..clips {
            play(&mut scene, clip);
            let duration = f64::from(scene.figures[0].clips[clip].duration_s);
            assert!((0.2..6.0).contains(&duration), "{name}: {duration}");
            let mut farthest = 0.0f32;
            let mut last: Option<Vec<Vec3>> = None;
            for step in 0..=(duration * 60.0) as u32 {
                posed.update(&scene, f64::from(step) / 60.0);
                let (l, h) = bounds(&posed);
                // A dying robot falls on its back (0.90 of its diagonal measured), a jumping one rises: within one around its rest.
                let reach = (low - l).max(h - high).max_element();
                assert!(reach < size, "{name} clip {clip} step {step}: {reach} of {size}");
                for (object, rest) in posed.objects().iter().zip(&rest) {
                    assert!(object.normals_world.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
                    for (a, b) in object.positions_world.iter().zip(rest) {
                        farthest = farthest.max(a.distance(*b) / size);
                    }
                }
                let all: Vec<Vec3> = posed.objects().iter().flat_map(|o| o.positions_world.clone()).collect();
                if let Some(last) = last {
                    let jump = all.iter().zip(&last).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
                    // Nothing tears: the fastest is a punch, 0.18 of the diagonal in a sixtieth of a second.
                    assert!(jump < 0.2 * size, "{name} clip {clip} step {step}: {jump} of {size}");
                }
                last = Some(all);
            }
            assert!(
                farthest > 0.01 * f32::from(joints_used as u8),
                "{name}: clip {clip} moves nothing: {farthest}"
            );
        }
    }
}

/// A scene of one model that walks round a square.
fn walking(shared: &Path, name: &str, keys: &str) -> String {
    let file = shared.join("data/models").join(name).display().to_string();
    format!(
        "[[object]]\nshape = \"box\"\n[[object]]\nfile = {file:?}\nheight_m = 0.25\n{keys}\n\
         path = [[0, 0], [0.4, 0], [0.4, 0.4], [0, 0.4]]\npath_speed_m_s = 0.1\n"
    )
}

#[test]
fn models_walk_round_the_table() {
    let Some(shared) = support::shared("models_walk") else { return };
    for (name, keys) in [
        ("RobotExpressive.glb", "animation = \"Walking\"\nspheres = 20"),
        ("Fox.glb", "animation = \"Walk\"\nanimation_speed = 0.5\nanimation_start_s = 0.2\nspheres = 20"),
    ] {
        let loaded =
            halflight::assets::scene::parse(Path::new("walk.toml"), &walking(&shared, name, keys)).unwrap();
        let scene = loaded.scene;
        assert_eq!((scene.figures.len(), scene.figures[1].sphere_count), (2, 20));
        assert!(scene.figures[0].is_still() && !scene.figures[1].is_still());
        let mut posed = Posed::new(&scene);
        // Where the objects are placed for those who do not animate: at rest at the walk's start.
        let middle = |posed: &Posed| {
            let all: Vec<Vec3> =
                posed.objects()[1..].iter().flat_map(|o| o.positions_world.clone()).collect();
            let (low, high) = all.iter().fold((all[0], all[0]), |(l, h), &p| (l.min(p), h.max(p)));
            assert!(low.z > -0.02 && high.z < 0.32 && high.z > 0.15, "{name}: {low} {high}");
            (low + high) / 2.0
        };
        for step in 0..80 {
            let t = f64::from(step) * 0.2;
            posed.update(&scene, t);
            assert!(!posed.objects()[0].moved && posed.objects()[1..].iter().all(|o| o.moved));
            let found = middle(&posed);
            let walk = scene.figures[1].walk.as_ref().unwrap();
            let (place, _) = halflight::animate::walk::place_at(walk, t).unwrap();
            // Limbs and tails swing about the middle by less than a third of the height.
            assert!(found.truncate().distance(place) < 0.08, "{name} {t}: {found} {place}");
        }
        // It looks where it goes: heads of both models are before their middles. At t = 0 it goes along +x.
        posed.update(&scene, 0.0);
        let forward = scene.figures[1].world_from_figure.transform_vector3(Vec3::NEG_Y);
        assert!(forward.normalize().abs_diff_eq(Vec3::X, 1e-6), "{forward}");
    }
}

#[test]
fn mistakes_of_a_moving_object_are_named() {
    let Some(shared) = support::shared("mistakes_of_a_moving_object") else { return };
    let parse = |text: &str| halflight::assets::scene::parse(Path::new("bad.toml"), text);
    let wrong = |keys: &str| parse(&walking(&shared, "Fox.glb", keys)).unwrap_err().to_string();
    for (keys, words) in [
        (
            "animation = \"Swim\"",
            "object[1].animation = \"Swim\": must be one of \"Survey\", \"Walk\", \"Run\"",
        ),
        ("animation = \"Walk\"\nspheres = 3", "object[1].spheres = 3: must be a whole number within 4..=64"),
        (
            "animation_speed = 2",
            "object[1].animation_speed = 2: must be left out where there is no animation",
        ),
        ("position = [1, 2, 3]", "object[1].position = [1, 2, 3]: must be left out where there is a path"),
    ] {
        let error = wrong(keys);
        assert!(error.starts_with("bad.toml:") && error.contains(words), "{error}");
    }
    for (text, words) in [
        (
            "animation = \"Walk\"",
            "object[0].animation = \"Walk\": must be left out: the file has no animation",
        ),
        (
            "path = [[0, 0], [1, 0]]\npath_speed_m_s = 1",
            "object[0].path = [[0, 0], [1, 0]]: must be at least 3 corners",
        ),
        (
            "path = [[0, 0], [1, 0], [0.5, 0.0]]\npath_speed_m_s = 1",
            "none of which turns by more than 165 degrees",
        ),
        ("path = [[0, 0], [1, 0], [0, 1]]", "object[0].path_speed_m_s: must be given with path"),
        ("path_speed_m_s = 1", "object[0].path_speed_m_s = 1: must be left out where there is no path"),
    ] {
        let error = parse(&format!("[[object]]\nshape = \"box\"\n{text}\n")).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}
