//! A known room's light on virtual objects: all of it from the irradiance volume, and of that the frame's lights with the
//! shadows that objects throw on themselves and on one another, from the same maps (Sections 7.2 and 7.3 of [Gib03]).

use super::{frame::NearFrame, irradiance::IrradianceVolume};
use crate::visibility::point_maps;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// What a white matt surface radiates at a vertex (world frame, metres, unit normal), linear RGB: light of the frame's
/// lights as far as it arrives, and the rest of the volume's light times `openness`, the share of the hemisphere that the
/// object itself leaves open. The maps must be drawn.
///
/// A light counts as a small one in its middle: near a large one its part is too much, and is cut to what the volume has.
pub fn white_at(
    volume: &IrradianceVolume,
    frame: &NearFrame,
    point_world: Vec3,
    normal: Vec3,
    openness: f32,
) -> [f32; 3] {
    let whole = volume.white(point_world, normal);
    let (mut near, mut arrives) = ([0.0f32; 3], [0.0f32; 3]);
    for (k, (light, intensity)) in frame.lights().iter().zip(frame.intensities()).enumerate() {
        let to = light.middle_world - point_world;
        let square = to.length_squared();
        let towards = to.normalize_or_zero();
        let (cosine, ahead) = (normal.dot(towards), -light.normal_world.dot(towards));
        if !(cosine > 0.0 && ahead > 0.0 && square > 0.0) {
            continue;
        }
        let share = FRAC_1_PI * cosine * ahead / square;
        let visible = match frame.maps().get(k) {
            Some((camera, map)) => match camera.map(point_world) {
                Some(mapped) => {
                    // Vertices lie in no plane: a little before the surface nothing of it is in the way.
                    let slope = camera.slope(point_world, normal);
                    point_maps::visibility(map.depth(), camera, &frame.places()[k], mapped, slope)
                }
                None => 1.0,
            },
            None => 1.0,
        };
        for c in 0..3 {
            let e = share * intensity[c];
            near[c] += e;
            arrives[c] += e * visible;
        }
    }
    std::array::from_fn(|c| {
        // The volume knows how much there is; the lights, which part of it is theirs.
        let part = if near[c] > whole[c] { whole[c] / near[c] } else { 1.0 };
        part * arrives[c] + (whole[c] - part * near[c]).max(0.0) * openness
    })
}
