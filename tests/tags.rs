//! Tags on real photographs, and their poses against truth.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/golden.rs"]
mod golden;
mod support;

use glam::{DQuat, DVec2, DVec3};
use golden::{Entry, Precision};
use halflight::math::{
    dice::Dice,
    lens::{Distortion, Lens},
    pose::Pose,
    projection::Pinhole,
    rigid::{Quaternion, Rigid},
    sh::Real,
    vector::Vector,
};
use halflight::model::image::{Image, Rgb8Image};
use halflight::track::{
    minima::{self, Minima, Minimum},
    tag::{TagDetection, TagDetector, TagOptions, gray_of},
    tag_pose::{self, TagPoses},
};
use proptest::prelude::*;
use serde_json::Value;
use std::path::Path;

fn gray(path: &Path) -> Image<u8> {
    let picture = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).to_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let rgb = Rgb8Image::from_pixels(width, height, picture.pixels().map(|p| p.0).collect()).unwrap();
    let mut gray = Image::default();
    gray_of(&rgb, &mut gray);
    gray
}

fn detect(options: TagOptions, gray: &Image<u8>) -> Vec<TagDetection> {
    let mut out = Vec::new();
    TagDetector::new(options).unwrap().detect(gray, None, &mut out).unwrap();
    out
}

fn corner_truth(path: &Path) -> Vec<[DVec2; 4]> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines()
        .filter(|l| !l.trim().is_empty())
        .map(|line| {
            let numbers: Vec<f64> = line
                .split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
                .filter(|s| !s.is_empty())
                .skip(1)
                .map(|s| s.parse().unwrap())
                .collect();
            std::array::from_fn(|i| DVec2::new(numbers[2 * i], numbers[2 * i + 1]))
        })
        .collect()
}

/// Largest distance of the corners of two squares, over the four ways to number them and both ways round.
fn corner_distance(a: &[DVec2; 4], b: &[DVec2; 4]) -> f64 {
    (0..8)
        .map(|k| {
            (0..4)
                .map(|i| {
                    let j = if k < 4 { (i + k) % 4 } else { (8 + k - i) % 4 };
                    a[i].distance(b[j])
                })
                .fold(0.0, f64::max)
        })
        .fold(f64::INFINITY, f64::min)
}

/// How far four corners are from a parallelogram, pixels.
fn askew_px(corners_px: &[DVec2; 4]) -> f64 {
    let [a, b, c, d] = *corners_px;
    (a - b + c - d).length()
}

#[test]
fn three_photographs_show_12_22_and_10_tags() {
    let Some(shared) = support::shared("three_photographs") else { return };
    let mut worst = 0.0f64;
    let (mut ours, mut library_s) = (Vec::new(), Vec::new());
    for (name, count) in
        [("33369213973_9d9bb4cc96_c", 12), ("34085369442_304b6bafd9_c", 22), ("34139872896_defdb2f8d9_c", 10)]
    {
        let folder = shared.join("data/apriltag");
        let picture = gray(&folder.join(format!("{name}.jpg")));
        let truth = corner_truth(&folder.join(format!("{name}.txt")));
        let tags = detect(TagOptions::thorough(), &picture);
        assert_eq!(tags.len(), count, "{name}");
        for tag in &tags {
            let nearest =
                truth.iter().map(|c| corner_distance(&tag.corners_px, c)).fold(f64::INFINITY, f64::min);
            worst = worst.max(nearest);
            ours.push(askew_px(&tag.corners_px));
        }
        let plain = detect(TagOptions { refine: false, ..TagOptions::thorough() }, &picture);
        for tag in &plain {
            let nearest =
                truth.iter().map(|c| corner_distance(&tag.corners_px, c)).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.35, "{name}: tag at {:.1} is {nearest:.2} px off", tag.middle_px());
            library_s.push(askew_px(&tag.corners_px));
        }
    }
    // The library's corners are those of the border of what is dark: on drawn tags of 30 px they lie 0.24 px inside, give or take 0.12.
    // Ours are nearer to the tags that are seen: squares so small are nearly parallelograms.
    let median = |all: &mut Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let (ours, library_s) = (median(&mut ours), median(&mut library_s));
    println!("askew by {ours:.2} px, the library's by {library_s:.2} px (medians)");
    assert!(ours < 0.45 && ours < 0.6 * library_s, "{ours} {library_s}");
    support::wanted::hold("tags.photographs.corners", worst);
}

