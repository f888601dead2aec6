//! Soft shadows of thin things, made by rule: what spheres and boxes take of an even sky, against rays.
#![allow(clippy::approx_constant, reason = "any angle will do")]
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{Affine3A, DVec3, Quat, Vec3};
use halflight::animate::posed::Posed;
use halflight::assets::{scene, shapes, spheres};
use halflight::math::{
    bvh::Bvh,
    dice::Dice,
    sh::{log_exp::whole, zonal},
    spiral,
};
use halflight::model::{
    animation::Figure,
    blocker::Rung,
    scene::{Material, Mesh, Scene, VirtualObject},
};
use halflight::visibility::{blockers::Blockers, fit_boxes};
use std::path::Path;

const ORDER: usize = 4;

fn object(name: &str, mesh: Mesh) -> VirtualObject {
    let openness = vec![1.0; mesh.positions.len()];
    VirtualObject {
        name: name.into(),
        mesh,
        material: Material::Lambert { albedo_rgb: [0.5; 3] },
        world_from_object: Affine3A::IDENTITY,
        openness,
    }
}

/// A body of one object that stands where its mesh is.
fn alone(name: &str, mesh: Mesh) -> Scene {
    let mut figure = Figure::still(name.into(), 0, Affine3A::IDENTITY, std::iter::empty());
    figure.sphere_count = 20;
    Scene { objects: vec![object(name, mesh)], figures: vec![figure], ..Scene::default() }
}

fn slab(size: [f64; 3], turn: Quat, at: Vec3) -> Mesh {
    let mesh = shapes::cuboid(0.5 * DVec3::from(size));
    shapes::transformed(&mesh, &Affine3A::from_rotation_translation(turn, at))
}

fn standing(size: [f64; 3], x: f32, y: f32, z: f32) -> Mesh {
    slab(size, Quat::IDENTITY, Vec3::new(x, y, z))
}

/// A polygon in the x-y plane, counter-clockwise, drawn out to a thickness: one connected piece. `fan`: triangles of it.
fn drawn_out(outline: &[[f32; 2]], fan: &[[u32; 3]], thickness: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let count = outline.len() as u32;
    for z in [0.0, thickness] {
        mesh.positions.extend(outline.iter().map(|[x, y]| Vec3::new(*x, *y, z)));
    }
    mesh.normals = vec![Vec3::Z; mesh.positions.len()];
    mesh.triangles.extend(fan.iter().map(|t| t.map(|i| i + count)));
    mesh.triangles.extend(fan.iter().map(|[a, b, c]| [*a, *c, *b]));
    for i in 0..count {
        let next = (i + 1) % count;
        mesh.triangles.extend([[i, next, next + count], [i, next + count, i + count]]);
    }
    mesh
}

/// What is taken of an even sky on the ground about a scene, by our blockers over by rays, where rays find less than half
/// taken; and the root mean square of the difference, as a share of the sky.
fn taken(scene: &Scene, rung: Rung) -> (f64, f64) {
    let posed = Posed::new(scene);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (posed, object) in posed.objects().iter().zip(&scene.objects) {
        let base = positions.len() as u32;
        positions.extend(&posed.positions_world);
        triangles.extend(object.mesh.triangles.iter().map(|t| t.map(|i| i + base)));
    }
    let bvh = Bvh::build(&positions, &triangles);
    let mut blockers = Blockers::new();
    blockers.prepare(posed.blocking(), rung, ORDER, 128);
    blockers.add_boxes(posed.boxes());
    // An even sky through Lambert's lobe; from below comes none that the lobe would see.
    let (mut lambert, mut lobe) = ([0.0f32; 6], [0.0f32; 36]);
    zonal::lambert(ORDER, &mut lambert);
    zonal::rotate(&lambert[..ORDER], [0.0, 0.0, 1.0], &mut lobe);
    let row = lobe.map(|f| [f; 3]);
    const RAYS: usize = 1500;
    let directions: Vec<Vec3> =
        (0..2 * RAYS).map(|j| spiral::direction(j, 2 * RAYS).as_vec3()).filter(|d| d.z > 0.0).collect();
    let weight: f32 = directions.iter().map(|d| d.z).sum();
    let (mut ours, mut truth, mut square, mut count) = (0.0, 0.0, 0.0, 0);
    for k in 0..21 * 21 {
        let at = Vec3::new((k % 21) as f32 * 0.033 - 0.331, (k / 21) as f32 * 0.033 - 0.327, 0.0);
        let start = at + Vec3::Z * 1e-5;
        let hidden = directions.iter().filter(|d| bvh.occluded(start, **d, 0.0, f32::INFINITY));
        let hidden = f64::from(hidden.map(|d| d.z).sum::<f32>() / weight);
        if hidden > 0.5 {
            continue;
        }
        let (open, all) = blockers.shade(at, Vec3::Z, None, &row);
        let by_us = f64::from((all[0] - open[0]) / all[0]);
        (ours, truth) = (ours + by_us, truth + hidden);
        (square, count) = (square + (by_us - hidden).powi(2), count + 1);
    }
    assert!(all_finite(&blockers), "{rung:?}");
    (ours / truth, (square / f64::from(count)).sqrt())
}

