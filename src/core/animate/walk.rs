//! Closed walks on a level: corners rounded, speed even, facing the way.

use crate::model::animation::{Leg, Walk};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::f32::consts::FRAC_PI_2;

/// Shortest side of a walk, metres.
pub const MIN_SIDE_M: f32 = 1e-3;
/// Sharpest turn at a corner, degrees: beyond this the figure would have to turn on the spot.
pub const MAX_TURN_DEG: f32 = 165.0;
/// Each corner's arc takes this share of the shorter side beside it.
const ROUNDED: f32 = 0.45;

/// The legs of a closed walk through points (at least 3; at most 1e6 apart): each corner is cut by an arc that
/// touches both sides within 0.45 of the shorter one, so the heading never jumps. `None` where there are fewer points,
/// a side is shorter than `MIN_SIDE_M` or a corner turns by more than `MAX_TURN_DEG`.
pub fn round_corners(points_world: &[Vec2]) -> Option<Vec<Leg>> {
    let n = points_world.len();
    if n < 3 {
        return None;
    }
    let point = |k: usize| points_world[k % n];
    let side = |k: usize| point(k + 1) - point(k);
    let mut lengths = Vec::with_capacity(n);
    for k in 0..n {
        let length = side(k).length();
        if !(MIN_SIDE_M..=1e6).contains(&length) {
            return None;
        }
        lengths.push(length);
    }
    let along = |k: usize| side(k % n) / lengths[k % n];
    // Corner k lies between side k - 1 and side k: how far its arc reaches into both, and how it turns.
    let mut corners = Vec::with_capacity(n);
    for k in 0..n {
        let (before, after) = (along(k + n - 1), along(k));
        let turn = before.perp_dot(after).atan2(before.dot(after));
        if turn.abs() > MAX_TURN_DEG.to_radians() {
            return None;
        }
        corners.push((ROUNDED * lengths[k].min(lengths[(k + n - 1) % n]), turn));
    }
    let mut legs = Vec::with_capacity(2 * n);
    for k in 0..n {
        let ((reach, _), (next_reach, turn)) = (corners[k], corners[(k + 1) % n]);
        let heading_rad = along(k).to_angle();
        let length_m = lengths[k] - reach - next_reach;
        legs.push(Leg { start_world: point(k) + along(k) * reach, heading_rad, length_m, turn_rad: 0.0 });
        let start_world = point(k + 1) - along(k) * next_reach;
        // Radius = reach / tan(turn / 2), length = radius * turn; 2 reach where the corner is straight.
        let length_m = if turn.abs() < 1e-3 {
            2.0 * next_reach
        } else {
            next_reach * turn.abs() / (turn.abs() / 2.0).tan()
        };
        legs.push(Leg {
            start_world,
            heading_rad,
            length_m,
            turn_rad: if turn.abs() < 1e-3 { 0.0 } else { turn },
        });
    }
    Some(legs)
}

/// Length of a walk, metres.
pub fn length_m(walk: &Walk) -> f64 {
    walk.legs.iter().map(|leg| f64::from(leg.length_m)).sum()
}

/// Where a walker is at a time and its heading (angle from +x towards +y). It starts on the first leg at t = 0; any
/// time gives a place. `None` where the walk has no length.
pub fn place_at(walk: &Walk, t_s: f64) -> Option<(Vec2, f32)> {
    let total = length_m(walk);
    let gone = walk.speed_m_s * t_s;
    if !(total > 0.0) || !gone.is_finite() {
        return walk.legs.first().map(|leg| (leg.start_world, leg.heading_rad));
    }
    let mut left = gone.rem_euclid(total);
    let last = walk.legs.len().checked_sub(1)?;
    for (k, leg) in walk.legs.iter().enumerate() {
        let length = f64::from(leg.length_m);
        if left < length || k == last {
            return Some(on_leg(leg, left.min(length) as f32));
        }
        left -= length;
    }
    None
}

fn on_leg(leg: &Leg, gone_m: f32) -> (Vec2, f32) {
    let ahead = Vec2::from_angle(leg.heading_rad);
    if leg.turn_rad == 0.0 {
        return (leg.start_world + ahead * gone_m, leg.heading_rad);
    }
    // Chord of the arc so far: 2 radius sin(angle / 2), half the angle aside.
    let angle = leg.turn_rad * gone_m / leg.length_m;
    let radius = leg.length_m / leg.turn_rad;
    let chord = Vec2::from_angle(leg.heading_rad + angle / 2.0) * (2.0 * radius * (angle / 2.0).sin());
    (leg.start_world + chord, leg.heading_rad + angle)
}

