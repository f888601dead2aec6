#![allow(warnings, clippy::all)]
#[path = "support/room_scene.rs"]
mod room_scene;
mod support;
use halflight::{assets::{case, pictures}, nearfield::{field::{NearField, Preparation}, patches::{Subdivision, subdivide}}, sources::expand::Priority};
use room_scene::*;
#[test]
fn exp() {
    let shared = support::shared("x").unwrap();
    for id in ["f3_ceiling_light", "f3_window_ceiling_patch"] {
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let room = case.room();
    let background = pictures::load_raw(&case.image("noobj").unwrap().file).unwrap();
    let base = Preparation { power_share: 1.0, ..Preparation::default() };
    for (name, how, count) in [("base", base, 1500), ("neglect 0", Preparation { neglected: 0.0, ..base }, 1500), ("rays 4", Preparation { rays_side: 4, ..base }, 1500), ("rays4 neglect0 3000", Preparation { rays_side: 4, neglected: 0.0, ..base }, 3000)] {
        let patches = subdivide(&room, &Subdivision { patches: count, ..Subdivision::default() }, &|_| None).unwrap();
        let field = NearField::build(&room, patches, &how, &|_| ()).unwrap();
        let view = RoomView::new(&case, &field.patches, &room, 2);
        let model = view.gathered(&field);
        for object_name in ["table", "raised", "under"] {
            let object = Object::of(&case, &format!("obj_{object_name}"));
            let truth = Traced::new(&case, object_name, &room, &view, &object, 24);
            let mut shadows = Shadows::default();
            let mut line = String::new();
            for n in [10, 50, usize::MAX] {
                shadows.frame(&case, &field, &object, n, Priority::ErrorRemoved);
                let removed = shadows.removed(&view, &field, &object, if n > 100 { 1 } else { 3 });
                let raw = truth.compare(&removed);
                let mut shown = removed.clone();
                for (i, s) in shown.iter_mut().enumerate() { for c in 0..3 {
                    let m = model[i][c];
                    s[c] = (if m > 0.0 { removed[i][c] / m } else { 0.0 }).min(1.0) * background.pixels()[i][c];
                } }
                let o = truth.compare(&shown);
                line += &format!("  {:.3} {:+.1}% (raw {:.3} {:+.1}%)", o.rmse, 100.0 * (o.energy - 1.0), raw.rmse, 100.0 * (raw.energy - 1.0));
            }
            println!("{id} {name} {object_name}: {line}");
        }
    }
    }
}
