//! Synthetic views of a board through lenses that are known.

use super::*;
use crate::math::{dice::Dice, solve::least_squares};
use glam::DQuat;

const GRID: AprilGrid = AprilGrid { columns: 6, rows: 6, size_m: 0.088, spacing: 0.3 };
const SIZE: (u32, u32) = (640, 480);

fn lens(distortion: Distortion) -> Lens {
    Lens { distortion, ..Lens::pinhole(SIZE.0, SIZE.1, 452.3, 455.1, 326.4, 236.8) }
}

fn radial() -> Lens {
    lens(Distortion::RadialTangential([-0.28, 0.09, 0.0008, -0.0005, -0.01, 0.0, 0.0, 0.0]))
}

fn fisheye() -> Lens {
    Lens { fx: 330.0, fy: 331.5, ..lens(Distortion::Equidistant([0.02, -0.012, 0.004, -0.001])) }
}

/// Views of the board from all sides, as far as it is within the picture; `tilt` at most so many degrees.
fn views(lens: &Lens, seed: u64, count: usize, tilt_deg: f64, noise_px: f64) -> Vec<Vec<BoardPoint>> {
    let mut dice = Dice::new(seed);
    let middle = DVec2::splat(0.5 * GRID.size_m * (6.0 + 5.0 * GRID.spacing));
    let mut views = Vec::new();
    while views.len() < count {
        // The board's x to the right, its y up, towards the camera.
        let facing = DQuat::from_rotation_x(std::f64::consts::PI);
        let axis = DVec3::new(dice.between(-1.0, 1.0), dice.between(-1.0, 1.0), dice.between(-0.3, 0.3));
        let turn = DQuat::from_axis_angle(axis.normalize(), (dice.unit() * tilt_deg).to_radians());
        let target = DVec2::new(dice.between(0.05, 0.95) * 640.0, dice.between(0.05, 0.95) * 480.0);
        let place = lens.unproject(target).unwrap() * dice.between(0.55, 1.1);
        // Whoever holds it turns it towards the camera; without tilt all boards are parallel.
        let ahead = if tilt_deg > 0.0 { place.normalize() } else { DVec3::Z };
        let rotation = DQuat::from_rotation_arc(DVec3::Z, ahead) * turn * facing;
        let pose = Pose::new(rotation, place - rotation * middle.extend(0.0));
        let corners = (0..36).flat_map(|id| GRID.corners(id).unwrap());
        let seen = corners.filter_map(|on_board| {
            let noise = DVec2::new(dice.normal(), dice.normal()) * noise_px;
            let pixel = lens.project(pose.transform(on_board.extend(0.0)))?;
            let inside = pixel.x > 2.0 && pixel.y > 2.0 && pixel.x < 638.0 && pixel.y < 478.0;
            inside.then_some(BoardPoint { on_board, pixel: pixel + noise })
        });
        let seen: Vec<BoardPoint> = seen.collect();
        if seen.len() >= LEAST_POINTS {
            views.push(seen);
        }
    }
    views
}

/// The largest distance over the picture between where the two lenses see a ray, apart from a turn of the camera, which the
/// boards' places take up; a margin is left out.
fn picture_error_px(found: &Lens, truth: &Lens, margin_px: f64) -> f64 {
    const STEP: f64 = 1e-5;
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for k in 0..17 * 13 {
        let share = DVec2::new(f64::from(k % 17) / 16.0, f64::from(k / 17) / 12.0);
        let pixel = DVec2::splat(margin_px) + share * (DVec2::new(640.0, 480.0) - 2.0 * margin_px);
        let Some(ray) = truth.unproject(pixel) else { continue };
        let seen = found.project(ray).unwrap();
        let turned = [DVec3::X, DVec3::Y, DVec3::Z]
            .map(|axis| (found.project(ray + STEP * axis.cross(ray)).unwrap() - seen) / STEP);
        for axis in 0..2 {
            left.extend(turned.map(|t| t.to_array()[axis]));
            right.push((pixel - seen).to_array()[axis]);
        }
    }
    let turn = least_squares(right.len(), 3, &left, &right).unwrap().solution;
    let rows = left.chunks_exact(3).zip(&right);
    let rest: Vec<f64> = rows.map(|(row, b)| b - (0..3).map(|k| row[k] * turn[k]).sum::<f64>()).collect();
    rest.chunks_exact(2).map(|r| r[0].hypot(r[1])).fold(0.0, f64::max)
}