/// A lens of duckie/test_info.yaml, whose principal point is for pixel centres at whole numbers.
fn duckie_lens(width: u32, height: u32, fx: f64, fy: f64, cx: f64, cy: f64) -> Lens {
    Lens::pinhole(width, height, fx, fy, cx + 0.5, cy + 0.5)
}

#[test]
fn the_duckie_tag_turns_and_keeps_its_distance() {
    let Some(shared) = support::shared("the_duckie_tag_turns") else { return };
    let lens = duckie_lens(1056, 792, 329.8729619143081, 332.94611303946357, 528.0, 396.0);
    for angle in [-60, -30, 0, 30, 60] {
        let picture = gray(&shared.join(format!("data/apriltag/duckie/test_image_rotation_{angle}.png")));
        for options in [TagOptions::default(), TagOptions::thorough()] {
            let tags = detect(options, &picture);
            let tag = tags.iter().find(|t| t.id == 76).expect("tag 76");
            let poses = tag_pose::solve(&tag.corners_px, 0.065, &lens).unwrap();
            let pose = poses.best.camera_from_tag;
            let distance = pose.translation.length();
            // Turn about the camera's vertical: where the tag's normal points, seen from above.
            let normal = pose.rotation * DVec3::Z;
            let turned = normal.x.atan2(normal.z).to_degrees();
            assert!((0.20..0.215).contains(&distance), "{angle}: {distance}");
            // Measured: 0.0 to +3.3 degrees, as the stand is not exactly where its turntable says.
            let off = turned + f64::from(angle);
            assert!((-0.5..4.0).contains(&off), "{angle}: turned by {turned}");
        }
    }
}

#[test]
fn several_duckie_tags_at_once() {
    let Some(shared) = support::shared("several_duckie_tags") else { return };
    let lens =
        duckie_lens(640, 480, 338.563277422543, 338.939280638548, 336.45495347495824, 230.486982216255);
    let picture = gray(&shared.join("data/apriltag/duckie/test_image_multiple_01.png"));
    let tags = detect(TagOptions::thorough(), &picture);
    assert_eq!(tags.iter().map(|t| t.id).collect::<Vec<_>>(), [22, 24, 58, 85, 144, 198]);
    for tag in &tags {
        let poses = tag_pose::solve(&tag.corners_px, 0.065, &lens).unwrap();
        // The table is between 0.6 and 1.3 m away.
        assert!((0.6..1.3).contains(&poses.best.camera_from_tag.translation.length()), "{}", tag.id);
        assert!(poses.best.rms_px < 0.5, "{}: {}", tag.id, poses.best.rms_px);
    }
}

