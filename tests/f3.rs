//! F3 of the reference: what near light in a known room takes away at each pixel, against ray tracing, for n = 1 to all
//! lights. Hard: each light seen from one place, as [Gib03] draws it. Soft: from nine places on the part of it that is seen, as a
//! filter over its shadow map does. In the ratio form, the share taken away times the picture without the object.
//! Pixels are means over four places, as the reference's are means over their area.
//!
//! The reference's own noise is up to a tenth of a faint shadow. So the figures are held against rays of our own too, which
//! have none, and those against the reference.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/room_scene.rs"]
mod room_scene;
mod support;

use glam::Vec3;
use halflight::{
    assets::{case, pictures},
    math::color,
    model::scene::Mesh,
    nearfield::{
        field::{NearField, Preparation},
        patches::{Subdivision, subdivide},
        representatives::Representative,
    },
    sources::expand::Priority,
    visibility::point_maps::SeenPart,
};
use room_scene::{Object, Off, RoomView, Shadows, Traced, compare};
use std::path::Path;
use support::wanted;

const ALL: usize = usize::MAX;
const COUNTS: [usize; 6] = [1, 5, 10, 20, 50, ALL];

struct Row {
    object: &'static str,
    /// Rays of our own against the reference: its noise.
    noise: Off,
    /// Against the reference, at one place a pixel.
    hard: Vec<Off>,
    /// Against the reference...
    soft: Vec<Off>,
    /// ...and against our rays.
    traced: Vec<Off>,
}

fn table(shared: &Path, id: &str, preparation: &Preparation) -> Vec<Row> {
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let room = case.room();
    let patches = subdivide(&room, &Subdivision::default(), &|_| None).unwrap();
    let field = NearField::build(&room, patches, preparation, &|_| ()).unwrap();
    let report = field.report();
    println!("{id}, {:.0} % of the power: {report:?}", 100.0 * preparation.power_share);
    assert!(report.patches <= 1500 && report.bytes < 3 << 20, "{report:?}");
    let views = [1, 2].map(|side| RoomView::new(&case, &field.patches, &room, side));
    let models = views.each_ref().map(|view| view.gathered(&field));
    let background = pictures::load_raw(&case.image("noobj").unwrap().file).unwrap();
    let mut rows = Vec::new();
    for object_name in ["table", "raised", "under"] {
        let object = Object::of(&case, &format!("obj_{object_name}"));
        let truth = Traced::new(&case, object_name, &room, &views[1], &object, 32);
        let noise = truth.against_reference(&case, object_name);
        let mut shadows = Shadows::default();
        let mut shown = |count: usize, side: u32| {
            shadows.frame(&case, &field, &object, count, Priority::ErrorRemoved);
            let which = usize::from(side > 1 || count == ALL);
            let removed = shadows.removed(&views[which], &field, &object, side);
            let mut shown = removed.clone();
            for (i, shown) in shown.iter_mut().enumerate() {
                for c in 0..3 {
                    let model = models[which][i][c];
                    let share = if model > 0.0 { removed[i][c] / model } else { 0.0 };
                    shown[c] = share.min(1.0) * background.pixels()[i][c];
                }
            }
            shown
        };
        let hard: Vec<Off> = [1, 10, 50].iter().map(|&n| compare(&case, object_name, &shown(n, 1))).collect();
        // Each of all is small: its own width is nothing. But where a sliver of the lamp is left, it is few of them.
        let of_all = if (id, object_name) == ("f3_ceiling_light", "under") { 3 } else { 1 };
        let sides = COUNTS.map(|n| if n == ALL { of_all } else { 3 });
        let pictures = COUNTS.iter().zip(sides).map(|(&n, side)| shown(n, side));
        let (soft, traced): (Vec<Off>, Vec<Off>) =
            pictures.map(|p| (compare(&case, object_name, &p), truth.compare(&p))).unzip();
        let line = |offs: &[Off]| -> String {
            offs.iter().map(|o| format!("  {:.3} {:+5.1}%", o.rmse, 100.0 * (o.energy - 1.0))).collect()
        };
        println!(
            "  {object_name:7} {} pixels, noise {}\n          hard {}\n          soft {}\n        traced {}",
            soft[5].pixels,
            line(&[noise]),
            line(&hard),
            line(&soft),
            line(&traced)
        );
        rows.push(Row { object: object_name, noise, hard, soft, traced });
    }
    rows
}

