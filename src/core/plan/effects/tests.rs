//! What scenes call for.

use super::*;
use crate::model::{
    blocker::Rung,
    light::{HardLight, RadianceSh},
    quality::NearForm,
    scene::{Material, Mesh, RealSurface, VirtualObject},
};
use glam::{Affine3A, DVec3, Vec3};

fn mesh() -> Mesh {
    Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tints_rgb: vec![[1.0; 3]; 3],
        triangles: vec![[0, 1, 2]],
    }
}

fn scene(objects: usize, receives: Option<bool>) -> Scene {
    let object = VirtualObject {
        name: "o".into(),
        mesh: mesh(),
        material: Material::Lambert { albedo_rgb: [0.5; 3] },
        world_from_object: Affine3A::IDENTITY,
        openness: vec![1.0; 3],
    };
    let surface =
        |receives_shadow| RealSurface { name: "s".into(), mesh: mesh(), receives_shadow, albedo_rgb: None };
    Scene {
        objects: vec![object; objects],
        surfaces: receives.map(surface).into_iter().collect(),
        ..Scene::default()
    }
}

fn sun(to_light_world: [f32; 3], e: f32) -> Lights {
    let mut lights = Lights::soft(RadianceSh::zero(4));
    lights.hard.push(HardLight { to_light_world, irradiance_rgb: [e; 3], extent_rad: 0.0 });
    lights
}

fn passes(occasion: &Occasion<'_>, scene: &Scene, light: &Lights) -> Vec<Pass> {
    let mut out = FramePlan::default();
    plan(occasion, scene, light, &Quality::default(), &mut out);
    let mut all: Vec<Pass> = out.passes.iter().chain(&out.left_out).map(|p| p.pass).collect();
    all.sort();
    assert_eq!(all, Pass::ALL, "every pass is either planned or left out");
    assert!(out.passes.is_sorted_by_key(|p| p.pass), "in the order of the frame");
    out.passes.iter().map(|p| p.pass).collect()
}

const UP: [f32; 3] = [0.0, 0.0, 1.0];
const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

#[test]
fn only_what_the_scene_calls_for() {
    use Pass::{Composite, ShadeObject, ShadeSurface, ShadowMaps, Tonemap};
    let show = Occasion::SHOW;
    let full = scene(1, Some(true));
    assert_eq!(
        passes(&show, &full, &sun(UP, 2.0)),
        [ShadowMaps, ShadeObject, ShadeSurface, Composite, Tonemap]
    );
    // No sun, or a sun without power, or below the ground: no shadow on it.
    let dark = Lights::soft(RadianceSh::zero(4));
    for light in [dark, sun(UP, 0.0), sun(UP, -1.0)] {
        assert_eq!(passes(&show, &full, &light), [ShadeObject, Composite, Tonemap]);
    }
    assert_eq!(passes(&show, &full, &sun(DOWN, 2.0)), [ShadowMaps, ShadeObject, Composite, Tonemap]);
    // A surface that only hides, or none.
    for surfaces in [Some(false), None] {
        let out = passes(&show, &scene(1, surfaces), &sun(UP, 2.0));
        assert_eq!(out, [ShadowMaps, ShadeObject, Composite, Tonemap]);
    }
    // Nothing virtual.
    assert_eq!(passes(&show, &scene(0, Some(true)), &sun(UP, 2.0)), [Composite, Tonemap]);
    let linear = Occasion { display: false, ..show };
    assert_eq!(passes(&linear, &scene(0, None), &sun(UP, 2.0)), [Composite]);
}

