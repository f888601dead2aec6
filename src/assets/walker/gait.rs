//! The walker's movements. Feet are led along the ground, and the legs follow by two-bone inverse kinematics.
//!
//! Turns about +x: positive ones swing a hanging limb back (+y) and a foot's toes down.

use super::{BONES, Bone, WALK_CYCLE_S, WALK_STRIDE_M, y_up, y_up_turn};
use crate::model::animation::{AnimationChannel, Clip, Interpolation, Moves};
use glam::{DQuat, DVec3, Vec4};
use std::f64::consts::{PI, TAU};

/// Keys of a cycle of "Walk", and of "Idle".
const WALK_KEYS: usize = 32;
const IDLE_KEYS: usize = 16;
const IDLE_S: f64 = 3.2;
/// Share of the cycle in which a foot is on the ground.
const STANCE: f64 = 0.6;
/// How much lower than at rest the hips are carried.
const CROUCH_M: f64 = 0.0078;
/// The heel's edge, from the ankle at rest.
const HEEL: DVec3 = DVec3::new(0.0, 0.0095, -0.013);

/// A pose: every bone's turn, and the hips' shift from rest.
struct BonePose {
    turns: [DQuat; BONES.len()],
    hips_shift: DVec3,
}

impl BonePose {
    fn turn(&mut self, bone: Bone, turn: DQuat) {
        self.turns[bone as usize] = turn;
    }

    /// Puts an ankle at a place with the foot pitched about x; the toes are turned against the foot by `toe`.
    fn leg(&mut self, [thigh, shin, foot, toe_bone]: [Bone; 4], ankle: DVec3, pitch: f64, toe: f64) {
        let hips_turn = self.turns[Bone::Hips as usize];
        let hip = Bone::Hips.place() + self.hips_shift + hips_turn * (thigh.place() - Bone::Hips.place());
        let upper = thigh.place().distance(shin.place());
        let lower = shin.place().distance(foot.place());
        let to = ankle - hip;
        // First aside about y, then forward and bent about x.
        let down = to.x.hypot(to.z);
        let aside = DQuat::from_rotation_y((-to.x / down).asin());
        let reach = to.length().min((upper + lower) * 0.9995);
        let at_hip = ((upper * upper + reach * reach - lower * lower) / (2.0 * upper * reach)).acos();
        let bend = PI - ((upper * upper + lower * lower - reach * reach) / (2.0 * upper * lower)).acos();
        let forward = to.y.atan2(down) - at_hip;
        self.turn(thigh, hips_turn.inverse() * aside * DQuat::from_rotation_x(forward));
        self.turn(shin, DQuat::from_rotation_x(bend));
        let shin_turn = aside * DQuat::from_rotation_x(forward + bend);
        self.turn(foot, shin_turn.inverse() * DQuat::from_rotation_x(pitch));
        self.turn(toe_bone, DQuat::from_rotation_x(toe));
    }
}

const LEFT_LEG: [Bone; 4] = [Bone::ThighL, Bone::ShinL, Bone::FootL, Bone::ToeL];
const RIGHT_LEG: [Bone; 4] = [Bone::ThighR, Bone::ShinR, Bone::FootR, Bone::ToeR];