/// The rows of `wanted.tsv` are held against rays without noise, of which 0.8 % of the light below the table at the window
/// are interpolation between corners of patches: with exact transfers 0.1 % is left. A light that is seen in part counts
/// with the part that is seen: with all of it ten lights were 3.3, 2.5 and -4.2 % off at the window.
///
/// The box under the lamp's table is no measure: six of the pixels looked at show its shadow, all in the table's penumbra,
/// and in one of them, away from the shadow, the object seems to reach in by less than the mask's 64 samples show. It is
/// held against the reference.
#[test]
fn removed_light_against_ray_tracing() {
    let Some(shared) = support::shared("removed_light_against_ray_tracing") else { return };
    for id in ["f3_ceiling_light", "f3_window_ceiling_patch"] {
        for row in table(&shared, id, &Preparation { power_share: 1.0, ..Preparation::default() }) {
            let Row { object, noise, hard, soft, traced } = row;
            let few = (id, object) == ("f3_ceiling_light", "under");
            let held = if few { &soft } else { &traced };
            let figure = format!("f3.rays.{}.{object}", room_scene::short_name(id));
            for (at, n) in [(2, "10"), (4, "50"), (5, "all")] {
                wanted::hold(&format!("{figure}.{n}"), held[at].rmse);
            }
            for (at, n) in [(2, "10"), (5, "all")] {
                wanted::hold(&format!("{figure}.{n}.light"), held[at].energy - 1.0);
            }
            // Rays of our own are the reference without its noise: 9 % of a faint shadow, 1 to 3 % of others.
            let most = if object == "raised" { 0.095 } else { 0.035 };
            if !few {
                assert!(noise.rmse <= most && (noise.energy - 1.0).abs() < 0.005, "{id} {object}: {noise:?}");
                // What is left against the reference is its noise and ours.
                let both = noise.rmse.hypot(traced[5].rmse);
                assert!(soft[5].rmse <= 1.15 * both, "{id} {object}: {:?}, {both}", soft[5]);
            }
            // More lights are better, hard or soft, up to a fiftieth; hard lights of the lamp alone get a shadow's
            // penumbra right by chance.
            for offs in [&hard, &soft] {
                for pair in offs.windows(2) {
                    assert!(pair[1].rmse <= 1.05 * pair[0].rmse + 0.02, "{id} {object}: {offs:?}");
                }
            }
        }
    }
}

#[test]
fn what_is_left_out_of_the_source_set_is_known() {
    let Some(shared) = support::shared("what_is_left_out_of_the_source_set_is_known") else { return };
    let id = "f3_window_ceiling_patch";
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let room = case.room();
    let patches = subdivide(&room, &Subdivision::default(), &|_| None).unwrap();
    let field = NearField::build(&room, patches, &Preparation::default(), &|_| ()).unwrap();
    let report = field.report();
    println!("{id}, 70 % of the power: {report:?}");
    // The window and part of the wall patch; the ceiling, which shines faintly, is left out as a whole.
    assert!((report.power_share - 0.7).abs() < 0.01 && report.sources_left_out > 100);
    assert!((0.3..0.6).contains(&report.lost_mean) && report.lost_worst > 0.9);
}

/// Lights of a frame, what each sends to every vertex, and what is removed there.
type Before = (Vec<Representative>, Vec<[f32; 3]>, Vec<SeenPart>, Vec<f32>);