fn all_finite(blockers: &Blockers) -> bool {
    let mut v = [0.0; 36];
    blockers.visibility(Vec3::ZERO, Vec3::Z, None, &mut v);
    v.iter().all(|v| v.is_finite()) && v[0] <= whole::<f32>() * 1.000_001
}

/// Thin things of many kinds, named.
fn things() -> Vec<(String, Scene)> {
    let mut dice = Dice::new(41);
    let mut list = Vec::new();
    for thickness_mm in [1u32, 2, 5, 10, 20] {
        let size = [
            f64::from(thickness_mm) * 1e-3,
            0.12 + 0.1 * f64::from(dice.unit_f32()),
            0.1 + 0.08 * f64::from(dice.unit_f32()),
        ];
        let turn = Quat::from_rotation_z(3.0 * dice.unit_f32());
        let stands = slab(size, turn, Vec3::Z * (0.5 * size[2]) as f32);
        list.push((format!("plate of {thickness_mm} mm that stands"), alone("plate", stands)));
        let tilt = turn * Quat::from_rotation_y(0.3 + 1.2 * dice.unit_f32());
        let tilted = slab(size, tilt, Vec3::new(0.0, 0.0, 0.14));
        list.push((format!("plate of {thickness_mm} mm, tilted"), alone("plate", tilted)));
        let disc = shapes::cylinder(0.08, 1e-3 * f64::from(thickness_mm), 32);
        let disc = shapes::transformed(
            &disc,
            &Affine3A::from_rotation_translation(Quat::from_rotation_x(dice.unit_f32()), Vec3::Z * 0.12),
        );
        list.push((format!("disc of {thickness_mm} mm"), alone("disc", disc)));
    }
    let outline = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.05], [0.05, 0.05], [0.05, 0.18], [0.0, 0.18]];
    let fan = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
    let flat = drawn_out(&outline, &fan, 0.004);
    let stands = Affine3A::from_rotation_translation(Quat::from_rotation_x(1.3), Vec3::new(-0.1, 0.0, 0.02));
    list.push(("an L cut from a plate".into(), alone("l", shapes::transformed(&flat, &stands))));
    let outline = [[0.0, 0.0], [0.15, 0.0], [0.15, 0.004], [0.004, 0.004], [0.004, 0.12], [0.0, 0.12]];
    let bracket = drawn_out(&outline, &fan, 0.1);
    let stands =
        Affine3A::from_rotation_translation(Quat::from_rotation_x(1.570_796), Vec3::new(-0.07, 0.05, 0.0));
    list.push(("a bracket of two plates".into(), alone("bracket", shapes::transformed(&bracket, &stands))));
    let sheet = shapes::quad([
        DVec3::new(-0.1, -0.06, 0.1),
        DVec3::new(0.1, -0.06, 0.12),
        DVec3::new(0.1, 0.06, 0.12),
        DVec3::new(-0.1, 0.06, 0.1),
    ]);
    list.push(("a sheet".into(), alone("sheet", sheet)));
    let leg = |x: f32, y: f32| standing([0.012, 0.012, 0.12], x, y, 0.06);
    let mut chair = vec![
        standing([0.14, 0.14, 0.01], 0.0, 0.0, 0.125),
        slab([0.008, 0.13, 0.14], Quat::from_rotation_y(-0.2), Vec3::new(-0.08, 0.0, 0.2)),
    ];
    chair.extend([leg(0.06, 0.06), leg(-0.06, 0.06), leg(0.06, -0.06), leg(-0.06, -0.06)]);
    list.push(("a chair".into(), alone("chair", shapes::merged(&chair))));
    let mut shelf: Vec<Mesh> =
        (0..4).map(|k| standing([0.22, 0.08, 0.005], 0.0, 0.0, 0.01 + 0.07 * k as f32)).collect();
    shelf.extend([-0.11f32, 0.11].map(|x| standing([0.005, 0.08, 0.23], x, 0.0, 0.115)));
    list.push(("a shelf".into(), alone("shelf", shapes::merged(&shelf))));
    let rod = shapes::cylinder(0.004, 0.25, 16);
    let leans = Affine3A::from_rotation_translation(Quat::from_rotation_y(0.5), Vec3::new(-0.05, 0.0, 0.01));
    list.push(("a rod that leans".into(), alone("rod", shapes::transformed(&rod, &leans))));
    list
}