#[test]
fn a_known_lens_is_found_again() {
    for (name, truth, kind, count) in [
        ("radial", radial(), DistortionKind::RadialTangential, 32),
        ("fisheye", fisheye(), DistortionKind::Equidistant, 32),
        ("pinhole", lens(Distortion::None), DistortionKind::RadialTangential, 32),
    ] {
        let (mut worst_focal, mut worst_px, mut corner_px, mut squares) = (0.0f64, 0.0f64, 0.0f64, 0.0);
        let seeds = 8;
        for seed in 1..=seeds {
            let found = calibrate(&views(&truth, seed * 7919, count, 40.0, 0.1), SIZE, kind).unwrap();
            let focal = (found.lens.fx / truth.fx - 1.0).abs().max((found.lens.fy / truth.fy - 1.0).abs());
            worst_focal = worst_focal.max(focal);
            worst_px = worst_px.max(picture_error_px(&found.lens, &truth, 24.0));
            corner_px = corner_px.max(picture_error_px(&found.lens, &truth, 0.0));
            squares += ((found.lens.fx - truth.fx) / found.sigma_px[0]).powi(2) / seeds as f64;
            assert!((found.rms_px - 0.141).abs() < 0.01, "{name} {seed}: {}", found.rms_px);
            assert!(found.coverage > 0.8 && found.outliers == 0, "{name} {seed}: {found:?}");
        }
        println!(
            "{name}: focal {:.3} %, picture {worst_px:.3} px, to its corners {corner_px:.3} px, errors/sigma {:.2}",
            100.0 * worst_focal,
            squares.sqrt()
        );
        // In the corners 0.3 px was wanted: no point of a board is seen there, and the polynomial goes on as it likes.
        assert!(
            worst_focal < 6e-4 && worst_px < 0.18 && corner_px < 0.45,
            "{name}: {worst_focal} {worst_px} {corner_px}"
        );
        // The stated deviations are those of the errors.
        assert!((0.5..1.8).contains(&squares.sqrt()), "{name}: {squares}");
    }
}

#[test]
fn exact_views_give_the_lens_exactly() {
    for (truth, kind) in
        [(radial(), DistortionKind::RadialTangential), (fisheye(), DistortionKind::Equidistant)]
    {
        let found = calibrate(&views(&truth, 7, 8, 40.0, 0.0), SIZE, kind).unwrap();
        assert!((found.lens.fx - truth.fx).abs() < 1e-3, "{found:?}");
        assert!(found.rms_px < 1e-4 && picture_error_px(&found.lens, &truth, 0.0) < 1e-2, "{found:?}");
    }
}

#[test]
fn wrong_corners_are_left_out() {
    let truth = radial();
    let mut seen = views(&truth, 3, 16, 40.0, 0.1);
    for (k, view) in seen.iter_mut().enumerate() {
        view[k].pixel += DVec2::new(9.0, -14.0);
    }
    let found = calibrate(&seen, SIZE, DistortionKind::RadialTangential).unwrap();
    assert_eq!(found.outliers, 16);
    assert!((found.lens.fx / truth.fx - 1.0).abs() < 0.002);
}

#[test]
fn too_few_views_and_views_without_tilt_are_refused() {
    let kind = DistortionKind::RadialTangential;
    let three = views(&radial(), 1, 3, 40.0, 0.1);
    assert_eq!(calibrate(&three, SIZE, kind), Err(CalibrateError::TooFewViews { found: 3 }));
    let mut cut = views(&radial(), 1, 6, 40.0, 0.1);
    cut[1].truncate(LEAST_POINTS - 1);
    assert_eq!(calibrate(&cut, SIZE, kind).unwrap().views.len(), 5);
    for seed in 1..6 {
        let flat = views(&radial(), seed, 12, 0.0, 0.1);
        let refused = calibrate(&flat, SIZE, kind).unwrap_err();
        let is_told = matches!(refused, CalibrateError::NoTilt { .. } | CalibrateError::Open { .. });
        assert!(is_told, "{seed}: {refused}");
    }
    let noise: Vec<Vec<BoardPoint>> = (0..6)
        .map(|seed| {
            let mut dice = Dice::new(seed);
            let corners = (0..36).flat_map(|id| GRID.corners(id).unwrap());
            corners
                .map(|on_board| BoardPoint { on_board, pixel: DVec2::new(dice.unit(), dice.unit()) * 480.0 })
                .collect()
        })
        .collect();
    assert!(calibrate(&noise, SIZE, kind).is_err());
}

#[test]
fn the_grid_is_kalibr_s() {
    let corners = GRID.corners(7).unwrap();
    assert!(corners[0].distance(DVec2::splat(0.088 * 1.3)) < 1e-12);
    assert!((corners[2] - corners[0]).distance(DVec2::splat(0.088)) < 1e-12);
    assert_eq!(GRID.corners(36), None);
}