/// The largest of what a step of `step_m` changes anywhere on the table and the floor, over the deepest shadow there, while a
/// box of 20 cm is carried over the table: where the lights of the frame before would have been kept, and in all.
fn largest_steps(case: &case::Case, field: &NearField, step_m: f32, count: usize, side: u32) -> [f32; 2] {
    const FRAMES: usize = 100;
    let vertices = field.patches.vertices.len();
    let watched: Vec<usize> = (0..vertices)
        .filter(|&v| {
            let at = field.patches.vertices[v];
            at.normal_world == Vec3::Z && at.position_world.z < 1e-3
        })
        .collect();
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 0.2 - 0.1;
    let sides: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mesh = Mesh {
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        ..Mesh::default()
    };
    let mut shadows = Shadows::default();
    let mut before: Option<Before> = None;
    let (mut depth, mut steps) = (0.0f32, [0.0f32; 2]);
    for frame in 0..FRAMES {
        let object = Object::new(&mesh, Vec3::new(-0.25 + step_m * frame as f32, 0.05, 0.25));
        shadows.frame(case, field, &object, count, Priority::ErrorRemoved);
        let removed = |lights: &[Representative], rows: &[[f32; 3]], parts: &[SeenPart]| -> Vec<f32> {
            let at = |&v: &usize| {
                let at = field.patches.vertices[v];
                let light = |(k, light): (usize, &Representative)| {
                    let row = color::luminance(rows[k * vertices + v]);
                    if row > 0.0 {
                        row * object.hidden(
                            at.gather_world,
                            at.normal_world,
                            light,
                            side,
                            parts[k * vertices + v].middle_half(),
                        )
                    } else {
                        0.0
                    }
                };
                lights.iter().enumerate().map(light).sum()
            };
            watched.iter().map(at).collect()
        };
        let now = removed(shadows.lights.near(), &shadows.rows, &shadows.parts);
        depth = now.iter().copied().fold(depth, f32::max);
        if let Some((lights, rows, parts, last)) = before {
            let largest = |old: &[f32]| old.iter().zip(&now).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let both = [largest(&removed(&lights, &rows, &parts)), largest(&last)];
            steps.iter_mut().zip(both).for_each(|(most, step)| *most = most.max(step));
        }
        before = Some((shadows.lights.near().to_vec(), shadows.rows.clone(), shadows.parts.clone(), now));
    }
    assert!(watched.len() > 100 && depth > 0.0);
    steps.map(|step| step / depth)
}

#[test]
fn a_box_that_moves_slowly_does_not_make_its_shadow_jump() {
    let Some(shared) = support::shared("a_box_that_moves_slowly") else { return };
    let case = case::load(&shared.join("reference/f3_window_ceiling_patch")).unwrap();
    let room = case.room();
    let patches = subdivide(&room, &Subdivision::default(), &|_| None).unwrap();
    let all = Preparation { power_share: 1.0, ..Preparation::default() };
    let field = NearField::build(&room, patches, &all, &|_| ()).unwrap();
    for (step_m, count, side) in STEPS {
        let [choice, all] = largest_steps(&case, &field, step_m, count, side);
        println!(
            "steps of {:.1} mm, {count} lights of {side} x {side} places: {choice:.4} {all:.4}",
            1e3 * step_m
        );
        let figure = format!("f3.step.{:.1}mm.{count}x{}", 1e3 * step_m, side * side);
        wanted::hold(&format!("{figure}.choice"), f64::from(choice));
        wanted::hold(&format!("{figure}.all"), f64::from(all));
    }
}

/// Step, lights, places a side.
///
/// Of steps of 0.1 mm one in a hundred marks a source anew, which shifts a light's parallelogram by micrometres. The worst of a
/// hundred such steps is 5.0 % of the deepest shadow: one place of nine of one light passes an edge, and at that vertex this
/// light is 45 % of the deepest shadow. So it falls with the share of a place: 1.2 % from 5 x 5 places on each light, 0.6 % from
/// 9 x 9, 0.1 % from 21 x 21; no light is exchanged, and none changes what it sends. Ten hard lights step by two lights when one
/// of them is split; fifty soft ones by a seventieth.
/// What moves in all is mostly edges of the box that pass over a place: a light of ten is a tenth of the shadow.
const STEPS: [(f32, usize, u32); 6] =
    [(0.0001, 10, 1), (0.0001, 10, 3), (0.0001, 50, 3), (0.005, 10, 1), (0.005, 10, 3), (0.005, 50, 3)];
