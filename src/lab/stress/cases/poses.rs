//! Quaternions, time, tags that hardly show, and rays that hardly cross.

use crate::light::{follow::Follow, halve::HalveOptions, split::SplitOptions};
use crate::math::{lens::Lens, pose::Pose, rigid::Quaternion, vector::Vector};
use crate::model::{
    estimate::LightFlags,
    light::{RadianceSamples, RadianceSh},
    quality::SplitKind,
    rig::{Rig, TagPlacement},
    time::Timestamp,
};
use crate::stress::{CaseBound, HardCase, Where, naive};
use crate::track::{
    align::{MapView, place},
    state::{FollowOptions, TrackState},
    tag::TagDetection,
    tag_pose::{corners_of_tag_m, solve},
};
use glam::{DMat3, DVec2, DVec3};

const LENS: Lens = Lens::pinhole(640, 480, 800.0, 800.0, 320.0, 240.0);
const SIDE_M: f64 = 0.1;

/// A small turn about no axis of the world.
const TURN: [f32; 4] = [0.001, -0.002, 0.0007, 0.999_997_2];

/// Light of mean radiance `level` from everywhere.
fn level(level: f32) -> RadianceSh {
    let mut light = RadianceSh::zero(2);
    light.rgb[0] = [level; 3];
    light
}

/// What a filter of 50 ms holds after 1 at time 0 s and 3 at `then_s`.
fn followed(then_s: f64) -> f64 {
    let net_flux = SplitOptions::default();
    let halve = HalveOptions {
        kind: SplitKind::Paper,
        lights: 4,
        shadow_maps: 1,
        net_flux,
        above_horizon: false,
        dering: false,
    };
    let mut follow = Follow::new(0.05, halve);
    let (flags, none) = (LightFlags::default(), RadianceSamples::default());
    // Many before, so that the filter counts by time and not by number.
    for k in -200..=0 {
        follow.update(Timestamp::from_seconds(0.01 * f64::from(k)), &level(1.0), &flags, &none);
    }
    follow.update(Timestamp::from_seconds(then_s), &level(3.0), &flags, &none);
    follow.estimate(Timestamp(0)).map_or(f64::NAN, |e| f64::from(e.total.rgb[0][1]))
}

/// A tag that lies face up in the world's origin.
fn rig() -> Rig {
    let face_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let world_from_tag = Pose::from_matrix(face_up, DVec3::ZERO);
    Rig { lens: LENS, tags: vec![TagPlacement { id: 0, side_m: SIDE_M, world_from_tag }], ball: None }
}

/// Half a metre away, moved aside.
fn camera(aside_m: f64) -> Pose {
    Pose::look_at(DVec3::new(aside_m, -0.4, 0.4), DVec3::ZERO, DVec3::Z)
}

fn corners(rig: &Rig, pose: &Pose) -> [DVec2; 4] {
    let camera_from_tag = pose.inverse().then(&rig.tags[0].world_from_tag);
    corners_of_tag_m(SIDE_M).map(|c| rig.lens.project(camera_from_tag.transform(c)).unwrap_or(DVec2::NAN))
}

/// How far off the camera is `ahead_s` after the last of three pictures; it moves aside by 0.1 mm (as noise has it)
/// within the last `step_s`, and then stays.
fn predicted_off_m(step_s: f64, ahead_s: f64) -> f64 {
    let rig = rig();
    let mut state = TrackState::new(rig.clone(), FollowOptions::default());
    let mut see = |t_s: f64, aside_m: f64| {
        let corners_px = corners(&rig, &camera(aside_m));
        let tag = TagDetection { id: 0, hamming: 0, decision_margin: 90.0, corners_px, corner_sigma_px: 0.1 };
        state.update(Timestamp::from_seconds(t_s), &[tag]);
    };
    see(1.0, 0.0);
    see(1.0 + step_s, 1e-4);
    let found = state.pose_at(Timestamp::from_seconds(1.0 + step_s + ahead_s));
    found.map_or(f64::NAN, |e| e.world_from_camera.translation.distance(camera(1e-4).translation))
}

