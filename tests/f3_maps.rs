//! F3 of the reference through the product's own frame: near light taken away by shadow maps, for n = 1 to 256 lights.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/room_scene.rs"]
mod room_scene;
mod support;

use halflight::{
    animate::posed::Posed,
    assets::{case, pictures},
    engine::{Engine, RelightInput, cpu::CpuEngine},
    model::{
        frame::Exposure,
        image::HdrImage,
        light::{Lights, RadianceSh},
        picture::Picture,
        quality::Quality,
        response::Response,
        time::Timestamp,
    },
    nearfield::{
        field::Preparation,
        prepare::{RoomLight, RoomSettings, prepare},
    },
    plan::{FramePlan, Pass, effects},
};
use room_scene::{Object, Off, RoomView, Traced, compare};
use std::{path::Path, sync::Arc};
use support::wanted;

const COUNTS: [usize; 6] = [1, 5, 10, 20, 50, 256];

/// Object, places of each light a side; off from rays of our own, and off from the reference's picture.
type Row = (&'static str, u32, Vec<Off>, Vec<Off>);

fn table(shared: &Path, id: &str) -> Vec<Row> {
    let case = case::load(&shared.join("reference").join(id)).unwrap();
    let preparation = Preparation { power_share: 1.0, ..Preparation::default() };
    let how = RoomSettings { preparation, ..RoomSettings::default() };
    let known = Arc::new(prepare(case.room(), &how, RoomLight::Given, None, &|_| ()).unwrap());
    let radiance = pictures::load_raw(&case.image("noobj").unwrap().file).unwrap();
    let mut background = HdrImage::default();
    background.flags.reshape(radiance.width(), radiance.height(), 0);
    background.radiance = radiance;
    let view = RoomView::new(&case, &known.field.patches, &case.room(), 2);
    let mut engine = CpuEngine::new(None).unwrap();
    engine.load_room(Some(Arc::clone(&known))).unwrap();
    let mut rows = Vec::new();
    for object in ["table", "raised", "under"] {
        let mut scene = case.scene(Some(&format!("obj_{object}"))).unwrap();
        scene.surfaces.clear();
        scene.room = Some(Arc::new(known.room.clone()));
        engine.load_scene(&scene).unwrap();
        let of_object = Object::of(&case, &format!("obj_{object}"));
        let truth = Traced::new(&case, object, &case.room(), &view, &of_object, 24);
        let posed = Posed::new(&scene);
        let light = Lights::soft(RadianceSh::zero(4));
        for places in [1, 4] {
            let (offs, of_reference): (Vec<Off>, Vec<Off>) = COUNTS
                .iter()
                .map(|&n| {
                    let quality = Quality { shadow_maps: n, pcf_taps: places, ..Quality::default() };
                    let mut plan = FramePlan::default();
                    effects::plan(&effects::Occasion::SHOW, &scene, &light, &quality, &mut plan);
                    assert!(plan.has(Pass::PointMaps) && plan.has(Pass::Subtract));
                    let input = RelightInput {
                        background: &background,
                        lens: &case.lens,
                        world_from_camera: &case.world_from_camera,
                        light: &light,
                        environment: None,
                        posed: Some(&posed),
                        response: &Response::srgb(),
                        shown_exposure: Exposure { time_s: 1.0, gain: 1.0 },
                        t: Timestamp(0),
                    };
                    let mut picture = Picture::default();
                    engine.relight(&plan, &input, &mut picture).unwrap();
                    let shown: Vec<[f32; 3]> = (background.radiance.pixels().iter())
                        .zip(picture.radiance.pixels())
                        .map(|(before, after)| std::array::from_fn(|c| before[c] - after[c]))
                        .collect();
                    (truth.compare(&shown), compare(&case, object, &shown))
                })
                .unzip();
            let line = |offs: &[Off]| -> String {
                offs.iter().map(|o| format!("  {:.4} {:+5.1}%", o.rmse, 100.0 * (o.energy - 1.0))).collect()
            };
            println!("{id} {object:7} {places} places {}", line(&offs));
            println!("                          the reference's  {}", line(&of_reference));
            rows.push((object, places, offs, of_reference));
        }
    }
    rows
}

/// The rows of `wanted.tsv` are measured from 4 x 4 places on each light, against rays of our own, which have no noise; the
/// reference's is 0.087 for the raised box at the window, about 0.03 for the others there. The box under the table at the
/// window misses the 0.04 with all lights: 0.047, and 0.028 by rays, whose pixels are means over four places.
///
/// The box under the lamp's table is no measure against rays (see `f3.rs`): its figures are against the reference.
#[test]
fn removed_light_by_shadow_maps_against_ray_tracing() {
    let Some(shared) = support::shared("removed_light_by_shadow_maps_against_ray_tracing") else { return };
    for id in ["f3_ceiling_light", "f3_window_ceiling_patch"] {
        for (object, places, offs, of_reference) in table(&shared, id) {
            let few = (id, object) == ("f3_ceiling_light", "under");
            // More maps are better, hard or soft; a box in the table's shadow of which six pixels are seen goes up and down by
            // a fiftieth, and hard shadows' edges fall on one of the six or beside it.
            for pair in of_reference.windows(2) {
                assert!(
                    few && places == 1 || pair[1].rmse <= 1.05 * pair[0].rmse + 0.02,
                    "{id} {object} {places}: {offs:?}"
                );
            }
            if places == 1 {
                continue;
            }
            let held = if few { &of_reference } else { &offs };
            let figure = format!("f3.maps.{}.{object}", room_scene::short_name(id));
            for at in [2, 4, 5] {
                let figure = format!("{figure}.{}", COUNTS[at]);
                wanted::hold(&figure, held[at].rmse);
                wanted::hold(&format!("{figure}.light"), held[at].energy - 1.0);
            }
        }
    }
}