/// With boxes, and with the spheres alone.
fn fitted(scene: &mut Scene) -> (Scene, usize) {
    spheres::fit_scene(scene, None, &mut |_| ());
    let mut spheres_alone = scene.clone();
    spheres_alone.figures.iter_mut().for_each(|figure| figure.boxes.clear());
    let posed = Posed::new(scene);
    let primitives = posed.boxes().len() + posed.blocking().len();
    for figure in &scene.figures {
        assert!(figure.boxes.len() <= fit_boxes::MAX_BOXES && figure.boxes.len() <= figure.sphere_count);
    }
    (spheres_alone, primitives)
}

#[test]
fn thin_things_take_what_they_should() {
    let mut misses = Vec::new();
    for (name, mut scene) in things() {
        let (spheres_alone, primitives) = fitted(&mut scene);
        let (before, _) = taken(&spheres_alone, Rung::Directions);
        let mut line = format!("{name:34} {primitives:2} primitives, spheres alone {before:.2}");
        for rung in [Rung::Directions, Rung::Linear, Rung::Hybrid, Rung::Chain] {
            let (share, rms) = taken(&scene, rung);
            line += &format!(", {} {share:.3} (rms {rms:.4})", rung.name());
            // Products of truncated series take what parts hide from each other twice, by a little: 1.105 of a shelf.
            let most = if rung == Rung::Directions { 0.1 } else { 0.12 };
            if (share - 1.0).abs() > most {
                misses.push(format!("{name}, {}: {share:.3}", rung.name()));
            }
        }
        println!("{line}");
        if primitives > 20 {
            misses.push(format!("{name}: {primitives} primitives"));
        }
    }
    assert!(misses.is_empty(), "{misses:#?}");
}

/// A rod's axis in a plane: how far it turns in all, and how thick it is at its end over its beginning.
#[derive(Clone, Copy, Debug)]
enum Bend {
    Straight,
    Arc,
    Ring,
    Wave,
}