/// The distance of a tag that the corners tell; 0 where they are refused.
fn distance_m(corners_px: &[DVec2; 4]) -> f64 {
    solve(corners_px, SIDE_M, &LENS).map_or(0.0, |poses| poses.best.camera_from_tag.translation.length())
}

fn narrow(corners_px: &[DVec2; 4]) -> [[f32; 2]; 4] {
    corners_px.map(|c| [c.x as f32, c.y as f32])
}

/// Seen along its plane: all corners on one line.
const EDGE_ON: [DVec2; 4] =
    [DVec2::new(300.0, 240.0), DVec2::new(340.0, 240.0), DVec2::new(336.0, 240.0), DVec2::new(304.0, 240.0)];

/// Two views whose lines of sight are parallel; the map is twice as large.
fn parallel() -> [MapView<f32>; 2] {
    let view = |x: f32| MapView { known_m: Vector([x, 0.0, 0.0]), map: Vector([1.0 + 2.0 * x, 2.0, 3.0]) };
    [view(0.2), view(0.4)]
}

/// Scale by the crossing of two lines in x and y: cross(a, q_1 - q_2) / cross(a, b).
fn scale_by_crossing([first, second]: &[MapView<f32>; 2]) -> f32 {
    let flat = |v: Vector<f32, 3>| [-v.0[0], -v.0[1]];
    let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
    let (a, b) = (flat(first.known_m), flat(second.known_m));
    cross(a, flat(second.map - first.map)) / cross(a, b)
}

/// Two views of a map at scale 2, a degree or so apart, their places off by a hundredth: the error of the scale.
fn noisy() -> [MapView<f32>; 2] {
    let view = |p: [f32; 3], off: f32| {
        let map = p.map(|c| 2.0 * c);
        MapView { known_m: Vector(p), map: Vector([map[0] + off, map[1] - off, map[2]]) }
    };
    [view([0.5, 0.02, 0.2], 0.01), view([0.5, 0.03, 0.5], -0.01)]
}

