//! Near light: sources that touch, hold or graze what they light. The form factor, the shafts and the cut have no shader;
//! maps and subtraction run on every engine.

use crate::engines;
use crate::lit_room;
use glam::{Affine3A, DQuat, DVec3, Vec3};
use halflight::{
    animate::posed::Posed,
    assets::shapes,
    engine::{Engine, RelightInput},
    math::lens::Distortion,
    model::{
        frame::Exposure,
        image::HdrImage,
        light::{Lights, RadianceSh},
        picture::Picture,
        quality::{NearForm, Quality},
        response::Response,
        scene::{Material, VirtualObject},
        time::Timestamp,
    },
    nearfield::{
        form_factor::{SMALLEST, form_factor},
        prepare::KnownRoom,
        shaft::{Aabb, shaft_interval},
    },
    plan::{FramePlan, Pass, effects},
    sources::{
        cut::{Cutter, Leaf},
        expand::{Expander, Marked, Priority, WantedNodes},
        tree::SourceTree,
    },
    visibility::point_maps::PointCamera,
};
use std::sync::{Arc, OnceLock};

fn square(height: f64, side: f64, aside: f64) -> [DVec3; 4] {
    let h = 0.5 * side;
    let corner = |x: f64, y: f64| DVec3::new(x + aside, y, height);
    [corner(-h, -h), corner(h, -h), corner(h, h), corner(-h, h)]
}

/// Six walls around a point are all that it sees, however near one of them is.
#[test]
fn a_closed_box_is_all_there_is() {
    for height in [0.5, 0.1, 1e-3, 1e-6, 1e-9, 1e-12] {
        // The receiver on the floor of a unit cube, or a little above, beside the wall x = 0.
        for away in [0.5, 1e-2, 1e-4, 1e-6] {
            let at = DVec3::new(away, 0.5, height);
            let c = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
            let walls = [
                [c(0.0, 0.0, 1.0), c(1.0, 0.0, 1.0), c(1.0, 1.0, 1.0), c(0.0, 1.0, 1.0)],
                [c(0.0, 0.0, 0.0), c(0.0, 1.0, 0.0), c(0.0, 1.0, 1.0), c(0.0, 0.0, 1.0)],
                [c(1.0, 0.0, 0.0), c(1.0, 1.0, 0.0), c(1.0, 1.0, 1.0), c(1.0, 0.0, 1.0)],
                [c(0.0, 0.0, 0.0), c(1.0, 0.0, 0.0), c(1.0, 0.0, 1.0), c(0.0, 0.0, 1.0)],
                [c(0.0, 1.0, 0.0), c(1.0, 1.0, 0.0), c(1.0, 1.0, 1.0), c(0.0, 1.0, 1.0)],
            ];
            let sum: f64 = walls.iter().map(|wall| form_factor(at, DVec3::Z, wall)).sum();
            // The floor is behind the receiver; what is below 1e-7 counts as nothing.
            assert!((sum - 1.0).abs() < 1e-6, "{at}: {sum}");
        }
    }
}

/// From far above down to the plane itself and out at its edge: shares, and small steps.
#[test]
fn form_factors_are_continuous_down_to_contact() {
    let mut before = form_factor(DVec3::ZERO, DVec3::Z, &square(10.0, 1.0, 0.0));
    let mut worst = 0.0f64;
    for step in 1..=1200 {
        let height = 10.0 * 0.98f64.powi(step);
        let now = form_factor(DVec3::ZERO, DVec3::Z, &square(height, 1.0, 0.0));
        assert!((0.0..=1.0).contains(&now), "{height}: {now}");
        worst = worst.max((now - before).abs());
        before = now;
        if height < EDGE_ON {
            break;
        }
    }
    // 2 % of the height is at most 2 % of the factor's own slope.
    assert!(worst < 0.02 && before > 0.999_999, "{worst}, {before}");
    // Past the edge of a patch that nearly touches the factor falls from 1 to 0 over the height: there sampled finely.
    let mut before = 1.0;
    for step in 0..=400 {
        let aside = 0.49 + 5e-5 * f64::from(step);
        let now = form_factor(DVec3::ZERO, DVec3::Z, &square(1e-3, 1.0, aside));
        assert!((0.0..=1.0).contains(&now) && (now - before).abs() < 0.03, "{aside}: {before} {now}");
        before = now;
    }
}

