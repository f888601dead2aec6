//! F3 of the reference through the product's own frame: near light taken away by shadow maps, for n = 1 to 256 lights.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/room_scene.rs"]
mod room_scene;
mod support;

use glam::Vec3;
use halflight::{
    animate::posed::Posed,
    assets::{
        case::{self, Case},
        pictures,
    },
    engine::{Engine, RelightInput, cpu::CpuEngine},
    math::dice::Dice,
    model::{
        frame::Exposure,
        image::HdrImage,
        light::{Lights, RadianceSh},
        picture::Picture,
        quality::Quality,
        response::Response,
        scene::Scene,
        time::Timestamp,
    },
    nearfield::{
        field::Preparation,
        prepare::{KnownRoom, RoomLight, RoomSettings, prepare},
    },
    plan::{FramePlan, Pass, effects},
};
use room_scene::{Object, Off, RoomView, Traced, compare};
use std::{path::Path, sync::Arc};
use support::wanted;

const COUNTS: [usize; 6] = [1, 5, 10, 20, 50, 256];

/// Object, places of each light a side; off from rays of our own, and off from the reference's picture.
type Row = (&'static str, u32, Vec<Off>, Vec<Off>);

/// A room of the reference, and an engine to draw it.
struct Drawn {
    case: Case,
    known: Arc<KnownRoom>,
    background: HdrImage,
    engine: CpuEngine,
}

impl Drawn {
    fn new(shared: &Path, id: &str) -> Self {
        let case = case::load(&shared.join("reference").join(id)).unwrap();
        let preparation = Preparation { power_share: 1.0, ..Preparation::default() };
        let how = RoomSettings { preparation, ..RoomSettings::default() };
        let known = Arc::new(prepare(case.room(), &how, RoomLight::Given, None, &|_| ()).unwrap());
        let radiance = pictures::load_raw(&case.image("noobj").unwrap().file).unwrap();
        let mut background = HdrImage::default();
        background.flags.reshape(radiance.width(), radiance.height(), 0);
        background.radiance = radiance;
        let mut engine = CpuEngine::new(None).unwrap();
        engine.load_room(Some(Arc::clone(&known))).unwrap();
        Self { case, known, background, engine }
    }

    /// The case's scene with one of its objects, in its place or shifted.
    fn scene(&self, object: &str, shift: Vec3) -> Scene {
        let mut scene = self.case.scene(Some(&format!("obj_{object}"))).unwrap();
        scene.surfaces.clear();
        scene.room = Some(Arc::new(self.known.room.clone()));
        // In the object's own space: a figure's nodes say where its parts stand.
        let own = scene.objects[0].world_from_object.matrix3.inverse() * glam::Vec3A::from(shift);
        scene.objects[0].mesh.positions.iter_mut().for_each(|p| *p += Vec3::from(own));
        scene
    }

    /// What the objects of a scene take away at every pixel, and how many near lights it was drawn with.
    fn removed(&mut self, scene: &Scene, quality: &Quality) -> (Vec<[f32; 3]>, usize) {
        self.engine.load_scene(scene).unwrap();
        let posed = Posed::new(scene);
        let light = Lights::soft(RadianceSh::zero(4));
        let mut plan = FramePlan::default();
        effects::plan(&effects::Occasion::SHOW, scene, &light, quality, &mut plan);
        assert!(plan.has(Pass::PointMaps) && plan.has(Pass::Subtract));
        let input = RelightInput {
            background: &self.background,
            lens: &self.case.lens,
            world_from_camera: &self.case.world_from_camera,
            light: &light,
            environment: None,
            posed: Some(&posed),
            response: &Response::srgb(),
            shown_exposure: Exposure { time_s: 1.0, gain: 1.0 },
            t: Timestamp(0),
        };
        let mut picture = Picture::default();
        self.engine.relight(&plan, &input, &mut picture).unwrap();
        let removed = (self.background.radiance.pixels().iter())
            .zip(picture.radiance.pixels())
            .map(|(before, after)| std::array::from_fn(|c| before[c] - after[c]))
            .collect();
        (removed, self.engine.near_choice().unwrap().lights)
    }
}

fn table(shared: &Path, id: &str) -> Vec<Row> {
    let mut drawn = Drawn::new(shared, id);
    let view = RoomView::new(&drawn.case, &drawn.known.field.patches, &drawn.case.room(), 2);
    let mut rows = Vec::new();
    for object in ["table", "raised", "under"] {
        let scene = drawn.scene(object, Vec3::ZERO);
        let of_object = Object::of(&drawn.case, &format!("obj_{object}"));
        let truth = Traced::new(&drawn.case, object, &drawn.case.room(), &view, &of_object, 24);
        for places in [1, 4] {
            let (offs, of_reference): (Vec<Off>, Vec<Off>) = COUNTS
                .iter()
                .map(|&n| {
                    let quality = Quality {
                        shadow_maps: n,
                        near_width_deg: 90.0,
                        pcf_taps: places,
                        ..Quality::default()
                    };
                    let (shown, _) = drawn.removed(&scene, &quality);
                    (truth.compare(&shown), compare(&drawn.case, object, &shown))
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

/// Point 11's figure: at the defaults the shadow of near light is right to an eighth, wherever the object stands. The cases'
/// own places, and places by rule with seeds; a shadow of fewer than 100 pixels is no measure.
#[test]
fn shadows_of_near_light_at_the_defaults() {
    let Some(shared) = support::shared("shadows_of_near_light_at_the_defaults") else { return };
    let quality = Quality::default();
    let (mut worst, mut light, mut most, mut measured) = (0.0f64, 0.0f64, 0, 0);
    for id in ["f3_ceiling_light", "f3_window_ceiling_patch"] {
        let mut drawn = Drawn::new(&shared, id);
        let view = RoomView::new(&drawn.case, &drawn.known.field.patches, &drawn.case.room(), 2);
        let mut dice = Dice::new(20_261_130);
        for place in 0..15 {
            let object = ["table", "raised", "under"][place % 3];
            let shift = match place {
                0..3 => Vec3::ZERO,
                _ => Vec3::from_array([0.25, 0.2, 0.15].map(|most| dice.between(-most, most) as f32)),
            };
            // Not into the table or the floor.
            let shift = if object == "raised" { shift } else { shift.with_z(0.0) };
            let scene = drawn.scene(object, shift);
            let moved = halflight::assets::shapes::transformed(
                &scene.objects[0].mesh,
                &scene.objects[0].world_from_object,
            );
            let of_object = Object::new(&moved, Vec3::ZERO);
            let truth = Traced::of_another(&drawn.case, &drawn.case.room(), &view, &of_object, 24);
            let (shown, lights) = drawn.removed(&scene, &quality);
            let off = truth.compare(&shown);
            println!("{id} {object:7} {shift:.2}  {lights:3} lights  {off:?}");
            // Every other pixel of every other row was traced.
            if off.pixels < 25 || off.rmse.is_nan() {
                continue;
            }
            measured += 1;
            most = most.max(lights);
            worst = worst.max(off.rmse);
            light = light.max((off.energy - 1.0).abs());
        }
    }
    println!("{measured} shadows, {most} lights at most");
    assert!(measured > 15 && most <= 4 * quality.shadow_maps);
    wanted::hold("f3.defaults.shadow", worst);
    wanted::hold("f3.defaults.light", light);
}

/// The rows of `wanted.tsv` are measured from 4 x 4 places on each light, against rays of our own, which have no noise; the
/// reference's is 0.087 for the raised box at the window, about 0.03 for the others there. The box under the table at the
/// window misses the 0.04 with all lights: 0.047. The cause is one ray a pixel: an edge that is a fraction of a texel off
/// falls on the ray or beside it. Drawn in twice the size and averaged by four pixels it is 0.0367, with nine rays against
/// nine 0.0361, with sixteen against sixteen 0.0369; 0.0467 with one against one. From 8 x 8 places on each light it is 0.046.
/// By rays of our own, with means over four places, it is 0.031.
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