/// Both minima, by the code that the product runs in f64 for any lens; here with a pinhole of either precision.
fn tag_poses<T: Precision>(entry: &Entry) {
    let focal = entry.number::<T>("focal");
    let principal_px = Vector::from_slice(&entry.list::<T>("pp"));
    let pinhole = Pinhole { focal_px: Vector([focal, focal]), principal_px };
    let (corners_m, corners_px) = (entry.list::<T>("corners_m"), entry.list::<T>("corners_px"));
    let corners_m = std::array::from_fn(|i| Vector::from_slice(&corners_m[3 * i..]));
    let corners_px = std::array::from_fn(|i| Vector::from_slice(&corners_px[2 * i..]));
    let minima = minima::solve_rectangle(&corners_m, &corners_px, T::of(0.1), &pinhole).unwrap();
    let check = |what: &str, found: &Minimum<T>, expected: &Value, keys: [&str; 3]| {
        let Rigid { rotation, translation } = found.camera_from_object;
        let rows: [T; 9] = std::array::from_fn(|i| rotation.columns()[i % 3].0[i / 3]);
        entry.check(&format!("{what} R"), &expected[keys[0]], Some(&rows));
        entry.check(&format!("{what} t"), &expected[keys[1]], Some(&translation.0));
        entry.check(&format!("{what} rms_px"), &expected[keys[2]], Some(&[found.rms_px]));
    };
    check("first", &minima.best, entry.expected, ["R_true", "t_true", "rms_px_true"]);
    let second = &entry.expected["second_minimum"];
    match (&minima.other, second.is_null()) {
        (Some(other), false) => check("second", other, second, ["R", "t", "rms_px"]),
        (None, true) => {}
        (other, _) => panic!("{}: second minimum {other:?} instead of {second}", entry.id),
    }
}

#[test]
fn golden_tag_poses() {
    let Some(shared) = support::shared("golden_tag_poses") else { return };
    golden::run(&shared, &[("tagpose", tag_poses::<f64>, tag_poses::<f32>)]);
}

fn any_lens() -> impl Strategy<Value = Lens> {
    let shape = prop_oneof![
        Just(Distortion::None),
        Just(Distortion::RadialTangential([-0.28, 0.07, 0.001, -0.0005, 0.0, 0.0, 0.0, 0.0])),
        Just(Distortion::RadialTangential([0.9, 0.2, 0.0004, 0.0002, 0.01, 1.2, 0.4, 0.05])),
        Just(Distortion::Equidistant([-0.02, 0.005, -0.003, 0.0006])),
    ];
    shape.prop_map(|distortion| Lens { distortion, ..Lens::pinhole(640, 480, 500.0, 510.0, 322.0, 236.5) })
}

/// A tag tilted by `tilt` about an axis across the line of sight, then turned about it.
fn tilted(direction: DVec3, distance: f64, tilt: f64, azimuth: f64, turn: f64) -> Pose {
    let view = direction.normalize();
    let face_on = DQuat::from_rotation_arc(DVec3::Z, view) * DQuat::from_rotation_z(turn);
    let across = DQuat::from_axis_angle(view, azimuth) * view.any_orthonormal_vector();
    Pose::new(DQuat::from_axis_angle(across, tilt) * face_on, view * distance)
}

fn corners_seen(pose: &Pose, side_m: f64, lens: &Lens) -> Option<[DVec2; 4]> {
    let mut corners = [DVec2::ZERO; 4];
    for (c, point) in corners.iter_mut().zip(tag_pose::corners_of_tag_m(side_m)) {
        *c = lens.project(pose.transform(point))?;
    }
    Some(corners)
}

