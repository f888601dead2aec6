//! `halflight.Rig`: tags, ball and response. Pure.

use super::channels::Message;
use super::messages::{Time, json, own};
use crate::math::pose::Pose;
use crate::model::limits::{MAX_BALL_M, MAX_PLACE_M, MAX_TAG_M, MIN_BALL_M, MIN_TAG_M};
use crate::model::{
    response::Response,
    rig::{MirrorBall, Rig, TagPlacement},
    time::Timestamp,
};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
struct TagMessage {
    id: u32,
    side_m: f64,
    position_m: [f64; 3],
    orientation_xyzw: [f64; 4],
}

#[derive(Serialize, Deserialize)]
struct BallMessage {
    centre_world_m: [f64; 3],
    radius_m: f64,
    reflectance_rgb: [f32; 3],
}

#[derive(Serialize, Deserialize)]
struct RigMessage {
    timestamp: Time,
    tags: Vec<TagMessage>,
    ball: Option<BallMessage>,
    response_log_exposure: Option<Vec<Vec<f32>>>,
}

/// `halflight.Rig`: all of the rig but its lens, and the response.
pub fn write_rig(t: Timestamp, rig: &Rig, response: Option<&Response>) -> Vec<u8> {
    let tags = rig.tags.iter().map(|tag| TagMessage {
        id: tag.id,
        side_m: tag.side_m,
        position_m: tag.world_from_tag.translation.to_array(),
        orientation_xyzw: tag.world_from_tag.rotation.to_array(),
    });
    json(&RigMessage {
        timestamp: t.into(),
        tags: tags.collect(),
        ball: rig.ball.map(|ball| BallMessage {
            centre_world_m: ball.centre_world.to_array(),
            radius_m: ball.radius_m,
            reflectance_rgb: ball.reflectance_rgb,
        }),
        response_log_exposure: response
            .map(|response| response.log_exposure().iter().map(|g| g.to_vec()).collect()),
    })
}

/// Tags, ball and response of a `halflight.Rig`.
pub type RigParts = (Vec<TagPlacement>, Option<MirrorBall>, Option<Response>);

/// Reads a `halflight.Rig`.
pub fn read_rig(message: &Message) -> Result<RigParts, String> {
    let m: RigMessage = own(message)?;
    let tags = m.tags.into_iter().map(|tag| {
        let rotation = DQuat::from_array(tag.orientation_xyzw);
        let is_near = tag.position_m.iter().all(|x| x.abs() <= MAX_PLACE_M);
        let good =
            (MIN_TAG_M..=MAX_TAG_M).contains(&tag.side_m) && is_near && (rotation.length() - 1.0).abs() < 1e-3;
        // The quaternion stays as written, so that a recording gives back exactly what went in.
        let world_from_tag = Pose { rotation, translation: tag.position_m.into() };
        good.then_some(TagPlacement { id: tag.id, side_m: tag.side_m, world_from_tag }).ok_or(format!(
            "tag {}: side_m {}, position_m {:?}: must be {MIN_TAG_M} to {MAX_TAG_M} m, within {MAX_PLACE_M} m, orientation_xyzw of unit length",
            tag.id, tag.side_m, tag.position_m
        ))
    });
    let tags = tags.collect::<Result<_, _>>()?;
    let ball = m.ball.map(|ball| MirrorBall {
        surface_radius_m: None,
        centre_world: ball.centre_world_m.into(),
        radius_m: ball.radius_m,
        reflectance_rgb: ball.reflectance_rgb,
    });
    let is_ball = |b: &MirrorBall| {
        (MIN_BALL_M..=MAX_BALL_M).contains(&b.radius_m)
            && b.centre_world.abs().cmple(DVec3::splat(MAX_PLACE_M)).all()
            && b.reflectance_rgb.iter().all(|r| *r > 0.0 && *r <= 1.0)
    };
    if let Some(ball) = ball.filter(|b| !is_ball(b)) {
        return Err(format!(
            "ball: radius_m {}, centre_world_m {}, reflectance_rgb {:?}: must be {MIN_BALL_M} to {MAX_BALL_M} m, within {MAX_PLACE_M} m, and above 0 to 1",
            ball.radius_m, ball.centre_world, ball.reflectance_rgb
        ));
    }
    let response = match m.response_log_exposure {
        None => None,
        Some(tables) => Some(read_response(&tables).map_err(|why| format!("response_log_exposure{why}"))?),
    };
    Ok((tags, ball, response))
}

fn read_response(tables: &[Vec<f32>]) -> Result<Response, String> {
    let mut all = [[0.0f32; 256]; 3];
    let is_whole = tables.len() == 3 && tables.iter().all(|t| t.len() == 256);
    if !is_whole {
        return Err(": must be three tables of 256 numbers".into());
    }
    all.iter_mut().zip(tables).for_each(|(table, given)| table.copy_from_slice(given));
    Response::checked(all).map_err(|bad| bad.to_string())
}
