//! Clips at a time, and the nodes that they move.

use crate::model::animation::{AnimationChannel, Clip, Interpolation, Moves, Playing, Skeleton, Transform};
use glam::{Affine3A, Quat, Vec4};

/// Rotations whose dot product is above this are mixed straight: the arc differs by less than 1e-5 there, and the
/// sine that it divides by is small.
const NEARLY_EQUAL: f32 = 0.9995;

/// The time within a clip, seconds on its own keys, that is shown at time `t_s` of the scene. Within
/// `start_s ..= start_s + duration_s`; any t gives a time (one that is not finite gives the start).
pub fn clip_time(clip: &Clip, playing: &Playing, t_s: f64) -> f64 {
    let (start, duration) = (f64::from(clip.start_s), f64::from(clip.duration_s));
    let since = playing.from_s + playing.speed * t_s;
    if !since.is_finite() || !(duration > 0.0) {
        return start;
    }
    start + if playing.looped { since.rem_euclid(duration) } else { since.clamp(0.0, duration) }
}

/// A channel's value at a time on its keys (glTF 2.0, appendix C): before the first key the first value, after the last
/// the last; rotations are unit and go the shorter way. `None` where the channel has no sound keys.
pub fn sample(channel: &AnimationChannel, time_s: f64) -> Option<Vec4> {
    let cubic = channel.interpolation == Interpolation::CubicSpline;
    let key = |k: usize| channel.values.get(if cubic { 3 * k + 1 } else { k }).copied();
    let times = &channel.times_s;
    let after = times.partition_point(|&t| f64::from(t) <= time_s);
    let mixed = if after == 0 {
        key(0)?
    } else if after >= times.len() {
        key(times.len().checked_sub(1)?)?
    } else {
        let (t0, t1) = (f64::from(times[after - 1]), f64::from(times[after]));
        let (dt, u) = ((t1 - t0) as f32, ((time_s - t0) / (t1 - t0)) as f32);
        let (from, to) = (key(after - 1)?, key(after)?);
        match channel.interpolation {
            Interpolation::Step => from,
            Interpolation::Linear if channel.moves == Moves::Rotation => shortest_arc(from, to, u),
            Interpolation::Linear => from + (to - from) * u,
            Interpolation::CubicSpline => {
                // Slopes are a second, so they count with the time between the keys.
                let out = *channel.values.get(3 * (after - 1) + 2)? * dt;
                let into = *channel.values.get(3 * after)? * dt;
                let (u2, u3) = (u * u, u * u * u);
                from * (2.0 * u3 - 3.0 * u2 + 1.0)
                    + out * (u3 - 2.0 * u2 + u)
                    + to * (3.0 * u2 - 2.0 * u3)
                    + into * (u3 - u2)
            }
        }
    };
    if channel.moves == Moves::Rotation { mixed.try_normalize().or_else(|| key(0)) } else { Some(mixed) }
}

fn shortest_arc(from: Vec4, to: Vec4, u: f32) -> Vec4 {
    let cosine = from.dot(to);
    let (to, cosine) = if cosine < 0.0 { (-to, -cosine) } else { (to, cosine) };
    if cosine > NEARLY_EQUAL {
        return from + (to - from) * u;
    }
    let angle = cosine.acos();
    (from * ((1.0 - u) * angle).sin() + to * (u * angle).sin()) / angle.sin()
}

/// Every node's transform in its parent at a time on the clip's keys: rest, and what the clip moves over it.
/// `locals` is cleared and filled; it keeps its memory.
pub fn locals_at(skeleton: &Skeleton, clip: Option<(&Clip, f64)>, locals: &mut Vec<Transform>) {
    locals.clear();
    locals.extend(skeleton.nodes.iter().map(|node| node.rest));
    let Some((clip, time_s)) = clip else { return };
    for channel in &clip.channels {
        let (Some(local), Some(value)) = (locals.get_mut(channel.node as usize), sample(channel, time_s))
        else {
            continue;
        };
        match channel.moves {
            Moves::Translation => local.translation = value.truncate(),
            Moves::Rotation => local.rotation = Quat::from_vec4(value),
            Moves::Scale => local.scale = value.truncate(),
        }
    }
}