fn error_of(poses: &TagPoses, truth: &Pose) -> (f64, f64) {
    let pose = poses.best.camera_from_tag;
    (pose.translation.distance(truth.translation), pose.angle_to(truth))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn exact_corners_give_back_the_pose(
        lens in any_lens(), x in -0.4..0.4_f64, y in -0.3..0.3_f64, distance in 0.25..1.5_f64,
        tilt in 0.0..1.2_f64, azimuth in 0.0..6.3_f64, turn in -3.1..3.1_f64,
    ) {
        let truth = tilted(DVec3::new(x, y, 1.0), distance, tilt, azimuth, turn);
        let corners = corners_seen(&truth, 0.08, &lens);
        prop_assume!(corners.is_some());
        let poses = tag_pose::solve(&corners.unwrap(), 0.08, &lens).unwrap();
        let (away, turned) = error_of(&poses, &truth);
        prop_assert!(away < 1e-6 && turned < 1e-5, "{away} m, {turned} rad, {poses:?}");
        prop_assert!(poses.best.rms_px < 1e-6);
        prop_assert!(poses.ambiguity >= 1.0);
        if let Some(other) = poses.other {
            prop_assert!(other.rms_px >= poses.best.rms_px);
            prop_assert!(other.camera_from_tag.angle_to(&truth) > 1e-3);
        }
        // Small, tilted tags have two minima.
        if tilt > 0.35 && distance > 0.5 {
            prop_assert!(poses.other.is_some(), "tilt {tilt} distance {distance}");
        }
    }

    #[test]
    fn any_corners_whatever_do_not_panic(
        corners in prop::array::uniform8(prop_oneof![
            -50.0..700.0_f64, Just(f64::NAN), Just(f64::INFINITY), Just(0.0), Just(1e200),
        ]),
        side in prop_oneof![0.01..1.0_f64, Just(0.0), Just(-1.0), Just(f64::NAN)], lens in any_lens(),
    ) {
        let corners = std::array::from_fn(|i| DVec2::new(corners[2 * i], corners[2 * i + 1]));
        if let Some(poses) = tag_pose::solve(&corners, side, &lens) {
            prop_assert!(side > 0.0);
            prop_assert!(poses.best.camera_from_tag.translation.is_finite());
            prop_assert!(poses.best.rms_px.is_finite() && poses.best.sigma.position_m.is_finite());
        }
    }
}

/// The same corners solved in f64 and in f32, both from the numbers that f32 can hold.
fn in_both(pose: &Pose, side_m: f64, noise_px: f64) -> Option<(Minima<f64>, Minima<f32>)> {
    const LENS: Lens = Lens::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0);
    let mut corners = corners_seen(pose, side_m, &LENS)?;
    for (i, corner) in corners.iter_mut().enumerate() {
        *corner += DVec2::from_angle(side_m * 1e3 + i as f64 * 2.4) * noise_px;
    }
    let inside = |c: &DVec2| (0.0..640.0).contains(&c.x) && (0.0..480.0).contains(&c.y);
    if !corners.iter().all(inside) {
        return None;
    }
    fn solved<T: Real>(corners_px: &[DVec2; 4], side_m: f64) -> Option<Minima<T>> {
        let lens = LENS.without_distortion();
        let narrow = |v: f64| T::of(f64::from(v as f32));
        let pinhole = Pinhole {
            focal_px: Vector(lens.focal_px.0.map(narrow)),
            principal_px: Vector(lens.principal_px.0.map(narrow)),
        };
        let corners_m = tag_pose::corners_of_tag_m(side_m).map(|c| Vector(c.to_array().map(narrow)));
        let corners_px = corners_px.map(|c| Vector(c.to_array().map(narrow)));
        minima::solve_rectangle(&corners_m, &corners_px, narrow(0.1), &pinhole)
    }
    Some((solved::<f64>(&corners, side_m)?, solved::<f32>(&corners, side_m).unwrap()))
}