/// A rod by rule: a tube of a few sides along its axis, lying anyhow, some way above the ground. `slender`: its length over its
/// radius.
fn rod(dice: &mut Dice, bend: Bend, tapers: bool, slender: f32) -> Mesh {
    let below = |dice: &mut Dice, count: usize| (dice.unit() * count as f64) as usize;
    let length = 0.25 + 0.5 * dice.unit_f32();
    let sides = [4usize, 6, 8, 12, 16][below(dice, 5)];
    let (angle, steps) = match bend {
        Bend::Straight => (0.0, 1 + below(dice, 10)),
        Bend::Arc => (0.5 + 4.0 * dice.unit_f32(), 24 + below(dice, 60)),
        Bend::Ring => (std::f32::consts::TAU, 24 + below(dice, 60)),
        Bend::Wave => (3.0 + 3.0 * dice.unit_f32(), 24 + below(dice, 60)),
    };
    let end = if tapers { 0.1 + 0.7 * dice.unit_f32() } else { 1.0 };
    let closed = matches!(bend, Bend::Ring);
    let rings = if closed { steps } else { steps + 1 };
    let (mut at, mut mesh) = (Vec3::ZERO, Mesh::default());
    let heading = |t: f32| match bend {
        Bend::Wave => angle * t.min(1.0 - t),
        _ => angle * t,
    };
    for ring in 0..rings {
        let t = ring as f32 / steps as f32;
        let aside = Vec3::new(-heading(t).sin(), heading(t).cos(), 0.0);
        let radius = length / slender * (1.0 + (end - 1.0) * t);
        for side in 0..sides {
            let (sine, cosine) = (std::f32::consts::TAU * (side as f32 + 0.3) / sides as f32).sin_cos();
            mesh.positions.push(at + (aside * cosine + Vec3::Z * sine) * radius);
        }
        // Chords of an arc, in steps far finer than the rings.
        for fine in 0..100 {
            let heading = heading((ring as f32 + (fine as f32 + 0.5) / 100.0) / steps as f32);
            at += Vec3::new(heading.cos(), heading.sin(), 0.0) * (length / (100 * steps) as f32);
        }
    }
    let index = |ring: usize, side: usize| ((ring % rings) * sides + side % sides) as u32;
    for (ring, side) in (0..steps).flat_map(|ring| (0..sides).map(move |side| (ring, side))) {
        let [a, b] = [index(ring, side), index(ring, side + 1)];
        let [c, d] = [index(ring + 1, side), index(ring + 1, side + 1)];
        mesh.triangles.extend([[a, c, d], [a, d, b]]);
    }
    if !closed {
        let last = index(rings - 1, 0);
        mesh.triangles
            .extend((1..sides as u32 - 1).flat_map(|s| [[0, s, s + 1], [last, last + s + 1, last + s]]));
    }
    mesh.normals = vec![Vec3::Z; mesh.positions.len()];
    let turn = Quat::from_rotation_z(6.28 * dice.unit_f32()) * Quat::from_rotation_x(3.0 * dice.unit_f32());
    let middle = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f32;
    mesh.positions.iter_mut().for_each(|p| *p = turn * (*p - middle));
    let low = mesh.positions.iter().fold(f32::INFINITY, |m, p| m.min(p.z));
    let lift = 0.003 + 0.1 * dice.unit_f32() - low;
    mesh.positions.iter_mut().for_each(|p| p.z += lift);
    mesh
}