/// What the walk adds in front of `world_from_figure`: the place, and the turn from +x to the heading.
pub fn world_from_start(walk: &Walk, t_s: f64) -> Affine3A {
    let Some((place, heading_rad)) = place_at(walk, t_s) else { return Affine3A::IDENTITY };
    Affine3A::from_rotation_translation(Quat::from_rotation_z(heading_rad), place.extend(0.0))
}

/// Turns a figure that faces -y, as they all do, to +x.
pub fn towards_x() -> Quat {
    Quat::from_axis_angle(Vec3::Z, FRAC_PI_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    fn square() -> Walk {
        let corners = [[0.0, 0.0], [0.4, 0.0], [0.4, 0.2], [0.0, 0.2]].map(Vec2::from);
        Walk { legs: round_corners(&corners).unwrap(), speed_m_s: 0.1 }
    }

    #[test]
    fn legs_meet_and_close_without_a_jump() {
        let triangle = [[0.0, 0.0], [0.5, 0.02], [0.1, -0.3]].map(Vec2::from);
        for legs in [square().legs, round_corners(&triangle).unwrap()] {
            let mut turned = 0.0;
            for (k, leg) in legs.iter().enumerate() {
                let (end, heading) = on_leg(leg, leg.length_m);
                let next = &legs[(k + 1) % legs.len()];
                assert!(end.abs_diff_eq(next.start_world, 1e-6), "{k}: {end} {}", next.start_world);
                let jump = (heading - next.heading_rad).rem_euclid(TAU);
                assert!(jump.min(TAU - jump) < 1e-5, "{k}: {jump}");
                turned += leg.turn_rad;
            }
            assert!((turned.abs() - TAU).abs() < 1e-5, "once round: {turned}");
        }
    }

    #[test]
    fn speed_is_even_and_the_heading_is_the_way() {
        let walk = square();
        // Straight sides without 0.45 of 0.2 m at both ends, and four quarter circles of 0.09 m.
        let expected = 2.0 * (0.4 - 0.18) + 2.0 * (0.2 - 0.18) + 0.09 * std::f64::consts::TAU;
        assert!((length_m(&walk) - expected).abs() < 1e-6, "{}", length_m(&walk));
        let dt = 0.01;
        for k in 0..1500 {
            let t = f64::from(k) * dt - 3.0;
            let (a, heading) = place_at(&walk, t).unwrap();
            let (b, _) = place_at(&walk, t + dt).unwrap();
            // A chord of 1 mm on a radius of 90 mm is shorter by 5e-9 m; rounding of 0.4 m is 3e-8.
            assert!(((b - a).length() - 1e-3).abs() < 2e-7, "{t}: {}", (b - a).length());
            assert!((b - a).normalize().dot(Vec2::from_angle(heading)) > 0.9999, "{t}");
        }
        let nose = world_from_start(&walk, 0.0).transform_vector3(towards_x() * -Vec3::Y);
        assert!(nose.abs_diff_eq(Vec3::X, 1e-6), "{nose}");
    }

    #[test]
    fn hopeless_walks_are_refused_and_any_time_is_taken() {
        let p = |list: &[[f32; 2]]| round_corners(&list.iter().map(|&q| Vec2::from(q)).collect::<Vec<_>>());
        assert!(p(&[]).is_none() && p(&[[0.0, 0.0], [1.0, 0.0]]).is_none());
        assert!(p(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]).is_none(), "a side without length");
        assert!(p(&[[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]]).is_none(), "back on itself");
        assert!(p(&[[0.0, 0.0], [f32::NAN, 0.0], [0.5, 1.0]]).is_none());
        let walk = square();
        assert!(place_at(&walk, f64::NAN).unwrap().0.is_finite());
        assert!(place_at(&walk, 1e300).unwrap().0.is_finite());
        assert_eq!(place_at(&Walk { legs: Vec::new(), speed_m_s: 1.0 }, 1.0), None);
    }
}
