//! Foxglove's messages on where things are, in protobuf as they are written: the lens, the camera's pose, and frames within frames.
//! Every number is written as it is, so that reading gives back the same bits. Pure.

use super::lens::CENTRE_PX;
use super::messages::Time;
use super::wire::WireWriter;
use crate::math::{
    lens::{Distortion, Lens},
    pose::Pose,
};
use crate::model::{rig::Rig, time::Timestamp};
use glam::{DQuat, DVec3};

/// The root of all frames: metres, z up.
pub const WORLD: &str = "world";
/// The camera: x right and y down in the picture, z forward.
pub const CAMERA: &str = "camera";

/// A `google.protobuf.Timestamp` as field 1.
pub(super) fn put_time(w: &mut WireWriter, t: Timestamp) {
    let Time { sec, nsec } = t.into();
    w.message(1, |w| {
        w.varint(1, sec as u64).varint(2, u64::from(nsec));
    });
}

fn put_place(w: &mut WireWriter, field: u32, place: DVec3) {
    w.message(field, |w| {
        w.double(1, place.x).double(2, place.y).double(3, place.z);
    });
}

fn put_turn(w: &mut WireWriter, field: u32, turn: DQuat) {
    w.message(field, |w| {
        w.double(1, turn.x).double(2, turn.y).double(3, turn.z).double(4, turn.w);
    });
}

/// A lens as `foxglove.CameraCalibration`.
pub fn write_calibration(t: Timestamp, lens: &Lens) -> Vec<u8> {
    let (fx, fy, cx, cy) = (lens.fx, lens.fy, lens.cx - CENTRE_PX, lens.cy - CENTRE_PX);
    let (model, d) = match lens.distortion {
        Distortion::None => ("plumb_bob", vec![0.0; 5]),
        Distortion::RadialTangential(k) => ("rational_polynomial", k.to_vec()),
        Distortion::Equidistant(k) => ("kannala_brandt", k.to_vec()),
    };
    let mut w = WireWriter::new();
    put_time(&mut w, t);
    w.bytes(9, CAMERA.as_bytes()).fixed32(2, lens.width).fixed32(3, lens.height);
    w.bytes(4, model.as_bytes()).doubles(5, &d);
    w.doubles(6, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    w.doubles(7, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    w.doubles(8, &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    w.finish()
}

/// The camera in the world as `foxglove.PoseInFrame`.
pub fn write_pose(t: Timestamp, world_from_camera: &Pose) -> Vec<u8> {
    let mut w = WireWriter::new();
    put_time(&mut w, t);
    w.bytes(2, WORLD.as_bytes()).message(3, |w| {
        put_place(w, 1, world_from_camera.translation);
        put_turn(w, 2, world_from_camera.rotation);
    });
    w.finish()
}

/// A frame in the world as `foxglove.FrameTransform`: where its origin is, and how it is turned.
pub fn write_transform(t: Timestamp, child: &str, world_from_child: &Pose) -> Vec<u8> {
    let mut w = WireWriter::new();
    put_time(&mut w, t);
    w.bytes(2, WORLD.as_bytes()).bytes(3, child.as_bytes());
    put_place(&mut w, 4, world_from_child.translation);
    put_turn(&mut w, 5, world_from_child.rotation);
    w.finish()
}

/// What stands still in the world: `tag_ID` of each tag, and `ball`, with its name and its place.
pub fn standing(rig: &Rig) -> Vec<(String, Pose)> {
    let tags = rig.tags.iter().map(|tag| (format!("tag_{}", tag.id), tag.world_from_tag));
    let ball = rig
        .ball
        .map(|ball| ("ball".to_owned(), Pose { rotation: DQuat::IDENTITY, translation: ball.centre_world }));
    tags.chain(ball).collect()
}