/// Nearer to the plane than this the polygon counts as seen edge-on.
const EDGE_ON: f64 = 1e-6;

/// Slivers, folded and doubled corners, NaN: nothing negative, nothing beyond 1.
#[test]
fn slivers_have_the_factor_of_slivers() {
    let at = |x: f64, y: f64| DVec3::new(x, y, 1.0);
    for thin in [1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0] {
        let sliver = [at(-0.5, 0.0), at(0.5, 0.0), at(0.5, thin), at(-0.5, thin)];
        let factor = form_factor(DVec3::ZERO, DVec3::Z, &sliver);
        // The integral of 1/(pi (1 + x^2)^2) over its length, times its width.
        let want = thin * (0.5f64 / 1.25 + 0.5f64.atan()) / std::f64::consts::PI;
        assert!((factor - want).abs() < 1e-6 * want.max(1e-3) + SMALLEST, "{thin}: {factor} for {want}");
    }
    let odd = [
        vec![at(0.0, 0.0); 4],
        vec![at(0.0, 0.0), at(1.0, 0.0)],
        vec![at(0.0, 0.0), at(1.0, 0.0), at(0.0, 0.0), at(1.0, 0.0)],
        vec![DVec3::NAN, at(1.0, 0.0), at(0.0, 1.0)],
        vec![DVec3::INFINITY, at(1.0, 0.0), at(0.0, 1.0)],
        vec![at(1e300, 0.0), at(1e300, 1.0), at(0.0, 1e300)],
        vec![DVec3::ZERO, at(1.0, 0.0), at(0.0, 1.0)],
    ];
    for corners in odd {
        for normal in [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::ZERO, DVec3::NAN] {
            let factor = form_factor(DVec3::ZERO, normal, &corners);
            assert!((0.0..=1.0).contains(&factor), "{corners:?} along {normal}: {factor}");
        }
    }
}

/// Turned, moved and scaled together the factor stays.
#[test]
fn form_factors_do_not_depend_on_frame_or_unit() {
    let base = form_factor(DVec3::ZERO, DVec3::Z, &square(0.3, 1.0, 0.4));
    for k in 0..50 {
        let turn = DQuat::from_euler(
            glam::EulerRot::XYZ,
            0.37 * f64::from(k),
            1.1 * f64::from(k),
            -0.2 * f64::from(k),
        );
        let scale = 10f64.powf(0.2 * f64::from(k) - 5.0);
        let away = DVec3::new(3.0, -2.0, 1.0) * scale;
        let place = |p: DVec3| turn * (p * scale) + away;
        let corners = square(0.3, 1.0, 0.4).map(place);
        let factor = form_factor(place(DVec3::ZERO), turn * DVec3::Z, &corners);
        assert!((factor - base).abs() < 1e-12, "{k}: {factor} {base}");
    }
}

/// A lamp that an object comes up to, swallows and leaves: its map is there, or nothing is before it.
#[test]
fn a_lamp_within_an_object_has_a_sound_map() {
    let ball = shapes::uv_sphere(0.2, 16, 8);
    for step in -60..=60 {
        let aside = 0.01 * step as f32;
        let casters: Vec<Vec3> = ball.positions.iter().map(|p| *p + Vec3::new(aside, 0.003, 0.001)).collect();
        for front in [Vec3::NEG_Z, Vec3::X, Vec3::ZERO] {
            let Some(camera) = PointCamera::fit(Vec3::ZERO, front, &casters, 128) else { continue };
            assert!(camera.near_m > 0.0 && camera.near_m.is_finite(), "{aside}: {camera:?}");
            assert!(
                camera.texel > 0.0 && camera.rows.as_flattened().iter().all(|v| v.is_finite()),
                "{camera:?}"
            );
            for p in &casters {
                if let Some([x, y, depth]) = camera.map(0, *p) {
                    assert!(
                        x.is_finite() && y.is_finite() && (0.0..1.0).contains(&depth),
                        "{aside}: {x} {y} {depth}"
                    );
                }
            }
            let slope = camera.slope(0, Vec3::new(1.0, 0.0, 0.0), Vec3::Y);
            assert!(slope.iter().all(|s| s.is_finite()), "a receiver whose plane holds the lamp: {slope:?}");
        }
    }
}

