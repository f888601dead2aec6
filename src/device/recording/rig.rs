//! `halflight.Rig`: tags, ball and response. Pure.

use super::channels::Message;
use super::lens::CENTRE_PX;
use super::messages::{Colour, Time, json, own};
use crate::math::{lens::Distortion, pose::Pose};
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
    /// Left out where there is none; older recordings say null.
    #[serde(skip_serializing_if = "Option::is_none")]
    ball: Option<BallMessage>,
    #[serde(skip_serializing_if = "Option::is_none")]
    response_log_exposure: Option<Colour<Vec<f32>>>,
}

impl From<&TagPlacement> for TagMessage {
    fn from(tag: &TagPlacement) -> Self {
        Self {
            id: tag.id,
            side_m: tag.side_m,
            position_m: tag.world_from_tag.translation.to_array(),
            orientation_xyzw: tag.world_from_tag.rotation.to_array(),
        }
    }
}

impl From<MirrorBall> for BallMessage {
    fn from(ball: MirrorBall) -> Self {
        Self {
            centre_world_m: ball.centre_world.to_array(),
            radius_m: ball.radius_m,
            reflectance_rgb: ball.reflectance_rgb,
        }
    }
}

/// The rig in one line of JSON, for the notes at a recording's start. Pixels as in the calibration: the first one's centre is 0.
pub(super) fn rig_in_short(rig: &Rig) -> String {
    let lens = &rig.lens;
    let (model, coefficients) = match lens.distortion {
        Distortion::None => ("none", vec![]),
        Distortion::RadialTangential(k) => ("rational_polynomial", k.to_vec()),
        Distortion::Equidistant(k) => ("kannala_brandt", k.to_vec()),
    };
    let tags: Vec<TagMessage> = rig.tags.iter().map(TagMessage::from).collect();
    let mut all = serde_json::json!({
        "lens": {
            "width_px": lens.width, "height_px": lens.height, "fx_px": lens.fx, "fy_px": lens.fy,
            "cx_px": lens.cx - CENTRE_PX, "cy_px": lens.cy - CENTRE_PX,
            "distortion_model": model, "distortion": coefficients,
        },
        "tags": tags,
    });
    if let Some(ball) = rig.ball.map(BallMessage::from) {
        all["ball"] = serde_json::json!(ball);
    }
    all.to_string()
}

/// `halflight.Rig`: all of the rig but its lens, and the response.
pub fn write_rig(t: Timestamp, rig: &Rig, response: Option<&Response>) -> Vec<u8> {
    json(&RigMessage {
        timestamp: t.into(),
        tags: rig.tags.iter().map(TagMessage::from).collect(),
        ball: rig.ball.map(BallMessage::from),
        response_log_exposure: response
            .map(|response| response.log_exposure().each_ref().map(|table| table.to_vec()).into()),
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
        Some(tables) => {
            Some(read_response(&tables.into()).map_err(|why| format!("response_log_exposure{why}"))?)
        }
    };
    Ok((tags, ball, response))
}

fn read_response(tables: &[Vec<f32>; 3]) -> Result<Response, String> {
    let mut all = [[0.0f32; 256]; 3];
    if tables.iter().any(|t| t.len() != 256) {
        return Err(": must be three tables of 256 numbers".into());
    }
    all.iter_mut().zip(tables).for_each(|(table, given)| table.copy_from_slice(given));
    Response::checked(all).map_err(|bad| bad.to_string())
}

#[cfg(test)]
mod tests {
    use super::super::channels::Encoding;
    use super::super::schema::Topic;
    use super::*;

    fn message(content: String) -> Message {
        Message {
            topic: Topic::Rig,
            name: "/rig".into(),
            schema: "halflight.Rig".into(),
            encoding: Encoding::Json,
            encoding_name: "json".into(),
            number: 1,
            log_time: 0,
            shift_ns: 0,
            content: content.into_bytes(),
        }
    }

    /// Lists of lists and null, as recordings had them before, are the same rig.
    #[test]
    fn older_rigs_are_read() {
        let response = Response::srgb();
        let lens = crate::math::lens::Lens::pinhole(64, 48, 50.0, 50.0, 32.0, 24.0);
        let rig = Rig { lens, tags: Vec::new(), ball: None };
        let new = write_rig(Timestamp(5), &rig, Some(&response));
        let new = read_rig(&message(String::from_utf8(new).unwrap())).unwrap();
        let tables: Vec<&[f32]> = response.log_exposure().iter().map(|t| &t[..]).collect();
        let head = r#"{"timestamp":{"sec":0,"nsec":5},"tags":[],"ball":null,"response_log_exposure":"#;
        let old = format!("{head}{}}}", serde_json::to_string(&tables).unwrap());
        assert_eq!(read_rig(&message(old)).unwrap(), new);
        assert_eq!(new, (Vec::new(), None, Some(response)));
        let none = read_rig(&message(format!("{head}null}}"))).unwrap();
        assert_eq!(none, (Vec::new(), None, None));
        let short = read_rig(&message(format!("{head}[[1.0],[2.0],[3.0]]}}"))).unwrap_err();
        assert!(short.contains("three tables of 256 numbers"), "{short}");
    }
}
