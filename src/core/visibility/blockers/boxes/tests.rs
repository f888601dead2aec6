use super::super::{BlockedPlane, Blockers};
use super::*;
use crate::math::{dice::Dice, spiral};
use glam::{DVec3, Quat};

fn any_box(dice: &mut Dice, thinnest: f32) -> BlockerBox {
    let turn = Quat::from_euler(
        glam::EulerRot::ZYX,
        6.0 * dice.unit_f32(),
        3.0 * dice.unit_f32(),
        3.0 * dice.unit_f32(),
    );
    let half =
        Vec3::new(0.02 + 0.2 * dice.unit_f32(), 0.02 + 0.2 * dice.unit_f32(), thinnest * dice.unit_f32());
    BlockerBox {
        centre_world: Vec3::new(dice.unit_f32() - 0.5, dice.unit_f32() - 0.5, 0.35 + 0.4 * dice.unit_f32()),
        axes_world: [turn * Vec3::X, turn * Vec3::Y, turn * Vec3::Z],
        half_m: half,
        body: 0,
    }
}

/// Whether a ray from the origin meets a box: all three slabs at once.
fn meets(of: &BlockerBox, direction: DVec3) -> bool {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for (axis, half) in of.axes_world.iter().zip(of.half_m.to_array()) {
        let (axis, half) = (axis.as_dvec3(), f64::from(half));
        let (at, along) = (axis.dot(of.centre_world.as_dvec3()), axis.dot(direction));
        let ends = [(at - half) / along, (at + half) / along];
        (enter, leave) = (enter.max(ends[0].min(ends[1])), leave.min(ends[0].max(ends[1])));
    }
    enter <= leave
}

/// The integral of each y_i over what a box hides from the origin.
fn by_summing(of: &BlockerBox, order: usize) -> [f64; 36] {
    const COUNT: usize = 200_000;
    let (mut sum, mut y) = ([0.0f64; 36], [0.0f64; 36]);
    for j in 0..COUNT {
        let d = spiral::direction(j, COUNT);
        if meets(of, d) {
            basis::evaluate(order, d.to_array(), &mut y);
            sum.iter_mut().zip(y).take(order * order).for_each(|(s, y)| *s += y);
        }
    }
    sum.map(|s| s * 4.0 * std::f64::consts::PI / COUNT as f64)
}

#[test]
fn harmonics_of_a_box_are_what_summing_says() {
    let mut dice = Dice::new(5);
    let mut worst = [0.0f64; 2];
    for k in 0..40 {
        let of = any_box(&mut dice, if k % 2 == 0 { 0.005 } else { 0.1 });
        let ours = hidden(&of, 6, Vec3::ZERO, Vec3::Z).expect("it is above");
        for (i, (ours, truth)) in ours.iter().zip(by_summing(&of, 6)).enumerate() {
            let off = (f64::from(*ours) - truth).abs();
            let slot = usize::from(i > 0);
            worst[slot] = worst[slot].max(off);
        }
    }
    println!("{worst:?}");
    // The sum itself is good to about 5e-4.
    assert!(worst[0] < 1e-3 && worst[1] < 3e-3, "{worst:?}");
}

/// By van Oosterom and Strackee, in f64.
fn solid_angle(of: &BlockerBox) -> f64 {
    let triangle = |[a, b, c]: [DVec3; 3]| {
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let over = la * lb * lc + a.dot(b) * lc + a.dot(c) * lb + b.dot(c) * la;
        2.0 * a.dot(b.cross(c)).abs().atan2(over)
    };
    let SeenBox::Faces(faces) = seen(of, Vec3::ZERO, Vec3::Z) else { return f64::NAN };
    let mut sum = 0.0;
    for face in faces.iter().flatten() {
        let [x, y, z] = face.axes.map(|axis| axis.as_dvec3());
        let at = |i: f32, j: f32| x * f64::from(i) + y * f64::from(j) + z * f64::from(face.depth);
        let (low, high) = (face.low, face.high);
        let corners = [at(low[0], low[1]), at(high[0], low[1]), at(high[0], high[1]), at(low[0], high[1])];
        sum +=
            triangle([corners[0], corners[1], corners[2]]) + triangle([corners[0], corners[2], corners[3]]);
    }
    sum
}