#[test]
fn the_reason_says_what_no_shader_can_do() {
    let mut place = scene(1, Some(true));
    let light = |order| {
        let mut global = RadianceSh::zero(order);
        global.rgb[0] = [1.0; 3];
        Lights::soft(global)
    };
    let reason = |place: &Scene, rung, order| {
        let mut out = FramePlan::default();
        let quality = Quality { rung, sh_order: order, ..Quality::default() };
        plan(&Occasion::SHOW, place, &light(order), &quality, &mut out);
        out.passes.iter().find(|p| p.pass == Pass::SoftShadow).expect("soft shadows").reason
    };
    let body = |count| {
        let spheres = (0..count).map(|k| (Vec3::X * k as f32, 0.1));
        crate::model::animation::Figure::still("body".into(), 0, Affine3A::IDENTITY, spheres)
    };
    place.figures = vec![body(128), body(128)];
    for rung in Rung::ALL {
        for order in 2..=6 {
            assert!(!reason(&place, rung, order).contains("CPU"), "{} {order}", rung.name());
        }
    }
    place.figures = vec![body(128), body(128), body(1)];
    assert!(reason(&place, Rung::Directions, 4).contains("more than 256 spheres"));
}

#[test]
fn a_known_room_is_drawn_by_its_own_light() {
    use Pass::{Composite, PointMaps, ShadeObject, ShadowMaps, Subtract, Tonemap};
    let mut place = scene(1, Some(true));
    place.room = Some(std::sync::Arc::default());
    let mut light = Lights::soft(RadianceSh::zero(4));
    light.global.rgb[0] = [1.0; 3];
    // Soft light alone, as of a room: no halves of far light.
    let near = [PointMaps, Subtract, ShadeObject, Composite, Tonemap];
    assert_eq!(passes(&Occasion::SHOW, &place, &light), near);
    // From 8-bit values instead.
    let mut out = FramePlan::default();
    let ldr = Quality { near_form: NearForm::Ldr, ..Quality::default() };
    plan(&Occasion::SHOW, &place, &light, &ldr, &mut out);
    let forms = || super::super::Product::Ratios.makers().iter().filter(|pass| out.has(*pass));
    assert!(forms().count() == 1 && !out.has(Subtract) && !out.has(Pass::ShadeSurface) && out.has(PointMaps));
    // A sun shines in: the objects' map under it, too, even where no real surface outside of the room faces it.
    for to_light in [UP, DOWN] {
        let with_sun = [ShadowMaps, PointMaps, Subtract, ShadeObject, Composite, Tonemap];
        assert_eq!(passes(&Occasion::SHOW, &place, &sun(to_light, 2.0)), with_sun);
    }
    // Nothing virtual: nothing is taken.
    place.objects.clear();
    assert_eq!(passes(&Occasion::SHOW, &place, &sun(UP, 2.0)), [Composite, Tonemap]);
}

#[test]
fn measuring_and_drawing_are_independent() {
    use Pass::{MergeBracket, ProjectSh, UnwrapBall};
    let measure = Occasion { merge: true, ball: true, ..Occasion::default() };
    let out = passes(&measure, &scene(1, Some(true)), &sun(UP, 2.0));
    assert_eq!(out, [MergeBracket, UnwrapBall, ProjectSh]);
    let map = Occasion { project: true, ..Occasion::default() };
    assert_eq!(passes(&map, &scene(0, None), &sun(UP, 2.0)), [ProjectSh]);
}

#[test]
fn objects_out_of_view_still_throw_shadows_into_it() {
    use Pass::{Composite, ShadeObject, ShadeSurface, ShadowMaps, Tonemap};
    let lens = Lens::pinhole(64, 48, 60.0, 60.0, 32.0, 24.0);
    let at = Pose::look_at(DVec3::new(0.3, -4.0, 1.0), DVec3::new(0.3, 0.3, 0.0), DVec3::Z);
    let away = Pose::look_at(DVec3::new(0.3, -4.0, 1.0), DVec3::new(0.3, -9.0, 0.0), DVec3::Z);
    let full = scene(1, Some(true));
    let with = |pose| {
        let occasion = Occasion { camera: Some((&lens, pose)), ..Occasion::SHOW };
        passes(&occasion, &full, &sun(UP, 2.0))
    };
    assert_eq!(with(&at), [ShadowMaps, ShadeObject, ShadeSurface, Composite, Tonemap]);
    assert_eq!(with(&away), [ShadowMaps, ShadeSurface, Composite, Tonemap]);
}