/// f32 against f64 on 16,000 poses from 0.2 m (a tag of 500 px) to 10 m (one of 2 px), leaning by up to 75 degrees,
/// corners exact and off by up to 0.15 px. The errors are counted in standard deviations of the pose at 0.1 px, as a
/// tag of 2 px has no pose to speak of in any precision.
#[test]
fn poses_in_single_precision_follow_those_in_double() {
    let mut dice = Dice::new(1);
    for (nearest, farthest) in [(0.2, 0.5), (0.5, 1.5), (1.5, 4.0), (4.0, 10.0)] {
        let (mut off, mut lost, mut gained) = (Vec::new(), 0, 0);
        for case in 0..4000 {
            let mut next = |from: f64, to: f64| dice.between(from, to);
            let solved = std::iter::repeat_with(|| {
                let direction = DVec3::new(next(-0.5, 0.5), next(-0.35, 0.35), 1.0);
                let truth = tilted(
                    direction,
                    next(nearest, farthest),
                    next(0.0, 1.3),
                    next(0.0, 6.3),
                    next(0.0, 6.3),
                );
                in_both(&truth, next(0.03, 0.18), if case % 2 == 0 { 0.0 } else { next(0.05, 0.15) })
            });
            let (double, single) = solved.flatten().next().unwrap();
            lost += usize::from(single.other.is_none() && double.other.is_some());
            gained += usize::from(single.other.is_some() && double.other.is_none());
            let found = single.best.camera_from_object;
            let found = Pose::from(Rigid {
                rotation: Quaternion(found.rotation.0.map(f64::from)),
                translation: Vector(found.translation.0.map(f64::from)),
            });
            // Which is the better of two that are as good may be rounding.
            let minima = std::iter::once(&double.best).chain(&double.other);
            let turned = |m: &&Minimum<f64>| Pose::from(m.camera_from_object).angle_to(&found);
            let same = minima.min_by(|a, b| turned(a).total_cmp(&turned(b))).unwrap();
            let centre = |pose: Pose| pose.inverse().translation;
            let away = centre(same.camera_from_object.into()).distance(centre(found));
            off.push((away / same.sigma.position_m).max(turned(&same) / same.sigma.rotation_rad));
        }
        off.sort_by(f64::total_cmp);
        // Measured: at most 1.2e-4, 4.8e-3 and 3.3e-2, the largest in the farthest band, where 4 of 4000 tags of a
        // few pixels gained a second minimum. There the valley between the two is so flat that f32, which holds a
        // coordinate of 600 px to 3e-5 px, may stop in it.
        let band = format!("{nearest}..{farthest} m");
        assert!(off[2000] < 2e-4 && off[3960] < 8e-3, "{band}: {:e} {:e}", off[2000], off[3960]);
        assert!(off[3996] < 6e-2, "{band}: {:e}", off[3996]);
        assert!(lost == 0 && gained <= 8, "{band}: {lost} second minima lost, {gained} gained");
    }
}

#[test]
fn a_small_far_tag_is_ambiguous_and_a_near_one_is_not() {
    // The spec's case: half side 5 cm, f = 800 px: second pose 8.5 px at 0.4 m, 0.36 px at 2 m.
    let lens = Lens::pinhole(1280, 960, 800.0, 800.0, 640.0, 480.0);
    let seen = |distance: f64| {
        let truth = tilted(DVec3::Z, distance, 30f64.to_radians(), 0.3, 0.2);
        tag_pose::solve(&corners_seen(&truth, 0.1, &lens).unwrap(), 0.1, &lens).unwrap()
    };
    let (near, far) = (seen(0.4), seen(2.0));
    assert!(near.other.unwrap().rms_px > 7.0 && !near.is_ambiguous(0.5), "{near:?}");
    let other = far.other.unwrap();
    assert!((0.2..0.45).contains(&other.rms_px), "{other:?}");
    assert!(far.is_ambiguous(0.5));
    let apart = other.camera_from_tag.angle_to(&far.best.camera_from_tag).to_degrees();
    assert!((55.0..65.0).contains(&apart), "{apart}");
}

fn halflight(arguments: &[&str]) -> (i32, String, String) {
    let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight")).args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (out.status.code().unwrap(), text(out.stdout), text(out.stderr))
}

