//! Posing a scene allocates nothing in steady state.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;
#[path = "support/sys.rs"]
mod sys;

use glam::{Affine3A, Vec3};
use halflight::animate::posed::Posed;
use halflight::assets::gltf;
use halflight::model::{animation::Playing, scene::Scene};

#[test]
fn updates_allocate_nothing() {
    let Some(shared) = support::shared("updates_allocate_nothing") else { return };
    let loaded = gltf::load_figure(&shared.join("data/models/Fox.glb"), 0, &|_| ()).unwrap();
    let figures = vec![loaded.figure.clone()];
    let mut scene = Scene { objects: loaded.objects, figures, ..Scene::default() };
    let mut second = loaded.figure;
    second.parts[0].object = 1;
    second.world_from_figure = Affine3A::from_translation(Vec3::X);
    scene.objects.push(scene.objects[0].clone());
    scene.figures.push(second);
    scene.figures[0].playing = Some(Playing { clip: 1, from_s: 0.0, speed: 1.0, looped: true });
    let mut posed = Posed::new(&scene);
    let counted = sys::allocated(|| {
        for step in 0..50 {
            posed.update(&scene, f64::from(step) / 30.0);
        }
    });
    assert_eq!(counted.count, 0, "{counted}");
    assert!(posed.objects()[0].moved && !posed.objects()[1].moved);
}