/// Boxes that touch, are flat, or are points: what is met from one side is met from the other.
#[test]
fn shafts_between_touching_boxes() {
    let flat = |low: [f32; 3], high: [f32; 3]| Aabb { low: Vec3::from(low), high: Vec3::from(high) };
    let (wall, floor) = (flat([0.0; 3], [0.0, 1.0, 1.0]), flat([0.0; 3], [1.0, 1.0, 0.0]));
    let edge = flat([0.0, 0.5, 0.0], [0.0, 0.5, 0.0]);
    assert!(shaft_interval(&wall, &floor, &edge).is_some());
    assert!(shaft_interval(&floor, &wall, &edge).is_some());
    assert_eq!(shaft_interval(&wall, &floor, &flat([1.1, 0.0, 1.1], [2.0; 3])), None);
    for huge in [1e-30f32, 1e-3, 1.0, 1e10, 1e30] {
        let [a, b, c] = [wall, floor, edge].map(|b| Aabb { low: b.low * huge, high: b.high * huge });
        let met = shaft_interval(&a, &b, &c).expect("in any unit");
        assert!((0.0..=1.0).contains(&met[0]) && met[0] <= met[1] && met[1] <= 1.0, "{met:?}");
    }
}

/// Power of the k-th source.
type Power = fn(usize) -> f32;

/// Sources at one place, of no power, of infinite power, far apart in power: what is cut has all the light.
#[test]
fn cuts_keep_the_light() {
    let place = |k: usize| Vec3::new((k % 7) as f32, (k % 3) as f32, 1.0);
    let powers: [(&str, Power); 5] = [
        ("equal", |_| 1.0),
        ("from 1e-30 to 1e30", |k| 10f32.powf(2.0 * k as f32 - 30.0)),
        ("one", |k| if k == 5 { 1e6 } else { 0.0 }),
        ("damaged", |k| [1.0, f32::NAN, f32::INFINITY, -2.0][k % 4]),
        ("none", |_| 0.0),
    ];
    for (name, power) in powers {
        for together in [false, true] {
            let at = |k: usize| if together { Vec3::ONE } else { place(k) };
            let leaves: Vec<Leaf> =
                (0..31).map(|k| Leaf { at: at(k), flux_rgb: [power(k); 3], root: (k % 2) as u32 }).collect();
            let sound = |e: &f32| e.is_finite() && *e > 0.0;
            let all: f64 = (0..31).map(power).filter(sound).map(f64::from).sum();
            let mut cutter = Cutter::default();
            for count in [1, 2, 8, 64] {
                let made = cutter.cut(&leaves, count);
                assert!(made.len() <= count);
                let sum: f64 = made.iter().map(|r| f64::from(r.flux_rgb[1])).sum();
                assert!(made.iter().all(|r| r.at.is_finite() && r.flux_rgb[1] > 0.0), "{name}: {made:?}");
                assert!(sum <= all * (1.0 + 1e-5), "{name}: {sum} of {all}");
                assert!(count < 2 || (sum - all).abs() <= 1e-5 * all, "{name}, {count}: {sum} of {all}");
            }
            let places: Vec<Vec3> = (0..31).map(at).collect();
            let light: Vec<f32> = (0..31).map(power).collect();
            let tree = SourceTree::build(&places, &light);
            let ordered: Vec<f32> = tree.order().iter().map(|&k| light[k as usize]).collect();
            let towards = vec![Vec3::Z; 31];
            let marked = Marked { tree: &tree, light: &ordered, towards: &towards, lasting: false };
            let mut expander = Expander::default();
            for by in [Priority::ErrorRemoved, Priority::Transfer] {
                for count in [1, 3, 40] {
                    let sum: f64 = expander
                        .expand(&[marked], WantedNodes::exactly(count), by)
                        .iter()
                        .map(|c| f64::from(c.light))
                        .sum();
                    assert!((sum - all).abs() <= 1e-5 * all, "{name}, {count}: {sum} of {all}");
                }
            }
        }
    }
}

fn known() -> Arc<KnownRoom> {
    static ROOM: OnceLock<Arc<KnownRoom>> = OnceLock::new();
    Arc::clone(ROOM.get_or_init(|| Arc::new(lit_room::known_room(false))))
}