/// In order.
pub const CASES: &[HardCase] = &[
    HardCase {
        name: "a quaternion after a million turns",
        measures: "its length",
        formula: "q <- q dq, as it comes",
        runs: Where::Processor,
        textbook: || {
            let q = (0..1_000_000).fold([0.0, 0.0, 0.0, 1.0], |q, _| naive::quaternion_product(q, TURN));
            q.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt()
        },
        ours: |_| {
            let turn = Quaternion(TURN);
            let q = (0..1_000_000)
                .fold(Quaternion::identity(), |q: Quaternion<f32>, _| q.times(turn).renormalised());
            Ok(q.0.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt())
        },
        bound: CaseBound::about(1.0, 2e-7),
    },
    HardCase {
        name: "half way between two equal turns",
        measures: "length of the quaternion",
        formula: "sin((1 - t) a) / sin(a), a = 0",
        runs: Where::Processor,
        textbook: || {
            let q = [0.0, 0.0, 0.0, 1.0];
            f64::from(naive::slerp(q, q, 0.5).iter().map(|c| c * c).sum::<f32>().sqrt())
        },
        ours: |_| {
            let q = Quaternion::<f32>::identity();
            Ok(f64::from(q.slerp(q, 0.5).dot(q)))
        },
        bound: CaseBound::about(1.0, 2e-7),
    },
    HardCase {
        name: "half way from q to -q, the same turn",
        measures: "length of the quaternion along q",
        formula: "sin((1 - t) a) / sin(a), a = pi",
        runs: Where::Processor,
        textbook: || {
            let q = [0.6, 0.0, 0.0, 0.8];
            let middle = naive::slerp(q, q.map(|c: f32| -c), 0.5);
            f64::from(middle[0] * q[0] + middle[3] * q[3])
        },
        ours: |_| {
            let q = Quaternion([0.6f32, 0.0, 0.0, 0.8]);
            Ok(f64::from(q.slerp(Quaternion(q.0.map(|c| -c)), 0.5).dot(q).abs()))
        },
        bound: CaseBound::about(1.0, 1e-6),
    },
    HardCase {
        name: "time that runs backwards",
        measures: "light of 1, then 3 a tenth of a second earlier",
        formula: "old + (1 - exp(-dt/tau)) (new - old), dt < 0",
        runs: Where::Processor,
        textbook: || f64::from(naive::filtered(1.0, 3.0, -0.1, 0.05)),
        ours: |_| Ok(followed(-0.1)),
        bound: CaseBound::about(1.0, 1e-6),
    },
    HardCase {
        name: "two pictures of one time",
        measures: "camera's error 0.1 s ahead, metres",
        formula: "speed (b - a) / dt, dt = 0",
        runs: Where::Processor,
        textbook: || f64::from(naive::speed(0.0, 1e-4, 0.0) * 0.1),
        ours: |_| Ok(predicted_off_m(0.0, 0.1)),
        bound: CaseBound::new(0.0, 0.002),
    },
    HardCase {
        name: "two pictures a microsecond apart",
        measures: "camera's error 0.1 s ahead, metres",
        formula: "speed (b - a) / dt from 0.1 mm of noise",
        runs: Where::Processor,
        textbook: || f64::from(naive::speed(0.0, 1e-4, 1e-6) * 0.1),
        ours: |_| Ok(predicted_off_m(1e-6, 0.1)),
        bound: CaseBound::new(0.0, 0.002),
    },
    HardCase {
        name: "no picture for ten seconds",
        measures: "camera's error then, metres",
        formula: "a + speed dt, from 0.1 mm in 2 ms",
        runs: Where::Processor,
        textbook: || f64::from(naive::speed(0.0, 1e-4, 0.002) * 10.0),
        ours: |_| Ok(predicted_off_m(0.002, 10.0)),
        bound: CaseBound::new(0.0, 0.02),
    },
    HardCase {
        name: "a tag seen along its plane",
        measures: "its distance, metres; 0 where refused",
        formula: "f side / sqrt(area), area = 0",
        runs: Where::Processor,
        textbook: || f64::from(naive::distance_by_area(800.0, 0.1, &narrow(&EDGE_ON))),
        ours: |_| Ok(distance_m(&EDGE_ON)),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "a tag of one point",
        measures: "its distance, metres; 0 where refused",
        formula: "f side / sqrt(area), area = 0",
        runs: Where::Processor,
        textbook: || f64::from(naive::distance_by_area(800.0, 0.1, &[[320.0, 240.0]; 4])),
        ours: |_| Ok(distance_m(&[DVec2::new(320.0, 240.0); 4])),
        bound: CaseBound::exactly(0.0),
    },
    HardCase {
        name: "a tag of eight pixels",
        measures: "1 where both of its poses are kept",
        formula: "one pose, the first that was found",
        runs: Where::Processor,
        textbook: || 0.0,
        ours: |_| {
            let rig = rig();
            let pose = Pose::look_at(DVec3::new(0.0, -6.0, 8.0), DVec3::ZERO, DVec3::Z);
            let found = solve(&corners(&rig, &pose), SIDE_M, &LENS);
            Ok(found.map_or(f64::NAN, |poses| f64::from(u8::from(poses.is_ambiguous(0.2)))))
        },
        bound: CaseBound::exactly(1.0),
    },
    HardCase {
        name: "parallel lines of sight",
        measures: "scale of the map (2)",
        formula: "crossing of two lines: 0/0",
        runs: Where::Processor,
        textbook: || f64::from(scale_by_crossing(&parallel())),
        ours: |_| Ok(place(Quaternion::identity(), &parallel()).map_or(f64::NAN, |p| f64::from(p.scale))),
        bound: CaseBound::about(2.0, 1e-5),
    },
    HardCase {
        name: "lines of sight that differ in z only, with noise",
        measures: "scale of the map (2)",
        formula: "crossing of two lines in x and y",
        runs: Where::Processor,
        textbook: || f64::from(scale_by_crossing(&noisy())),
        ours: |_| Ok(place(Quaternion::identity(), &noisy()).map_or(f64::NAN, |p| f64::from(p.scale))),
        bound: CaseBound::about(2.0, 0.1),
    },
];