/// Rods whose length is 84 to 250 times their radius (shorter ones are left to spheres): 12 of them, with
/// HALFLIGHT_ALL_RODS=1 204. Of those 2 are more than 10 % off, 0.112 at worst; 0.023 in the median.
#[test]
fn rods_of_any_shape_take_what_they_should() {
    let count = if std::env::var_os("HALFLIGHT_ALL_RODS").is_some() { 204 } else { 12 };
    let kinds = [
        (Bend::Straight, false),
        (Bend::Arc, false),
        (Bend::Ring, false),
        (Bend::Straight, true),
        (Bend::Arc, true),
        (Bend::Wave, false),
    ];
    let mut dice = Dice::new(71);
    let mut found = Vec::new();
    for k in 0..count {
        let (bend, tapers) = kinds[k % kinds.len()];
        let slender = 84.0 * 3.0f32.powf(dice.unit_f32());
        let mesh = rod(&mut dice, bend, tapers, slender);
        let name = format!("{bend:?}, tapers: {tapers}, {slender:.0} radii long");
        let boxes = fit_boxes::fit(&mesh.positions, &mesh.triangles, 20);
        assert!(!boxes.is_empty(), "{name}");
        let mut scene = alone("rod", mesh);
        let (_, primitives) = fitted(&mut scene);
        let (share, _) = taken(&scene, Rung::Directions);
        println!("{name:44} {primitives:2} primitives, {share:.3}");
        found.push(((share - 1.0).abs(), name));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (worst, name) = &found[found.len() - 1];
    println!("median {:.3}, worst {worst:.3} ({name})", found[found.len() / 2].0);
    let far = found.iter().filter(|(off, _)| *off > 0.1).count();
    assert!(far * 50 <= count && *worst < 0.2, "{far} of {count} are more than 10 % off; {worst} ({name})");
}

#[test]
fn the_handed_cases_take_what_they_should() {
    let Some(shared) = support::shared("thin_plate_soft_shadow") else { return };
    let folder = shared.join("cases/thin-plate-soft-shadow");
    if !folder.is_dir() {
        return support::skipped("no case thin-plate-soft-shadow");
    }
    for file in ["plate.toml", "table.toml"] {
        let mut scene = scene::load(&folder.join(Path::new(file))).unwrap().scene;
        let (spheres_alone, primitives) = fitted(&mut scene);
        let (before, after) = (taken(&spheres_alone, Rung::Directions), taken(&scene, Rung::Directions));
        let linear = taken(&scene, Rung::Linear);
        println!("{file}: {primitives} primitives, {before:?} -> {after:?}, linear {linear:?}");
        assert!(primitives <= 20 && before.0 < 0.6);
        assert!((after.0 - 1.0).abs() < 0.1 && (linear.0 - 1.0).abs() < 0.1, "{after:?} {linear:?}");
    }
}

/// What is not thin keeps its spheres, all of them.
#[test]
fn what_is_not_thin_has_no_boxes() {
    let solids = [
        ("cube", shapes::cuboid(DVec3::splat(0.05))),
        ("brick", shapes::cuboid(DVec3::new(0.1, 0.05, 0.04))),
        ("ball", shapes::icosphere(0.1, 3)),
        ("drum", shapes::cylinder(0.05, 0.1, 32)),
        ("pawn", shapes::pawn_with_ring(0.2)),
        ("vase", shapes::vase(0.2, 48)),
        ("torus", shapes::torus(0.1, 0.02, 48, 16)),
        ("knot", shapes::torus_knot(0.1, 0.02, 128, 12)),
        ("nothing", Mesh::default()),
    ];
    for (name, mesh) in solids {
        let found = fit_boxes::fit(&mesh.positions, &mesh.triangles, 20);
        assert!(found.is_empty(), "{name}: {found:?}");
    }
}

/// Damaged geometry gives no box that is not finite, and no panic.
#[test]
fn hostile_geometry_is_taken() {
    let plate = shapes::cuboid(DVec3::new(0.1, 0.06, 0.001));
    let mut dice = Dice::new(77);
    for _ in 0..300 {
        let mut mesh = plate.clone();
        for _ in 0..3 {
            let vertex = (dice.unit_f32() * 23.9) as usize;
            let value = [f32::NAN, f32::INFINITY, 1e30, -1e-30, 0.0, 1e38][(dice.unit_f32() * 5.9) as usize];
            mesh.positions[vertex][(dice.unit_f32() * 2.9) as usize] = value;
            let triangle = (dice.unit_f32() * 11.9) as usize;
            mesh.triangles[triangle][0] = (dice.unit_f32() * 30.0) as u32;
        }
        for b in fit_boxes::fit(&mesh.positions, &mesh.triangles, 20) {
            let finite = b.centre.is_finite() && b.half.is_finite() && b.axes.iter().all(|a| a.is_finite());
            assert!(finite && b.half.min_element() >= 0.0, "{b:?}");
        }
    }
}

/// A mesh without thickness, seen from its back as from its front, and one of two bodies that stands on the other.
#[test]
fn turned_and_scaled_bodies_carry_their_boxes() {
    let mut scene = alone("plate", standing([0.004, 0.2, 0.12], 0.0, 0.0, 0.06));
    spheres::fit_scene(&mut scene, None, &mut |_| ());
    let turn = Quat::from_rotation_z(0.8);
    scene.figures[0].world_from_figure =
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.5), turn, Vec3::new(0.1, 0.0, 0.0));
    let posed = Posed::new(&scene);
    let [one] = posed.boxes() else { panic!("{:?}", posed.boxes()) };
    assert!(one.centre_world.distance(Vec3::new(0.1, 0.0, 0.03)) < 1e-5, "{one:?}");
    let mut half = one.half_m.to_array();
    half.sort_by(f32::total_cmp);
    for (ours, truth) in half.iter().zip([0.001, 0.03, 0.05]) {
        assert!((ours - truth).abs() < 1e-5, "{one:?}");
    }
    assert!(posed.blocking().is_empty() && !posed.spheres().is_empty());
    assert_eq!(posed.around().len(), posed.spheres().len() + 1);
    let (share, _) = taken(&scene, Rung::Directions);
    assert!((share - 1.0).abs() < 0.1, "{share}");
}