/// What is left of the room's light with one object in it.
fn left(engine: &mut dyn Engine, object: VirtualObject, near_form: NearForm) -> Picture {
    let known = known();
    let mut scene = lit_room::scene(&known);
    scene.objects = vec![object];
    let (lens, pose) = lit_room::camera(40, 30, Distortion::None);
    let mut background = HdrImage::default();
    background.radiance.reshape(40, 30, [1.0; 3]);
    background.flags.reshape(40, 30, 0);
    let light = Lights::soft(RadianceSh::zero(4));
    let quality = Quality {
        shadow_maps: 8,
        coverage_samples: 1,
        shadow_map_texels: 256,
        near_form,
        ..Quality::default()
    };
    let mut plan = FramePlan::default();
    effects::plan(&effects::Occasion::SHOW, &scene, &light, &quality, &mut plan);
    plan.passes.retain(|planned| planned.pass != Pass::ShadeObject);
    engine.load_room(Some(known)).expect("a room");
    engine.load_scene(&scene).expect("a sound scene");
    let input = RelightInput {
        background: &background,
        lens: &lens,
        world_from_camera: &pose,
        light: &light,
        environment: None,
        posed: Some(&Posed::new(&scene)),
        response: &Response::srgb(),
        shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
        t: Timestamp(0),
    };
    let mut out = Picture::default();
    engine.relight(&plan, &input, &mut out).expect("a sound frame");
    engine.load_room(None).expect("no room");
    out
}

fn ball(at: Vec3, radius: f64) -> VirtualObject {
    VirtualObject {
        name: "ball".into(),
        mesh: shapes::uv_sphere(radius, 16, 8),
        material: Material::Lambert { albedo_rgb: [0.5; 3] },
        world_from_object: Affine3A::from_translation(at),
        openness: Vec::new(),
    }
}

/// An object around the window, in its plane, through the table, within a wall, around the camera, outside of the room,
/// of no size: what is left is a share everywhere.
pub fn all(engine: &mut dyn Engine) {
    let window = Vec3::new(-1.99, -0.1, 0.75);
    let places = [
        ("around the window", ball(window, 0.9)),
        ("touching the window", ball(window + Vec3::new(0.2, 0.0, 0.0), 0.2)),
        ("in the window's plane", ball(window + Vec3::new(0.0, 1.0, 0.0), 0.2)),
        ("through the table", ball(Vec3::new(0.0, 0.0, 0.0), 0.2)),
        ("on the table", ball(Vec3::new(0.0, 0.0, 0.1), 0.1)),
        ("in a wall", ball(Vec3::new(0.0, 1.5, 0.5), 0.3)),
        ("around the camera", ball(Vec3::new(0.9, -1.2, 0.95), 0.5)),
        ("around the room", ball(Vec3::ZERO, 6.0)),
        ("outside of the room", ball(Vec3::new(9.0, 0.0, 0.0), 0.5)),
        ("of no size", ball(Vec3::new(0.0, 0.0, 0.1), 1e-9)),
    ];
    for (name, object) in places {
        for form in [NearForm::Ratio, NearForm::Ldr] {
            let picture = left(engine, object.clone(), form);
            for c in picture.radiance.pixels().as_flattened() {
                assert!((0.0..=1.0).contains(c), "{name}, {}: {c}", form.name());
            }
        }
    }
    // On its way from the table to the lamp and through it.
    let (mut before, mut worst) = (None::<Picture>, 0.0f32);
    for step in 0..=24 {
        let at = Vec3::new(0.0, 0.0, 0.15).lerp(window - Vec3::new(0.3, 0.0, 0.0), step as f32 / 24.0);
        let picture = left(engine, ball(at, 0.12), NearForm::Ratio);
        if let Some(before) = &before {
            let (a, b) = (before.radiance.pixels().as_flattened(), picture.radiance.pixels().as_flattened());
            let mean = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32;
            worst = worst.max(mean);
        }
        before = Some(picture);
    }
    println!("on its way through the window: {worst:.3} in the mean for 10 cm");
    assert!(worst < 0.05, "{worst}");
}

engines::on_each!("near::gl");