/// Every node's frame seen from outside: `outside_from_root` times all transforms down to it. `nodes` is cleared and
/// filled; it keeps its memory.
pub fn stack(
    skeleton: &Skeleton,
    outside_from_root: &Affine3A,
    locals: &[Transform],
    nodes: &mut Vec<Affine3A>,
) {
    nodes.clear();
    for (node, local) in skeleton.nodes.iter().zip(locals) {
        let above = node.parent.and_then(|p| nodes.get(p as usize)).copied().unwrap_or(*outside_from_root);
        nodes.push(above * local.affine());
    }
}

/// Every node's frame at rest, seen from the figure's.
pub fn figure_from_nodes_at_rest(skeleton: &Skeleton) -> Vec<Affine3A> {
    let (mut locals, mut nodes) = (Vec::new(), Vec::new());
    locals_at(skeleton, None, &mut locals);
    stack(skeleton, &skeleton.figure_from_root, &locals, &mut nodes);
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::animation::SkeletonNode;
    use glam::Vec3;

    fn channel(
        moves: Moves,
        interpolation: Interpolation,
        times_s: &[f32],
        values: &[[f32; 4]],
    ) -> AnimationChannel {
        let values = values.iter().map(|&v| Vec4::from(v)).collect();
        AnimationChannel { node: 0, moves, interpolation, times_s: times_s.to_vec(), values }
    }

    #[test]
    fn steps_lines_and_splines_pass_through_known_values() {
        let keys = [[0.0, 1.0, 2.0, 0.0], [4.0, 1.0, 0.0, 0.0]];
        let step = channel(Moves::Translation, Interpolation::Step, &[1.0, 3.0], &keys);
        let line = channel(Moves::Translation, Interpolation::Linear, &[1.0, 3.0], &keys);
        for (t, held, straight) in
            [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.5, 0.0, 3.0), (3.0, 4.0, 4.0), (9.0, 4.0, 4.0)]
        {
            assert_eq!(sample(&step, t).unwrap().x, held, "{t}");
            assert_eq!(sample(&line, t).unwrap().x, straight, "{t}");
        }
        // x(t) = t^3 on [0, 2] with its own slopes 3 t^2 is met exactly by one cubic; slopes count a second, so a
        // sampler that forgets the factor of 2 gives 0.5 + ... instead of 1 in the middle.
        let slope = |s: f32| [s, 0.0, 0.0, 0.0];
        let cubic = channel(
            Moves::Translation,
            Interpolation::CubicSpline,
            &[0.0, 2.0],
            &[slope(-7.0), slope(0.0), slope(0.0), slope(12.0), slope(8.0), slope(-7.0)],
        );
        for k in 0..=20 {
            let t = f64::from(k) / 10.0;
            assert!((f64::from(sample(&cubic, t).unwrap().x) - t.powi(3)).abs() < 2e-6, "{t}");
        }
        assert_eq!(sample(&cubic, 5.0).unwrap().x, 8.0);
        assert_eq!(sample(&channel(Moves::Scale, Interpolation::Linear, &[], &[]), 0.0), None);
        assert_eq!(
            sample(&channel(Moves::Scale, Interpolation::CubicSpline, &[0.0], &[[1.0; 4]]), 0.0),
            None
        );
    }

    #[test]
    fn rotations_go_the_shorter_way_at_even_speed_and_stay_unit() {
        let turn = |degrees: f32| Quat::from_rotation_z(degrees.to_radians());
        let rows = |list: &[Quat]| list.iter().map(|q| q.to_array()).collect::<Vec<_>>();
        for (from, to) in [(10.0f32, 130.0f32), (0.0, 2.0), (-100.0, 60.0)] {
            // The far key negated is the same rotation.
            let keys = rows(&[turn(from), -turn(to)]);
            let line = channel(Moves::Rotation, Interpolation::Linear, &[0.0, 1.0], &keys);
            for k in 0..=8 {
                let u = k as f32 / 8.0;
                let q = Quat::from_vec4(sample(&line, f64::from(u)).unwrap());
                assert!((q.length() - 1.0).abs() < 1e-6);
                let expected = turn(from + u * (to - from));
                // The straight mix of near rotations strays by 2e-7 rad; rounding is larger.
                assert!(q.dot(expected).abs() > 1.0 - 1e-6, "{from} {to} {u}: {q}");
            }
        }
        // A spline's mix is not unit before it is made so.
        let zero = [0.0; 4];
        let keys = [zero, turn(0.0).to_array(), zero, zero, turn(90.0).to_array(), zero];
        let cubic = channel(Moves::Rotation, Interpolation::CubicSpline, &[0.0, 1.0], &keys);
        let middle = Quat::from_vec4(sample(&cubic, 0.5).unwrap());
        assert!(
            (middle.length() - 1.0).abs() < 1e-6 && middle.dot(turn(45.0)).abs() > 1.0 - 1e-6,
            "{middle}"
        );
    }

    #[test]
    fn clips_begin_again_or_stop() {
        let clip = Clip { name: "a".into(), start_s: 0.5, duration_s: 2.0, channels: Vec::new() };
        let time =
            |from_s, speed, looped, t| clip_time(&clip, &Playing { clip: 0, from_s, speed, looped }, t);
        assert_eq!(time(0.0, 1.0, true, 5.0), 1.5);
        assert_eq!(time(0.25, 2.0, true, 1.0), 0.75);
        assert_eq!(time(0.0, -1.0, true, 0.5), 2.0);
        assert_eq!((time(0.0, 1.0, false, 5.0), time(0.0, 1.0, false, -5.0)), (2.5, 0.5));
        assert_eq!((time(0.0, 1.0, true, f64::NAN), time(0.0, f64::MAX, true, 1e300)), (0.5, 0.5));
        let still = Clip { duration_s: 0.0, ..clip };
        assert_eq!(clip_time(&still, &Playing { clip: 0, from_s: 0.0, speed: 1.0, looped: true }, 3.0), 0.5);
    }

    #[test]
    fn children_follow_their_parents() {
        let node = |parent, translation| SkeletonNode {
            name: String::new(),
            parent,
            rest: Transform { translation, ..Transform::IDENTITY },
        };
        let skeleton = Skeleton {
            nodes: vec![node(None, Vec3::X), node(Some(0), Vec3::X), node(Some(1), Vec3::Y)],
            joints: Vec::new(),
            figure_from_root: Affine3A::from_translation(Vec3::Z),
        };
        let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
        let moved = channel(Moves::Rotation, Interpolation::Step, &[0.0], &[quarter.to_array()]);
        let clip = Clip { name: String::new(), start_s: 0.0, duration_s: 0.0, channels: vec![moved] };
        let (mut locals, mut nodes) = (Vec::new(), Vec::new());
        locals_at(&skeleton, Some((&clip, 0.0)), &mut locals);
        stack(&skeleton, &skeleton.figure_from_root, &locals, &mut nodes);
        let at = |k: usize| Vec3::from(nodes[k].translation);
        assert!(at(0).abs_diff_eq(Vec3::new(1.0, 0.0, 1.0), 1e-6));
        assert!(at(1).abs_diff_eq(Vec3::new(1.0, 1.0, 1.0), 1e-6));
        assert!(at(2).abs_diff_eq(Vec3::new(0.0, 1.0, 1.0), 1e-6), "{}", at(2));
        let rest = figure_from_nodes_at_rest(&skeleton);
        assert!(Vec3::from(rest[2].translation).abs_diff_eq(Vec3::new(2.0, 1.0, 1.0), 1e-6));
    }
}