#[test]
fn the_verb_prints_json_and_draws() {
    let Some(shared) = support::shared("the_verb_prints_json") else { return };
    let duckie = shared.join("data/apriltag/duckie");
    let picture = duckie.join("test_image_rotation_30.png");
    let camera = format!("{}#rotation_test", duckie.join("test_info.yaml").display());
    let out = std::env::temp_dir().join(format!("halflight-tags-{}.png", std::process::id()));
    let (picture, drawn) = (picture.to_str().unwrap(), out.to_str().unwrap());
    let (status, text, _) =
        halflight(&["tags", picture, "--camera", &camera, "--size", "0.065", "--json", "--out", drawn]);
    assert_eq!(status, 0);
    let list: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(list["format"], 1);
    let tags = list["tags"].as_array().unwrap();
    assert_eq!(tags.len(), 1);
    let tag = &tags[0];
    assert_eq!(tag["id"], 76);
    assert_eq!(tag["corners_px"].as_array().unwrap().len(), 4);
    let rows: [[f64; 4]; 4] = serde_json::from_value(tag["camera_from_tag"].clone()).unwrap();
    assert_eq!(rows[3], [0.0, 0.0, 0.0, 1.0]);
    let distance = rows[0][3].hypot(rows[1][3]).hypot(rows[2][3]);
    assert!((0.20..0.215).contains(&distance), "{distance}");
    // The same pose puts the corners back to where they were seen, within the error it states.
    let lens = duckie_lens(1056, 792, 329.8729619143081, 332.94611303946357, 528.0, 396.0);
    let mut squares = 0.0;
    for (i, corner) in tag_pose::corners_of_tag_m(0.065).into_iter().enumerate() {
        let seen = |k: usize| tag["corners_px"][i][k].as_f64().unwrap();
        let again = lens.project(Pose::from_rows(rows).transform(corner)).unwrap();
        squares += again.distance_squared(DVec2::new(seen(0), seen(1)));
    }
    let rms = tag["reprojection_px"].as_f64().unwrap();
    assert!(((squares / 8.0).sqrt() - rms).abs() < 1e-9);
    assert!(tag["ambiguity"].as_f64().unwrap() >= 1.0);
    let (before, after) = (image::open(picture).unwrap().to_rgb8(), image::open(&out).unwrap().to_rgb8());
    let changed = before.pixels().zip(after.pixels()).filter(|(a, b)| a != b).count();
    // Four sides of about 95 px, two pixels wide, and the axes.
    assert!((600..1600).contains(&changed), "{changed}");
    std::fs::remove_file(&out).unwrap();
}

#[test]
fn the_verb_says_what_is_wrong() {
    let Some(shared) = support::shared("the_verb_says_what_is_wrong") else { return };
    let duckie = shared.join("data/apriltag/duckie");
    let picture = duckie.join("test_image_multiple_01.png");
    let (picture, info) = (picture.to_str().unwrap(), duckie.join("test_info.yaml"));
    let wrong_size = format!("{}#rotation_test", info.display());
    let wrong_name = format!("{}#nobody", info.display());
    let focal = ["--focal", "338,338,320,240"];
    for (arguments, want) in [
        (["/no/such.png", "--size", "0.1", focal[0], focal[1]], "/no/such.png"),
        ([picture, "--size", "0", focal[0], focal[1]], "--size: must be above 0 metres, was 0"),
        ([picture, "--size", "-1", focal[0], focal[1]], "must be above 0 metres, was -1"),
        ([picture, "--size", "0.1", "--focal", "1,2,3"], "must be four numbers FX,FY,CX,CY"),
        ([picture, "--size", "0.1", "--focal", "1,x,3,4"], "must be four numbers FX,FY,CX,CY"),
        (
            [picture, "--size", "0.1", "--camera", &wrong_size],
            "1056 x 792: must be the picture's own size, 640 x 480",
        ),
        (
            [picture, "--size", "0.1", "--camera", &wrong_name],
            "camera = nobody: must be one of the file's: sample_test",
        ),
        ([picture, "--size", "0.1", "--camera", picture], "UTF-8"),
    ] {
        let mut all = vec!["tags"];
        all.extend(arguments);
        let (status, out, error) = halflight(&all);
        assert_eq!((status, out.as_str()), (2, ""), "{arguments:?}");
        assert!(error.contains(want), "{arguments:?}: {error}");
    }
    let (status, out, _) = halflight(&["tags", picture, "--size", "0.065", focal[0], focal[1]]);
    assert_eq!(status, 0);
    assert!(out.ends_with("6 tags\n"), "{out}");
}