#[test]
fn solid_angles_are_exact_near_and_far() {
    let mut worst = 0.0f64;
    for (half, what) in [(Vec3::new(0.1, 0.06, 0.001), "plate"), (Vec3::new(0.3, 0.004, 0.004), "bar")] {
        for distance in [1e-5f32, 1e-3, 0.01, 0.03, 0.1, 1.0, 30.0] {
            for tilt in [0.0f32, 0.3, 1.2, 1.5] {
                let turn = Quat::from_rotation_x(tilt) * Quat::from_rotation_z(0.7);
                let axes_world = [turn * Vec3::X, turn * Vec3::Y, turn * Vec3::Z];
                // The receiver is so far off the middle of the box's face.
                let centre_world = axes_world[2] * (half.z + distance);
                let of = BlockerBox { centre_world, axes_world, half_m: half, body: 0 };
                let truth = solid_angle(&of);
                let ours = hidden(&of, 1, Vec3::ZERO, Vec3::Z).map_or(0.0, |h| f64::from(h[0]));
                let off = ours * (4.0 * std::f64::consts::PI).sqrt() / truth - 1.0;
                println!("{what} {distance} {tilt}: {truth:.6} off by {off:.1e}");
                worst = worst.max(off.abs());
            }
        }
    }
    // Of a bar seen from close by four nodes miss some.
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn directions_hide_the_solid_angle_in_the_mean() {
    let mut dice = Dice::new(9);
    for count in [64, 128, 256] {
        let (mut sum, mut truth) = (0.0, 0.0);
        for k in 0..400 {
            let of = any_box(&mut dice, if k % 2 == 0 { 0.0 } else { 0.01 });
            let mut v = [0.0; 36];
            let mut blockers = Blockers::new();
            blockers.prepare(&[], Rung::Directions, 2, count);
            blockers.add_boxes(&[of]);
            blockers.visibility(Vec3::ZERO, Vec3::Z, None, &mut v);
            let whole = f64::from(whole::<f32>());
            let (ours, exact) = (whole * (whole - f64::from(v[0])), solid_angle(&of));
            // A direction stands for its cell: a plate that lies between two of them hides what they say.
            let cell = whole * whole / count as f64;
            assert!((ours - exact).abs() < cell, "{count}: {of:?}: {ours}, {exact}");
            (sum, truth) = (sum + ours, truth + exact);
        }
        println!("{count}: {:.4}", sum / truth);
        assert!((sum / truth - 1.0).abs() < 0.02, "{count}: {sum}, {truth}");
    }
}

#[test]
fn what_cannot_hide_hides_nothing_and_a_batch_is_its_receivers() {
    let mut dice = Dice::new(3);
    let sound = any_box(&mut dice, 0.01);
    let unsound = [
        BlockerBox { centre_world: Vec3::NAN, ..sound },
        BlockerBox { half_m: Vec3::new(0.1, 0.0, 0.0), ..sound },
        BlockerBox { half_m: Vec3::new(0.1, -0.1, 0.1), ..sound },
        BlockerBox { half_m: Vec3::splat(f32::INFINITY), ..sound },
        BlockerBox { centre_world: Vec3::new(0.0, 0.0, -1.0), ..sound },
        BlockerBox { body: 5, ..sound },
    ];
    let points: Vec<Vec3> = (0..13).map(|i| Vec3::new(0.1 * i as f32 - 0.6, 0.05, 0.0)).collect();
    let normals = vec![Vec3::Z; points.len()];
    for rung in Rung::ALL {
        for order in 2..=6 {
            let mut blockers = Blockers::new();
            blockers.prepare(&[], rung, order, 64);
            blockers.add_boxes(&unsound);
            let mut v = [7.0; 36];
            blockers.visibility(Vec3::ZERO, Vec3::Z, Some(5), &mut v);
            assert!(v[0] == whole::<f32>() && v[1..].iter().all(|v| *v == 0.0), "{rung:?} {order}: {v:?}");
            blockers.prepare(&[], rung, order, 64);
            blockers.add_boxes(&[sound, any_box(&mut dice, 0.01)]);
            let transfer = std::array::from_fn(|i| [1.0 / (1.0 + i as f32), 0.3, 0.2]);
            let (mut plane, mut out) = (BlockedPlane::default(), [[0.0; 3]; 13]);
            blockers.plane(Vec3::Z, None, &transfer, &mut plane);
            blockers.shade_plane(&plane, &points, &mut out);
            blockers.visibility_many(&points, &normals, None, |k, many| {
                let mut one = [0.0; 36];
                blockers.visibility(points[k], Vec3::Z, None, &mut one);
                assert_eq!(&one, many, "{rung:?} {order}");
                let rest: f32 = one[1..].iter().map(|v| v * v).sum();
                assert!((0.0..=whole::<f32>()).contains(&one[0]) && one[0] < whole());
                let room = one[0] * (whole::<f32>() - one[0]);
                assert!(rest <= 1.2 * room + 1e-5 || rung == Rung::Directions, "{rest} {room}");
                let (blocked, _) = blockers.shade(points[k], Vec3::Z, None, &transfer);
                assert!((blocked[0] - out[k][0]).abs() < 1e-5, "{rung:?} {order}");
            });
        }
    }
}

#[test]
fn from_inside_a_hemisphere_is_hidden() {
    let of = BlockerBox {
        centre_world: Vec3::new(0.01, 0.0, 0.0),
        axes_world: [Vec3::X, Vec3::Y, Vec3::Z],
        half_m: Vec3::splat(0.1),
        body: 0,
    };
    let normal = Vec3::new(0.36, -0.48, 0.8);
    let ours = hidden(&of, 6, Vec3::ZERO, normal).expect("it hides");
    let mut truth = [0.0f64; 36];
    const COUNT: usize = 100_000;
    let mut y = [0.0f64; 36];
    for d in (0..COUNT).map(|j| spiral::direction(j, COUNT)).filter(|d| d.dot(normal.as_dvec3()) > 0.0) {
        basis::evaluate(6, d.to_array(), &mut y);
        truth.iter_mut().zip(y).for_each(|(t, y)| *t += y * 4.0 * std::f64::consts::PI / COUNT as f64);
    }
    for (ours, truth) in ours.iter().zip(truth) {
        assert!((f64::from(*ours) - truth).abs() < 2e-3, "{ours} {truth}");
    }
    let mut blockers = Blockers::new();
    blockers.prepare(&[], Rung::Directions, 4, 128);
    blockers.add_boxes(&[of]);
    let mut v = [0.0; 36];
    blockers.visibility(Vec3::ZERO, normal, None, &mut v);
    assert!((v[0] - 0.5 * whole::<f32>()).abs() < 0.02, "{}", v[0]);
}