fn smooth(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A foot on the ground at a phase within 0..=STANCE: its ankle (y and z as seen from the figure) and pitch.
fn stance(ankle: DVec3, toe: DVec3, phase: f64) -> (DVec3, f64) {
    let gone = DVec3::Y * WALK_STRIDE_M * (phase - STANCE / 2.0);
    let pitch = -0.26 * (1.0 - smooth(0.0, 0.11, phase)) + 0.75 * smooth(0.36, STANCE + 0.06, phase);
    let turn = DQuat::from_rotation_x(pitch);
    // Rolls over the heel's edge, then over the ball of the foot.
    let pivot = if pitch < 0.0 { ankle + HEEL } else { toe };
    (pivot + turn * (ankle - pivot) + gone, pitch)
}

/// A foot at any phase: ankle, pitch, and the toes' turn.
fn foot([_, _, foot, toe]: [Bone; 4], phase: f64) -> (DVec3, f64, f64) {
    let phase = phase.rem_euclid(1.0);
    let (ankle, toe) = (foot.place(), toe.place());
    if phase <= STANCE {
        let (place, pitch) = stance(ankle, toe, phase);
        return (place, pitch, -pitch.max(0.0));
    }
    let t = (phase - STANCE) / (1.0 - STANCE);
    let ((from, pitch0), (to, pitch1)) = (stance(ankle, toe, STANCE), stance(ankle, toe, 0.0));
    // Leaves and meets the ground with the ground's speed.
    let slope = DVec3::Y * WALK_STRIDE_M * (1.0 - STANCE);
    let (t2, t3) = (t * t, t * t * t);
    let mut place = from * (2.0 * t3 - 3.0 * t2 + 1.0)
        + to * (3.0 * t2 - 2.0 * t3)
        + slope * (t3 - 2.0 * t2 + t)
        + slope * (t3 - t2);
    place.z += 0.009 * (PI * t).sin().powi(2);
    let pitch = pitch0 + (pitch1 - pitch0) * smooth(0.05, 0.9, t);
    (place, pitch, -pitch0.max(0.0) * (1.0 - smooth(0.0, 0.5, t)))
}

fn walk_pose(phase: f64) -> BonePose {
    let mut pose = BonePose { turns: [DQuat::IDENTITY; BONES.len()], hips_shift: DVec3::ZERO };
    let wave = |shift: f64| (TAU * (phase - shift)).cos();
    // Highest and farthest to its side in the middle of a foot's stance.
    let bob = (2.0 * TAU * (phase - STANCE / 2.0)).cos();
    pose.hips_shift = DVec3::new(0.0025 * wave(STANCE / 2.0), 0.0, -CROUCH_M + 0.0012 * bob);
    // The left hip goes ahead with the left foot (phase 0), and sinks while that foot swings.
    let (twist, roll) = (-0.10 * wave(0.0), -0.045 * wave(STANCE / 2.0));
    pose.turn(Bone::Hips, DQuat::from_rotation_z(twist) * DQuat::from_rotation_y(roll));
    pose.turn(
        Bone::Spine,
        DQuat::from_rotation_z(-0.9 * twist)
            * DQuat::from_rotation_y(-0.7 * roll)
            * DQuat::from_rotation_x(0.035),
    );
    pose.turn(Bone::Chest, DQuat::from_rotation_z(-1.1 * twist) * DQuat::from_rotation_y(-0.5 * roll));
    pose.turn(Bone::Neck, DQuat::from_rotation_z(0.5 * twist));
    pose.turn(Bone::Head, DQuat::from_rotation_z(0.5 * twist) * DQuat::from_rotation_x(-0.03 + 0.02 * bob));
    // An arm swings against its leg.
    for (side, bones) in [
        (1.0, [Bone::UpperArmL, Bone::ForearmL, Bone::HandL]),
        (-1.0, [Bone::UpperArmR, Bone::ForearmR, Bone::HandR]),
    ] {
        let swing = side * wave(0.03);
        pose.turn(
            bones[0],
            DQuat::from_rotation_x(0.42 * swing + 0.05) * DQuat::from_rotation_y(side * 0.12),
        );
        pose.turn(bones[1], DQuat::from_rotation_x(-0.42 + 0.2 * swing));
        pose.turn(bones[2], DQuat::from_rotation_x(-0.1 + 0.1 * swing));
    }
    for (bones, phase) in [(LEFT_LEG, phase), (RIGHT_LEG, phase + 0.5)] {
        let (ankle, pitch, toe) = foot(bones, phase);
        pose.leg(bones, ankle, pitch, toe);
    }
    pose
}

fn idle_pose(phase: f64) -> BonePose {
    let mut pose = BonePose { turns: [DQuat::IDENTITY; BONES.len()], hips_shift: DVec3::ZERO };
    let (wave, twice) = ((TAU * phase).sin(), (2.0 * TAU * phase).sin());
    pose.hips_shift = DVec3::new(0.0012 * wave, 0.0, -0.0016 + 0.0004 * twice);
    pose.turn(Bone::Spine, DQuat::from_rotation_y(-0.02 * wave) * DQuat::from_rotation_x(0.012 * twice));
    pose.turn(Bone::Chest, DQuat::from_rotation_x(-0.022 * twice));
    pose.turn(Bone::Head, DQuat::from_rotation_z(0.22 * wave) * DQuat::from_rotation_x(0.03 * twice));
    for (side, bones) in [(1.0, [Bone::UpperArmL, Bone::ForearmL]), (-1.0, [Bone::UpperArmR, Bone::ForearmR])]
    {
        pose.turn(bones[0], DQuat::from_rotation_y(side * (0.10 + 0.012 * twice)));
        pose.turn(bones[1], DQuat::from_rotation_x(-0.18 + 0.02 * twice));
    }
    for bones in [LEFT_LEG, RIGHT_LEG] {
        pose.leg(bones, bones[2].place(), 0.0, 0.0);
    }
    pose
}

/// A pair of steps, ending as it began.
pub fn walk() -> Clip {
    clip("Walk", WALK_CYCLE_S, WALK_KEYS, walk_pose)
}

/// Standing, breathing, looking round.
pub fn idle() -> Clip {
    clip("Idle", IDLE_S, IDLE_KEYS, idle_pose)
}

fn clip(name: &str, duration_s: f64, keys: usize, pose: fn(f64) -> BonePose) -> Clip {
    // The last key is the first pose again, bit for bit.
    let poses: Vec<BonePose> = (0..=keys).map(|k| pose((k % keys) as f64 / keys as f64)).collect();
    let times_s: Vec<f32> = (0..=keys).map(|k| (duration_s * k as f64 / keys as f64) as f32).collect();
    let channel = |node: usize, moves, values: Vec<Vec4>| AnimationChannel {
        node: node as u32,
        moves,
        interpolation: Interpolation::Linear,
        times_s: times_s.clone(),
        values,
    };
    let shifted = |pose: &BonePose| y_up(Bone::Hips.place() + pose.hips_shift).extend(0.0);
    let mut channels =
        vec![channel(Bone::Hips as usize, Moves::Translation, poses.iter().map(shifted).collect())];
    for bone in 0..BONES.len() {
        if poses.iter().any(|pose| pose.turns[bone] != DQuat::IDENTITY) {
            let values = poses.iter().map(|pose| y_up_turn(pose.turns[bone]).into()).collect();
            channels.push(channel(bone, Moves::Rotation, values));
        }
    }
    Clip { name: name.into(), start_s: 0.0, duration_s: duration_s as f32, channels }
}
